"""Storeys that are no straight springs: SciPy's frame against the C entry's, and `unknown` because of one."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from excitation import Array
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.frame_run import judge
from mrdamp.diagnosis.hypotheses.outside_storeys import bent
from mrdamp.diagnosis.problem.frame import FrameRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model import Model, core
from mrdamp.model.core import FrameInput
from mrdamp.records import Record
from mrdamp.structures import ShearFrame

DT, N = 0.002, 1200
MASS, STIFFNESS, DAMPING = np.array([98.0, 90.0]), np.array([5e5, 6e5]), np.array([120.0, 60.0])
LAW = {
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
        damper = LAW["c0a"] * y[2] + LAW["fya"] * np.tanh(y[2] / LAW["v_ref"])
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
    got = core.run_frame("bingham", LAW, bent(settings, FRAME), DT, ground, 0.0)
    for name, want in twin(ground, spring, yields).items():
        assert np.std(got[name] - want) < 1e-2 * np.std(want), name
    straight = twin(ground, crack(0.0, 1.0))["acceleration_2"]
    assert np.std(got["acceleration_2"] - straight) > 0.05 * np.std(straight)


def measured(spring: Spring, noise: float = 0.01) -> tuple[tuple[Record, ...], Array]:
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
    records, noise = measured(spring)
    model = Model("bingham", LAW, (), "frame", ShearFrame(MASS, STIFFNESS, DAMPING, (0, 1)), name="frame")
    clean = frozenset({"damper", "storey 1", "accelerometer 1", "accelerometer 2"})
    rig = FrameRig(model, records, 4, clean, placed=True)
    problem = Problem(rig, coarse=True)
    search = Search(problem, problem.cost(noise / 2), Limits(singles=4, base=2))  # means of four samples
    search.extend(False, 1)
    search.outside()
    decision = judge(search, rig)[1]
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
