"""The functions of `mrdamp` give what the commands write, and answers draw themselves."""

from __future__ import annotations

import base64
import json
import pydoc
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mrdamp
from command_call import caller
from mrdamp.commands.compare import add_to as add_compare
from mrdamp.commands.identify import add_to as add_identify
from mrdamp.compare.benches import bench_of
from mrdamp.compare.comparison import compare
from mrdamp.compare.contenders import contenders, shipped_policies
from mrdamp.motions import kanai_tajimi
from mrdamp.records import embedded
from mrdamp.records.csv_file import render
from refusals import refuses


def test_identify_is_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder, records in (("train", embedded().train[:2]), ("validation", embedded().validation[:1])):
        (tmp_path / "set" / folder).mkdir(parents=True)
        for record in records:
            (tmp_path / "set" / folder / f"{record.name}.csv").write_text(render(record.channels))
    fit = mrdamp.identify(tmp_path / "set", "bingham", starts=1)
    out = tmp_path / "model.json"
    assert caller(add_identify)("identify", tmp_path / "set", "--law", "bingham", "--starts", "1", "-o", out) == 0
    assert mrdamp.Model.read(out).parameters == fit.model.parameters
    assert f"held-out records {fit.held_out_nrmse:.3f}" in capsys.readouterr().out
    bars: list[Any] = list(fit.plot().axes[0].patches)
    assert [b.get_width() for b in bars] == pytest.approx([e.nrmse for e in (*fit.held_out, *fit.train)], rel=1e-6)


def test_compare_is_the_command(tmp_path: Path) -> None:
    motion = kanai_tajimi(5, duration=2.0, rise=0.3, plateau=1.0, decay=0.3)
    motion.save(tmp_path / "m.csv")
    names = ["passive-on", "passive-off"]
    table = mrdamp.compare("frame", names, [mrdamp.read_motion(tmp_path / "m.csv")], engine="chain")
    call = ["compare", "frame", "--controllers", *names, "--motions", tmp_path / "m.csv", "--engine", "chain"]
    assert caller(add_compare)(*call, "--jobs", "1", "-o", tmp_path / "out") == 0
    written = json.loads((tmp_path / "out" / "result.json").read_text())["controllers"]
    assert set(written) == set(names)
    for name in names:
        for key, values in table.values[name].items():
            assert written[name]["measures"][key]["runs"] == values.tolist()
    assert repr(table) == "Comparison(2 controllers, 1 loads, 1 amplitudes)"
    assert len(table.plot().axes) == sum(m.ratio for m in table.measures)


def test_a_record_draws_every_channel_and_shows_itself() -> None:
    t = np.arange(200) * 0.01
    channels = {"displacement_m": 1e-3 * np.sin(t), "command": np.ones(200), "force_N": 50 * np.sin(3 * t)}
    record = mrdamp.Record("a<b", None, 0.01, channels)
    drawn = {ax.get_title(loc="left"): ax.get_lines()[0].get_ydata() for ax in record.plot().axes}
    assert list(drawn) == list(channels)
    assert np.max(np.asarray(drawn["force_N"])) == channels["force_N"].max()
    html = record._repr_html_()
    assert "a&lt;b" in html
    assert "a<b" not in html
    (png,) = re.findall(r"base64,([^\"]+)", html)
    assert base64.b64decode(png).startswith(b"\x89PNG")


def test_packages_are_the_functions_of_their_names() -> None:
    """Whatever was imported before: a submodule's import would hide a function of the same name."""
    from mrdamp.compare import comparison  # noqa: F401

    for name in ("identify", "compare", "train"):
        assert getattr(mrdamp, name) is sys.modules[f"mrdamp.{name}"]
        assert callable(getattr(mrdamp, name))
    refuses(lambda: mrdamp.compare("boat"), "boat")
    assert all(getattr(mrdamp, name) is not None for name in mrdamp.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = mrdamp.nothing
    text = pydoc.plain(pydoc.render_doc(mrdamp))
    for name in ("identify", "predict", "diagnose", "compare", "train"):
        assert f"mrdamp.{name}(" in text
        assert name in dir(mrdamp)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"controllers": "passive-on"}, "controllers is 'passive-on'; allowed: a list of names"),
        ({"loads": 5}, "loads is 5; allowed: a list of loads"),
        ({"loads": [1]}, "1 is no load of a frame"),
        ({"amplitudes": 1}, "amplitudes is 1; allowed: a list of numbers"),
        ({"tune": "no"}, "tune is 'no'; allowed: True, False"),
        ({"command_unit": "kV"}, "command_unit is 'kV'; allowed: A, V"),
    ],
)
def test_wrong_values_are_told_in_a_line(given: dict[str, Any], said: str) -> None:
    refuses(lambda: mrdamp.compare("frame", **({"controllers": ["passive-on"]} | given)), said)


def test_a_policy_of_one_damper_on_two_is_told_of() -> None:
    bench = bench_of("frame", engine="chain", dampers=[(0, 1), (1, 2)])
    rows = contenders(bench, ["learned"], {}, shipped_policies("frame"))
    found = compare(bench, rows, [kanai_tajimi(3, duration=2.0)], [1.0])
    assert "learned was trained with one damper; its command is given to all 2" in found.notes
