"""The catalogue of effects, where causes end as another one, what records cannot tell apart, a delay on a clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bingham_rig import force, model
from laboratory import TRUE, rig_tests
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.constants import EVIDENCE_GAIN, NUMBER
from mrdamp.diagnosis.evidence.established import softmax
from mrdamp.diagnosis.evidence.judgement import scored
from mrdamp.diagnosis.evidence.structure_numbers import deviations
from mrdamp.diagnosis.evidence.verdict import by_causes, decide, of_fit
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.sampled_delay import sampled_delays, try_sampled_delay
from mrdamp.diagnosis.fits.screening import screen
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.damper_effects import damper_terms
from mrdamp.diagnosis.hypotheses.frame_effects import structure_coordinates
from mrdamp.diagnosis.hypotheses.outside import PLAIN, command_rivals, force_rivals, plain
from mrdamp.diagnosis.hypotheses.outside_storeys import storey_rivals
from mrdamp.diagnosis.hypotheses.terms import Hypothesis, Sizes, Term
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.run import diagnose
from mrdamp.model import Model, core
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.structures import dyke1996


@pytest.mark.parametrize("sample_time", [0.0002, 0.002, 0.005, 0.01, 0.05])
def test_every_effect_and_rival_has_starts_within_its_ranges_and_a_rival_has_words(
    sample_time: float,
) -> None:
    sizes = Sizes(800.0, 0.01, 0.1, 2.0, 2.0, 300.0, sample_time)
    terms = damper_terms(sizes)
    storeys = tuple(storey_rivals(dyke1996(), [2], np.full(3, 1e-3), np.full(3, 4e-3)))
    assert all(plain(term).endswith("in storey 2") for term in storeys)
    rivals = (*command_rivals(sizes), *force_rivals(sizes))
    assert {term.cause for term in rivals} <= set(PLAIN)
    for term in (*terms, *rivals, *storeys):
        assert term.starts, term.name
        for start in term.starts:
            for c, value in zip(term.coordinates, start, strict=True):
                assert c.low <= value <= c.high, (term.name, c.name)
                assert c.low <= c.start <= c.high, (term.name, c.name)
    every = damper_terms(Sizes(800.0, 0.01, 0.1, 2.0, 2.0, 300.0, 0.001))
    assert {t.cause for t in terms} == {t.cause for t in every}


@pytest.mark.parametrize(("power", "other"), [(0.5, False), (0.64, False), (0.95, True)])
def test_a_thinning_that_is_the_same_at_all_speeds_is_a_viscosity(power: float, other: bool) -> None:
    """Far above its knee it is v^(m - 1): from half to twice a speed 4^(m - 1) is .50, .61 and .93."""
    terms = [t for t in damper_terms(Sizes(800.0, 0.01, 0.1, 2.0, 2.0, 300.0, 0.001)) if t.effect == "shear_thinning"]
    assert len(terms) == 2
    for term in terms:
        assert term.is_other is not None
        assert term.is_other({"shear_thinning_m": power, "shear_thinning_v_s": 1e-5}) is other


@pytest.mark.parametrize(("wobble", "shown"), [(0.014, False), (0.2, True)])
def test_a_command_that_hardly_changes_shows_nothing_of_what_acts_while_it_changes(
    wobble: float, shown: bool
) -> None:
    t = np.arange(400) * 0.005
    model = Model("bingham", {"c0a": 500.0, "c0b": 0.0, "fya": 50.0, "fyb": 300.0, "v_ref": 0.005})
    records = []
    for k, level in enumerate((0.5, 1.0)):
        x = 0.01 * np.sin(2 * np.pi * t)
        u = level + wobble * np.cos(2 * np.pi * t)
        channels = {"displacement_m": x, "command": u, "force_N": 500 * np.gradient(x)}
        records.append(Record(f"{k}", None, 0.005, channels))
    search = Search(Problem(DamperRig(model, tuple(records))), 1e-6, Limits(base=0))
    effects = {term.effect for term in search.addable(())}
    assert {"seal_friction", "saturation", "channel_shift"} <= effects
    assert ({"driver_lag", "command_delay", "remanence"} <= effects) is shown
    assert shown or not {"driver_lag", "command_delay", "remanence"} & effects


SIZES = Sizes(500.0, 0.01, 0.1, 2.0, 2.0, 50.0, 2e-3)
BINGHAM = {"c0a": 500.0, "c0b": 0.0, "fya": 100.0, "fyb": 0.0, "v_ref": 1e-3}


@pytest.mark.parametrize(("form", "weak"), [("extension", {1}), ("compression", {-1})])
def test_trapped_gas_takes_force_off_the_strokes_of_its_name(form: str, weak: set[int]) -> None:
    """After a turn the force comes back over 2 mm: less of it in extension (positive), compression, or both."""
    (term,) = (t for t in damper_terms(SIZES) if t.effect == "trapped_gas" and t.form == form)
    gas = {"trapped_gas_d": 0.5, "trapped_gas_s_g": 2e-3, **term.fixed}
    t = np.arange(2000) * 1e-3
    x, v = 0.01 * np.sin(2 * np.pi * t), 0.02 * np.pi * np.cos(2 * np.pi * t)
    with_gas, without = (
        core.run("bingham", p, 1e-3, x, v, u=np.zeros_like(t), columns=("force",))["force"]
        for p in (BINGHAM | gas, BINGHAM)
    )
    lost = 1 - with_gas / without
    later = t > 0.3  # after the first turn
    moving = np.abs(v) > 1e-3
    found = {sign for sign in (-1, 1) if lost[later & moving & (np.sign(v) == sign)].max() > 0.4}
    assert found == weak
    assert lost[later & moving].min() > -1e-9


@pytest.mark.parametrize("shared", [0.0, 0.2, -0.3])
def test_what_all_masses_and_stiffnesses_share_is_no_deviation(shared: float) -> None:
    """A frame heavier and stiffer by one factor moves as before; the storey that differs beside it is left."""
    nominal = structure_coordinates(dyke1996())
    wanted = np.array([0.0 if c.name.startswith("damping") else shared for c in nominal])
    odd = next(k for k, c in enumerate(nominal) if c.name == "stiffness@2")
    wanted[odd] += np.log(0.8)
    point = np.array([c.point(c.start * np.exp(x)) for c, x in zip(nominal, wanted, strict=True)])
    n = len(nominal)
    found = deviations(Fit(Hypothesis(nominal), point, 1e-3, np.zeros(n), np.eye(n)))
    expected = np.zeros(n)
    expected[odd] = np.log(0.8)
    assert found.names == tuple(c.name for c in nominal)
    np.testing.assert_allclose(found.values, expected, atol=1e-12)


def rig_with(*others: str) -> DamperRig:
    t = 0.002 * np.arange(1000)
    x, force = 0.01 * np.sin(2 * np.pi * 2 * t), 500 * np.cos(2 * np.pi * 2 * t)
    channels = {
        "displacement_m": x,
        "command": np.ones(1000),
        "force_N": force,
        **dict.fromkeys(others, force),
    }
    return DamperRig(model(), (Record("sine", None, 0.002, channels),))


@pytest.fixture(scope="module")
def terms() -> dict[str, Term]:
    return {t.name: t for t in rig_with().terms}


def made(term: Term, cost: float, point: Array | None = None) -> Fit:
    """A fit of one term; at its start unless told otherwise."""
    hypothesis = Hypothesis((), (term,))
    point = hypothesis.start() if point is None else point
    return Fit(hypothesis, point, cost, np.zeros(10), np.zeros((10, len(point))))


def chosen(*fits: Fit) -> tuple[str, ...]:
    """The causes that are decided for beside no cause at all."""
    every = [Fit(Hypothesis(()), np.zeros(0), 1.0, np.zeros(10), np.zeros((10, 0))), *fits]
    return decide(scored(every, left_out={id(f): f.cost for f in every}), 0.01).chosen.causes


def test_forms_of_a_cause_share_its_prior(terms: dict[str, Term]) -> None:
    """Three of eight forms of trapped gas, each as good as the only form of a shift, are three eighths as probable."""
    gas = [t for t in terms.values() if t.effect == "trapped_gas"]
    assert len(gas) == 8
    fits = [
        made(t, 0.5 * np.exp(-NUMBER * len(t.coordinates) / EVIDENCE_GAIN)) for t in (*gas[:3], terms["channel_shift"])
    ]
    known = scored(fits, left_out={id(f): f.cost for f in fits})
    sets = by_causes(known, softmax([of_fit(f) for f in known]).tolist())
    assert sets["trapped_gas",] / sets["channel_shift",] == pytest.approx(3 / 8)


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
    assert chosen(made(terms["backlash"], 0.0110), made(term, 0.0101, point)) == (cause,)


@pytest.mark.parametrize(("travel", "cause"), [(0.5, "mount_compliance"), (0.7, "backlash")])
def test_a_clearance_of_less_than_its_ends_give_way_by_is_a_mount(
    terms: dict[str, Term], travel: float, cause: str
) -> None:
    """travel: half of the clearance over that of its ends under the RMS force. The clearance fits a little better."""
    term, force, k = terms["backlash"], 500 / np.sqrt(2), 5e5
    values = {"backlash_gap": 2 * travel * force / k, "backlash_k": k}
    point = np.array([c.point(values[c.name]) for c in term.coordinates])
    assert chosen(made(terms["mount_compliance"], 0.0110), made(term, 0.0101, point)) == (cause,)


def test_at_one_command_a_coefficient_is_known_as_a_whole_only() -> None:
    """The rig's yield force at 1 A is 50 + 400 N, the simulator's 50 + 300 N: 150 N at no command do as well."""
    records = tuple(rig_tests("bingham", chosen=(2, 5, 8), duration=2.0))
    nominal = Model("bingham", {**TRUE["bingham"], "fyb": 300.0})
    found = diagnose(Case("rig", Path(), nominal, records, ()), jobs=1)
    assert found.verdict == "parameters"
    assert found.corrected.parameters["fya"] == pytest.approx(150.0, rel=5e-3)
    assert {name: found.corrected.parameters[name] for name in ("fyb", "c0b")} == {"fyb": 300.0, "c0b": 200.0}
    assert set(found.intervals) == {"fya", "c0a", "v_ref"}


DT, NOISE = 2e-3, 3.0
TIME: Array = DT * np.arange(3000, dtype=np.float64)
DELAY, PERIOD, PHASE = 0.021, 0.0137, 0.4


def command(t: Array, k: int) -> Array:
    """Two tests' commands at times (n,); before a test its first."""
    t = np.maximum(t, 0.0)
    return np.asarray(0.5 + 0.25 * np.sin((9 + k) * t) + 0.2 * np.sin((23 - 4 * k) * t + k))


