"""The real frames of a gap study, of the simulator's law and of another: without a cause the one is the simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from mrdamp import gap
from mrdamp.control.passive import Constant
from mrdamp.envs.training_loads import tuning_motions, unseen_motions
from mrdamp.errors import InputError
from mrdamp.gap import Scenario, straightened
from mrdamp.model import Effect, Model
from mrdamp.motions import TIME_SCALE, GroundMotion
from mrdamp.simulation.stepping import run_frame
from refusals import refuses
from studies.blindtest.rig import RATE_HZ
from studies.gap import real
from studies.gap.page import page
from studies.gap.real import nominal_frame
from studies.gap.study import Options, study


class Switching:
    """A feedback that sees every channel: full on where the damper works against the first floor's motion."""

    name = "switching"
    period = 1e-3

    def reset(self) -> None:
        self.seen: list[float] = []

    def command(self, t: float, y: Mapping[str, float]) -> float:
        self.seen.append(y["stroke_velocity"])
        return 2.0 if y["displacement_1"] * y["stroke_velocity"] > 0 else 0.3


def short(number: int) -> GroundMotion:
    whole = tuning_motions()[number].compressed(5.0)
    n = round(1.5 / whole.sample_time)
    return GroundMotion("short", whole.sample_time, whole.acceleration[:n])


@pytest.fixture
def motion() -> GroundMotion:
    return short(0)


def plain() -> real.RealFrame:
    return real.RealFrame(nominal_frame(), real.NONE)


def test_without_a_cause_the_rig_is_the_simulator_in_closed_loop(motion: GroundMotion) -> None:
    ours = run_frame(nominal_frame(), motion, Switching())
    theirs, _ = plain().run(motion, Switching())
    n = min(len(ours.time), len(theirs.time))
    for name, most in (("drift", 0.02), ("force", 0.05), ("stroke", 0.02)):
        a, b = getattr(ours, name)[:n], getattr(theirs, name)[:n]
        assert np.sqrt(np.mean((a - b) ** 2) / np.mean(b**2)) < most, name


@pytest.mark.parametrize("cause", real.EFFECTS)
def test_a_cause_changes_the_motion_or_what_the_load_cell_reads(cause: str, motion: GroundMotion) -> None:
    without, exact = plain().run(motion, Constant(1.0))
    run, log = real.RealFrame(nominal_frame(), cause).run(motion, Constant(1.0))
    if cause not in ("sensor_gain", "sensor_lag"):
        change = np.sqrt(np.mean((run.drift - without.drift) ** 2) / np.mean(without.drift**2))
        # a constant command does not see the driver's lag, but for its beginning
        assert change < 0.1 if cause == "driver_lag" else change > 0.02
        return
    np.testing.assert_array_equal(run.drift, without.drift)
    wanted = 1.1 * exact["force"]
    if cause == "sensor_lag":
        decay = np.exp(-1 / RATE_HZ / 0.003)
        wanted = lfilter([1 - decay], [1, -decay], exact["force"])
    np.testing.assert_allclose(log["force"], wanted, atol=1e-6 * np.abs(wanted).max())


def test_a_controller_reads_the_strokes_velocity_and_its_error_is_told(motion: GroundMotion) -> None:
    controller = Switching()
    run, _ = real.RealFrame(nominal_frame(), "driver_lag").run(motion, controller)
    slope = np.gradient(run.stroke, run.time)
    n = min(len(slope), len(controller.seen)) - 1
    assert np.corrcoef(slope[1:n], controller.seen[1:n])[0, 1] > 0.99

    class Broken(Switching):
        def command(self, t: float, y: Mapping[str, float]) -> float:
            raise InputError("no command")

    refuses(lambda: plain().run(motion, Broken()), "no command")


