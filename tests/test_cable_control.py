"""The taut cable against closed forms and its own noise, its reference numbers, and clipped-optimal on a stay cable."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from excitation import Array
from knowing import Known
from mrdamp.compare import cable_reference
from mrdamp.compare.bench import UNCONTROLLED
from mrdamp.compare.cable_reference import ControlledCable, semi_active
from mrdamp.compare.linear import CableBench
from mrdamp.control.cable import cable_outputs, cable_plant
from mrdamp.control.clipped_optimal import OptimalForce
from mrdamp.control.force_control import ForceController
from mrdamp.control.passive import Replay
from mrdamp.control.registry import make
from mrdamp.envs.loads import AmbientLoads, CableLoad
from mrdamp.envs.plant_env import RowPlant
from mrdamp.structures.cables import TENSION, StayCable
from refusals import refuses


def test_matrices_are_the_integrals_of_the_shapes() -> None:
    cable = ControlledCable(0.05, modes=3)
    x = np.linspace(0, 1, 20001)
    shapes = np.array([np.minimum(x / 0.05, (1 - x) / 0.95), *(np.sin(k * np.pi * x) for k in (1, 2, 3))])
    slopes = np.array(
        [np.where(x < 0.05, 20.0, -1 / 0.95), *(k * np.pi * np.cos(k * np.pi * x) for k in (1, 2, 3))]
    )
    for found, rows, unit in ((cable.mass, shapes, 1.0), (cable.stiffness, slopes, TENSION)):
        wanted = unit * np.trapezoid(rows[:, None] * rows[None, :], x, axis=2)
        np.testing.assert_allclose(found, wanted, rtol=2e-3, atol=2e-4 * np.abs(wanted).max())
    np.testing.assert_allclose(cable.forcing, np.trapezoid(shapes, x, axis=1), atol=1e-4)
    mode1 = replace(cable, load="mode1")
    np.testing.assert_allclose(mode1.forcing, np.trapezoid(shapes * shapes[1], x, axis=1), atol=1e-4)
    np.testing.assert_allclose(cable.at_damper, shapes[:, 1000])


@pytest.mark.parametrize(("at", "largest"), [(0.01, 0.50513), (0.02, 1.02113), (0.05, 2.64396)])
def test_damping_of_the_first_mode_by_the_best_dashpot(at: float, largest: float) -> None:
    # Largest damping of a taut string's first mode, percent, solved from its transcendental equation elsewhere.
    cable = ControlledCable(at, ratio=1e-9, modes=40)
    found = 0.0
    for kappa in np.linspace(0.085, 0.12, 12):
        c = kappa / at / math.pi  # kappa = c / (m L w1) x_d/L with m = L = w1 = 1, in units of pi
        p = cable.plant
        poles = np.linalg.eigvals(p.a - c * math.pi * np.outer(p.b, cable.velocity_row))
        first = poles[np.argmin(np.abs(poles - 1j))]
        found = max(found, -100 * first.real / abs(first))
    assert found == pytest.approx(largest, rel=0.01)


@pytest.mark.slow
def test_lyapunov_equation_and_simulated_noise_agree() -> None:
    # A dashpot's force always takes energy out, so that clipping leaves it as it is.
    cable = ControlledCable(0.05, ratio=0.02)
    gain = 2.3 * cable.velocity_row
    motion, force = cable.rms(gain)
    found = semi_active(cable, gain, period=2e-3, duration=150.0, runs=128)
    assert found[0] == pytest.approx(motion, rel=0.03)
    assert found[1] == pytest.approx(force, rel=0.05)
    # A force that pushes is cut to nothing: the bare cable.
    bare = semi_active(cable, -gain, period=2e-3, duration=150.0, runs=128)
    assert bare[0] == pytest.approx(cable.rms(0 * gain)[0], rel=0.06)
    assert bare[1] == 0.0


def test_active_control_minimises_its_cost() -> None:
    cable, r = ControlledCable(0.02), 1e-3
    gain = cable.optimal_gain(r)

    def cost(k: Array) -> float:
        motion, force = cable.rms(k)
        return motion**2 + r * force**2

    best = cost(gain)
    for share in (0.05, -0.05):
        assert best < cost((1 + share) * gain) < 1.05 * best
    for c in (0.3, -0.3):
        assert best < cost(gain + c * cable.velocity_row) < 1.1 * best
    refuses(lambda: cable.rms(-gain), "unstable")
    assert cost(cable.best_viscous() * cable.velocity_row) > 3 * best


def test_reference_numbers_of_uncontrolled_and_active_cables() -> None:
    for (at, load), (uncontrolled, active, _) in cable_reference.REFERENCE.items():
        cable = ControlledCable(at, load=load)
        best = cable.rms(cable.best_viscous() * cable.velocity_row)[0]
        gain = cable.optimal_gain()
        assert cable.rms(0 * gain)[0] / best == pytest.approx(uncontrolled, rel=1e-3)
        assert cable.rms(gain)[0] / best == pytest.approx(active, rel=1e-3)


@pytest.mark.slow
def test_semi_active_reference_numbers_within_five_percent() -> None:
    for row in cable_reference.table():
        assert max(map(abs, row.deviation)) < 5.0, row
        assert abs(row.deviation[0]) < 0.1


def test_outputs_of_a_stay_cable() -> None:
    cable = StayCable(modes=4)
    rows, through = cable_outputs(
        cable, (0.1,), ["displacement_1", "velocity_1", "stroke", "mode_2", "acceleration_1"]
    )
    n = len(cable.natural)
    rng = np.random.default_rng(1)
    s, f = rng.standard_normal(2 * n), 3.0
    linear, w = cable_plant(cable), cable.natural
    rates = np.concatenate([s[n:], -(w**2) * s[:n] - 2 * cable.ratio * w * s[n:] - cable.at(cable.damper_at) * f])
    np.testing.assert_allclose(linear.a @ s + linear.b * f, rates)
    x = rows @ s + through * f
    assert x[0] == pytest.approx(float(cable.at(0.1) @ s[:n]))
    assert x[1] == pytest.approx(float(cable.at(0.1) @ s[n:]))
    assert x[2] == pytest.approx(float(cable.at(cable.damper_at) @ s[:n]))
    assert x[4] == pytest.approx(float(cable.at(0.1) @ rates[n:]))
    # The squares of the modes are the mean square motion over the length.
    place = np.linspace(0, 1, 4001)
    modes, _ = cable_outputs(cable, (), [f"mode_{k}" for k in range(1, n + 1)])
    assert np.sum((modes @ s) ** 2) == pytest.approx(
        np.trapezoid((cable.at(place) @ s[:n]) ** 2, place), rel=1e-4
    )
    refuses(lambda: cable_outputs(cable, (0.1,), ["acceleration_2"]), "measurement 'acceleration_2' is unknown")


@pytest.mark.parametrize("engine", ["mujoco", "chain"])
def test_force_and_energy_of_a_run_are_over_all_steps(engine: str) -> None:
    """By the samples of the same commands at every step of a fifth: the force follows the sign of a fast motion."""
    load = AmbientLoads(duration=1.0).draw(np.random.default_rng(0), StayCable().length)
    u = np.random.default_rng(1).choice([0.0, 4.0], 201)
    bench = CableBench(engine=engine)
    run = bench.driven(Replay(u, 5e-3, "given"), load, 1.0)
    plant = RowPlant(bench.structure, period=5e-5, timestep=5e-5, engine=engine)
    y = [plant.reset(load), *(plant.step(one) for one in np.repeat(u, 100))]
    force, stroke = (np.array([each[name] for each in y]) for name in ("true_force", "stroke"))
    assert run["peak_force"] == pytest.approx(np.abs(force).max(), rel=0.01)
    energy = np.sum((force[1:] + force[:-1]) / 2 * np.diff(stroke))
    assert run["dissipated_energy"] == pytest.approx(energy, rel=0.01)


@pytest.mark.slow
def test_clipped_optimal_moves_the_cable_less_than_any_constant_command() -> None:
    bench = CableBench()
    load = CableLoad("noise", 0.02, np.array([0.5]), 1.5 * np.random.default_rng(3).standard_normal((300, 1)))
    bare = bench.run(UNCONTROLLED, load, 1.0)
    specs = ("clipped-optimal", *(f"constant:value={v}" for v in (0, 1, 2, 4)))
    motion = {s: bench.values(bench.run(s, load, 1.0), bare)["motion"] for s in specs}
    best = min(value for s, value in motion.items() if s != "clipped-optimal")
    assert motion["clipped-optimal"] < 0.95 * best < 0.8
    again = bench.run("clipped-optimal", load, 1.0)
    assert again["dissipated_energy"] > 0
    assert 0 < again["mean_command"] < 4
    refuses(lambda: make("best-guess", bench.site), "controller 'best-guess' is unknown")


@pytest.mark.parametrize("kind", ["lyapunov", "max-dissipation"])
def test_bang_bang_on_a_cable_is_on_where_the_force_takes_the_function_down(kind: str) -> None:
    cable = StayCable(modes=4, ratio=0.01)
    made = make(kind, replace(CableBench(cable).site, cable=cable))
    assert isinstance(made, ForceController)
    assert isinstance(made.aim, OptimalForce)
    w, shape, n = cable.natural, cable.at(cable.damper_at), len(cable.natural)
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(40):
        s, f = (
            rng.standard_normal(2 * n) * np.concatenate([1e-2 / w, np.full(n, 1e-2)]),
            float(rng.standard_normal()),
        )
        if kind == "max-dissipation":  # the energy of each mode, typed in
            gradient = np.concatenate([w**2 * s[:n], s[n:]])
        else:  # int of |q|^2 of a free oscillator, from its Lyapunov equation solved by hand, mode by mode
            z = cable.ratio
            qq, qv, vv = (1 + 4 * z * z) / (4 * z * w), 1 / (2 * w**2), 1 / (4 * z * w**3)
            gradient = 2 * np.concatenate([qq * s[:n] + qv * s[n:], qv * s[:n] + vv * s[n:]])
        made.aim.estimator = Known(s)  # type: ignore[assignment]
        on = made.command(0.0, {"force": f}) > 0
        assert on == (float(gradient[n:] @ (-shape * f)) < 0)
        seen.add(on)
    assert seen == {True, False}
