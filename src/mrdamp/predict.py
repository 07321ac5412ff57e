"""A model's free run over a record's inputs, as a file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from mrdamp.between import between, mended_ends
from mrdamp.core import Array
from mrdamp.files import write_atomic
from mrdamp.model import Model
from mrdamp.record_csv import render
from mrdamp.records import read_record

#: s, the longest step between the samples of a damper's record, whose motion runs along a spline there.
_STEP = 5e-4
#: The inputs of each rig: what `predict` reads of a record, and all that it sees of it.
INPUTS = {
    "damper": ("time_s", "displacement_m", "command"),
    "frame": ("time_s", "ground_acceleration_m_s2", "command"),
}


def predict(model: Model, record: Path | str) -> dict[str, Array]:
    """`time_s` and the simulated channels, (n,) each, for the inputs of a record file. Raises InputError."""
    names = INPUTS[model.rig]
    read = read_record(record, required=names)
    inputs = {name: np.asarray(read.channel(name)) for name in names}
    factor = max(1, math.ceil(read.sample_time / _STEP - 1e-9))
    if model.rig == "frame" or model.law == "narx" or factor == 1:
        return {"time_s": np.asarray(read.time), **model.simulate(read.sample_time, inputs)}
    x = mended_ends(inputs["displacement_m"])
    fine = between(x, inputs["command"], read.sample_time, factor)
    moved = {"displacement_m": fine.x, "velocity_m_s": fine.v, "acceleration_m_s2": fine.a, "command": fine.u}
    simulated = model.simulate(fine.sample_time, moved)
    return {"time_s": np.asarray(read.time), **{name: y[::factor] for name, y in simulated.items()}}


def write_prediction(model: Model, record: Path | str, path: Path | str) -> dict[str, Array]:
    """Predicts and writes the CSV in one go; returns its columns."""
    columns = predict(model, record)
    write_atomic(Path(path), render(columns))
    return columns
