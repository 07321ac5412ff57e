"""A frame that is not as controllers are told: `--spread`, `--told`, and a diagnosis in between."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from command_call import caller
from mrdamp.commands.compare import add_to
from mrdamp.compare.benches import scaled
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import FrameBench
from mrdamp.control.clipped_optimal import OptimalForce, optimal_force
from mrdamp.control.force_control import ForceController
from mrdamp.control.told import Told
from mrdamp.motions import kanai_tajimi
from mrdamp.structures import ShearFrame, dyke1996

run = caller(add_to)
#: 5.16e5, 6.84e5, 6.84e5 N/m less a tenth, typed in.
SOFT = ShearFrame(np.full(3, 98.3), np.array([464400.0, 615600.0, 615600.0]), np.array([125.0, 50.0, 50.0]))
NAMES = ("passive-on", "clipped-optimal:balance=100,r=1e-8,noise_ratio=2000")


def test_a_tenth_of_stiffness_or_mass_moves_the_frequencies_by_its_root() -> None:
    nominal = dyke1996().frequencies
    for part, power in (("stiffness", 0.5), ("mass", -0.5)):
        frame = scaled(frame_model(), part, 1.21).structure
        assert frame is not None
        np.testing.assert_allclose(frame.frequencies / nominal, 1.21**power, rtol=1e-12)


def test_controllers_are_made_for_what_they_are_told() -> None:
    model = replace(frame_model(), structure=SOFT)
    for bench, told in ((FrameBench(model), SOFT), (FrameBench(model, told=frame_model()), dyke1996())):
        made = bench.controller(NAMES[1].replace("balance=100,", ""))
        assert isinstance(made, Told)
        assert isinstance(made.inner, ForceController)
        assert isinstance(made.inner.aim, OptimalForce)
        wanted = optimal_force(told, r=1e-8, noise_ratio=2000.0)
        np.testing.assert_allclose(made.inner.aim.k, wanted.k)
        np.testing.assert_allclose(made.inner.aim.estimator.gain, wanted.estimator.gain)


def test_the_spread_is_that_of_frames_typed_in(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its gain on the softer frame is that of a file of that frame, with the nominal one told."""
    for seed in (1, 2):
        kanai_tajimi(seed, duration=5.0).save(tmp_path / f"shake_{seed}.csv")
    replace(frame_model(), structure=SOFT).write(tmp_path / "soft.json")
    frame_model().write(tmp_path / "thought.json")
    call: list[str | Path] = ["compare", "frame", "--motions", *tmp_path.glob("shake_*.csv"), "--engine", "chain"]
    call += ["--jobs", "1", "--command-unit", "V", "--json"]
    assert run(*call, "--controllers", *NAMES, "--spread", "10", "-o", tmp_path / "out") == 0
    found = json.loads(capsys.readouterr().out)["controllers"][NAMES[1]]["spread"]
    assert set(found) == {f"{part} {sign}10 %" for part in ("stiffness", "mass") for sign in "+-"}
    text = (tmp_path / "out" / "table.md").read_text()
    assert "not as controllers are told" in text

    def gain(*more: str | Path) -> float:
        assert run(*call, "--controllers", *NAMES, "--model", tmp_path / "soft.json", *more) == 0
        rows = json.loads(capsys.readouterr().out)["controllers"]
        on, own = (sum(rows[name]["measures"][key]["mean"] for key in ("J1", "J2")) / 2 for name in NAMES)
        return own - on  # type: ignore[no-any-return]

    wrong, right = gain("--told", tmp_path / "thought.json"), gain()
    # Rows take peaks within control periods as well.
    assert found["stiffness -10 %"]["mean"] == pytest.approx(wrong, abs=0.01)
    assert right < wrong  # a controller of the true frame does better
