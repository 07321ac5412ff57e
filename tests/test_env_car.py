"""The quarter car: its model against SciPy and Lyapunov's equation, MuJoCo against the chain, and its controllers."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_continuous_are, solve_continuous_lyapunov, solve_discrete_are

from dampers import off
from env_arguments import dashpot
from excitation import Array
from mrdamp import models_xml
from mrdamp.compare.car import CarBench
from mrdamp.control.car import HookForce, add_switch, car_plant, regulated, sh_add_switch, skyhook_switch
from mrdamp.control.registry import make
from mrdamp.envs import Bumps, CarPlant, CarTask, RecordedRoads
from mrdamp.envs.car import linear_run
from mrdamp.envs.frame_xml import car_xml
from mrdamp.simulation.criteria import wk, wk_sections
from mrdamp.simulation.roads import CLASSES, Road, bump, iso8608, read_road
from mrdamp.structures.lumped import QuarterCar
from refusals import refuses

CAR = QuarterCar()
@pytest.mark.parametrize("road_class", CLASSES)
def test_a_road_has_the_spectrum_of_its_class(road_class: str) -> None:
    """By Welch's estimate, in octaves: G(n) = G(0.1) (n / 0.1)^-2, G(0.1) 4^k 16e-6 m3."""
    found = []
    for seed in range(20):
        road = iso8608(road_class, 20.0, 100.0, seed, lead=0.0)
        n, density = signal.welch(road.height, 1 / road.spacing, nperseg=2**15, detrend="linear")
        found.append(density)
    density = np.mean(found, axis=0)
    wanted = 16e-6 * 4.0 ** "ABCD".index(road_class)
    for centre in (0.022, 0.1, 0.5, 2.0):
        band = (n > centre / math.sqrt(2)) & (n < centre * math.sqrt(2))
        assert np.mean(density[band] * (n[band] / 0.1) ** 2) == pytest.approx(wanted, rel=0.05), centre
    assert density[n > 3.0].max() < 1e-3 * wanted * (3.0 / 0.1) ** -2


def test_a_short_road_holds_the_whole_band() -> None:
    """The mean square of the rise over 30 m is that of the spectrum: the integral of 2 G (1 - cos 2 pi n L)."""
    rises = [iso8608("C", 3.0, 10.0, seed, lead=0.0).height[-1] for seed in range(1500)]
    n = np.linspace(0.011, 2.83, 200001)
    wanted = np.trapezoid(2 * 256e-6 * (n / 0.1) ** -2 * (1 - np.cos(2 * np.pi * n * 30.0)), n)
    assert np.mean(np.square(rises)) == pytest.approx(wanted, rel=0.08)


def test_the_wheel_passes_the_heights_without_jumps_of_its_velocity() -> None:
    road = iso8608("C", 20.0, 2.0, 1)
    place = road.spacing * np.arange(len(road.height))
    np.testing.assert_allclose(road.at(place / road.speed), road.height, atol=1e-12)
    fine = np.diff(road.at(np.arange(0, 1.9, 1e-5))) / 1e-5
    assert np.abs(np.diff(fine)).max() < 5e-3 * np.abs(fine).max()


def test_bumps_and_files(tmp_path: Path) -> None:
    road = bump(0.08, 2.0, 5.0, lead=0.5)
    time = np.array([0.49, 0.6, 0.7, 0.91, 3.0])
    x = 5.0 * (time - 0.5)
    wanted = np.where((x > 0) & (x < 2), 0.04 * (1 - np.cos(np.pi * x)), 0.0)
    np.testing.assert_allclose(road.at(time), wanted, atol=2e-5)
    file = tmp_path / "lane.csv"
    file.write_text("position_m,height_m\n0,0.01\n0.5,0.02\n2,0.01\n4,0.05\n")
    found = read_road(file, 2.0)
    np.testing.assert_allclose(found.at([0.0, 0.25, 1.0, 1.5, 9.0]), [0.0, 0.01, 0.0, 0.02, 0.04], atol=1e-12)
    assert RecordedRoads([file], speed=(3.0, 3.0)).draw(np.random.default_rng(0)).speed == 3.0
    file.write_text("position_m,height_m\n0,0.01\n0,0.02\n2,0.01\n")
    refuses(lambda: read_road(file, 2.0), r"lane\.csv: 3 positions")
    refuses(lambda: iso8608("E", 20.0, 5.0, 1), "road class is 'E'; allowed: A, B, C, D")
    assert Bumps().draw(np.random.default_rng(1)).height.max() > 0.02


