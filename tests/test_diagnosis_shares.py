"""Where the gap lies and how sure that is; storeys that are no straight springs, SciPy's against the C entry's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from bingham_rig import LAW, model
from excitation import Array
from mrdamp.diagnosis import frame_run
from mrdamp.diagnosis.attribution.interfaces import parts
from mrdamp.diagnosis.attribution.stages import stage_shares
from mrdamp.diagnosis.damper_run import judge
from mrdamp.diagnosis.evidence.resample import spread
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.outside_storeys import bent
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Hypothesis
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.frame import FrameRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model import Model, core
from mrdamp.model.core import FrameInput
from mrdamp.records import Record
from mrdamp.structures import ShearFrame
from studies.blindtest import rig as reference
from studies.blindtest.bench import Truth, damper_channels, logged
from studies.blindtest.excitation import GRID_HZ, Excitation
from toy_rig import ToyRig, searched, toy

NOISE = 4.0  # N


@dataclass(frozen=True)
class Bench:
    """The reference rig's channels for two tests, and its own error of the whole and of its parts."""

    records: tuple[Record, ...]
    shares: tuple[float, float, float]


def measured(
    inner: dict[str, float], outside: dict[str, float], channels: tuple[str, ...], noise: float = NOISE
) -> Bench:
    """Two tests with a changing current. Shares of driver, body and sensor by the rig's own forces, free of noise."""
    rng = np.random.default_rng(4)
    truth = Truth({"law": 0.0, **LAW, **inner}, outside)
    records, sums = [], []
    t = np.arange(4 * GRID_HZ + 1) / GRID_HZ
    for k, hz in enumerate((0.9, 2.3)):
        u = 0.5 + 0.5 * np.sign(np.sin(2 * np.pi * (1.7 + k) * t))
        test = Excitation("test", 0.008 * np.sin(2 * np.pi * hz * t), u)
        clean = damper_channels(truth, test, rng)
        kept = {n: clean[n] for n in ("displacement_m", "command", "force_N", *channels)}
        kept["force_N"] = kept["force_N"] + noise * rng.standard_normal(len(kept["force_N"]))
        time = np.arange(len(kept["command"])) / 500.0
        records.append(Record(f"{k}", None, 1 / 500.0, {"time_s": time, **kept}))
        motion = test.spline()
        x, v = motion(test.time), motion(test.time, 1)
        believed = {"law": 0.0, **LAW}
        whole = reference.run_damper(believed, x, v, test.fine(u))["force"]
        current = np.repeat(reference.run_damper(truth.numbers, x, v, test.fine(u))["current"], 2)[1:]
        driven = reference.run_damper(believed, x, v, current)["force"]
        e = [logged(truth, whole - driven), logged(truth, driven) - clean["reference_force_N"]]
        e.append(clean["reference_force_N"] - clean["force_N"])
        keep = slice(50, -8)
        size = np.sum(clean["force_N"][keep] ** 2)
        sums.append([np.sum(part[keep] * np.sum(e, axis=0)[keep]) / size for part in e])
    total = np.sum(sums, axis=0)
    driver, body, sensor = (total / (total.sum() or 1.0)).tolist()
    return Bench(tuple(records), (driver, body, sensor))


BOTH = ("current_A", "reference_force_N")
LAG = {"lag_form": 1.0, "lag_tau": 0.02, "lag_tau2": 0.004}
STIFF = {"c0a": 900.0, "c0b": 1000.0}


@pytest.mark.parametrize(
    ("inner", "outside"),
    [
        (LAG, {}),
        ({**LAG, **STIFF}, {"sensor.gain": 0.1}),
        (STIFF, {"sensor.gain": -0.08}),
    ],
)
def test_measured_signals_part_the_chain(inner: dict[str, float], outside: dict[str, float]) -> None:
    made = measured(inner, outside, BOTH)
    found = parts(DamperRig(model(), made.records), NOISE)
    assert [m.stages for m in found.found] == [
        ("driver",), ("magnetics", "fluid", "mechanics", "mount"), ("sensor",),
    ]  # fmt: skip
    assert sum(m.share for m in found.found) == pytest.approx(1.0)
    for m, want in zip(found.found, made.shares, strict=True):
        assert m.share == pytest.approx(want, abs=0.03), m.between
        assert m.interval[0] - 0.03 <= want <= m.interval[1] + 0.03
        assert m.interval[0] <= m.share <= m.interval[1]


