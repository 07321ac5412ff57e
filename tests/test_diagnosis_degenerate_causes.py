"""Causes that end where they are another one, and parameters that the records cannot tell apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from laboratory import TRUE, rig_tests
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.constants import CAUSE, LAW
from mrdamp.diagnosis.evidence.judgement import scored
from mrdamp.diagnosis.evidence.penalties import gone, of_damper, unreferenced
from mrdamp.diagnosis.evidence.verdict import decide
from mrdamp.diagnosis.fits.least_squares import Fit
from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Term
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.run import diagnose
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record


def rig_with(*others: str) -> DamperRig:
    """A damper with other channels that read the force beside the force sensor."""
    t = 0.002 * np.arange(1000)
    x, force = 0.01 * np.sin(2 * np.pi * 2 * t), 500 * np.cos(2 * np.pi * 2 * t)
    channels = {
        "displacement_m": x,
        "command": np.ones(1000),
        "force_N": force,
        **dict.fromkeys(others, force),
    }
    law = {"c0a": 700.0, "c0b": 800.0, "fya": 70.0, "fyb": 620.0, "v_ref": 0.03}
    return DamperRig(Model("bingham", law), (Record("sine", None, 0.002, channels),))


@pytest.fixture(scope="module")
def terms() -> dict[str, Term]:
    return {t.name: t for t in rig_with().terms}


def made(term: Term, point: Array, cost: float) -> Fit:
    hypothesis = Hypothesis((), (term,))
    return Fit(hypothesis, point, cost, np.zeros(10), np.zeros((10, len(point))))


@pytest.mark.parametrize(("least", "cause"), [(True, "mount_compliance"), (False, "backlash")])
def test_a_clearance_that_is_none_is_a_spring(terms: dict[str, Term], least: bool, cause: str) -> None:
    """The least gap that is tried leaves a mount with stiffness; a fit there is no evidence of a clearance."""
    backlash, mount = terms["backlash"], terms["mount_compliance"]
    point = Hypothesis((), (backlash,)).start()
    if least:
        point[0] = Hypothesis((), (backlash,)).bounds()[0][0] + 0.1
    fits = [
        Fit(Hypothesis(()), np.zeros(0), 1.0, np.zeros(10), np.zeros((10, 0))),
        made(backlash, point, 0.0101),
        made(mount, Hypothesis((), (mount,)).start(), 0.0110),
    ]
    assert ("backlash_gap" in fits[1].at_lower_bounds) == least
    decision = decide(scored(fits, left_out={id(f): f.cost for f in fits}), 0.01)
    assert decision.chosen.causes == (cause,)


@pytest.mark.parametrize(
    ("form", "ratio", "cause"),
    [
        ("with a stop", 7.5, "backlash"),
        ("with a stop", 6.5, "mount_compliance"),
        ("hardening", 7.5, "backlash"),
        ("hardening", 6.5, "mount_compliance"),
    ],
)
def test_a_soft_mount_with_a_hard_stop_is_a_clearance(
    terms: dict[str, Term], form: str, ratio: float, cause: str
) -> None:
    """ratio: of the stiffness under the RMS force to that without a force. The mount fits a little better, as it may
    beside an error of the law."""
    term, force, k = terms[f"mount_compliance:{form}"], 500 / np.sqrt(2), 5e5
    values = {"mount_compliance_k": k, "mount_compliance_stop": 1e-4, "mount_compliance_stiffer": ratio - 1}
    # k d (1 + k3 d^2) = force with 3 k3 d^2 = ratio - 1
    values["mount_compliance_k3"] = (ratio - 1) / 3 * (k * (1 + (ratio - 1) / 3) / force) ** 2
    point = np.array([c.point(values[c.name]) for c in term.coordinates])
    fits = [
        Fit(Hypothesis(()), np.zeros(0), 1.0, np.zeros(10), np.zeros((10, 0))),
        made(terms["backlash"], Hypothesis((), (terms["backlash"],)).start(), 0.0110),
        made(term, point, 0.0101),
    ]
    assert decide(scored(fits, left_out={id(f): f.cost for f in fits}), 0.01).chosen.causes == (cause,)


@pytest.mark.parametrize(
    ("form", "least", "is_gone"),
    [
        ("", (), False),
        ("", ("driver_lag_tau",), False),  # the other pole is a lag
        ("", ("driver_lag_tau", "driver_lag_tau2"), True),
        ("falling apart", ("driver_lag_tau",), True),
        ("falling apart", ("driver_lag_fall",), False),  # rising late, falling at once
    ],
)
def test_a_lag_without_its_times_is_none(
    terms: dict[str, Term], form: str, least: tuple[str, ...], is_gone: bool
) -> None:
    hypothesis = Hypothesis((), (terms[f"driver_lag:{form}" if form else "driver_lag"],))
    point, low = hypothesis.start(), hypothesis.bounds()[0]
    for k, c in enumerate(hypothesis.coordinates):
        if c.name in least:
            point[k] = low[k]
    assert gone(Fit(hypothesis, point, 0.01, np.zeros(10), np.zeros((10, len(point))))) == is_gone


@pytest.mark.parametrize("channels", [(), ("reference_force_N",)])
def test_a_gain_without_a_reference_adds_nothing_to_free_numbers_of_the_law(
    terms: dict[str, Term], channels: tuple[str, ...]
) -> None:
    """A gain is a common factor of the law's coefficients: beside fixed ones it is a cause, beside free ones none."""
    rig = rig_with(*channels)
    gain, mass = terms["sensor_gain"], terms["moving_mass"]
    held = made(gain, Hypothesis((), (gain,)).start(), 0.0101)
    free = replace(held, hypothesis=Hypothesis(rig.nominal, (gain,)))
    assert [of_damper(rig, f) for f in (held, free)] == [0.0, 0.0 if channels else CAUSE]
    assert not unreferenced(rig, made(mass, Hypothesis((), (mass,)).start(), 0.01))


def test_hysteresis_beside_a_law_without_any_counts_as_another_law_unless_the_law_is_known(
    terms: dict[str, Term],
) -> None:
    """Seal friction of presliding beside Bingham's law; a spring has no loop."""
    rig = rig_with("reference_force_N")
    seal, spring = (made(terms[n], Hypothesis((), (terms[n],)).start(), 0.1) for n in ("seal_friction", "gas_spring"))
    assert of_damper(rig, seal, unsure=True) == LAW
    assert of_damper(rig, seal) == 0.0
    assert of_damper(rig, spring, unsure=True) == 0.0


def test_at_one_command_a_coefficient_is_known_as_a_whole_only() -> None:
    """The rig's yield force at 1 A is 50 + 400 N, the simulator's 50 + 300 N: 150 N at no command do as well."""
    records = tuple(rig_tests("bingham", chosen=(2, 5, 8), duration=2.0))
    nominal = Model("bingham", {**TRUE["bingham"], "fyb": 300.0})
    found = diagnose(Case("rig", Path(), nominal, records, ()), jobs=1)
    assert found.verdict == "parameters"
    assert found.corrected.parameters["fya"] == pytest.approx(150.0, rel=5e-3)
    assert {name: found.corrected.parameters[name] for name in ("fyb", "c0b")} == {"fyb": 300.0, "c0b": 200.0}
    assert set(found.intervals) == {"fya", "c0a", "v_ref"}
