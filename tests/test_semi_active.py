"""Followers, Lyapunov, skyhook and ideal control: signs, closed forms and SciPy's integration."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from excitation import Array
from knowing import Known, Watching
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.control import Controller, ForceController, registry, skyhook
from mrdamp.control.base import ZeroOrderHold
from mrdamp.control.clipped_optimal import (
    OptimalForce,
    bang_bang,
    lyapunov,
    lyapunov_matrix,
    max_dissipation,
    optimal_force,
)
from mrdamp.control.force_control import Modulated, OnOff
from mrdamp.control.lqg import outputs, plant
from mrdamp.motions import kanai_tajimi
from mrdamp.simulation import stepping
from mrdamp.structures import ShearFrame, dyke1996
from refusals import refuses


def test_modulated_command_is_in_proportion_to_the_wanted_force() -> None:
    law = Modulated(2.0, 1000.0)
    for wanted, force, command in ((300, 100, 0.6), (2500, 100, 2), (-300, -100, 0.6), (300, 400, 0), (300, -10, 0)):
        assert law(wanted, 0.0, {"force": force}) == pytest.approx(command)


def left_roots(*coefficients: float) -> NDArray[np.complex128]:
    roots = np.roots(coefficients)
    return np.asarray(np.sort_complex(roots[roots.real < 0]))


def test_regulator_and_filter_of_one_storey_meet_their_closed_forms() -> None:
    # x'' = -w^2 x - f/m + noise. Spectral factors: s^4 + 2 w^2 s^2 + w^4 + q/(r m^2) for the regulator of x, and
    # s^4 + 2 w^2 s^2 + w^4 + S_g/S_v for the filter that measures x.
    r, ratio, w2, m = 2e-13, 3e7, 4.8e5 / 120.0, 120.0
    frame = ShearFrame(np.array([m]), np.array([w2 * m]), np.array([0.0]))
    aim = optimal_force(
        frame, regulate={"displacement_1": 1.0}, r=r, noise_ratio=ratio, measurements=["displacement_1"]
    )
    linear = plant(frame)
    regulated = np.linalg.eigvals(linear.a - np.outer(linear.b, aim.k))
    np.testing.assert_allclose(
        np.sort_complex(regulated), left_roots(1, 0, 2 * w2, 0, w2**2 + 1 / (r * m**2)), rtol=1e-6
    )
    c, _ = outputs(frame, ["displacement_1"])
    filtered = np.linalg.eigvals(linear.a - aim.estimator.gain @ c)
    np.testing.assert_allclose(
        np.sort_complex(filtered), left_roots(1, 0, 2 * w2, 0, w2**2 + ratio), rtol=1e-6
    )
    # A floor that is out and at rest is to be pulled back: the damper's rod end pulls with -f.
    assert aim.k[0] < 0
    assert aim.k[1] < 0


def test_lyapunov_matrix_is_the_cost_to_come() -> None:
    # s^T P s is the integral of the weighted outputs of the frame left alone.
    frame = replace(dyke1996(), damping=np.array([900.0, 700.0, 500.0]))
    weights = {"acceleration_3": 1.0, "drift_1": 4e5}
    a, (c, _) = plant(frame).a, outputs(frame, tuple(weights))
    q = c.T @ np.diag(list(weights.values())) @ c
    p = lyapunov_matrix(frame, weights)
    for start in ([1e-3, 0, 2e-3, 0, 0, 0.0], [0, 0, 1e-3, 0.1, -0.2, 0.05]):
        run = solve_ivp(
            lambda t, s: np.append(a @ s[:6], s[:6] @ q @ s[:6]),
            (0, 4.0),
            [*start, 0.0],
            method="DOP853",
            rtol=1e-8,
        )
        end = run.y[:6, -1]
        assert np.array(start) @ p @ start == pytest.approx(run.y[6, -1] + end @ p @ end, rel=1e-4)
        assert run.y[6, -1] > 0.9 * (np.array(start) @ p @ start)


@pytest.mark.parametrize("floors", [(0, 1), (1, 2), (3, 1)])
@pytest.mark.parametrize("energy", [True, False])
def test_bang_bang_is_on_where_the_force_takes_the_function_down(
    floors: tuple[int, int], energy: bool
) -> None:
    frame = dyke1996(damper_between=floors)
    made = (
        max_dissipation(frame, 2.0)
        if energy
        else lyapunov(frame, 2.0, {"drift_2": 1.0, "acceleration_1": 1e-6})
    )
    k = np.zeros((6, 6))
    k[:3, :3], k[3:, 3:] = frame.stiffness_matrix, frame.mass_matrix
    p = k if energy else lyapunov_matrix(frame, {"drift_2": 1.0, "acceleration_1": 1e-6})
    # M^-1 Gamma typed in: the damper pulls its rod end back.
    pull = np.zeros(4)
    pull[floors[1]], pull[floors[0]] = -1, 1
    b = np.concatenate([np.zeros(3), pull[1:] / 98.3])
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(40):
        state, force = rng.standard_normal(6) * 1e-3, float(rng.standard_normal() * 100)
        controller = bang_bang(-made.aim.k, Known(state), 2.0, 1e-3, "x")  # type: ignore[arg-type, attr-defined]
        on = controller.command(0.0, {"force": force}) > 0
        assert on == (2 * state @ p @ b * force < 0)
        seen.add(on)
    assert seen == {True, False}


@pytest.mark.parametrize(("floors", "floor", "sign"), [((0, 1), 1, 1.0), ((1, 3), 3, 1.0), ((2, 1), 2, -1.0)])
def test_skyhook_force_is_that_of_a_dashpot_to_the_sky(
    floors: tuple[int, int], floor: int, sign: float
) -> None:
    frame, h, tau, c = dyke1996(damper_between=floors), 2e-3, 0.15, 700.0
    controller = skyhook(frame, 2.0, damping=c, leak=tau, period=h)
    times = np.arange(200) * h
    a = 3 * np.sin(31 * times) + 0.5
    run = solve_ivp(
        lambda t, v: np.interp(t, times, a) - v / tau,
        (0, times[-1]),
        [0.0],
        rtol=1e-9,
        atol=1e-12,
        max_step=h,
    )
    for t, now in zip(times, a, strict=True):
        y = {f"acceleration_{j}": 99.0 for j in (1, 2, 3)} | {
            f"acceleration_{floor}": float(now),
            "force": 5.0,
        }
        command = controller.command(float(t), y)
    # A floor on its way up is to be held down; the damper does so where it is being extended and sits below.
    assert controller.wanted == pytest.approx(sign * c * run.y[0, -1], rel=1e-5)
    assert command == (2.0 if controller.wanted > 5.0 else 0.0)


def test_a_held_controller_is_asked_at_its_own_period() -> None:
    inner = Watching(lambda t: 2.0 * math.sin(60.0 * t), 5e-3)
    held = ZeroOrderHold(inner, 5)
    assert held.period == pytest.approx(1e-3)
    held.reset()
    commands = [held.command(k * 1e-3, {"force": float(k)}) for k in range(11)]
    assert [y["force"] for y in inner.seen] == [0.0, 5.0, 10.0]
    assert commands[5:10] == [pytest.approx(2.0 * math.sin(60 * 5e-3))] * 5
    refuses(lambda: ZeroOrderHold(inner, 0), "held over 0")


@pytest.mark.parametrize("floors", [(0, 1), (1, 2), (3, 1)])
def test_an_ideal_force_moves_the_frame_as_scipy_has_it(floors: tuple[int, int]) -> None:
    frame = dyke1996(damper_between=floors)
    model = replace(frame_model(), structure=frame)
    motion = kanai_tajimi(5, duration=3.0).compressed(5.0)
    script = Watching(lambda t: 400.0 * math.sin(60.0 * t), 5e-4)
    run = stepping.run_frame(model, motion, script, timestep=1.25e-4, ideal_force=True)
    gamma = np.zeros(4)
    gamma[floors[1]], gamma[floors[0]] = -1, 1
    inverse = np.linalg.inv(frame.mass_matrix)

    def rate(t: float, s: Array) -> Array:
        force = 400.0 * math.sin(60.0 * 5e-4 * math.floor(t / 5e-4 + 1e-9))
        ground = np.interp(t, motion.time, motion.acceleration)
        a = (
            inverse @ (gamma[1:] * force - frame.stiffness_matrix @ s[:3] - frame.damping_matrix @ s[3:])
            - ground
        )
        return np.concatenate([s[3:], a])

    s, states = np.zeros(6), [np.zeros(6)]
    for k in range(len(run.time) - 1):  # piece by piece: the force jumps
        step = solve_ivp(rate, (run.time[k], run.time[k + 1] - 1e-12), s, rtol=1e-7, atol=1e-10)
        s = step.y[:, -1]
        states.append(s)
    x = np.array(states)[:, :3]
    off = np.abs(np.cumsum(run.drift, axis=1) - x).max() / np.abs(x).max()
    assert off < 5e-3
    stroke = x @ -gamma[1:]
    np.testing.assert_allclose(run.stroke, stroke, atol=6e-3 * np.abs(stroke).max())
    velocity = np.array(states)[:, 3:] @ -gamma[1:]
    seen = np.array([y["stroke_velocity"] for y in script.seen])
    np.testing.assert_allclose(seen, velocity, atol=0.03 * np.abs(velocity).max())
    # What the actuator's load cell reads is the force of the period that ended.
    np.testing.assert_allclose(run.force[1:], run.command[:-1])
    assert not run.current.any()


SITE = registry.Site.of(frame_model())


def test_every_named_controller_is_one() -> None:
    y = {f"acceleration_{j}": -0.5 * j for j in (1, 2, 3)} | {f"displacement_{j}": -1e-3 for j in (1, 2, 3)}
    y |= {"stroke_velocity": 0.05, "force": 60.0}
    for kind in registry.OPTIONS:
        controller = registry.make("constant:value=1" if kind == "constant" else kind, SITE)
        assert isinstance(controller, Controller)
        assert controller.period == SITE.period
        runs = []
        for _ in range(2):
            controller.reset()
            runs.append([controller.command(k * SITE.period, {**y, "stroke": 5e-5 * k}) for k in range(30)])
        assert runs[0] == runs[1], kind
        assert np.isfinite(runs[0]).all(), kind
        if not registry.is_ideal(kind):
            assert all(0 <= u <= SITE.command_max for u in runs[0]), kind


def test_options_reach_the_controller() -> None:
    tuned = registry.make("clipped-optimal:r=1e-9,balance=2", SITE)
    assert isinstance(tuned, ForceController)
    assert isinstance(tuned.follower, OnOff)
    wanted = optimal_force(dyke1996(), regulate=registry.balanced(dyke1996(), 2.0), r=1e-9).k
    assert isinstance(tuned.aim, OptimalForce)
    np.testing.assert_allclose(tuned.aim.k, wanted)
    assert registry.parse(registry.spec("constant", {"value": 0.75})) == ("constant", "", {"value": 0.75})
    # With balance 1, a drift x and an acceleration w1^2 x cost the same.
    weights = registry.balanced(dyke1996(), 1.0)
    assert weights["drift_1"] == pytest.approx((2 * np.pi * 5.44) ** 4, rel=2e-3)
