"""The bench of each structure by name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from mrdamp.compare.bench import Bench
from mrdamp.compare.cable import CableBench
from mrdamp.compare.car import CarBench
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import FrameBench
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.structures import dyke1996

#: Name, or id of the environment with or without its namespace -> structure.
STRUCTURES = {
    name: kind
    for kind, identity in (("frame", "Frame-v0"), ("cable", "Cable-v0"), ("car", "QuarterCar-v0"))
    for name in (kind, identity, f"mrdamp/{identity}")
}


def bench_of(
    structure: str,
    model: Model | Path | str | None = None,
    *,
    command_unit: str | None = None,
    period: float | None = None,
    engine: str = "mujoco",
    compression: float = 5.0,
) -> Bench:
    """The bench of a structure. Raises InputError.

    model: of the damper, or its file; None: the published one. command_unit: A or V; None: V for the published model,
    else A. period: s; None: 1 ms of the frame, else 5 ms. compression: of the frame's time.
    """
    if structure not in STRUCTURES:
        raise InputError(f"environment {structure!r} is unknown; there are {', '.join(STRUCTURES)}")
    kind = STRUCTURES[structure]
    unit = command_unit or ("V" if model is None else "A")
    read = model if model is None or isinstance(model, Model) else Model.read(model)
    if kind == "frame":
        read = frame_model() if read is None else read
        if read.rig == "damper":
            read = replace(read, rig="frame", structure=dyke1996())
        return FrameBench(read, unit, compression, 1e-3 if period is None else period, engine=engine)
    made: Any = CableBench if kind == "cable" else CarBench
    given = {} if read is None else {"model": read}
    bench: Bench = made(**given, command_unit=unit, period=5e-3 if period is None else period, engine=engine)
    return bench
