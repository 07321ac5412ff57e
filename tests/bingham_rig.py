"""A Bingham damper written out in NumPy, and small cases of it: truth for diagnoses."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records.csv_file import render

LAW = {"c0a": 700.0, "c0b": 800.0, "fya": 70.0, "fyb": 620.0, "v_ref": 0.03}


def model() -> Model:
    return Model("bingham", LAW)


def force(v: Array, u: Array, **changed: float) -> Array:
    """N, as the law's equation has it: dry friction of the field and a dashpot."""
    p = LAW | changed
    return np.asarray((p["fya"] + p["fyb"] * u) * np.tanh(v / p["v_ref"]) + (p["c0a"] + p["c0b"] * u) * v)


def write_case(folder: Path, tests: Mapping[str, Mapping[str, Array]], **changes: Any) -> Path:
    folder.mkdir()
    for name, channels in tests.items():
        (folder / f"{name}.csv").write_text(render(channels))
    channels = next(iter(tests.values()))
    rate = 1 / float(channels["time_s"][1] - channels["time_s"][0])
    case = {
        "name": "small", "format": 1, "rig": "damper", "sample_rate_hz": round(rate, 6),
        "nominal": {"law": "bingham", "parameters": LAW}, "channels": list(channels),
        "records": [f"{name}.csv" for name in tests],
    }  # fmt: skip
    (folder / "case.json").write_text(json.dumps(case | changes))
    return folder