#: ISO 2631-1:1997, table 3, principal weighting Wk in thirds of octaves.
TABLE = {
    0.5: 0.418, 1.0: 0.482, 2.0: 0.531, 4.0: 0.967, 6.3: 1.054, 8.0: 1.036, 16.0: 0.768, 31.5: 0.405, 63.0: 0.186,
    80.0: 0.132,
}  # fmt: skip


def test_the_weighting_is_the_standards() -> None:
    np.testing.assert_allclose(np.abs(wk(list(TABLE))), list(TABLE.values()), rtol=0.004)
    time = np.arange(0, 40.0, 1e-3)
    for f, weight in TABLE.items():
        if f <= 31.5:
            found = signal.sosfilt(wk_sections(1e-3), np.sqrt(2) * np.sin(2 * np.pi * f * time))
            assert np.sqrt(np.mean(found**2)) == pytest.approx(weight, rel=0.02), f
    refuses(lambda: wk_sections(5e-3), "sample time")


def test_rms_values_are_lyapunovs() -> None:
    """A long class C road is white noise in velocity, of density (2 pi 0.1)^2 G(0.1) v."""
    c, speed = 0.3 * CAR.critical_damping, 20.0
    a, b, out, _ = CAR.passive(c)
    density = (2 * math.pi * 0.1) ** 2 * CLASSES["C"] * speed
    covariance = solve_continuous_lyapunov(a, -0.5 * density * b @ b.T)
    wanted = np.sqrt(np.diag(out @ covariance @ out.T))
    heights = iso8608("C", speed, 400.0, 2).at(1e-3 * np.arange(400_000))
    _, load, stroke = linear_run(CAR, heights, 1e-3)
    assert np.std(stroke) == pytest.approx(wanted[2], rel=0.05)
    assert np.std(load) == pytest.approx(wanted[1], rel=0.05)


def test_what_a_damper_dissipates_is_the_roads() -> None:
    """Zuo and Zhang 2013, doi 10.1115/1.4007562: pi^2 G_r V k_t, whatever the damper; G_r = 0.1^2 G(0.1)."""
    task = CarTask(1, car=QuarterCar(tyre_damping=0.0), engine="chain")
    road = iso8608("B", 25.0, 60.0, 4)
    task.reset([0], [np.random.default_rng(0)], {"road": road})
    for _ in range(round(road.duration / 5e-3)):
        info = task.step(np.array([[-0.6]])).info[0]
    found = info[task.score.NAMES.index("dissipated_energy")] / road.duration
    assert found == pytest.approx(math.pi**2 * 0.01 * CLASSES["B"] * 25.0 * 210e3, rel=0.06)


@pytest.mark.parametrize("engine", ["mujoco", "chain"])
def test_a_dashpot_in_place_of_the_damper_is_the_linear_car(engine: str) -> None:
    plant = CarPlant(model=dashpot(0.3 * CAR.critical_damping), timestep=2e-4, engine=engine)
    road = iso8608("B", 20.0, 4.0, 7)
    plant.reset(road)
    total, rows = np.zeros(3), []
    while not plant.finished:
        rows.append(plant.step(0.0)["stroke"])
        total += plant.of_period[:3]
    n = len(rows)
    found = linear_run(CAR, road.at(2e-4 * np.arange(25 * n)), 2e-4)
    np.testing.assert_allclose(total / n, [np.mean(x * x) for x in found], rtol=0.01)
    assert off(np.array(rows[:-1]), found[2][25::25]) < 0.01


