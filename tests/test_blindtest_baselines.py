"""Simpler methods on a case whose answer is plain."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from studies.blindtest import baselines, causes, damper_case, run
from studies.blindtest.sizing import Task


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
