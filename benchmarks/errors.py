"""The accuracy table: force errors at the measured settings."""

from __future__ import annotations

from benchmarks import accuracy
from benchmarks.frames import DYKE
from benchmarks.result import Figure, Section


def measure(end: float = 3.0) -> list[Section]:
    """Errors in percent of the RMS force, over `end` seconds."""
    rows = []
    for dt in (5e-4, 1e-3, 2e-3):
        rows.append(Figure(f"law alone, {dt * 1e3:g} ms", 100.0 * accuracy.law_error(dt, end), "%", "<= 1"))
    for dt in (5e-4, 1e-3):
        rows.append(
            Figure(f"frame stepped by MuJoCo, {dt * 1e3:g} ms", 100.0 * accuracy.frame_error(dt, end), "%")
        )
    return [
        Section(
            "Accuracy at these speeds",
            f"RMS error of the damper's force over its RMS, against SciPy (LSODA, rtol 1e-9). {DYKE.id} in the frame: "
            "40 sines from 1 to 10 Hz with a peak near 3.4 m/s2, commands over the whole range.",
            tuple(rows),
        )
    ]