def jumping(t: float, s: Array, c: float, road: Road) -> Array:
    """Rates of wheel, body (m) and their velocities, written out from Newton's law."""
    w, rate = road.at(t), (road.at(t + 1e-6) - road.at(t - 1e-6)) / 2e-6
    strut = 20_000.0 * (s[1] - s[0]) + c * (s[3] - s[2])
    tyre = max(0.0, 440.0 * 9.80665 - 210_000.0 * (s[0] - w) - 120.0 * (s[2] - rate))
    return np.array([s[2], s[3], (strut + tyre - 440.0 * 9.80665) / 40.0, -strut / 400.0])


@pytest.mark.parametrize("engine", ["mujoco", "chain"])
def test_the_wheel_leaves_the_road_as_in_scipy(engine: str) -> None:
    road, c, period = bump(0.12, 1.0, 8.0, 1.5, lead=0.2), 800.0, 5e-3
    plant = CarPlant(model=dashpot(c), timestep=2e-4, period=period, engine=engine)
    plant.reset(road)
    rows, off_road = [], 0.0
    while not plant.finished:
        y = plant.step(0.0)
        rows.append([y["stroke"], y["displacement_1"]])
        off_road += plant.of_period[4]
    time = period * np.arange(1, len(rows) + 1)
    solved = solve_ivp(
        jumping,
        (0.0, time[-1]),
        np.zeros(4),
        args=(c, road),
        t_eval=time,
        max_step=5e-4,
        rtol=1e-8,
        atol=1e-10,
    )
    wheel, body, wheel_rate, _ = solved.y
    gap = wheel - road.at(time)
    found = np.array(rows)
    assert off(found[:, 0], body - wheel) < 0.01
    assert off(found[:, 1], gap) < 0.01
    away = 440.0 * 9.80665 - 210_000.0 * gap - 120.0 * wheel_rate <= 0  # behind the bump the road is flat
    assert away.any()
    assert off_road / len(rows) == pytest.approx(away.mean(), abs=0.02)


def test_the_shipped_model_is_the_environments() -> None:
    ends = []
    for text in (
        models_xml.path("quarter_car").read_text(encoding="utf-8"),
        car_xml(CAR, CarTask(1).structure.models[0], 5e-4),
    ):
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        data.actuator("damper").ctrl = 1.0
        data.joint("tyre").qpos, data.joint("suspension").qvel = -0.01, 0.3
        for _ in range(200):
            mujoco.mj_step(model, data)
        ends.append([*data.qpos[1:], *data.qvel[1:]])
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-9)


BENCH = CarBench(engine="chain", timestep=1e-3)
SITE = BENCH.site


def test_sh_add_is_the_papers_rule() -> None:
    """Savaresi and Spelta 2007: c_max where (a^2 - alpha^2 v^2 <= 0 and v r > 0) or (a^2 - alpha^2 v^2 > 0 and a r >
    0)."""
    alpha, switch = 7.0, sh_add_switch(7.0)
    rng = np.random.default_rng(1)
    for v, r, a in rng.normal(size=(200, 3)) * [0.2, 0.3, 1.0]:
        low = a * a - alpha**2 * v * v <= 0
        assert switch(0.0, v, r, a) == bool((low and v * r > 0) or (not low and a * r > 0))


def test_the_field_is_on_where_the_force_on_the_body_helps() -> None:
    """A damper that is being extended pulls the body down: on where that brakes it, or takes from its acceleration."""
    rng = np.random.default_rng(2)
    for wheel, body, acceleration in rng.normal(size=(100, 3)) * [1.0, 0.2, 1.0]:
        stroke = body - wheel
        on_body = -100.0 * np.sign(stroke)
        assert skyhook_switch(wheel, body, stroke, acceleration) == (on_body * body < 0)
        assert add_switch(wheel, body, stroke, acceleration) == (on_body * acceleration < 0)


def test_velocities_and_forces_of_a_sine() -> None:
    """With accelerations of wheel and body in quadrature; the integrator's leak is slow."""
    aim, w = HookForce(900.0, 0.25, 50.0, SITE.period), 2 * math.pi * 3.0
    for k in range(2000):
        t = k * SITE.period
        found = aim(t, {"acceleration_1": 4 * w * math.cos(w * t), "acceleration_2": -w * math.sin(w * t)})
    # The start's offset of the body's velocity has leaked away by exp(-t / 50 s).
    body = math.cos(w * t) - math.exp(-t / 50.0)
    assert found == pytest.approx(900.0 * (0.25 * body - 0.75 * 4 * math.sin(w * t)), abs=15.0)


