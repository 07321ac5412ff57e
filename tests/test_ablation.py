"""The ablation tool: every rule can be left out and is back afterwards; its table counts what it says."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from modules import TOOLS, loaded
from mrdamp.diagnosis import frame_run, run
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.damper_run import judge
from mrdamp.diagnosis.evidence import established, judgement, penalties, verdict
from mrdamp.diagnosis.fits import record_costs
from mrdamp.diagnosis.fits.final import final_fit
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.problem.noise import Noise
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.searched import Searched
from mrdamp.model import Model
from toy_rig import toy


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    return loaded(TOOLS / "ablation.py")


def found() -> Searched:
    """A search that nothing comes near the noise of: half of the gap is outside the toy's catalogue."""
    search = Search(Problem(toy({"outside": 1.1, "cubic": 0.5}, 0.02)), 1e-5)
    search.run()
    model = Model("bingham", {"c0a": 1.0, "c0b": 0.0, "fya": 1.0, "fyb": 0.0, "v_ref": 0.1})
    one, none = np.ones(1), np.zeros(1)
    return Searched(
        Case("toy", Path(), model, search.problem.rig.records, ()),
        search.problem.rig,
        search,
        Noise(one, "repeat", one),
        one,
        none,
        [],
        lambda: judge(search),
        lambda answer, chosen: answer,
    )


def test_every_rule_is_left_out_and_back_again(tool: ModuleType) -> None:
    one = found()
    before = json.dumps(tool._judged(one))
    for rule in tool.RULES.values():
        with rule(one):
            tool._judged(one)
    assert json.dumps(tool._judged(one)) == before
    assert one.search.inexact
    with tool.RULES["separate evidence for a wrong law (`INEXACT`)"](one):
        assert not one.search.inexact
        assert one.judge()[1].standing is None
    before = verdict.LAW_PENALTY, established.LOGIT_LAW
    with tool.RULES["penalty of free nominal parameters (`LAW_PENALTY`, `LOGIT_LAW`)"](one):
        assert (verdict.LAW_PENALTY, established.LOGIT_LAW) == (0.0, 0.0)
    assert before == (verdict.LAW_PENALTY, established.LOGIT_LAW)
    with tool.RULES["penalty of a cause that equals another one (`NOT_ITSELF`)"](one):
        assert penalties.NOT_ITSELF == 0.0
    with tool.RULES["a cause that harms a regime (`REGIME_WORSE`)"](one):
        assert math.inf == judgement.REGIME_WORSE
    with tool.RULES["another law beside a cause of a law's form (`LAW_FORMS`)"](one):
        assert not frame_run.LAW_FORMS
    fits = one.search.ranked(False)
    (f, *_) = (f for f in fits if f.hypothesis.coordinates)
    halves = judgement.left_out_costs(one.search, fits)[id(f)]
    with tool.RULES["halves of records left out, not whole ones"](one):
        whole = judgement.left_out_costs(one.search, fits)[id(f)]
    with tool.RULES["left-out records, with a wrong law"](one):
        own = judgement.left_out_costs(one.search, fits)[id(f)]
    assert own < min(halves, whole)
    assert halves != whole
    with tool.RULES["an error variance of each record (`RECORD_VARIANCE`)"](one):
        assert record_costs.own_cost(one.search, f) == pytest.approx(f.cost)
    assert record_costs.own_cost(one.search, f) != pytest.approx(f.cost)


def test_checks_after_the_final_fit_are_left_out_as_well(tool: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    one = found()
    assert tool._judged(one)["verdict"] == "effect"
    worse = replace(run.concluded(one)[2], heldout=np.full(1, 1e3))
    monkeypatch.setattr(run, "final_fit", lambda *args, **kwargs: worse)
    assert tool._judged(one)["verdict"] == "unknown"
    with tool.RULES["an answer that is worse than nominal on left-out records"](one):
        assert tool._judged(one)["verdict"] == "effect"


def test_a_final_fit_is_made_once_for_every_rule(tool: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    one, made = found(), []

    def final(*args: Any, **kwargs: Any) -> Any:
        made.append(kwargs["mend"])
        return final_fit(*args, **kwargs)

    monkeypatch.setattr(run, "final_fit", final)
    with tool._once(run, "final_fit"):
        tool._judged(one)
        tool._judged(one)
        assert len(made) == 1
        with tool.RULES["separate evidence for a wrong law (`INEXACT`)"](one):
            tool._judged(one)
        assert len(made) == 2
    assert vars(run)["final_fit"] is final


def test_the_table_counts_right_named_and_invented(tool: ModuleType, tmp_path: Path) -> None:
    lag = [{"name": "driver_lag", "place": None, "probability": 0.9}]
    wrong = [{"name": "heating", "place": None, "probability": 0.9}]

    def answer(effects: list[dict[str, Any]]) -> dict[str, Any]:
        return {"verdict": "effect" if effects else "unknown", "effects": effects}

    rows = {"a": (answer(lag), answer(wrong)), "b": (answer([]), answer(lag))}
    (tmp_path / "out" / "bench").mkdir(parents=True)
    for case, (every, without) in rows.items():
        text = json.dumps({"nothing": every, "a rule": without})
        (tmp_path / "out" / "bench" / f"{case}.json").write_text(text)
    labels = tmp_path / "labels.json"
    labels.write_text(
        json.dumps({"a": {"label": "driver_lag"}, "b": {"label": "~own", "also": ["remanence"]}})
    )
    scored = tool.rows(tmp_path / "out", {"bench": (tmp_path, labels)})
    lines = tool.table(scored, ["bench"]).splitlines()
    assert lines[0] == "| removed rule | bench (2) | causes named (1) | cases with an invented cause (2) |"
    assert lines[2:] == ["| nothing | 2 | 1 | 0 |", "| a rule | 0 | 0 | 2 |"]


def test_a_bench_without_labels_is_one_line(
    tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "sys.argv", ["ablation.py", str(tmp_path / "out"), "--bench", f"x={tmp_path},no.json"]
    )
    assert tool.main() == 2
    assert "LABELS.json is needed" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
