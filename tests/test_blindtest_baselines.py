"""Simpler methods on cases whose answer is plain."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mrdamp.diagnosis.case.folder import Case
from mrdamp.model import Model
from mrdamp.records import Record
from studies.blindtest import baselines, causes, damper_case, run, sparse
from studies.blindtest.rig import Array
from studies.blindtest.sizing import Task

BINGHAM = Model("bingham", {"c0a": 600.0, "c0b": 500.0, "fya": 60.0, "fyb": 500.0, "v_ref": 0.02})


def case(added: dict[str, float]) -> Case:
    """Three records of a damper whose force has parts of the library besides the model's."""
    rng = np.random.default_rng(0)
    t = np.arange(2000) * 0.002
    records = []
    for k in range(3):
        x = 0.008 * np.sin(2 * np.pi * (1.1 + 0.6 * k) * t + k)
        u = 0.5 + 0.4 * np.sin(2 * np.pi * (0.3 + 0.2 * k) * t)
        inputs = {"displacement_m": x, "command": u}
        force = BINGHAM.simulate(0.002, inputs)["force_N"]
        table = sparse.library(inputs, force, 0.002)
        total = force + sum(c * table[name] for name, c in added.items()) + rng.normal(0.0, 2.0, len(t))
        records.append(Record(f"r{k}", None, 0.002, {**inputs, "force_N": total}))
    return Case("x", Path("x"), BINGHAM, tuple(records), ())


@pytest.mark.skipif(not sparse.available(), reason="needs pysindy (extra bench)")
@pytest.mark.parametrize(
    ("added", "effect"),
    [
        ({"sign v": 60.0}, "seal_friction"),
        ({"1": -40.0}, "sensor_offset"),
        ({"|F|": 0.2}, "asymmetry"),
        ({}, ""),
    ],
)
def test_sparse_regression_names_the_part_that_was_added(added: dict[str, float], effect: str) -> None:
    made = case(added)
    found = sparse.regress(made)
    assert found.effect == effect
    record = made.records[1]
    inputs = {name: record.channel(name) for name in ("time_s", "displacement_m", "command")}
    error: Array = found.predict(inputs)["force_N"] - record.channel("force_N")
    assert np.std(error[50:]) < 4.0


@pytest.mark.slow
def test_methods_on_an_asymmetric_damper(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stage, forms = causes.EFFECTS["asymmetry"]
    monkeypatch.setitem(causes.EFFECTS, "asymmetry", (stage, forms[:1] * 2))  # by the velocity's sign alone
    out = run.Folders(tmp_path)
    task = Task("case_001", "damper", "asymmetry")
    seed = np.random.SeedSequence(8)
    label = damper_case.make(task, out.cases / task.name, out.tests / f"{task.name}.npz", seed)
    (tmp_path / "labels.json").write_text(json.dumps({task.name: label}))
    rows = {name: found[0] for name, found in baselines.run_all(out, 1, lambda what, share: None).items()}
    assert rows["nominal only"].after == pytest.approx(rows["nominal only"].before, rel=0.02)
    assert abs(rows["recalibration only"].shrink) < 0.1  # no number of the law is asymmetric
    assert rows["greedy, by error on the records"].right
    assert rows["greedy, by error on the records"].shrink > 0.7
