"""LQG on a frame: its filters against SciPy, the clipping law, designs that cannot be; and a frame of a user's file
with two dampers: its mechanics, its controllers, and `mine=`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import StateSpace, lsim

from command_call import caller
from knowing import steady
from mrdamp.commands import controllers
from mrdamp.compare.contenders import contenders
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import FrameBench
from mrdamp.control.force_control import clip
from mrdamp.control.force_levels import LeastCommand
from mrdamp.control.lqg import first_order_hold, outputs, plant, regulator_gain
from mrdamp.control.observe import Observer
from mrdamp.envs.frame_xml import frame_models, frame_xml
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.motions import kanai_tajimi
from mrdamp.structures import ShearFrame, dyke1996
from mrdamp.train.worlds import Ground
from refusals import refuses


def test_first_order_hold_is_exact_for_a_ramp() -> None:
    a, b = np.array([[0.0, 1.0], [-900.0, -3.0]]), np.array([[0.0, 2.0], [1.0, -4.0]])
    u0, u1, s0, h = np.array([3.0, -1.0]), np.array([-2.0, 5.0]), np.array([0.4, -0.7]), 0.02
    phi, g0, g1 = first_order_hold(a, b, h)
    run = solve_ivp(lambda t, s: a @ s + b @ (u0 + (u1 - u0) * t / h), (0, h), s0, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(phi @ s0 + g0 @ u0 + g1 @ u1, run.y[:, -1], rtol=1e-8)


def test_clipping_law() -> None:
    """On where more force of the same sign is wanted: a damper cannot push."""
    for wanted, force in ((900.0, 300.0), (-900.0, -300.0)):
        assert clip(wanted, force, 2.25) == 2.25
        for other in ((force, wanted), (-wanted, force), (wanted, 0.0), (force, force)):
            assert clip(*other, 2.25) == 0.0


FRAME = dyke1996()
NAMES = ("acceleration_1", "acceleration_2", "acceleration_3", "displacement_1")
PERIOD = 2e-3


def measured(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Measurements (T, 4), force (T,), states (T, 6) and ground acceleration (T,) of a frame under a motion and a
    sine of a force."""
    motion = kanai_tajimi(seed, ground_frequency=10.0, filter_frequency=1.0).compressed(5.0)
    t = np.arange(0.0, motion.duration, PERIOD)
    ground, force = np.interp(t, motion.time, motion.acceleration), 200.0 * np.sin(40.0 * t)
    linear = plant(FRAME)
    c, d = outputs(FRAME, NAMES)
    system = StateSpace(linear.a, np.column_stack([linear.b, linear.e]), np.eye(6), np.zeros((6, 2)))
    states = lsim(system, np.column_stack([force, ground]), t)[1]
    return states @ c.T + np.outer(force, d), force, states, ground


@pytest.mark.parametrize("seed", [3, 4])
def test_states_and_ground_are_estimated(seed: int) -> None:
    y, force, states, ground = measured(seed)
    given = Ground(50.0, 0.5, 1e5, 8e-4)
    filter_ = given.estimator(FRAME, NAMES, PERIOD)
    found = np.array(
        [filter_({**dict(zip(NAMES, row, strict=True)), "force": f}) for row, f in zip(y, force, strict=True)]
    )
    error = np.sqrt(np.mean((found[:, :6] - states) ** 2, axis=0) / np.mean(states**2, axis=0))
    assert error.max() < 0.05
    estimated = 50.0**2 * found[:, 6] + 2 * 0.5 * 50.0 * found[:, 7]
    assert np.corrcoef(estimated, ground)[0, 1] > 0.85
    assert np.sqrt(np.mean((estimated - ground) ** 2) / np.mean(ground**2)) < 0.5


