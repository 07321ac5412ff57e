"""A real frame's own closed-loop records, as a case for the diagnosis."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp.control.base import Controller
from mrdamp.files import write_atomic
from mrdamp.model import Model
from mrdamp.motions import GroundMotion
from mrdamp.records.csv_file import render
from studies.gap.real import LOG_HZ, RealFrame, record


def write_case(
    real: RealFrame,
    controller: Controller,
    motions: Sequence[GroundMotion],
    folder: Path,
    seed: int,
    before: RealFrame | None = None,
) -> None:
    """A case folder: the controlled frame in the motions, in the first half as strong, in the second again.

    before: the real frame in the state in which its simulator was made; its records in the motions are the baseline.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([seed, 3])
    played = [*motions, motions[0].scaled(0.5), motions[1]]
    names = [*(f"{k}_closed_loop.csv" for k in range(1, len(played))), f"{len(played)}_repeat.csv"]
    for name, motion in zip(names, played, strict=True):
        channels = record(real.run(motion, controller)[1], rng)
        write_atomic(folder / name, render(channels))
    baseline = []
    if before is not None:
        noise = np.random.default_rng([seed, 4])
        baseline = [f"baseline_{k}.csv" for k in range(1, len(motions) + 1)]
        for name, motion in zip(baseline, motions, strict=True):
            write_atomic(folder / name, render(record(before.run(motion, controller)[1], noise)))
    data = {
        "name": real.cause,
        "format": 1,
        "rig": "frame",
        "sample_rate_hz": LOG_HZ,
        "nominal": _nominal_form(real.nominal),
        "channels": list(channels),
        "records": names,
        **({"baseline": baseline} if baseline else {}),
    }
    write_atomic(folder / "case.json", json.dumps(data, indent=1) + "\n")


def _nominal_form(nominal: Model) -> dict[str, Any]:
    s = nominal.structure
    assert s is not None
    assert s.damper_between is not None
    return {
        "law": nominal.law,
        "parameters": dict(nominal.parameters),
        "structure": {
            "mass_kg": s.mass.tolist(),
            "stiffness_n_m": s.stiffness.tolist(),
            "damping_n_s_m": s.damping.tolist(),
        },
        "damper_between": list(s.damper_between),
    }