def test_noise_of_the_own_sensor_is_no_fault_of_it() -> None:
    made = measured(STIFF, {}, BOTH, noise=8.0)
    rig = DamperRig(model(), made.records)
    assert abs(parts(rig, 8.0).found[2].share) < 0.08
    assert parts(rig, 0.0).found[2].share > 0.15
    # And where there is nothing but noise, nothing is shared.
    still = measured({}, {}, BOTH, noise=8.0)
    assert parts(DamperRig(model(), still.records), 8.0).found == ()


def test_what_is_not_measured_stays_together_and_says_what_would_part_it() -> None:
    current = parts(DamperRig(model(), measured(LAG, {}, ("current_A",)).records), NOISE).found
    assert [m.stages[0] for m in current] == ["driver", "magnetics"]
    assert current[0].share == pytest.approx(1.0, abs=0.05)
    assert current[1].part_by == "reference_force_N"
    load = parts(DamperRig(model(), measured(LAG, {}, ("reference_force_N",)).records), NOISE).found
    assert [m.part_by for m in load] == ["current_A", ""]
    assert parts(DamperRig(model(), measured(LAG, {}, ()).records), NOISE).found == ()


def test_a_current_in_another_unit_than_the_command_counts_by_its_shape() -> None:
    made = measured(LAG, {}, ("current_A",))
    scaled = tuple(r.with_channels({"current_A": 0.5 * r.channel("current_A")}) for r in made.records)
    plain, other = (parts(DamperRig(model(), records), NOISE).found for records in (made.records, scaled))
    assert other[0].share == pytest.approx(plain[0].share, abs=0.15)


def test_intervals_of_shares_hold_the_shares_and_widen_with_the_noise() -> None:
    widths = []
    for noise in (0.02, 0.15):
        search = searched({"sign": 0.6, "offset": 0.3}, noise)
        fits, decision = judge(search)
        chosen = fits[decision.chosen.index]
        shares, found = stage_shares(search, chosen, decision.verdict)
        assert set(found) == set(shares)
        for stage, (low, high) in found.items():
            assert low - 1e-9 <= shares[stage] <= high + 1e-9, stage
        low, high = found["mechanics"]
        assert low <= 0.8 <= high  # the squares, .36 to .09
        widths.append(high - low)
    assert 0 < widths[0] < widths[1]


def fitted(rig: ToyRig) -> tuple[Problem, Fit]:
    problem = Problem(rig)
    chosen = tuple(t for t in rig.terms if t.effect in ("sign", "offset"))
    hypothesis = Hypothesis(rig.nominal, chosen)
    return problem, fit(problem, hypothesis, hypothesis.start(), tolerance=1e-8)


TRUTH = {"gain": 2.1, "sign": 0.3, "offset": 0.2}


def test_intervals_of_parameters_hold_the_truth_as_often_as_they_say() -> None:
    hits, widths, values = [], [], []
    for seed in range(60):
        problem, found = fitted(toy(TRUTH, 0.5, seed=seed, n=400))
        ends = spread(problem, found).intervals()
        hits += [ends[k][0] <= v <= ends[k][1] for k, v in TRUTH.items()]
        widths.append(ends["offset"][1] - ends["offset"][0])
        values.append(found.settings["offset"])
    assert 0.88 < np.mean(hits) <= 1.0
    # The width of 95 % of a normal distribution, of what the fits themselves scatter by.
    assert np.mean(widths) == pytest.approx(3.92 * np.std(values), rel=0.35)


def coloured(rig: ToyRig, size: float, seed: int) -> ToyRig:
    rng = np.random.default_rng(seed)
    records = []
    for r in rig.records:
        slow = lfilter([np.sqrt(1 - 0.96**2)], [1, -0.96], rng.standard_normal(r.n + 300))[300:]
        records.append(r.with_channels({"force_N": r.channel("force_N") + size * slow}))
    return replace(rig, records=tuple(records))


