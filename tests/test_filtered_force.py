"""A force that jumps, in a log with a filter: against NumPy at 20 kHz, its channels through a converter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.report.handover import agreement
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.log_filter import FILTERED, LOGGER, unfolded
from mrdamp.simulation.predict import free_run
from test_logged import DT, EVERY, RATE, decimated, fine_steps

#: Friction that turns within a sample or two.
LAW = {"c0a": 800.0, "c0b": 600.0, "fya": 80.0, "fyb": 600.0, "v_ref": 0.004}


def triangle(hz: float, amplitude: float) -> Array:
    """A displacement whose corners take some milliseconds, at EVERY times the log's rate."""
    t = np.arange(len(fine_steps())) / (RATE * EVERY)
    return np.asarray(gaussian_filter1d(amplitude * 2 / np.pi * np.arcsin(np.sin(2 * np.pi * hz * t)), 60))


def force(x: Array, u: Array) -> Array:
    v = np.gradient(x, 1 / (RATE * EVERY))
    return np.asarray(
        (LAW["c0a"] + LAW["c0b"] * u) * v + (LAW["fya"] + LAW["fyb"] * u) * np.tanh(v / LAW["v_ref"])
    )


def records(*, filtered: bool) -> tuple[Record, Record]:
    """A command that jumps, and one that stays."""
    out = []
    for name, u, hz in (("steps", fine_steps(), 1.2), ("held", np.ones(len(fine_steps())), 0.9)):
        x = triangle(hz, 0.012)
        log = decimated if filtered else lambda y: np.asarray(y[::EVERY])
        channels = {"displacement_m": log(x), "command": log(u), "force_N": log(force(x, u))}
        out.append(Record(name, None, DT, channels))
    return out[0], out[1]


def errors(rig: DamperRig) -> list[float]:
    out = []
    for k, r in enumerate(rig.records):
        got, want = rig.simulate([{}], k)[0, 0], r.channel("force_N")
        keep = slice(60, -60)
        out.append(float(np.sqrt(np.mean((got - want)[keep] ** 2) / np.mean(want[keep] ** 2))))
    return out


def test_what_is_simulated_goes_through_the_logs_filter() -> None:
    rig = DamperRig(Model("bingham", LAW), records(filtered=True))
    assert rig.filtered
    through = errors(rig)
    assert max(through) < 0.012
    alone = replace(rig)
    alone.__dict__["filtered"] = False
    assert min(a / t for a, t in zip(errors(alone), through, strict=True)) > 2


def test_a_log_without_a_filter_is_taken_as_it_is() -> None:
    rig = DamperRig(Model("bingham", LAW), records(filtered=False))
    assert not rig.filtered
    assert max(errors(rig)) < 0.012
    assert LOGGER not in rig.model({}).extra


def test_a_model_tells_of_the_filter_where_a_records_own_command_cannot(tmp_path: Path) -> None:
    rig = DamperRig(Model("bingham", LAW), records(filtered=True))
    rig.model({}).write(tmp_path / "model.json")
    model = Model.read(tmp_path / "model.json")
    assert model.extra[LOGGER] == FILTERED
    for k, record in enumerate(rig.records):
        got = free_run(model, record)["force_N"]
        want = rig.simulate([{}], k)[0, 0]
        assert np.allclose(got, want, rtol=0, atol=1e-3 * np.abs(want).max())
    held = rig.records[1]
    untold = free_run(replace(model, extra={}), held)["force_N"]
    assert np.abs(untold - free_run(model, held)["force_N"]).max() > 0.02 * np.abs(untold).max()
    assert agreement(model, held).within


def test_a_filtered_log_has_what_was_between_its_samples() -> None:
    x = triangle(1.2, 0.012)
    got = unfolded(decimated(x), 4)
    assert len(got) == 4 * (len(decimated(x)) - 1) + 1
    off = np.abs(got - x[:: EVERY // 4][: len(got)])[240:-240]
    assert off.max() < 2e-3 * 0.012