def test_an_observer_has_the_states_behind_its_own() -> None:
    """Scaled: displacements and velocities of a strong motion, and the ground's share of 5 m/s2."""
    y, force, _, _ = measured(5)
    given = Ground(50.0, 0.5, 1e5, 8e-4)
    plain = Observer((*NAMES, "force"), (5.0, 5.0, 5.0, 0.004, 1400.0), 1, False, (2.25,), 1e3)
    own = given.observed(plain, FRAME, PERIOD)
    both = given.observed(own, FRAME, PERIOD)
    assert (own.size, both.size) == (5 + 8, 5 + 16)
    filter_ = given.estimator(FRAME, NAMES, PERIOD)
    w = 2 * np.pi * float(FRAME.frequencies[0])
    scale = np.array([w**2, w**2, w**2, w, w, w, 2500.0, 50.0]) / 5.0
    for row, f in zip(y[:400], force, strict=False):
        given_now = {**dict(zip(NAMES, row, strict=True)), "force": f}
        seen, twice, estimate = own(given_now, 0.0), both(given_now, 0.0), filter_(given_now)
    np.testing.assert_allclose(seen[5:], scale * estimate, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(twice, [*seen, *seen[5:]])


MASS, STIFFNESS, DAMPING = [120.0, 110.0, 100.0, 80.0], [7e5, 6e5, 5e5, 4e5], [150.0, 90.0, 60.0, 40.0]
PLACES = ((0, 1), (1, 2))
LOAD = kanai_tajimi(7, duration=5.0)
OWN = '''
class Two:
    """1 V below, half a volt above; each only while its damper resists."""
    name, period = "two", 0.002

    def __init__(self, site):
        assert site.dampers == 2

    def reset(self):
        pass

    def command(self, t, y):
        return [1.0, 0.5]


class Three(Two):
    def command(self, t, y):
        return [1.0, 0.5, 0.0]
'''


run = caller(controllers.add_to)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "tower.json"
    damper = frame_model()
    frame = ShearFrame(np.array(MASS), np.array(STIFFNESS), np.array(DAMPING))
    replace(damper, structure=frame, name="tower").write(path)
    return path


def bench(file: Path, engine: str = "chain") -> FrameBench:
    model = Model.read(file)
    assert model.structure is not None
    return FrameBench(replace(model, structure=replace(model.structure, others=PLACES[1:])), engine=engine)


def test_the_plant_is_the_engines_own(file: Path) -> None:
    """Accelerations of the floors for states and forces at random, from the joints' masses and springs in MuJoCo."""
    known = bench(file).site.frame
    models = frame_models(Model.read(file), None, PLACES)
    m = mujoco.MjModel.from_xml_string(frame_xml(models, 1e-4))
    m.opt.gravity[:] = 0.0
    d, rng, linear = mujoco.MjData(m), np.random.default_rng(0), plant(known)
    joints = [m.joint(f"storey{j}") for j in range(1, 5)]
    at = [int(j.dofadr[0]) for j in joints]
    for _ in range(5):
        drift, rate = rng.standard_normal(4) * 1e-3, rng.standard_normal(4) * 1e-2
        mujoco.mj_resetData(m, d)
        d.qpos[[int(j.qposadr[0]) for j in joints]], d.qvel[at] = drift, rate
        mujoco.mj_forward(m, d)
        force = np.array([d.sensor("pull").data[0], d.sensor("pull_2").data[0]])
        # Relative to the ground, whose own acceleration the engine has too.
        own = np.cumsum(d.qacc[at])
        state = np.concatenate([np.cumsum(drift), np.cumsum(rate)])
        found = (linear.a @ state - linear.b @ force)[4:]
        np.testing.assert_allclose(found, own, atol=2e-6)
        measured, through = outputs(known, [f"acceleration_{j}" for j in range(1, 5)])
        np.testing.assert_allclose(measured @ state - through @ force, own, atol=2e-6)
        stroke, _ = outputs(known, names := ["stroke", "stroke_2", "stroke_velocity_2", "drift_1", "drift_3"])
        read = [float(d.sensor(name).data[0]) for name in names]
        np.testing.assert_allclose(stroke @ state, read, rtol=1e-9, atol=1e-12)


def test_the_regulator_of_two_forces_on_two_oscillators_is_that_of_each() -> None:
    """x'' = -w^2 x + f: min of q x^2 + r f^2 gives k = [-w^2 + sqrt(w^4 + q/r), sqrt(2 k_1)] by hand."""
    w, q, r = np.array([3.0, 5.0]), np.array([4.0, 9.0]), 0.1
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.diag(w**2), np.zeros((2, 2))]])
    b, c = np.vstack([np.zeros((2, 2)), np.eye(2)]), np.hstack([np.eye(2), np.zeros((2, 2))])
    k = regulator_gain(a, b, c, np.zeros((2, 2)), q, r)
    first = -(w**2) + np.sqrt(w**4 + q / r)
    np.testing.assert_allclose(k, np.hstack([np.diag(first), np.diag(np.sqrt(2 * first))]), atol=1e-9)