def test_noise_that_is_alike_from_sample_to_sample_widens_an_interval() -> None:
    hits, ratio = [], []
    for seed in range(40):
        white = toy(TRUTH, 0.0, seed=seed)
        problem, found = fitted(coloured(white, 0.3, seed))
        ends = spread(problem, found).intervals()["offset"]
        hits.append(ends[0] <= TRUTH["offset"] <= ends[1])
        # What least squares says where samples are taken for independent.
        j = found.jacobian
        each = found.cost / problem.samples * np.linalg.inv(j.T @ j)[-1, -1]
        ratio.append((ends[1] - ends[0]) / (3.92 * np.sqrt(each) * 0.1))
    assert np.mean(hits) > 0.82
    assert np.median(ratio) > 3.0


def test_what_the_records_do_not_show_has_its_whole_range_as_its_interval() -> None:
    rig = toy({"gain": 2.2})
    problem, unseen = Problem(rig), Coordinate("offset", 0.0, -5.0, 3.0, 0.1, prior=3.0)
    found = fit(problem, Hypothesis(rig.nominal), np.zeros(1))
    both = Hypothesis((*rig.nominal, unseen))
    blind = np.hstack([found.jacobian, np.zeros((problem.samples, 1))])
    found_both = replace(found, hypothesis=both, point=np.append(found.point, 0.0), jacobian=blind)
    ends = spread(problem, found_both).intervals()
    assert ends["offset"] == pytest.approx((-4.8, 2.8), abs=0.01)  # 95 % of the range
    assert ends["gain"] == pytest.approx(spread(problem, found).intervals()["gain"])


DT, N = 0.002, 1200
MASS, STIFFNESS, DAMPING = np.array([98.0, 90.0]), np.array([5e5, 6e5]), np.array([120.0, 60.0])
DAMPER = {
    "c0a": 300.0,
    "c0b": 100.0,
    "fya": 20.0,
    "fyb": 10.0,
    "v_ref": 0.01,
}  # the damper in storey 1, without command
FRAME = FrameInput(MASS, STIFFNESS, DAMPING, (0, 1))

Spring = Callable[[float, float], float]


def crack(share: float, side: float) -> Spring:
    return lambda x, _: STIFFNESS[1] * x * (1 - share if side * x > 0 else 1.0)


def shaken(seed: int) -> Array:
    """m/s2: sines below 10 Hz from rest."""
    t, rng = DT * np.arange(N), np.random.default_rng(seed)
    sines = [rng.normal() * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in rng.uniform(1, 10, 12)]
    return np.asarray(np.sum(sines, axis=0) * np.minimum(t / 0.3, 1.0))


