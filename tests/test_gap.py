"""The real frames of a gap study: the reference rig without a cause is the simulator, with one it is not."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from mrdamp.compare.motions import tuning_motions
from mrdamp.control.passive import Constant
from mrdamp.diagnosis.case import read_case
from mrdamp.errors import InputError
from mrdamp.gap import real
from mrdamp.gap.closed_loop import write_case
from mrdamp.gap.desk import folded, nominal_frame
from mrdamp.gap.study import Options
from mrdamp.model import Effect
from mrdamp.motions import GroundMotion
from mrdamp.stepping import run_frame


class Switching:
    """A feedback that sees every channel: full on where the damper works against the first floor's motion."""

    name = "switching"
    period = 1e-3

    def reset(self) -> None:
        self.seen: list[float] = []

    def command(self, t: float, y: Mapping[str, float]) -> float:
        self.seen.append(y["stroke_velocity"])
        return 2.0 if y["displacement_1"] * y["stroke_velocity"] > 0 else 0.3


@pytest.fixture
def motion() -> GroundMotion:
    whole = tuning_motions()[0].compressed(5.0)
    n = round(1.5 / whole.sample_time)
    return GroundMotion("short", whole.sample_time, whole.acceleration[:n])


def plain(monkeypatch: pytest.MonkeyPatch) -> real.RealFrame:
    monkeypatch.setattr(real, "EFFECTS", {**real.EFFECTS, "none": ({}, {})})
    return real.RealFrame(nominal_frame(), "none")


def test_without_a_cause_the_rig_is_the_simulator_in_closed_loop(
    monkeypatch: pytest.MonkeyPatch, motion: GroundMotion
) -> None:
    ours = run_frame(nominal_frame(), motion, Switching())
    theirs, _ = plain(monkeypatch).run(motion, Switching())
    n = min(len(ours.time), len(theirs.time))
    for name, most in (("drift", 0.02), ("force", 0.05), ("stroke", 0.02)):
        a, b = getattr(ours, name)[:n], getattr(theirs, name)[:n]
        assert np.sqrt(np.mean((a - b) ** 2) / np.mean(b**2)) < most, name


@pytest.mark.parametrize("cause", list(real.EFFECTS))
def test_a_cause_changes_the_motion(
    cause: str, monkeypatch: pytest.MonkeyPatch, motion: GroundMotion
) -> None:
    controller = Constant(1.0)
    without, _ = plain(monkeypatch).run(motion, controller)
    run, _ = real.RealFrame(nominal_frame(), cause).run(motion, controller)
    change = np.sqrt(np.mean((run.drift - without.drift) ** 2) / np.mean(without.drift**2))
    if cause == "driver_lag":  # a constant command does not see it, but for its beginning
        assert change < 0.1
    else:
        assert change > 0.02


def test_velocity_is_the_strokes_and_an_error_in_the_controller_is_told(motion: GroundMotion) -> None:
    frame, controller = real.RealFrame(nominal_frame(), "driver_lag"), Switching()
    run, _ = frame.run(motion, controller)
    slope = np.gradient(run.stroke, run.time)
    n = min(len(slope), len(controller.seen)) - 1
    assert np.corrcoef(slope[1:n], controller.seen[1:n])[0, 1] > 0.99

    class Broken(Switching):
        def command(self, t: float, y: Mapping[str, float]) -> float:
            raise InputError("no command")

    with pytest.raises(InputError, match="no command"):
        frame.run(motion, Broken())


def test_a_closed_loop_record_has_the_command_that_the_force_was_read_under(
    monkeypatch: pytest.MonkeyPatch, motion: GroundMotion
) -> None:
    """The simulator that matches the rig has to leave little on the record, though the command switches."""
    frame = plain(monkeypatch)
    made = real.record(frame.run(motion, Switching())[1], np.random.default_rng(1))
    assert np.mean(np.diff(made["command"]) != 0) > 0.005
    out = nominal_frame().simulate(1 / real.LOG_HZ, made)
    for name, most in (("force_N", 0.1), ("floor1_acceleration_m_s2", 0.12), ("floor3_acceleration_m_s2", 0.03)):
        error = np.sqrt(np.mean((out[name] - made[name]) ** 2) / np.mean(made[name] ** 2))
        assert error < most, name


def test_the_case_is_one(tmp_path: Path, motion: GroundMotion) -> None:
    frame = real.RealFrame(nominal_frame(), "floor_mass@3")
    write_case(frame, Constant(1.0), [motion, motion.scaled(1.2), motion.scaled(0.9)], tmp_path, seed=1)
    case = read_case(tmp_path)
    assert case.model.structure is not None
    np.testing.assert_allclose(case.model.structure.mass, 98.3)
    assert [r.sample_time for r in case.records] == pytest.approx([1 / real.LOG_HZ] * 4)
    assert case.repeats[0][1] == 1


def test_a_controller_is_made_for_the_structure_with_its_effects() -> None:
    nominal = nominal_frame()
    changed = nominal.__class__(
        nominal.law, nominal.parameters, (Effect("floor_mass", {"dm": 10.0}, 3),), "frame", nominal.structure
    )
    structure = folded(changed).structure
    assert structure is not None
    np.testing.assert_allclose(structure.mass, [98.3, 98.3, 108.3])


@pytest.mark.parametrize("wrong", [{"effects": ("rust",)}, {"loads": 0}, {"controller": "magic"}])
def test_wrong_options_are_told(wrong: dict[str, object]) -> None:
    with pytest.raises(InputError):
        Options(**wrong)  # type: ignore[arg-type]
