"""The damper in MuJoCo: the C chain on a driven rig, SciPy on free structures, signs."""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dampers import attributes, excitation, rms, sample
from excitation import Array
from mjcf_builders import (
    BINGHAM,
    BOUC_WEN,
    DYKE,
    HEAVY,
    Damper,
    document,
    drive,
    grid,
    oscillator,
    signals,
    slider,
    step_through,
)
from mrdamp import sets
from mrdamp.model import core
from test_effects import BASES, TOGETHER, with_effects
from twin_laws import LAWS, Softening

TIMESTEPS = (5e-4, 5e-3)  # s
# sensor signal -> column of the C entry
COLUMNS = {name: name for name in ("force", "current", "field", "temperature")} | {"true_force": "reference"}
FOAM = attributes("zapateiro_foam_tanh")


def same_as_the_chain(law: str, parameters: Mapping[str, float], id: str, kind: str, timestep: float) -> None:
    """Every signal of the sensor, step by step, to 1e-8 of its size."""
    motion, command = excitation(id, kind)
    record = sample(motion, command, timestep, min(0.8, 4000 * timestep))
    # a record begins with its first command, a model with none
    damper = Damper(law, {**parameters, "command_start": float(record.u[0])})
    rig = document(slider(HEAVY), [damper], signals(), timestep=timestep)
    found = drive(rig, record.x, record.v, record.u)
    # MuJoCo holds the command over a step; the heavy body has no acceleration of its own
    expected = core.run(
        law, parameters, timestep, record.x, record.v, np.zeros(len(record.x)), record.u, hold=True,
        columns=tuple(COLUMNS.values()),
    )  # fmt: skip
    assert rms(expected["reference"]) > 0.0
    for signal, column in COLUMNS.items():
        limit = 1e-8 * max(rms(expected[column]), 1e-12)
        np.testing.assert_allclose(found[signal], expected[column], rtol=0.0, atol=limit, err_msg=signal)
    np.testing.assert_array_equal(found["stroke"], record.x)
    np.testing.assert_array_equal(found["stroke_velocity"], record.v)


@pytest.mark.parametrize("timestep", TIMESTEPS)
@pytest.mark.parametrize("id", sets.names())
def test_driven_rig_is_the_chain(id: str, timestep: float) -> None:
    same_as_the_chain(sets.load(id).law, attributes(id), id, "sine", timestep)


@pytest.mark.parametrize("names", TOGETHER, ids="+".join)
@pytest.mark.parametrize("base", BASES)
def test_driven_rig_is_the_chain_with_effects(base: str, names: tuple[str, ...]) -> None:
    """But for what the rig does not have: an acceleration of its rod, and a channel that is late. A record's step is
    cut where a delayed jump arrives, for the sensor; the rig's is not. A lag hides it."""
    without = {"channel_shift"} | (set() if "mount_compliance" in names else {"moving_mass"})
    without |= {"command_delay"} if names[0] == "command_delay" else set()
    law = with_effects(BASES[base], *(name for name in names if name not in without))
    for timestep in TIMESTEPS:
        same_as_the_chain(BASES[base].law, law, "dyke1996_3kN", "steps", timestep)


# law, its parameters, command, mass (kg), stiffness (N/m), first displacement (m)
FREE = {
    "bingham": (BINGHAM, 0.5, 60.0, 24e3, 0.03),
    "bouc_wen": (BOUC_WEN, 0.2, 200.0, 80e3, 0.03),
    "hyperbolic_tangent": (FOAM, 1.0, 10.0, 4000.0, 0.04),
    "modified_bouc_wen": (DYKE, 0.4, 400.0, 160e3, 0.03),
}


def reference(
    law: str, levels: Array, hold: float, push: float, dt: float, speed: float = 0.0
) -> tuple[Array, Array]:
    """x, force every dt of a mass on a spring with the damper, pushed with push sin(15 t) newton: SciPy.

    levels: commands, each held for `hold` (s). At a change the force is that of the new command. speed: at the start.
    """
    p, _, mass, stiffness, x0 = FREE[law]
    equations, soft = LAWS[law](p), Softening()

    def force(y: Array, u: float) -> float:
        return float(sum(equations.forces(list(y[2:]), float(y[0]), float(y[1]), u, soft)))

    def rates(time: float, y: Array, u: float) -> list[float]:
        pull = push * math.sin(15.0 * time) - stiffness * float(y[0]) - force(y, u)
        return [float(y[1]), pull / mass, *equations.rates(list(y[2:]), float(y[0]), float(y[1]), u, soft)]

    state = np.array([x0, speed, *equations.start(x0)])
    tolerance = [1e-10, 1e-9, *(1e-9 * scale for scale in equations.scales)]
    found: list[tuple[float, float]] = []
    for k, u in enumerate(levels):
        t = k * hold + grid(hold, dt)
        done = solve_ivp(
            rates, (t[0], t[-1]), state, "LSODA", t, args=(float(u),), rtol=1e-8, atol=tolerance, max_step=0.005
        )
        assert done.success
        found += [(float(y[0]), force(y, float(u))) for y in done.y.T[:-1]]
        state = done.y[:, -1]
    x, forces = np.array(found).T
    return x, forces


