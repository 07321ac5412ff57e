"""Former name of `mrdamp.records.csv_file`, for tests of `mrdamp.diagnosis`."""

from mrdamp.records.csv_file import numbers, parse, render

__all__ = ["numbers", "parse", "render"]
