"""Records of tests: CSV files of channels, read, checked, cut and converted.

`mrdamp.records.conversion` turns a rig's own tables into records; `csv_file` parses and writes them.
"""

from __future__ import annotations

from mrdamp.files import SUFFIXES
from mrdamp.records.record import Record, RecordSet, embedded, read_record, read_records, record_files

__all__ = ["SUFFIXES", "Record", "RecordSet", "embedded", "read_record", "read_records", "record_files"]
