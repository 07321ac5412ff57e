"""The study of what a forecast is worth: its runs, table and picture, and what it refuses."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from modules import TOOLS, loaded
from mrdamp.compare import Comparison, Contender, FrameBench
from mrdamp.compare import dyke1996 as preset
from mrdamp.compare.bench import UNCONTROLLED, Measure
from mrdamp.compare.preview import Known, Plans, receding, row_name
from mrdamp.motions import kanai_tajimi


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    return loaded(TOOLS / "preview_study.py")


def made(known: dict[float, float]) -> Comparison:
    """Passive-on at 1, the bounds at .5; J1 and J2 of the plans are the given ones, on two motions."""
    rows = {"passive-on": 1.0, "learned": 0.9, **{row_name(s): v for s, v in known.items()}}
    bounds = {
        "clairvoyant": {"J1": 0.5, "J2": 0.5},
        "clairvoyant-drift": {"J1": 1.0},
        "clairvoyant-acceleration": {"J2": 1.0},
    }
    rows |= dict.fromkeys(bounds, 0.5)
    values = {
        name: {key: np.full((1, 2, 1), v) for key in ("J1", "J2", "mean_command")} for name, v in rows.items()
    }
    contenders = tuple(Contender(name, (name,), bound=name not in ("passive-on", "learned")) for name in rows)
    measures = tuple(Measure(key, key) for key in ("J1", "J2", "mean_command"))
    return Comparison(contenders, measures, ("a", "b"), (1.0,), values, bounds)


def test_the_table_has_the_share_of_every_time_known_ahead(tool: ModuleType) -> None:
    lines = tool.table(made({0.0: 0.95, 0.1: 0.6}), [0.0, 0.1]).splitlines()
    cells = {line.split("|")[1].strip(): [c.strip() for c in line.split("|")[2:-1]] for line in lines[2:]}
    assert cells["0 s"] == ["0.950"] * 3 + ["0.10 (0.10 to 0.10)"] * 3
    assert cells["0.1 s"][3] == "0.80 (0.80 to 0.80)"
    assert cells["learned"][3] == "0.20 (0.20 to 0.20)"
    assert list(cells)[:2] == ["0 s", "0.1 s"]
    assert len(cells) == 7


def test_the_picture_has_a_panel_for_each_bound(tool: ModuleType) -> None:
    drawn = tool.figure(made({0.0: 0.95, 0.1: 0.6}), [0.0, 0.1])
    assert [ax.get_title(loc="left") for ax in drawn.axes] == ["both", "drift", "acceleration"]
    for ax in drawn.axes:
        plans = next(line for line in ax.get_lines() if line.get_label() == "plans")
        assert np.asarray(plans.get_ydata()) == pytest.approx([0.1, 0.8])
        assert any(line.get_label() == "learned" for line in ax.get_lines())


def test_a_run_is_judged_in_the_benchs_engine() -> None:
    """With a tenth of a second known a plan has less of both peaks than passive-on; its key tells plans apart."""
    bench = FrameBench(preset.frame_model(), engine="chain", timestep=5e-4)
    motion = kanai_tajimi(5, duration=4.0, rise=0.5, plateau=2.0, decay=0.5)
    task = Known(motion, 1.0, 0.1)
    values = Plans(bench).run(task)["values"]
    on = bench.values(bench.run("passive-on", motion, 1.0), bench.run(UNCONTROLLED, motion, 1.0))
    assert values["J1"] + values["J2"] < 0.9 * (on["J1"] + on["J2"])
    assert 0 < values["mean_command"] < bench.site.command_max
    keys = {Plans(bench).key(Known(motion, a, s)) for a in (0.5, 1.0) for s in (0.0, 0.1)}
    assert len(keys) == 4


def test_plans_come_less_often_where_more_is_known() -> None:
    assert [receding(s).blocks for s in (0.0, 0.05, 0.1, 0.3, 1.0)] == [1, 1, 2, 6, 6]


def test_what_is_refused(tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, said in (
        (["--seconds", "-1"], "seconds is [-1.0]"),
        (["--controllers", "learned", "--amplitudes", "-1"], "amplitude -1"),
    ):
        with pytest.raises(SystemExit, match="2"):
            tool.main([*arguments, "-o", str(tmp_path)])
        assert said in capsys.readouterr().err