def search(period: float, stride: int) -> tuple[Search, Fit]:
    """Of records with a clock of that period (0: none), with the plain delay fitted to them."""
    rng, records = np.random.default_rng(5), []
    for k in (0, 1):
        x = 0.012 * np.sin((11 - 2 * k) * TIME) + 0.004 * np.sin(29 * TIME + k)
        v = 0.012 * (11 - 2 * k) * np.cos((11 - 2 * k) * TIME) + 0.004 * 29 * np.cos(29 * TIME + k)
        taken: Array = TIME - DELAY
        if period > 0:
            taken = np.asarray((np.floor(taken / period - PHASE) + PHASE) * period)
        u = command(taken, k)
        read = force(v, u) + NOISE * rng.standard_normal(len(v))
        channels = {"displacement_m": x, "velocity_m_s": v, "command": command(TIME, k), "force_N": read}
        records.append(Record(f"{k}", None, DT, channels))
    problem = Problem(DamperRig(model(), tuple(records)), stride=stride, coarse=True)
    made = Search(problem, sum((NOISE / b.size) ** 2 for b in problem.blocks))
    term = next(t for t in problem.rig.terms if t.name == "command_delay")
    plain = Hypothesis((), (term,))
    return made, fit(problem, plain, plain.start((1,)))


