"""Real frames whose damper has another law than the simulator's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mrdamp.compare.motions import tuning_motions
from mrdamp.control.passive import Constant
from mrdamp.diagnosis.case.folder import read_case
from mrdamp.gap.scenario import nominal_frame
from mrdamp.motions import GroundMotion
from mrdamp.simulation.stepping import run_frame
from studies.blindtest.commissioning import MISFIT
from studies.gap.closed_loop import write_case
from studies.gap.other_law import OtherLaw, other_law
from studies.gap.real import LOG_HZ, NONE, RealFrame

SEED = 4


@pytest.fixture(scope="module")
def made() -> OtherLaw:
    return other_law(nominal_frame(), SEED)


@pytest.fixture
def motion() -> GroundMotion:
    whole = tuning_motions()[1].compressed(5.0)
    n = round(1.5 / whole.sample_time)
    return GroundMotion("short", whole.sample_time, whole.acceleration[:n])


@pytest.mark.slow
def test_the_simulator_has_another_law_and_the_error_of_a_real_rig(made: OtherLaw) -> None:
    assert made.nominal.law != nominal_frame().law
    assert MISFIT[0] <= made.misfit <= MISFIT[1]
    assert made.nominal.effects == ()
    assert made.nominal.structure == nominal_frame().structure
    assert made.nominal.attributes["command_max"] == nominal_frame().attributes["command_max"]
    assert made.parts == ("rate_dependent_yield",)  # the others resemble an effect of the real frames


def test_the_real_frame_runs_with_its_own_damper(made: OtherLaw, motion: GroundMotion) -> None:
    controller = Constant(1.0)
    simulated = run_frame(made.nominal, motion, controller)
    real, _ = RealFrame(made.nominal, NONE, made.numbers).run(motion, controller)
    first, _ = RealFrame(nominal_frame(), NONE).run(motion, controller)
    n = min(len(simulated.time), len(real.time), len(first.time))

    def apart(one: np.ndarray, other: np.ndarray) -> float:
        return float(np.sqrt(np.mean((one[:n] - other[:n]) ** 2) / np.mean(other[:n] ** 2)))

    assert 0.01 < apart(simulated.force, real.force) < 0.4
    assert apart(first.force, real.force) > 0.02
    assert apart(simulated.drift, real.drift) < 0.3


def test_the_case_has_the_frame_without_the_effect_as_its_baseline(
    tmp_path: Path, made: OtherLaw, motion: GroundMotion
) -> None:
    softer = RealFrame(made.nominal, "storey_stiffness@1", made.numbers)
    before = RealFrame(made.nominal, NONE, made.numbers)
    motions = [motion, motion.scaled(1.2)]
    write_case(softer, Constant(1.0), motions, tmp_path, seed=1, before=before)
    case = read_case(tmp_path)
    assert case.repeats[0][1] == 1
    assert [r.sample_time for r in case.records] == pytest.approx([1 / LOG_HZ] * 3)
    assert case.model.law == made.nominal.law
    assert [r.name for r in case.baseline] == ["baseline_1", "baseline_2"]
    own, baseline = (r.channel("floor1_displacement_m") for r in (case.records[0], case.baseline[0]))
    assert np.sqrt(np.mean(own**2)) > 1.1 * np.sqrt(np.mean(baseline**2))