def twin(ground: Array, spring: Spring, yields: float = np.inf) -> dict[str, Array]:
    """Displacements, absolute accelerations and the damper's force of a frame whose storey 2 is `spring`: its force
    at a drift (m) and at a stretch (m) of what slides more and more, wholly at `yields`."""
    t = DT * np.arange(N)

    def forces(y: Array) -> tuple[float, float, float]:
        damper = DAMPER["c0a"] * y[2] + DAMPER["fya"] * np.tanh(y[2] / DAMPER["v_ref"])
        first = STIFFNESS[0] * y[0] + DAMPING[0] * y[2] + damper
        return first, spring(y[1] - y[0], y[4]) + DAMPING[1] * (y[3] - y[2]), damper

    def rates(at: float, y: Array) -> list[float]:
        first, second, _ = forces(y)
        a = np.interp(at, t, ground)
        v = y[3] - y[2]
        stretches = v - abs(v) * y[4] / yields
        return [y[2], y[3], (second - first) / MASS[0] - a, -second / MASS[1] - a, stretches]

    y = solve_ivp(rates, (0, t[-1]), np.zeros(5), t_eval=t, rtol=1e-7, atol=1e-11, max_step=DT).y
    first, second, damper = np.array([forces(column) for column in y.T]).T
    return {
        "displacement_1": y[0], "displacement_2": y[1],
        "acceleration_1": (second - first) / MASS[0], "acceleration_2": -second / MASS[1], "force": damper,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("settings", "spring", "yields"),
    [
        ({"outside_crack_share@2": 0.4, "outside_crack_side@2": 1.0}, crack(0.4, 1.0), np.inf),
        ({"outside_crack_share@2": 0.4, "outside_crack_side@2": -1.0}, crack(0.4, -1.0), np.inf),
        ({"outside_cubic@2": 4e10}, lambda x, _: STIFFNESS[1] * x + 4e10 * x**3, np.inf),
        (
            {"outside_yield_share@2": 0.4, "outside_yield_drift@2": 5e-4},
            lambda x, z: STIFFNESS[1] * (0.6 * x + 0.4 * z),
            5e-4,
        ),
    ],
    ids=["crack", "crack on the other side", "hardening", "yielding"],
)
def test_a_storeys_spring_is_that_of_scipy(
    settings: Mapping[str, float], spring: Spring, yields: float
) -> None:
    ground = shaken(2)
    got = core.run_frame("bingham", DAMPER, bent(settings, FRAME), DT, ground, 0.0)
    for name, want in twin(ground, spring, yields).items():
        assert np.std(got[name] - want) < 1e-2 * np.std(want), name
    straight = twin(ground, crack(0.0, 1.0))["acceleration_2"]
    assert np.std(got["acceleration_2"] - straight) > 0.05 * np.std(straight)


def records_of(spring: Spring, noise: float = 0.01) -> tuple[tuple[Record, ...], Array]:
    rng, out, gaps = np.random.default_rng(5), [], []
    names = {
        f"{kind}_{j}": f"floor{j}_{kind}_{unit}"
        for kind, unit in (("acceleration", "m_s2"), ("displacement", "m"))
        for j in (1, 2)
    }
    for seed in (3, 4):
        ground = shaken(seed)
        channels: dict[str, Array] = {
            "time_s": np.linspace(0, DT * (N - 1), N),
            "ground_acceleration_m_s2": ground,
            "command": np.zeros(N),
        }
        run = twin(ground, spring)
        for name, channel in (*names.items(), ("force", "force_N")):
            channels[channel] = run[name] + rng.normal(0, noise * np.std(run[name]), N)
            gaps.append(noise)
        out.append(Record(f"shaken {seed}", None, DT, channels))
    return tuple(out), np.array(gaps)


def judged(spring: Spring) -> tuple[Search, str, Mapping[str, float]]:
    records, noise = records_of(spring)
    model = Model("bingham", DAMPER, (), "frame", ShearFrame(MASS, STIFFNESS, DAMPING, (0, 1)), name="frame")
    clean = frozenset({"damper", "storey 1", "accelerometer 1", "accelerometer 2"})
    rig = FrameRig(model, records, 4, clean, placed=True)
    problem = Problem(rig, coarse=True)
    search = Search(problem, problem.cost(noise / 2), Limits(singles=4, base=2))  # means of four samples
    search.extend(False, 1)
    search.outside()
    decision = frame_run.judge(search, rig)[1]
    return search, decision.verdict, {} if search.looks_like is None else search.looks_like.settings


def test_a_crack_is_unknown_and_looks_like_one() -> None:
    search, verdict, settings = judged(crack(0.2, -1.0))
    assert verdict == "unknown"
    assert search.looks_like is not None
    assert search.looks_like.hypothesis.causes == ("storey_crack@2",)
    assert settings["outside_crack_share@2"] == pytest.approx(0.2, abs=0.01)
    assert settings["outside_crack_side@2"] == -1.0


def test_a_soft_storey_stays_what_it_is() -> None:
    search, verdict, _ = judged(lambda x, _: 0.85 * STIFFNESS[1] * x)
    assert verdict == "effect"
    best = search.best(False)
    assert best is not None
    assert best.hypothesis.causes == ("storey_stiffness@2",)
