"""The default steps against finer ones, SciPy and closed forms; the benchmarks measure what they say."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks import accuracy, convergence, fits, opensees, python_env
from benchmarks.convergence import Array, Draw, apart, rms
from benchmarks.frames import DYKE
from benchmarks.python_law import PythonDamper
from mrdamp.envs import FrameEnv, FrameTask
from mrdamp.identify import simulate
from mrdamp.model import Model, core, effects_from
from mrdamp.motions import kanai_tajimi
from mrdamp.narx.splits import cut_varying
from mrdamp.records import Record, embedded
from mrdamp.structures import dyke1996


def shares(some: list[Draw]) -> tuple[float, float]:
    errors = np.array([convergence.error(one) for one in some])
    assert np.isfinite(errors).all()
    return float(np.mean(errors > 0.01)), float(np.mean(errors > 0.05))


@pytest.mark.slow
def test_many_random_laws_and_effects() -> None:
    """Of all draws; and of those that have an answer, without a mass that rattles."""
    some = convergence.draws(11, 1200)
    above, far = shares(some)
    assert above <= 0.015
    assert far <= 0.008
    above, far = shares([one for one in some if not convergence.rattles(one)])
    assert above <= 0.01
    assert far <= 0.003


@pytest.mark.parametrize("form", convergence.PASSIVE)
def test_a_steady_cycle_gives_no_work(form: str) -> None:
    for law in convergence.LAWS:
        for amplitude in convergence.AMPLITUDES:
            assert convergence.work_made(law, convergence.FORMS[form], amplitude) > -0.003


DT, END = 1e-3, 0.5
T: Array = np.arange(round(END / DT) + 1, dtype=np.float64) * DT
DASHPOT = {"c0a": 300.0, "c0b": -200.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01}


def rod(t: float) -> float:
    return float(convergence.motion(np.array([t]))[0][0])


def run(attributes: Mapping[str, float], u: Array | float = 0.0) -> Array:
    x, v, a = convergence.motion(T)
    command = np.full(len(T), u) if np.isscalar(u) else np.asarray(u)
    return core.run("bingham", attributes, DT, x, v, a, command, hold=True, columns=("force",))["force"]


@pytest.mark.slow
@pytest.mark.parametrize(("coulomb", "breakaway"), [(60.0, 6.0), (200.0, 2.5), (20.0, 15.0)])
def test_friction_that_falls_with_the_velocity_slips_behind_a_mount(coulomb: float, breakaway: float) -> None:
    """The dashpot's coefficient jumps with the command, which makes the piston slip within microseconds."""
    k, v_s, presliding = 4e4, 0.005, 2e-5
    sigma = coulomb * breakaway / presliding
    u = (np.arange(len(T)) // 40 % 2).astype(np.float64)
    seal = {
        "mount_compliance_k": k, "seal_friction_coulomb": coulomb, "seal_friction_breakaway": breakaway,
        "seal_friction_v_s": v_s, "seal_friction_presliding": presliding,
    }  # fmt: skip

    def rates(t: float, y: Array, c: float) -> list[float]:
        v = (k * (rod(t) - y[0]) - sigma * y[1]) / c
        limit = coulomb * (1 + (breakaway - 1) * np.exp(-((v / v_s) ** 2)))
        return [v, v - abs(v) * sigma * y[1] / limit]

    y, expected = np.zeros(2), [0.0]
    for begin in range(0, len(T) - 1, 40):
        part = slice(begin, min(begin + 41, len(T)))
        c = DASHPOT["c0a"] + DASHPOT["c0b"] * u[begin]
        found = solve_ivp(
            rates,
            (T[begin], T[part][-1]),
            y,
            "Radau",
            T[part],
            args=(c,),
            rtol=1e-8,
            atol=1e-11,
            max_step=1e-4,
        )
        y = found.y[:, -1]
        expected += list(k * (np.array([rod(t) for t in T[part]]) - found.y[0])[1:])
    force = run({**DASHPOT, **seal}, u)
    assert rms(force - expected) < 0.02 * rms(np.array(expected))  # slip sets in up to a step late
    steady = run({**DASHPOT, **seal, "seal_friction_breakaway": 1.0}, u)
    assert rms(steady - expected) > 0.1 * rms(np.array(expected))


@pytest.mark.slow
def test_a_mass_meets_the_ends_of_a_clearance() -> None:
    m, k, gap, c = 2.0, 5e5, 1e-3, 300.0
    damper = {**DASHPOT, "c0b": 0.0, "backlash_gap": gap, "backlash_k": k, "moving_mass_m": m}

    def contact(stretch: Array) -> Array:
        return np.asarray(k * np.sign(stretch) * np.maximum(np.abs(stretch) - gap / 2, 0.0))

    def rates(t: float, y: Array) -> list[float]:
        return [y[1], (float(contact(np.array(rod(t) - y[0]))) - c * y[1]) / m]

    y = solve_ivp(rates, (0, END), [0.0, 0.0], "DOP853", T, rtol=1e-9, atol=1e-12, max_step=2e-5).y[0]
    expected = contact(np.array([rod(t) for t in T]) - y)
    assert rms(run(damper) - expected) < 0.01 * rms(expected)
    assert rms(run({**damper, "moving_mass_m": 0.0}) - expected) > 0.1 * rms(expected)


def test_a_preloaded_damper_rests_on_its_mount() -> None:
    """Two springs in series from the start on: -k k1 x0 / (k + k1); also with gas in series."""
    _, parameters, largest = convergence.LAWS["modified_bouc_wen"]
    gas = {
        "trapped_gas_force": 8.76, "trapped_gas_s_g": 0.00438, "trapped_gas_series": 1.0, "trapped_gas_shape": 6.57,
    }  # fmt: skip
    k, k1, x0 = 14300.0, parameters["k1"], 0.143
    for extra in ({}, gas):
        law = {**parameters, "x0": x0, "mount_compliance_k": k, **extra}
        still = core.run("modified_bouc_wen", law, DT, np.zeros(100), u=largest, columns=("force", "piston"))
        np.testing.assert_allclose(still["force"], -k * k1 * x0 / (k + k1), rtol=1e-6)
        np.testing.assert_allclose(still["piston"], k1 * x0 / (k + k1), rtol=1e-6)


MOTION = kanai_tajimi(3, duration=5.0, pga=5.0).compressed(5.0)
BINGHAM = {"c0a": 900.0, "c0b": 500.0, "fya": 60.0, "fyb": 400.0, "v_ref": 0.004}


def task(engine: str, timestep: float, **effects: float) -> FrameTask:
    model = Model("bingham", BINGHAM, effects_from(effects), "frame", dyke1996())
    made = FrameTask(1, model=model, command_max=1.0, engine=engine, timestep=timestep)
    made.reset([0], [np.random.default_rng(0)], {"motion": MOTION})
    return made


def periods(made: FrameTask, count: int, every: int = 1) -> tuple[Array, Array]:
    """Commands, and what was measured after each period, (count, ...)."""
    actions = np.repeat(np.random.default_rng(5).uniform(-1, 1, (count, 1)), every, axis=0)[:count]
    commands, found = [], []
    for action in actions:
        made.step(action[None])
        commands.append(float(made.commands(action[None])[0, 0]))
        found.append(made.measured[0].copy())
    return np.array(commands), np.array(found)


@pytest.mark.parametrize(
    ("engine", "timestep"), [("chain", 5e-3), ("chain", 1e-3), ("chain", 2e-4), ("mujoco", 5e-4)]
)
def test_a_clock_takes_the_command_of_its_tick(engine: str, timestep: float) -> None:
    """Ticks at the control periods' own ends: every command acts, in its own period."""
    made = task(engine, timestep, command_delay_period=5e-3)
    commands, found = periods(made, 150)
    np.testing.assert_array_equal(found[:, made.rows.names.index("current")], commands)


@pytest.mark.parametrize("delay", [5e-3, 2e-2])
def test_a_delay_of_whole_periods_has_arrived_when_a_period_ends(delay: float) -> None:
    """Both engines measure the force of the current that they report: c0 v + fy of it, at these velocities."""
    for engine, timestep in (("chain", 1e-3), ("mujoco", 5e-4)):
        made = task(engine, timestep, command_delay_d=delay)
        _, found = periods(made, 150, 7)
        names = made.rows.names
        current, force, v = (found[:, names.index(name)] for name in ("current", "force", "stroke_velocity"))
        expected = (BINGHAM["c0a"] + BINGHAM["c0b"] * current) * v
        expected += (BINGHAM["fya"] + BINGHAM["fyb"] * current) * np.tanh(v / BINGHAM["v_ref"])
        assert rms(force - expected) < 0.02 * rms(expected), engine


@pytest.mark.slow
def test_every_signal_is_converged_at_the_default_steps() -> None:
    """Of both engines, within 2 % of the chain at a tenth of the step, under commands that switch."""
    for s in convergence.structures():
        _, fine = s.run("chain", s.fine)
        for engine, step in s.steps.items():
            assert apart(s.run(engine, step)[1], fine).max() < 0.02, (s.name, engine)


LAST = 1.2  # s, of the accuracy runs


def test_errors_are_small_where_the_speed_is_stated() -> None:
    for dt in (5e-4, 1e-3):
        assert accuracy.law_error(dt, LAST) < 2e-3
        assert accuracy.frame_error(dt, LAST) < 8e-3


def test_python_law_is_the_same_law() -> None:
    """Against SciPy: three inner steps are as good as the plugin, one is useless at this step of the engine."""
    p = DYKE.attributes()
    assert accuracy.python_law_error(PythonDamper(p, 3), 5e-4, LAST) < 2e-3
    assert accuracy.python_law_error(PythonDamper(p, 1), 1e-4, LAST) < 2e-3
    assert accuracy.python_law_error(PythonDamper(p, 0), 1e-3, LAST) > 0.1
    assert accuracy.frame_error(1e-4, LAST, PythonDamper(p, 1)) < 8e-3


@pytest.mark.slow
def test_the_environment_in_python_is_the_same_environment() -> None:
    """Neither side of the comparison is let off: forces are alike, those of the finer steps too."""
    exact = python_env.forces(FrameEnv(motions=python_env.MOTIONS, timestep=1e-4), 1.0)
    plugin = accuracy.error(python_env.forces(FrameEnv(motions=python_env.MOTIONS), 1.0), exact)
    errors = [accuracy.error(python_env.forces(loop.env(), 1.0), exact) for loop in python_env.LOOPS]
    plain, abreast, shorter, fine = errors
    assert plugin < max(abreast, shorter) < 2.5e-3
    assert fine < 4e-3 < plain < 0.02


@pytest.mark.skipif(find_spec("openseespy") is None, reason="openseespy (extra bench) is missing")
def test_opensees_frame_is_the_same_frame() -> None:
    assert opensees.force_error(sys.executable, 2e-4, LAST) < 0.02


PARAMETERS = {"c0a": 900.0, "c0b": 500.0, "alpha_a": 300.0, "alpha_b": 450.0, "k0": 0.0, "k1": 0.0, "x0": 0.0,
              "c1a": 2e4, "c1b": 2e4, "A": 2000.0, "gamma": 1000.0, "beta": 1000.0, "n": 2.0}  # fmt: skip


def a_record() -> Record:
    (part,) = cut_varying(embedded(), fits.RECORD).train
    return part.part(part.time[0], part.time[0] + 1.5)


def test_the_law_in_python_is_that_of_the_c_entry() -> None:
    record = a_record()
    point = np.array([0.9, 0.5, 0.3, 0.45, 2.0])
    ours, other = fits.in_c(record)(point), fits.in_python(record)(point)
    assert np.std(ours - other) < 0.02 * np.std(ours)
    less = fits.in_python(record)(point * [1, 1, 0.9, 1, 1])
    assert np.std(ours - less) > 0.03 * np.std(ours)


def test_the_rig_that_mujoco_fits_in_moves_as_the_record_does() -> None:
    sysid = pytest.importorskip(
        "benchmarks.sysid", reason="mujoco[sysid] (extra bench) is missing", exc_type=ImportError
    )
    record, model = a_record(), Model("modified_bouc_wen", PARAMETERS)
    found, expected = sysid.force(model, record), simulate(model, record)[: record.n - 1]
    assert np.std(found - expected) < 0.03 * np.std(expected)
    assert np.std(found[1:] - expected[:-1]) > 0.05 * np.std(expected)  # not a sample late