@pytest.mark.parametrize("stride", [1, 5])
def test_period_and_phase_are_read_off_what_a_plain_delay_leaves(stride: int) -> None:
    made, plain = search(PERIOD, stride)
    assert plain.settings["command_delay_d"] == pytest.approx(DELAY + PERIOD / 2, abs=1e-3)
    hypothesis, start = next(sampled_delays(made.problem, plain))
    first = hypothesis.settings(start)
    assert first["command_delay_period"] == pytest.approx(PERIOD, rel=1e-3)
    assert first["command_delay_phase"] % 1 == pytest.approx(PHASE, abs=0.15)
    try_sampled_delay(made, plain)
    found = made.best(False)
    assert found is not None
    assert found.hypothesis.name == "command_delay:on a clock"
    assert found.cost < 0.3 * plain.cost
    assert found.settings["command_delay_period"] == pytest.approx(PERIOD, rel=2e-4)
    assert found.settings["command_delay_d"] == pytest.approx(DELAY, abs=5e-4)
    assert found.settings["command_delay_phase"] % 1 == pytest.approx(PHASE, abs=0.05)


def test_a_plain_delay_gets_no_clock() -> None:
    made, plain = search(0.0, 1)
    try_sampled_delay(made, plain)
    assert [f.hypothesis.name for f in made.ranked(False)] == ["parameters"]


