"""Pictures of records, fits and controlled frames: functions that return a matplotlib Figure."""

from mrdamp.pictures.damper import LoopData, error_bars, histories, loops
from mrdamp.pictures.structure import command_history, controllers, drifts, profile

__all__ = [
    "LoopData",
    "command_history",
    "controllers",
    "drifts",
    "error_bars",
    "histories",
    "loops",
    "profile",
]