def test_a_closed_loop_record_has_the_command_beside_what_it_does(
    monkeypatch: pytest.MonkeyPatch, motion: GroundMotion
) -> None:
    """The simulator that matches the rig has to leave little on the record, though the command switches."""
    monkeypatch.setattr(real, "_NOISE", 0.0)
    frame = plain()
    made = real.record(frame.run(motion, Switching())[1], np.random.default_rng(1))
    assert np.mean(np.diff(made["command"]) != 0) > 0.005

    def error(name: str, late: int) -> float:
        command = np.roll(made["command"], late)
        out = nominal_frame().simulate(1 / real.LOG_HZ, {**made, "command": command})
        return float(np.sqrt(np.mean((out[name] - made[name]) ** 2) / np.mean(made[name] ** 2)))

    for name, most in (
        ("force_N", 0.02),
        ("floor1_acceleration_m_s2", 0.03),
        ("floor3_acceleration_m_s2", 0.003),
    ):
        matched = error(name, 0)
        assert matched < most, name
        assert matched < 0.5 * min(error(name, -1), error(name, 1)), name


def test_a_policy_is_trained_on_a_structure_with_its_masses_and_stiffnesses() -> None:
    """What else is wrong stays an effect."""
    nominal = nominal_frame()
    effects = (Effect("storey_stiffness", {"e": -0.3}, 1), Effect("sensor_gain", {"g": 1.1}, 2))
    softer = replace(nominal, effects=effects)
    structure = straightened(softer).structure
    assert structure is not None
    assert nominal.structure is not None
    np.testing.assert_allclose(structure.stiffness / nominal.structure.stiffness, [0.7, 1.0, 1.0])
    assert straightened(softer).effects == effects[1:]


@pytest.mark.slow
def test_a_softer_storey_is_found_in_closed_loop_and_most_of_the_gap_closes(tmp_path: Path) -> None:
    done = study(Options(effects=("storey_stiffness@1",), loads=1, draws=1), tmp_path)
    page(done).write(tmp_path / "index.html")
    assert "named it on 1 of 1" in (tmp_path / "index.html").read_text()
    (found,) = done.rows
    assert found.named == ("storey_stiffness@1",)
    assert found.closed > 0.7
    assert None not in (found.retuned, found.randomised, found.blind, found.direct)


def answer(corrected: Model, drawn: tuple[Model, ...], named: tuple[Effect, ...] = ()) -> SimpleNamespace:
    verdict = "effect" if named else "none"
    effects = [SimpleNamespace(effect=e.name, place=e.place) for e in named]
    return SimpleNamespace(
        verdict=verdict, effects=effects, corrected=corrected, drawn=drawn, sentence="Said.", to_dict=dict,
        gap=SimpleNamespace(corrected=0.02),
    )  # fmt: skip


@pytest.mark.slow
def test_a_measured_frame_is_stood_for_by_its_corrected_simulator(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The figures are those of runs in the simulators; the intervals contain what the draws give."""
    nominal = nominal_frame()
    softer = [
        replace(nominal, effects=(Effect("storey_stiffness", {"e": e}, 1),)) for e in (-0.3, -0.28, -0.32)
    ]
    given = answer(softer[0], tuple(softer[1:]), softer[0].effects)
    monkeypatch.setattr("mrdamp.gap.diagnose", lambda case, jobs: given)
    case = SimpleNamespace(name="rig", model=nominal, records=())
    found = gap.of_case(Options("constant:value=1", loads=1), case, tmp_path)  # type: ignore[arg-type]
    assert (found.verdict, found.named) == ("effect", ("storey_stiffness@1",))
    load = unseen_motions()[0].compressed(TIME_SCALE)
    peaks = [np.abs(run_frame(m, load, Constant(1.0)).drift).max() for m in (nominal, *softer)]
    scenario = Scenario(nominal, Options("constant:value=1", loads=1))
    before, after = (scenario.criteria(m, Constant(1.0), scenario.loads[0]) for m in (nominal, softer[0]))
    assert before.peak_drift.max() == pytest.approx(peaks[0])
    errors = [
        abs(np.max(getattr(before, name)) / np.max(getattr(after, name)) - 1)
        for name in ("peak_drift", "peak_acceleration", "rms_drift", "rms_acceleration")
    ]
    assert found.error == pytest.approx(np.mean(errors))
    assert found.kept_interval is not None
    assert found.kept_interval[0] < found.kept < found.kept_interval[1]
    assert found.retuned is None, "a controller with options is left as it is"
    assert ("diagnosis", "storey_stiffness@1") in gap.rows(found)
    assert Model.read(tmp_path / "corrected.json").effects == softer[0].effects
