"""A model's free run over a record's inputs, as a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mrdamp.core import Array
from mrdamp.files import write_atomic
from mrdamp.model import Model
from mrdamp.record_csv import render
from mrdamp.records import read_record

#: The inputs of each rig: what `predict` reads of a record, and all that it sees of it.
INPUTS = {
    "damper": ("time_s", "displacement_m", "command"),
    "frame": ("time_s", "ground_acceleration_m_s2", "command"),
}


def predict(model: Model, record: Path | str) -> dict[str, Array]:
    """`time_s` and the simulated channels, (n,) each, for the inputs of a record file. Raises InputError."""
    names = INPUTS[model.rig]
    read = read_record(record, required=names)
    inputs = {name: read.channel(name) for name in names}
    simulated = model.simulate(read.sample_time, inputs)
    return {"time_s": np.asarray(read.time), **simulated}


def write_prediction(model: Model, record: Path | str, path: Path | str) -> dict[str, Array]:
    """Predicts and writes the CSV in one go; returns its columns."""
    columns = predict(model, record)
    write_atomic(Path(path), render(columns))
    return columns
