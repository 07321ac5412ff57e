"""The frame's C entry against an independent integration of the same equations by SciPy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim, lti

from dampers import off
from mrdamp.model import core
from mrdamp.model.core import Array, FrameInput
from mrdamp.simulation.floor_sensors import FloorSensors
from refusals import refuses

BOUC_WEN = {
    "c0a": 300.0, "c0b": 150.0, "alpha_a": 60.0, "alpha_b": 250.0, "gamma": 900.0, "beta": 600.0, "A": 1500.0,
    "n": 2.0, "k0": 800.0, "x0": 0.0,
}  # fmt: skip
DT = 0.002
TIME = np.arange(0, 1.0, DT)


def motion(t: Array | float) -> Array:
    parts = ((1.1, 3.1, 0.3), (0.9, 5.6, 1.9), (0.5, 11.3, 4.0))
    return np.asarray(sum(a * np.sin(2 * np.pi * f * np.asarray(t) + p) for a, f, p in parts))


def command(t: Array | float) -> Array:
    return np.asarray(1.0 + 0.8 * np.sin(2 * np.pi * 1.3 * np.asarray(t)))


def reference(frame: FrameInput, tau: float, friction: float = 0.0, storey: int = 0) -> dict[str, Array]:
    """States x, v, z, i; dry friction of one storey as a steep tanh."""
    n = len(frame.mass)
    chain = np.eye(n) - np.eye(n, k=-1)  # drift = chain @ x
    k, c = chain.T @ np.diag(frame.stiffness) @ chain, chain.T @ np.diag(frame.damping) @ chain
    assert frame.damper_between is not None
    along = np.zeros(n + 1)
    along[frame.damper_between[1]], along[frame.damper_between[0]] = 1.0, -1.0
    along = along[1:]
    p = BOUC_WEN

    def law(x: Array, v: Array, z: float, i: float) -> tuple[float, float]:
        stroke, rate = float(along @ x), float(along @ v)
        force = (p["c0a"] + p["c0b"] * i) * rate + (p["alpha_a"] + p["alpha_b"] * i) * z + p["k0"] * stroke
        slope = p["A"] * rate - p["gamma"] * abs(rate) * z * abs(z) - p["beta"] * rate * z * z
        return force, slope

    def acceleration(x: Array, v: Array, force: float) -> Array:
        dry = np.zeros(n)
        dry[storey] = friction * np.tanh((chain @ v)[storey] / 2e-4)
        return np.asarray((-k @ x - c @ v - along * force - chain.T @ dry) / frame.mass)

    def rhs(t: float, s: Array) -> Array:
        x, v, z, i = s[:n], s[n : 2 * n], float(s[-2]), float(s[-1])
        force, slope = law(x, v, z, i)
        push = acceleration(x, v, force) - float(np.interp(t, TIME, motion(TIME)))
        return np.concatenate([v, push, [slope, (float(np.interp(t, TIME, command(TIME))) - i) / tau]])

    start = np.zeros(2 * n + 2)
    start[-1] = command(0.0)
    s = solve_ivp(
        rhs, (0, TIME[-1]), start, t_eval=TIME, method="LSODA", rtol=1e-8, atol=1e-10, max_step=DT
    ).y
    forces = np.array([law(s[:n, j], s[n : 2 * n, j], s[-2, j], s[-1, j])[0] for j in range(len(TIME))])
    out = {f"displacement_{j + 1}": s[j] for j in range(n)} | {"force": forces, "current": s[-1]}
    absolute = [acceleration(s[:n, j], s[n : 2 * n, j], forces[j]) for j in range(len(TIME))]
    return out | {f"acceleration_{j + 1}": np.array(absolute)[:, j] for j in range(n)}


def frame_of(n: int, between: tuple[int, int], friction: Array | None = None) -> FrameInput:
    rng = np.random.default_rng(n)
    mass = rng.uniform(60, 120, n)
    return FrameInput(mass, rng.uniform(1e5, 3e5, n), rng.uniform(40, 150, n), between, friction)


def run(frame: FrameInput, u: Array | float = 1.0, **more: float) -> dict[str, Array]:
    return core.run_frame("bouc_wen", BOUC_WEN | more, frame, DT, motion(TIME), u)


@pytest.mark.parametrize(("n", "between"), [(1, (0, 1)), (3, (1, 3)), (3, (2, 1))])
def test_frame_agrees_with_scipy(n: int, between: tuple[int, int]) -> None:
    frame, tau = frame_of(n, between), 0.015
    want = reference(frame, tau)
    got = run(frame, command(TIME), driver_lag_tau=tau)
    for name, values in want.items():
        assert off(got[name], values) < 2e-3, name


def test_dry_friction_in_a_storey_agrees_with_scipy() -> None:
    friction = np.array([0.0, 60.0, 0.0])
    frame = frame_of(3, (0, 1), friction)
    want = reference(frame, 0.015, 60.0, 1)
    got = run(frame, command(TIME), driver_lag_tau=0.015)
    for name in ("displacement_1", "displacement_2", "displacement_3"):
        assert off(got[name], want[name]) < 0.02, name  # the steep tanh is not quite dry
    # With the width of that tanh it is the same equation.
    wide = replace(frame, friction_width=np.array([0.0, 2e-4, 0.0]))
    got = run(wide, command(TIME), driver_lag_tau=0.015)
    for name in ("displacement_1", "displacement_2", "displacement_3", "force"):
        assert off(got[name], want[name]) < 3e-3, name
    # It matters: the same frame without it is far off.
    plain = run(frame_of(3, (0, 1)), command(TIME), driver_lag_tau=0.015)
    assert off(plain["displacement_2"], want["displacement_2"]) > 0.1


def test_dry_friction_that_builds_up_over_a_long_drift_is_a_spring() -> None:
    """Far below its limit a bristle gives sigma x with sigma = F / drift."""
    limit, drift = 2e5, 1.0
    plain = frame_of(3, (0, 1), np.array([0.0, limit, 0.0]))
    rubbing = replace(plain, friction_presliding=np.array([0.0, drift, 0.0]))
    stiffer = replace(plain, friction=None, stiffness=plain.stiffness + np.array([0.0, limit / drift, 0.0]))
    got, want = (run(f) for f in (rubbing, stiffer))
    for name in ("displacement_1", "displacement_2", "displacement_3", "force"):
        assert off(got[name], want[name]) < 0.02, name
    without = run(replace(plain, friction=None))
    assert off(without["displacement_2"], want["displacement_2"]) > 0.1


def test_a_dashpot_that_grows_with_the_velocity() -> None:
    """Against SciPy, of a frame without a damper: c v + c2 |v| v in the first storey."""
    plain = replace(frame_of(2, (0, 1)), damper_between=None)
    c2 = 40 * float(plain.damping[0])
    chain = np.eye(2) - np.eye(2, k=-1)
    k = chain.T @ np.diag(plain.stiffness) @ chain

    def rhs(t: float, s: Array, c2: float) -> Array:
        rate = chain @ s[2:]
        force = chain.T @ (plain.damping * rate + np.array([c2 * abs(rate[0]) * rate[0], 0.0])) + k @ s[:2]
        return np.concatenate([s[2:], -force / plain.mass - float(np.interp(t, TIME, motion(TIME)))])

    want, linear = (
        solve_ivp(
            rhs, (0, TIME[-1]), np.zeros(4), args=(c,), t_eval=TIME, max_step=DT, rtol=1e-8, atol=1e-10
        ).y
        for c in (c2, 0.0)
    )
    got = run(replace(plain, damping2=np.array([c2, 0.0])))
    assert off(got["displacement_2"], want[1]) < 2e-3 < 0.05 < off(linear[1], want[1])


def test_many_frames_are_the_same_on_any_number_of_threads() -> None:
    frames = [frame_of(3, (0, 1)), frame_of(2, (1, 2)), frame_of(4, (0, 2))]
    vectors = np.array([core.vector("bouc_wen", BOUC_WEN | {"alpha_b": b}) for b in (100.0, 250.0, 400.0)])
    runs = [
        core.run_frame_many("bouc_wen", vectors, frames, DT, motion(TIME), command(TIME), threads=t)
        for t in (1, 3)
    ]
    for one, three in zip(*runs, strict=True):
        for name in one:
            np.testing.assert_array_equal(one[name], three[name])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"mass": np.array([1.0, -1.0])}, "mass_kg of storey 2"),
        ({"stiffness": np.array([0.0, 1.0])}, "stiffness_n_m of storey 1"),
        ({"damper_between": (0, 3)}, "damper_between"),
        ({"acc_settle_time": np.array([0.0, -1.0])}, "acc_settle_time of floor 2 is -1"),
        ({"sway": (0.0, 1.0, 1.0)}, "sway_mass"),
    ],
)
def test_a_bad_frame_is_told(change: dict[str, object], said: str) -> None:
    parts: dict[str, Any] = dict.fromkeys(("mass", "stiffness", "damping"), np.ones(2)) | {"damper_between": (0, 1)}
    refuses(lambda: run(FrameInput(**(parts | change))), said)


def test_a_foundation_that_sways_and_rocks() -> None:
    """Against the equations in deformations (storeys, base, angle), heights in m, with a dashpot as damper."""
    m, k, c, height = np.full(3, 98.3), np.array([516e3, 684e3, 684e3]), np.array([125.0, 50.0, 50.0]), 0.5
    base, soil, loss = 100.0, 4e6, 2e3  # kg, N/m, N s/m
    inertia, turning, turned = 20.0, 1.5e6, 600.0  # kg m2, N m, N m s
    dashpot = 800.0
    floors = np.column_stack([np.eye(3), np.ones(3), height * np.arange(1, 4)])  # displacement of the floors
    chain = np.eye(3) - np.eye(3, k=-1)
    mass = floors.T @ np.diag(m) @ floors + np.diag([0, 0, 0, base, inertia])
    stiffness, damping = np.diag([0.0, 0, 0, soil, turning]), np.diag([dashpot, 0, 0, loss, turned])
    stiffness[:3, :3] += chain.T @ np.diag(k) @ chain
    damping[:3, :3] += chain.T @ np.diag(c) @ chain
    load = -floors.T @ m - [0, 0, 0, base, 0]
    ag = motion(TIME)

    def rates(t: float, y: Array) -> Array:
        pushed = load * np.interp(t, TIME, ag) - stiffness @ y[:5] - damping @ y[5:]
        return np.concatenate([y[5:], np.linalg.solve(mass, pushed)])

    y = solve_ivp(rates, (0, TIME[-1]), np.zeros(10), t_eval=TIME, rtol=1e-8, atol=1e-12, max_step=DT).y
    absolute = ag + floors @ np.array([rates(t, row)[5:] for t, row in zip(TIME, y.T, strict=True)]).T
    frame = FrameInput(
        m, k, c, (0, 1), sway=(base, soil, loss),
        rock=(inertia / height**2, turning / height**2, turned / height**2),
    )  # fmt: skip
    law = {"c0a": dashpot, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.1}
    found = core.run_frame("bingham", law, frame, DT, ag)
    for j in range(3):
        assert off(found[f"displacement_{j + 1}"], (floors @ y[:5])[j]) < 1e-4
        assert off(found[f"acceleration_{j + 1}"], absolute[j]) < 1e-4


SENSED: Mapping[str, Mapping[str, list[float]]] = {
    "poles": {"acc_gain": [1.0, 1.25], "acc_lag": [0.0, 0.01], "acc_lag2": [0.0, 0.004], "acc_offset": [0.2, 0.0]},
    "second order": {"acc_lag": [0.012, 0.01], "acc_ratio": [0.7, 0.0], "acc_gain": [1.2, 0.9]},
    "third order": {"acc_lag": [0.012, 0.01], "acc_ratio": [0.7, 0.0], "acc_lag2": [0.006, 0.003]},
    "two leaks": {"acc_leakage": [0.1, 0.0], "acc_leakage_share": [0.3, 0.0], "acc_leakage2": [0.6, 0.0]},
    "settling": {"acc_settle": [0.5, -0.3], "acc_settle_time": [0.4, 0.0], "acc_lag": [0.01, 0.0]},
    "settling in a second": {"acc_settle": [0.7, 0.0]},
    "a share that stays": {"acc_leakage": [0.1, 0.2], "acc_leakage_share": [0.3, 0.0]},
}


def reading(
    y: Array, gain: float = 1.0, offset: float = 0.0, settle: float = 0.0, settle_time: float = 0.0, lag: float = 0.0,
    ratio: float = 0.0, lag2: float = 0.0, leakage: float = 0.0, leakage_share: float = 0.0, leakage2: float = 0.0,
) -> Array:  # fmt: skip
    """What a floor's sensor reads of its acceleration y (n,): gain, leaks, lags and offset, by SciPy."""
    charge = gain * y

    def leaked(tau: float) -> Array:
        change = lsim(lti([1, 0], [1, 1 / tau]), charge - charge[0], TIME)[1] if tau else 0.0
        return np.asarray(charge[0] * np.exp(-TIME / tau) + change) if tau else charge

    read = (1 - leakage_share) * leaked(leakage) + leakage_share * leaked(leakage2)
    first = lti([1], [lag or 1e-9, 1])
    if ratio:
        w = 2 * ratio / lag
        first = lti([w**2], [1, 2 * ratio * w, w**2])
    for pole, system in ((lag, first), (lag2, lti([1], [lag2 or 1e-9, 1]))):
        if pole:
            read = read[0] + lsim(system, read - read[0], TIME)[1]
    return np.asarray(read + offset + settle * np.exp(-TIME / (settle_time or 1.0)))


@pytest.mark.parametrize("what", SENSED)
def test_floor_sensors_are_filters_of_scipy(what: str) -> None:
    """Those of the C entry; an environment's own read as they do."""
    given = {name: np.array(values) for name, values in SENSED[what].items()}
    plain = frame_of(2, (0, 1))
    sensed = replace(plain, **({"acc_gain": np.ones(2)} | given))
    found = (run(f) for f in (plain, sensed))
    true, read = (np.column_stack([out["acceleration_1"], out["acceleration_2"]]) for out in found)
    for floor in range(2):
        own = {name.removeprefix("acc_"): values[floor] for name, values in SENSED[what].items()}
        assert off(read[:, floor], reading(true[:, floor], **own)) < 1e-5, floor
    sensors = FloorSensors(sensed, DT, 3)
    got = [sensors.read(np.repeat(true[:1], 3, axis=0), (0, 1, 2))]
    got += [sensors.read(np.repeat(row[None], 3, axis=0), None) for row in true[1:]]
    for row in range(3):
        np.testing.assert_allclose([g[row] for g in got], read, rtol=1e-9, atol=1e-9)
    assert np.abs(read - true).max() > 0.1  # the sensor changes something