def cost(holding: float, stroke: float, r: float) -> tuple[Array, Array, Array, Array, Array]:
    """a, b, and the weights of states, of states with the force and of the force, written out."""
    a = np.array(
        [[0, 0, 1, 0], [0, 0, -1, 1], [-210e3 / 40, 20e3 / 40, -120 / 40, 0], [0, -20e3 / 400, 0, 0]],
        dtype=float,
    )
    b = np.array([[0.0], [0.0], [1 / 40], [-1 / 400]])
    c = np.vstack([a[3], [1.0, 0, 0, 0], [0, 1.0, 0, 0]])
    d = np.array([b[3, 0], 0.0, 0.0])
    q = np.diag([1.0, holding * (210e3 / 400) ** 2, stroke * (20e3 / 400) ** 2])
    return a, b, c.T @ q @ c, (c.T @ q @ d)[:, None], np.array([[d @ q @ d + r / 400**2]])


def test_the_lq_force_is_that_of_riccatis_equation() -> None:
    a, b, q, s, r = cost(0.3, 0.03, 1e-3)
    p = solve_continuous_are(a, b, q, r, s=s)
    gain = np.linalg.solve(r, b.T @ p + s.T)[0]
    aim: Any = make("lq-tracking:holding=0.3,stroke=0.03,r=1e-3,roughness=1e-3", SITE)
    np.testing.assert_allclose(aim.aim.k, gain, rtol=1e-6)
    np.testing.assert_allclose(car_plant(SITE.car).a, a)
    assert regulated(SITE.car, 0.0, 0.0)["acceleration_2"] == 1.0


def test_mpc_is_the_discrete_regulator_where_nothing_binds(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("osqp", reason="needs the extra mpc")
    from mrdamp.control.car import MpcForce

    a, b, q, s, r = cost(0.3, 0.03, 1e-3)
    both = np.zeros((5, 5))
    both[:4, :4], both[:4, 4:] = a, b
    moved = expm(both * SITE.period)
    a, b = moved[:4, :4], moved[:4, 4:]
    p = solve_discrete_are(a, b, q, r, s=s)
    gain = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a + s.T)[0]
    aim = MpcForce(SITE, {"holding": 0.3, "stroke": 0.03, "r": 1e-3, "roughness": 1e-3, "horizon": 0.1})
    state = np.array([-1e-3, 4e-3, 0.05, 0.03])
    monkeypatch.setattr(aim, "_estimator", lambda y: state)
    wanted = -float(gain @ state)
    assert abs(wanted) > 20
    found = aim(0.0, {"stroke_velocity": math.copysign(0.1, wanted)})
    assert found == pytest.approx(wanted, rel=0.01)
    assert aim(0.0, {"stroke_velocity": -math.copysign(0.1, wanted)}) == pytest.approx(0.0, abs=1e-6)
    monkeypatch.setattr(aim, "_estimator", lambda y: 1e3 * state)
    assert abs(aim(0.0, {"stroke_velocity": math.copysign(0.1, wanted)})) == pytest.approx(
        SITE.force_max, rel=1e-3
    )


def test_a_road_at_another_speed_takes_the_time_and_the_name_of_that_speed() -> None:
    """20 m/s are 72 km/h; at 10 m/s a road takes twice the time."""
    road = iso8608("B", 20.0, 10.0, 3)
    slow = road.at_speed(10.0)
    assert slow.speed == 10.0
    assert slow.duration == pytest.approx(2 * road.duration)
    np.testing.assert_array_equal(slow.height, road.height)
    assert slow.name == iso8608("B", 10.0, 10.0, 3).name
    env = gymnasium.make("mrdamp:mrdamp/QuarterCar-v0", engine="chain")
    _, info = env.reset(seed=1, options={"road": road, "speed": 10.0})
    assert (info["road"], info["speed"]) == (slow.name, 10.0)
    assert info["duration"] == pytest.approx(slow.duration, abs=0.01)
