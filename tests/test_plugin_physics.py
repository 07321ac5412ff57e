"""The damper in MuJoCo: the C chain on a driven rig, SciPy on free structures, signs, commands."""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dampers import attributes, excitation, rms, sample, size
from excitation import Array
from mjcf_builders import (
    HEAVY,
    Damper,
    chain,
    compiled,
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
from twin_laws import LAWS, Softening

TIMESTEPS = (5e-4, 5e-3)  # s
# sensor signal -> column of the C entry
COLUMNS = {
    "force": "force",
    "true_force": "reference",
    "current": "current",
    "field": "field",
    "temperature": "temperature",
}
BOUC_WEN = {
    "c0a": 900.0, "c0b": 900.0, "alpha_a": 3e4, "alpha_b": 1e5, "gamma": 9e5, "beta": 4e5, "A": 110.0,
    "n": 2.0, "k0": 3000.0, "x0": 0.001,
}  # fmt: skip
BINGHAM = {"c0a": 150.0, "c0b": 80.0, "fya": 40.0, "fyb": 60.0, "v_ref": 0.008}
DYKE = {**attributes("dyke1996_3kN"), "driver_lag_tau": 0.0}
FOAM = attributes("zapateiro_foam_tanh")


def effects(force: float, stroke: float, command: float) -> Mapping[str, dict[str, float]]:
    """Several effects at a time, of the damper's size."""
    return {
        "none": {},
        "driver, magnetics, sensor": {
            "driver_lag_tau": 0.012, "driver_lag_tau2": 0.004, "command_delay_d": 0.0123,
            "saturation_i_s": 0.6 * command, "remanence_b": 0.1 * command, "remanence_d": 0.2 * command,
            "sensor_gain_g": 0.9, "sensor_offset_f": 0.1 * force, "sensor_leakage_tau": 0.3,
            "sensor_lag_tau": 0.004,
        },
        "fluid, mechanics": {
            "heating_kappa": 0.02, "heating_kappa_yield": 0.01, "heating_capacity": 0.2 * force * stroke,
            "heating_loss": 0.1 * force * stroke, "asymmetry_a": 0.2, "shear_thinning_m": 0.5,
            "trapped_gas_d": 0.5, "trapped_gas_s_g": 0.2 * stroke, "gas_spring_k": 0.3 * force / stroke,
            "gas_spring_k2": 0.2 / stroke, "gas_spring_f0": 0.1 * force, "seal_friction_coulomb": 0.2 * force,
            "seal_friction_breakaway": 1.5,
        },
        "mount": {
            "mount_compliance_k": 20.0 * force / stroke, "backlash_gap": 0.1 * stroke, "driver_lag_tau": 0.01,
            "moving_mass_m": 0.02 * force, "seal_friction_coulomb": 0.1 * force, "sensor_lag_tau": 0.003,
            "sensor_lag_tau2": 0.002,
        },
    }  # fmt: skip


COMBINED = tuple(effects(1.0, 1.0, 1.0))


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


@pytest.mark.parametrize("timestep", TIMESTEPS)
@pytest.mark.parametrize("combined", COMBINED[1:])
@pytest.mark.parametrize(
    "id", ["zapateiro_foam_bingham", "zapateiro_foam_bouc_wen", "zapateiro_foam_tanh", "dyke1996_3kN"]
)
def test_driven_rig_is_the_chain_with_effects(id: str, combined: str, timestep: float) -> None:
    stroke, _ = size(id)
    more = effects(600.0 if id.startswith("dyke") else 15.0, stroke, 2.0)[combined]
    same_as_the_chain(sets.load(id).law, {**attributes(id), **more}, id, "steps", timestep)


# --- free structures against SciPy -----------------------------------------------------------

# law, its parameters, command, mass (kg), stiffness (N/m), first displacement (m)
FREE = {
    "bingham": (BINGHAM, 0.5, 60.0, 24e3, 0.03),
    "bouc_wen": (BOUC_WEN, 0.2, 200.0, 80e3, 0.03),
    "hyperbolic_tangent": (FOAM, 1.0, 10.0, 4000.0, 0.04),
    "modified_bouc_wen": (DYKE, 0.4, 400.0, 160e3, 0.03),
}


def reference(
    law: str,
    p: Mapping[str, float],
    levels: Array,
    hold: float,
    mass: float,
    stiffness: float,
    x0: float,
    push: float,
    dt: float,
) -> tuple[Array, Array]:
    """x, force every dt of a mass on a spring with the damper, pushed with push sin(15 t) newton: SciPy.

    levels: commands, each held for `hold` (s). At a change the force is that of the new command.
    """
    equations, soft = LAWS[law](p), Softening()

    def force(y: Array, u: float) -> float:
        return float(sum(equations.forces(list(y[2:]), float(y[0]), float(y[1]), u, soft)))

    def rates(time: float, y: Array, u: float) -> list[float]:
        pull = push * math.sin(15.0 * time) - stiffness * float(y[0]) - force(y, u)
        return [float(y[1]), pull / mass, *equations.rates(list(y[2:]), float(y[0]), float(y[1]), u, soft)]

    state = np.array([x0, 0.0, *equations.start(x0)])
    tolerance = [1e-10, 1e-9, *(1e-9 * scale for scale in equations.scales)]
    found: list[tuple[float, float]] = []
    for k, u in enumerate(levels):
        t = k * hold + grid(hold, dt)
        done = solve_ivp(
            rates,
            (t[0], t[-1]),
            state,
            "LSODA",
            t,
            args=(float(u),),
            rtol=1e-8,
            atol=tolerance,
            max_step=0.005,
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


@pytest.mark.parametrize("pushed", [False, True], ids=["decay", "pushed"])
@pytest.mark.parametrize("timestep", [5e-4, 2e-3])
@pytest.mark.parametrize("law", FREE)
def test_free_structure_moves_as_scipy_says(law: str, timestep: float, pushed: bool) -> None:
    parameters, u, mass, stiffness, x0 = FREE[law]
    push, levels = 0.4 * stiffness * x0 if pushed else 0.0, np.array([u])
    x, force = reference(law, parameters, levels, 1.5, mass, stiffness, x0, push, timestep)
    found, felt = run_free(law, levels, 1.5, timestep, push, float(force[0]))
    assert rms(found - x) < (0.005 if timestep > 1e-3 else 0.002) * rms(x)
    # behind the first steps: the velocity at the start was set by hand
    assert rms((felt - force)[2:]) < (0.003 + 5.0 * timestep) * rms(force)
    # without the damper the test would fail
    free = x0 * np.cos(math.sqrt(stiffness / mass) * timestep * np.arange(len(x)))
    assert rms(free - x) > 0.3 * rms(x)


@pytest.mark.parametrize("law", FREE)
def test_switched_commands_are_scipys(law: str) -> None:
    """Jumps every 40 ms, pushed: motion and force, all laws alike, with an error of second order."""
    parameters, u, mass, stiffness, x0 = FREE[law]
    levels = u * np.random.default_rng(5).choice([1.0, 2.0, 3.0], 25)
    off = []
    for timestep in (1e-3, 5e-4):
        x, force = reference(
            law, parameters, levels, 0.04, mass, stiffness, x0, 0.4 * stiffness * x0, timestep
        )
        found, felt = run_free(law, levels, 0.04, timestep, 0.4 * stiffness * x0, float(force[0]))
        off.append((rms(found - x) / rms(x), rms((felt - force)[2:]) / rms(force)))
    assert off[1][0] < 1e-3
    assert off[1][1] < 0.01
    assert off[1][0] < max(0.4 * off[0][0], 2e-4)


@pytest.mark.parametrize("timestep", [2e-4, 1e-3])
def test_frame_shaken_from_the_ground_is_scipys(timestep: float) -> None:
    """Two storeys, damper between the ground and the first floor, joints as storey drifts."""
    masses, stiffness, damping = np.array([98.3, 98.3]), np.array([5.16e5, 6.84e5]), np.array([125.0, 50.0])
    u = 1.0
    equations, soft = LAWS["modified_bouc_wen"](DYKE), Softening()

    def ground(time: float) -> float:
        return 3.0 * math.sin(2 * math.pi * 4.6 * time)

    def rates(time: float, y: Array) -> list[float]:
        d, w, inner = y[:2], y[2:4], [float(value) for value in y[4:]]
        storey = stiffness * d + damping * w
        force = sum(equations.forces(inner, float(d[0]), float(w[0]), u, soft))
        lower = (storey[1] - storey[0] - force) / masses[0] - ground(time)
        upper = -storey[1] / masses[1] - ground(time)
        return [*w, lower, upper - lower, *equations.rates(inner, float(d[0]), float(w[0]), u, soft)]

    t = grid(1.5, timestep)
    scale = [1e-10] * 2 + [1e-9] * 2 + [1e-9 * size for size in equations.scales]
    start = [0.0] * 4 + equations.start(0.0)
    done = solve_ivp(rates, (0.0, t[-1]), start, "LSODA", t_eval=t, rtol=1e-8, atol=scale)
    model, data = compiled(
        document(chain(masses, stiffness, damping), [Damper("modified_bouc_wen", DYKE)], timestep=timestep)
    )
    data.ctrl[0] = u
    found = np.empty((len(t), 2))
    for k in range(len(t)):
        found[k] = data.qpos
        shake = np.array([ground(t[k]), ground(t[k])])
        data.qfrc_applied[:] = [-(masses @ shake), -masses[1] * shake[1]]
        mujoco.mj_step(model, data)
    for storey in range(2):
        x = done.y[storey]
        assert rms(found[:, storey] - x) < 0.01 * rms(x), storey


# --- signs, commands, invariances ---------------------------------------------------------------


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_signs(direction: float) -> None:
    """The sensor reads positive where the rod is pulled out; the actuator pushes the other way."""
    model, data = compiled(document(slider(HEAVY), [Damper("bingham", BINGHAM)], signals()))
    data.qvel[0], data.ctrl[0] = 0.2 * direction, 0.5
    mujoco.mj_forward(model, data)
    expected = (150.0 + 80.0 * 0.5) * 0.2 + (40.0 + 60.0 * 0.5) * math.tanh(0.2 / 0.008)
    assert data.sensor("force").data[0] == pytest.approx(direction * expected, rel=1e-12)
    assert data.actuator_force[0] == pytest.approx(-direction * expected, rel=1e-6)
    assert data.qfrc_actuator[0] == pytest.approx(-direction * expected, rel=1e-6)
    assert data.qacc[0] * direction < 0.0


@pytest.mark.parametrize("law", FREE)
def test_timestep_does_not_change_the_decay(law: str) -> None:
    """Peaks of the free motion at 0.1 ms and at 1, 2 ms."""
    parameters, u, mass, stiffness, x0 = FREE[law]

    def peaks(timestep: float) -> Array:
        model, data = oscillator(law, parameters, mass, stiffness, timestep)
        data.qpos[0], data.ctrl[0] = x0, u
        data.qvel[0] = 0.5 * timestep * stiffness * x0 / mass
        x = step_through(model, data, round(0.8 / timestep)).x[:, 0]
        size = np.abs(x)
        at = np.flatnonzero((size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:])) + 1
        bend = x[at + 1] - 2.0 * x[at] + x[at - 1]
        return np.asarray(x[at] - (x[at + 1] - x[at - 1]) ** 2 / (8.0 * bend))

    fine = [value for value in peaks(1e-4) if abs(value) > 0.05 * x0]
    assert len(fine) >= 2
    for timestep in (1e-3, 2e-3):
        np.testing.assert_allclose(peaks(timestep)[: len(fine)], fine, rtol=0.02, atol=0.002 * x0)


@pytest.mark.parametrize("law", FREE)
def test_runge_kutta_at_a_short_step(law: str) -> None:
    parameters, u, mass, stiffness, x0 = FREE[law]
    timestep = 2e-5 if law == "hyperbolic_tangent" else 1e-4
    x, force = reference(law, parameters, np.array([u]), 0.6, mass, stiffness, x0, 0.0, timestep)
    model, data = oscillator(law, parameters, mass, stiffness, timestep, integrator="RK4")
    data.qpos[0], data.ctrl[0] = x0, u
    track = step_through(model, data, len(x))
    assert rms(track.x[:, 0] - x) < 0.01 * rms(x)
    assert rms(track.sensors[:, model.sensor("true_force").adr[0]] - force) < 0.02 * rms(force)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_moving_mass_is_inertia(integrator: str) -> None:
    """A damper's moving mass slows the oscillation as mass on the body does."""
    law = {"c0a": 2.0, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01}
    tracks = []
    for body, moving in ((3.0, 0.0), (2.0, 1.0)):
        parameters = {**law, "moving_mass_m": moving}
        model, data = oscillator("bingham", parameters, body, 1200.0, 5e-4, integrator=integrator)
        data.qpos[0] = 0.02
        tracks.append(step_through(model, data, 2000))
    assert rms(tracks[0].x - tracks[1].x) < 1e-3 * rms(tracks[0].x)