@pytest.mark.slow
def test_a_lag_under_a_held_command_is_a_plain_one() -> None:
    """8 ms behind steps between constants, at 500 Hz: lines between the samples fit better as long as the lag lacks. A
    second pole, or a rate limit that acts in the first .6 ms of the largest steps, is nothing that the records show."""
    rng, records = np.random.default_rng(8), []
    for k in range(5):
        x = 0.012 * np.sin((11 - k) * TIME) + 0.004 * np.sin(29 * TIME + k)
        v = 0.012 * (11 - k) * np.cos((11 - k) * TIME) + 0.004 * 29 * np.cos(29 * TIME + k)
        given = np.repeat(rng.choice([0.0, 0.25, 0.5, 0.75, 1.0], len(TIME) // 100), 100)
        current = np.empty_like(given)
        current[0] = given[0]
        for j in range(1, len(given)):
            current[j] = given[j - 1] + (current[j - 1] - given[j - 1]) * np.exp(-DT / 0.008)
        read = force(v, current) + NOISE * rng.standard_normal(len(v))
        channels = {"displacement_m": x, "command": given, "force_N": read}
        records.append(Record(f"{k}", None, DT, channels))
    found = diagnose(Case("rig", Path(), model(), tuple(records), ()), jobs=1)
    assert found.corrected.hold
    assert [(e.effect, set(e.parameters)) for e in found.effects] == [("driver_lag", {"tau"})]
    assert found.effects[0].parameters["tau"] == pytest.approx(0.008, rel=0.01)


def test_the_duration_of_an_average_is_found_behind_its_walls() -> None:
    """A dashpot in random motion, whose displacement is averaged over 16 samples and has noise: a sum of sines, each
    times its sinc, also beyond the frequency that the average erases."""
    rng, dt, width = np.random.default_rng(3), 1e-3, 16e-3
    t, w = dt * np.arange(6000), 2 * np.pi * np.arange(0.5, 90.0, 0.5)
    phasor = 0.01 * (rng.standard_normal(len(w)) + 1j * rng.standard_normal(len(w))) / (1 + (w / 20) ** 1.5)
    waves = np.exp(1j * np.outer(t, w))
    x, v = (waves @ (phasor * np.sinc(w * width / (2 * np.pi)))).real, (waves @ (1j * w * phasor)).real
    channels = {
        "displacement_m": x + 2e-6 * rng.standard_normal(len(t)),
        "command": np.zeros_like(t),
        "force_N": 500 * v + 2.0 * rng.standard_normal(len(t)),
    }
    rig = DamperRig(Model("bingham", BINGHAM | {"fya": 0.0}), (Record("random", None, dt, channels),)).with_motion()
    search = Search(Problem(rig, coarse=True), 1e-6, Limits(base=0))
    terms = [term for term in rig.terms if term.name == "motion_lag:average"]
    (best,) = screen(search, search.fits[False, frozenset()], terms)
    found = search.fitted(*search.start_from(search.fits[False, frozenset()], best.term, best.start), most=15)
    assert found.settings["motion_lag_width"] == pytest.approx(width, rel=0.03)