@pytest.mark.parametrize(
    "spec", ["clipped-optimal", "force-tracking", "lyapunov", "skyhook", "max-dissipation:weak=80"]
)
def test_each_damper_has_a_command_of_its_own(file: Path, spec: str) -> None:
    made, off = bench(file), "passive-off"
    made.check(spec)
    found, without = (made.history(s, LOAD, 1.0) for s in (spec, off))
    assert found.command.shape == found.force.shape == (len(found.time), 2)
    assert (found.command[:, 0] != found.command[:, 1]).any()
    assert np.abs(found.drift).max() < np.abs(without.drift).max()
    engine = np.abs(bench(file, "mujoco").history(spec, LOAD, 1.0).drift).max()
    assert np.abs(found.drift).max() == pytest.approx(engine, rel=0.03)


def test_a_command_for_each_damper_in_the_table(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = tmp_path / "own_two.py"
    own.write_text(OWN)
    LOAD.save(tmp_path / "shake.csv")
    call: list[str | Path] = ["compare", "frame", "--model", file, "--dampers", "0-1", "1-2", "--engine", "chain"]
    call += ["--command-unit", "V", "--motions", tmp_path / "shake.csv", "--jobs", "1", "--json"]
    assert run(*call, "--controllers", f"mine={own}:Two", "passive-on") == 0
    found = json.loads(capsys.readouterr().out)["controllers"]
    assert found["mine"]["measures"]["mean_command"]["mean"] == pytest.approx(0.75)
    # Behind the driver's lag of 1/190 s, of five fifths of a second: 1 A at 3 V, 5 ohm, both coils.
    lasts, lag = 1.0, 1 / 190
    coils = 5.0 * (lasts - 1.5 * lag) * ((1 / 3) ** 2 + (0.5 / 3) ** 2)
    assert found["mine"]["measures"]["coil_energy"]["mean"] == pytest.approx(coils, rel=5e-3)
    with pytest.raises(InputError, match=r"its command at 0 s is .*; allowed: a finite number, or 2 of them"):
        run(*call, "--controllers", f"mine={own}:Three")


def test_a_policys_outputs_are_the_dampers_commands(file: Path, tmp_path: Path) -> None:
    """Actions 0 and -1/2 are a half and a quarter of 2.25 V, in a run and in rows of many."""
    both, made = steady(tmp_path / "policy.json", 0.0, -0.5), bench(file)
    ((spec,),) = (row.specs for row in contenders(made, [f"mine=policy:{both}"], {}))
    found = made.history(spec, LOAD, 1.0).command
    np.testing.assert_allclose(found, np.tile([1.125, 0.5625], (len(found), 1)), rtol=1e-12)
    rows = made.controller(spec).command(0.0, dict.fromkeys(made.measured, np.zeros(3)))  # type: ignore[arg-type]
    np.testing.assert_allclose(rows, [[1.125] * 3, [0.5625] * 3], rtol=1e-12)
    least = LeastCommand(1.0, 2.0, 1.0, 1.0)
    refuses(lambda: steady(both, 0.0, -0.5, least=least), "for 2 dampers; allowed")
