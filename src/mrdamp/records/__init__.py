"""Records of tests: CSV files of channels, read, checked, cut and converted.

`mrdamp.records.conversion` turns a rig's own tables into records; `csv_file` parses and writes them.
"""

from __future__ import annotations

from mrdamp.records.record import SUFFIXES, Record, RecordSet, embedded, read_record, read_records

__all__ = ["SUFFIXES", "Record", "RecordSet", "embedded", "read_record", "read_records"]
