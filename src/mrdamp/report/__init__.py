"""The pages that the commands write: one self-contained HTML file each (`page`)."""

from __future__ import annotations

from mrdamp.report.page import Cell, Page

__all__ = ["Cell", "Page"]