def run_free(
    law: str, levels: Array, hold: float, timestep: float, push: float, first: float
) -> tuple[Array, Array]:
    """The same in MuJoCo; first: force at the start, N."""
    parameters, _, mass, stiffness, x0 = FREE[law]
    model, data = oscillator(law, parameters, mass, stiffness, timestep)
    data.qpos[0] = x0
    # MuJoCo's velocity is that of half a step before: start it there
    data.qvel[0] = 0.5 * timestep * (stiffness * x0 + first) / mass
    each = round(hold / timestep)
    found = np.empty((2, each * len(levels)))
    for k in range(found.shape[1]):
        data.ctrl[0] = levels[k // each]
        found[0, k] = data.qpos[0]
        data.qfrc_applied[0] = push * math.sin(15.0 * k * timestep)
        mujoco.mj_step(model, data)
        found[1, k] = data.sensor("true_force").data[0]
    return found[0], found[1]


@pytest.mark.parametrize("law", FREE)
def test_switched_commands_are_scipys(law: str) -> None:
    """Jumps every 40 ms, pushed: motion and force, all laws alike, with an error of second order."""
    _, u, _, stiffness, x0 = FREE[law]
    levels, push = u * np.random.default_rng(5).choice([1.0, 2.0, 3.0], 25), 0.4 * stiffness * x0
    off = []
    for timestep in (1e-3, 5e-4):
        x, force = reference(law, levels, 0.04, push, timestep)
        found, felt = run_free(law, levels, 0.04, timestep, push, float(force[0]))
        off.append((rms(found - x) / rms(x), rms((felt - force)[2:]) / rms(force)))
    assert off[1][0] < 1e-3
    assert off[1][1] < 0.01
    assert off[1][0] < max(0.4 * off[0][0], 2e-4)


@pytest.mark.parametrize("law", FREE)
def test_runge_kutta_at_a_short_step(law: str) -> None:
    parameters, u, mass, stiffness, x0 = FREE[law]
    timestep = 2e-5 if law == "hyperbolic_tangent" else 1e-4
    x, force = reference(law, np.array([u]), 0.6, 0.0, timestep)
    model, data = oscillator(law, parameters, mass, stiffness, timestep, integrator="RK4")
    data.qpos[0], data.ctrl[0] = x0, u
    track = step_through(model, data, len(x))
    assert rms(track.x[:, 0] - x) < 0.01 * rms(x)
    assert rms(track.sensors[:, model.sensor("true_force").adr[0]] - force) < 0.02 * rms(force)


@pytest.mark.parametrize("law", ["bouc_wen", "modified_bouc_wen"])
def test_runge_kutta_begins_in_motion(law: str) -> None:
    """The hysteresis moves within the first step: the error after it falls as the step squared or faster."""
    parameters, u, mass, stiffness, x0 = FREE[law]
    off = []
    for timestep in (2e-4, 1e-4):
        x, _ = reference(law, np.array([u]), 0.01, 0.0, timestep, 1.0)
        model, data = oscillator(law, parameters, mass, stiffness, timestep, integrator="RK4")
        data.qpos[0], data.qvel[0], data.ctrl[0] = x0, 1.0, u
        off.append(float(np.max(np.abs(step_through(model, data, len(x)).x[:, 0] - x))))
    assert off[1] < 0.3 * off[0]


def test_runge_kutta_has_the_current_in_time() -> None:
    """1 - exp(-t / tau) from the first command on."""
    model, data = oscillator("bingham", {**BINGHAM, "driver_lag_tau": 0.01}, 1.0, 100.0, 1e-3, integrator="RK4")
    current = step_through(model, data, 40, np.ones((40, 1))).sensors[:, model.sensor("current").adr[0]]
    np.testing.assert_allclose(current, 1.0 - np.exp(-0.1 * np.arange(40)), atol=1e-9)
