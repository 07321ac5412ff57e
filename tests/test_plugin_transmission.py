"""Where a damper may act: several on one body, along chains, on tendons and sites, geared, under any load."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
import pytest
from scipy.linalg import expm

from dampers import attributes, rms
from excitation import Array
from mjcf_builders import Damper, Sensor, chain, compiled, config, document, signals, slider, step_through

BOUC_WEN = {
    "c0a": 300.0, "c0b": 0.0, "alpha_a": 3e4, "alpha_b": 0.0, "gamma": 9e5, "beta": 4e5, "A": 110.0, "n": 2.0,
    "k0": 0.0, "x0": 0.0,
}  # fmt: skip
APART = '<flag contact="disable"/>'  # bodies pass through each other
DYKE = {**attributes("dyke1996_3kN"), "driver_lag_tau": 0.0}
LAWS: Mapping[str, Mapping[str, float]] = {"bouc_wen": BOUC_WEN, "modified_bouc_wen": DYKE}


def viscous(c: float, friction: float = 0.0) -> dict[str, float]:
    return {"c0a": c, "c0b": 0.0, "fya": friction, "fyb": 0.0, "v_ref": 0.01}


# --- several dampers ------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [0.02, 0.3])
def test_two_linear_dampers_are_one_of_their_sum(ratio: float) -> None:
    """c h / m = ratio in all: the same motion, and shares of the force in proportion to c."""
    mass, timestep = 2.0, 1e-3
    c = ratio * mass / timestep
    pair = [Damper("bingham", viscous(0.3 * c), "a"), Damper("bingham", viscous(0.7 * c), "b")]
    one, one_data = compiled(
        document(slider(mass, stiffness=2e3), [Damper("bingham", viscous(c), "a")], (Sensor("f", "a"),))
    )
    two, two_data = compiled(
        document(slider(mass, stiffness=2e3), pair, (Sensor("f", "a"), Sensor("g", "b")))
    )
    one_data.qvel[0] = two_data.qvel[0] = 0.6
    single, double = step_through(one, one_data, 300), step_through(two, two_data, 300)
    assert np.max(np.abs(double.v - single.v)) < 2e-3 * 0.6
    assert rms(double.sensors.sum(axis=1) - single.sensors[:, 0]) < 2e-3 * rms(single.sensors)
    np.testing.assert_allclose(double.sensors[:, 1] * 0.3, double.sensors[:, 0] * 0.7, rtol=1e-9)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("count", [2, 5])
@pytest.mark.parametrize("ratio", [0.2, 1.0, 10.0, 30.0])
def test_stiff_dampers_on_one_joint_do_not_ring(ratio: float, count: int, integrator: str) -> None:
    """Each alone has c h / m = ratio: v falls as it should, and does not swing to the other side."""
    c, timestep = 500.0, 1e-3
    dampers = [Damper("bingham", viscous(c), f"d{k}") for k in range(count)]
    model, data = compiled(
        document(slider(c * timestep / ratio), dampers, (), timestep=timestep, integrator=integrator)
    )
    data.qvel[0] = 0.8
    v = step_through(model, data, 200).v[:, 0]
    assert np.all(np.diff(np.abs(v)) <= 1e-12)
    assert np.min(v) > -0.01 * 0.8
    assert v[1] == pytest.approx(0.8 * math.exp(-ratio * count), abs=0.1 * 0.8)
    assert abs(v[-1]) < 1e-9
    # and under a load they share it
    data.qfrc_applied[0] = 30.0
    assert step_through(model, data, 500).v[-1, 0] == pytest.approx(30.0 / (c * count), rel=1e-3)
    assert sum(data.actuator_force) == pytest.approx(-30.0, rel=1e-3)


@pytest.mark.parametrize("mass", [0.02, 0.5, 50.0])
def test_two_laws_on_one_joint(mass: float) -> None:
    """A Bingham and a modified Bouc-Wen damper side by side: bounded, and the energy falls."""
    dampers = [Damper("bingham", viscous(600.0, 80.0), "a"), Damper("modified_bouc_wen", DYKE, "b")]
    model, data = compiled(
        document(slider(mass, stiffness=1000.0), dampers, (Sensor("f", "a"), Sensor("g", "b")))
    )
    data.qpos[0] = 0.02
    data.qvel[0] = 0.5
    track = step_through(model, data, 5000)
    energy = 0.5 * mass * track.v[:, 0] ** 2 + 0.5 * 1000.0 * track.x[:, 0] ** 2
    assert np.all(np.isfinite(energy))
    # the hysteresis of the second holds some millijoule
    assert np.max(energy - np.minimum.accumulate(energy)) < 0.01 + 1e-3 * energy[0]
    assert np.max(np.abs(track.v[4000:])) < 0.01


def test_forces_of_two_laws_add_up() -> None:
    """On the same motion each reads what it reads alone, and the body feels the sum."""
    dampers = [Damper("bingham", viscous(600.0, 80.0), "a"), Damper("modified_bouc_wen", DYKE, "b")]
    readings = []
    for chosen in (dampers, dampers[:1], dampers[1:]):
        model, data = compiled(document(slider(1e9), chosen, tuple(Sensor(d.name, d.name) for d in chosen)))
        data.qvel[0] = 0.1
        readings.append((step_through(model, data, 400), data.qacc[0]))
    both, first, second = (track.sensors for track, _ in readings)
    np.testing.assert_allclose(both[:, 0], first[:, 0], rtol=1e-6)
    np.testing.assert_allclose(both[:, 1], second[:, 0], rtol=1e-6)
    assert readings[0][1] == pytest.approx(readings[1][1] + readings[2][1], rel=1e-6)


@pytest.mark.parametrize("scale", [1.0, 300.0])
def test_dampers_along_a_chain(scale: float) -> None:
    """Three bodies, a dashpot in each storey and one across two: the matrix exponential."""
    masses, c = np.array([3.0, 2.0, 1.0]), scale * np.array([8.0, 5.0, 12.0, 6.0])
    storeys = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0]])  # in drifts
    dampers = [Damper("bingham", viscous(float(c[k])), f"d{k}", f'joint="j{k}"') for k in range(3)]
    dampers.append(Damper("bingham", viscous(float(c[3])), "across", 'tendon="t"'))
    tendon = (
        '<tendon><fixed name="t"><joint joint="j1" coef="1"/><joint joint="j2" coef="1"/></fixed></tendon>'
    )
    model, data = compiled(document(chain(masses, [0.0] * 3, [0.0] * 3), dampers, (), extra=tendon))
    start = np.array([0.5, -0.3, 0.4])
    data.qvel[:] = start
    v = step_through(model, data, 400).v
    # inertia in drifts: velocities of the bodies are sums of the drifts' below
    lower = np.tril(np.ones((3, 3)))
    inertia = lower.T @ np.diag(masses) @ lower
    damping = storeys.T @ np.diag(c) @ storeys
    decay = expm(-np.linalg.solve(inertia, damping) * 1e-3)
    expected = np.array([np.linalg.matrix_power(decay, k) @ start for k in range(400)])
    if scale == 1.0:
        np.testing.assert_allclose(v, expected, atol=2e-3 * 0.5)
    energy = np.einsum("ki,ij,kj->k", v, inertia, v)
    assert np.all(np.diff(energy) <= 1e-9 * energy[0])
    assert energy[-1] < 1.5 * float(expected[-1] @ inertia @ expected[-1]) + 1e-6 * energy[0]


def test_dampers_on_separate_bodies_do_not_feel_each_other() -> None:
    dampers = [Damper("bouc_wen", BOUC_WEN, "a"), Damper("modified_bouc_wen", DYKE, "b", 'joint="j1"')]
    bodies = slider(1.0, stiffness=3e3) + slider(0.4, stiffness=2e3, name="j1")
    both, data = compiled(document(bodies, dampers, (), options=APART))
    data.qvel[:] = 0.4
    together = step_through(both, data, 1000).x
    for k, alone in enumerate(dampers):
        model, single = compiled(document(bodies, [alone], (), options=APART))
        single.qvel[:] = 0.4
        np.testing.assert_allclose(step_through(model, single, 1000).x[:, k], together[:, k], atol=1e-9)


# --- transmissions ----------------------------------------------------------------------------------

TWO = slider(2.0, stiffness=900.0) + slider(3.0, stiffness=700.0, name="j1")
TENDON = (
    '<tendon><fixed name="t"><joint joint="j0" coef="1.5"/><joint joint="j1" coef="-0.5"/></fixed></tendon>'
)
START = np.array([0.4, -0.2])


def run(bodies: str, damper: Damper, extra: str, steps: int = 1500) -> tuple[Array, Array, Array]:
    """Joint motion, stroke and actuator force along the way."""
    model, data = compiled(document(bodies, [damper], signals(), extra=extra, options=APART))
    data.qvel[: min(2, model.nv)] = START[: model.nv]
    track = step_through(model, data, steps)
    address = {name: model.sensor(name).adr[0] for name in ("stroke", "true_force")}
    return track.x, track.sensors[:, address["stroke"]], track.sensors[:, address["true_force"]]


@pytest.mark.parametrize("law", LAWS)
def test_fixed_tendon_over_two_joints(law: str) -> None:
    """Length and force go through the coefficients; the work of the joints is the work of the damper."""
    model, data = compiled(
        document(TWO, [Damper(law, LAWS[law], on='tendon="t"')], signals(), extra=TENDON, options=APART)
    )
    data.qvel[:] = START
    taken = 0.0
    before = energy(data, (2.0, 3.0), (900.0, 700.0))
    for _ in range(1500):
        v = data.qvel.copy()
        mujoco.mj_step(model, data)
        pull = float(data.actuator_force[0])
        np.testing.assert_allclose(data.qfrc_actuator, [1.5 * pull, -0.5 * pull], rtol=1e-12, atol=1e-12)
        assert data.sensor("stroke_velocity").data[0] == pytest.approx(1.5 * v[0] - 0.5 * v[1], abs=1e-12)
        mean = 0.5 * (v + data.qvel)
        taken -= pull * (1.5 * mean[0] - 0.5 * mean[1]) * 1e-3
    stored = energy(data, (2.0, 3.0), (900.0, 700.0))
    # the springs' energy wavers with the half step between x and v
    assert taken == pytest.approx(before - stored, rel=0.02)
    assert taken > 0.1 * before


def energy(data: mujoco.MjData, masses: Sequence[float], stiffness: Sequence[float]) -> float:
    return sum(
        0.5 * m * float(v) ** 2 + 0.5 * k * float(x) ** 2
        for m, k, x, v in zip(masses, stiffness, data.qpos, data.qvel, strict=True)
    )


@pytest.mark.parametrize("gear", [0.5, -2.0])
@pytest.mark.parametrize("law", LAWS)
def test_gear_scales_stroke_and_force(law: str, gear: float) -> None:
    """A gear g is a tendon of coefficient g; the sensor reads the damper's own force."""
    bodies = slider(2.0, stiffness=900.0)
    tendon = f'<tendon><fixed name="t"><joint joint="j0" coef="{gear!r}"/></fixed></tendon>'
    geared = run(bodies, Damper(law, LAWS[law], on='joint="j0"', more=f'gear="{gear!r}"'), "")
    other = run(bodies, Damper(law, LAWS[law], on='tendon="t"'), tendon)
    for one, two in zip(geared, other, strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-6, atol=1e-9 * float(np.max(np.abs(two))))
    np.testing.assert_allclose(geared[1], gear * geared[0][:, 0], rtol=1e-12)


@pytest.mark.parametrize("gear", [0.5, 3.0])
def test_geared_dashpot_is_a_stronger_one(gear: float) -> None:
    """c through a gear g is c g^2 on the joint, stiff or not."""
    for c in (4.0, 4000.0):
        bodies = slider(2.0)
        geared = run(bodies, Damper("bingham", viscous(c), more=f'gear="{gear!r}"'), "", 50)
        v = 0.4 * np.exp(-c * gear**2 / 2.0 * 1e-3 * np.arange(50))
        np.testing.assert_allclose(geared[0][1:, 0], np.cumsum(v[1:] * 1e-3).tolist()[:49], rtol=1e-5)


@pytest.mark.parametrize("law", LAWS)
def test_spatial_tendon_between_two_sites_is_the_slide_along_it(law: str) -> None:
    """A tendon along the axis: extension of the tendon is the drift between two bodies."""
    extra = '<tendon><spatial name="t"><site site="wall"/><site site="on_j0"/></spatial></tendon>'
    bodies = '<site name="wall" pos="-1 0 0"/>' + slider(2.0, stiffness=900.0)
    # the length counts from the wall, 1 m away
    on_tendon = run(bodies, Damper(law, {**LAWS[law], "x0": 1.0}, on='tendon="t"'), extra)
    on_joint = run(bodies, Damper(law, LAWS[law]), "")
    np.testing.assert_allclose(on_tendon[0], on_joint[0], atol=1e-8)
    np.testing.assert_allclose(on_tendon[1], on_joint[1] + 1.0, atol=1e-8)
    np.testing.assert_allclose(on_tendon[2], on_joint[2], atol=1e-5 * float(np.max(on_joint[2])))


def test_slanted_tendon_takes_the_cosine() -> None:
    """A dashpot at 60 degrees to the slide: c cos^2, for motions small against its length."""
    extra = '<tendon><spatial name="t"><site site="wall"/><site site="on_j0"/></spatial></tendon>'
    angle = math.radians(60.0)
    wall = f'<site name="wall" pos="{-100 * math.cos(angle)!r} {-100 * math.sin(angle)!r} 0"/>'
    x = run(wall + slider(2.0), Damper("bingham", viscous(40.0), on='tendon="t"'), extra, 300)[0]
    c = 40.0 * math.cos(angle) ** 2
    v = 0.4 * np.exp(-c / 2.0 * 1e-3 * np.arange(1, 300))
    np.testing.assert_allclose(x[1:, 0], np.cumsum(v) * 1e-3, rtol=2e-3)


@pytest.mark.parametrize("law", LAWS)
def test_site_transmission_is_the_joint_along_its_axis(law: str) -> None:
    """A site pulled along x; the stroke is followed there as well."""
    bodies = slider(2.0, stiffness=900.0)
    on_site = run(bodies, Damper(law, LAWS[law], on='site="on_j0"', more='gear="1 0 0 0 0 0"'), "")
    on_joint = run(bodies, Damper(law, LAWS[law]), "")
    np.testing.assert_allclose(on_site[0], on_joint[0], atol=1e-4 * float(np.max(np.abs(on_joint[0]))))
    assert rms(on_site[2] - on_joint[2]) < 1e-3 * rms(on_joint[2])


def test_hinge() -> None:
    """Radians and newton metres: a rotary dashpot of c on an inertia of J stops it at the rate c / J."""
    inertia = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 0.02"/>'
    body = f'<body><joint name="j0" type="hinge" axis="0 0 1"/>{inertia}</body>'
    model, data = compiled(document(body, [Damper("bingham", viscous(0.6))], ()))
    data.qvel[0] = 5.0
    v = step_through(model, data, 100).v[:, 0]
    np.testing.assert_allclose(v, 5.0 * np.exp(-0.6 / 0.02 * 1e-3 * np.arange(100)), rtol=1e-5)


# --- loads ------------------------------------------------------------------------------------------


def pushed(
    way: str, mass: float, c: float, push: float, damping: float
) -> tuple[mujoco.MjModel, mujoco.MjData]:
    motor = '<actuator><motor name="motor" joint="j0"/></actuator>'
    extra = motor if way == "motor" else ""
    text = document(slider(mass, damping=damping), [Damper("bingham", viscous(c))], signals(), extra=extra)
    if way == "gravity":
        text = text.replace('gravity="0 0 0"', f'gravity="{push / mass!r} 0 0"')
    model, data = compiled(text)
    if way == "qfrc":
        data.qfrc_applied[0] = push
    elif way == "xfrc":
        data.xfrc_applied[1, 0] = push
    elif way == "motor":
        data.ctrl[model.actuator("motor").id] = push
    return model, data


@pytest.mark.parametrize("damping", [0.0, 20.0, 3000.0])
@pytest.mark.parametrize(("mass", "integrator"), [(0.02, "implicitfast"), (1.0, "Euler")])
@pytest.mark.parametrize("way", ["qfrc", "xfrc", "motor", "gravity"])
def test_steady_speed_under_a_load(way: str, mass: float, damping: float, integrator: str) -> None:
    """A constant push P against dashpots c and the joint's d: v = P / (c + d), whatever pushes."""
    model, data = pushed(way, mass, 600.0, 30.0, damping)
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    v = step_through(model, data, 8000).v[:, 0]
    assert v[-1] == pytest.approx(30.0 / (600.0 + damping), rel=1e-4)
    assert np.all(v < 1.01 * v[-1])
    assert data.sensor("true_force").data[0] == pytest.approx(600.0 * v[-1], rel=1e-4)
    assert -data.actuator("mr").force[0] == pytest.approx(600.0 * v[-1], rel=1e-4)


@pytest.mark.parametrize("mass", [5.0, 0.5, 0.03])
def test_load_through_a_constraint(mass: float) -> None:
    """The damper stands on one body, the load on another that an equality ties to it: v = P / c as well."""
    tie = (
        '<equality><joint joint1="j0" joint2="j1" solref="0.004 1" solimp="0.999 0.9999 0.0001"/></equality>'
    )
    bodies = slider(mass) + slider(1.0, name="j1")
    model, data = compiled(
        document(bodies, [Damper("bingham", viscous(600.0))], signals(), extra=tie, options=APART)
    )
    data.qfrc_applied[1] = 30.0
    v = step_through(model, data, 4000).v[:, 0]
    assert v[-1] == pytest.approx(30.0 / 600.0, rel=0.01)
    assert data.sensor("true_force").data[0] == pytest.approx(30.0, rel=0.01)


@pytest.mark.parametrize("mass", [5.0, 0.5])
def test_steady_speed_against_joint_friction(mass: float) -> None:
    """The engine's own dry friction f in the joint: v = (P - f) / c."""
    body = slider(mass).replace('type="slide"', 'type="slide" frictionloss="5"')
    model, data = compiled(document(body, [Damper("bingham", viscous(600.0))], signals()))
    data.qfrc_applied[0] = 30.0
    v = step_through(model, data, 4000).v[:, 0]
    assert v[-1] == pytest.approx(25.0 / 600.0, rel=0.01)


@pytest.mark.parametrize(
    "first",
    [
        True,
        pytest.param(
            False, marks=pytest.mark.xfail(reason="the engine computes later plugins later", strict=True)
        ),
    ],
    ids=["controller first", "damper first"],
)
def test_steady_speed_under_another_plugin(first: bool) -> None:
    """MuJoCo's own PID plugin pushes, whichever of the two stands first in the file."""
    values = {"kp": 0.0, "kd": 0.0, "ki": 1e9, "imax": 30.0}
    pid = f'<plugin plugin="mujoco.pid"><instance name="pid">{config(values)}</instance></plugin>'
    text = document(slider(0.03), [Damper("bingham", viscous(600.0))], ())
    edge = "<extension>" if first else "</extension>"
    text = text.replace(edge, edge + pid if first else pid + edge)
    motor = '<plugin name="pid" joint="j0" plugin="mujoco.pid" instance="pid" actdim="1"/>'
    model, data = compiled(text.replace("</actuator>", motor + "</actuator>"))
    data.ctrl[model.actuator("pid").id] = 100.0
    v = step_through(model, data, 3000).v[:, 0]
    assert v[-1] == pytest.approx(30.0 / 600.0, rel=1e-3)


@pytest.mark.parametrize("order", list(itertools.permutations("abc"))[1:])
def test_order_of_the_dampers_does_not_matter(order: tuple[str, ...]) -> None:
    """Three coupled dampers, in any order in the file: the same motion within the solver's tolerance."""
    parts = {
        "a": Damper("bingham", viscous(300.0, 20.0), "a"),
        "b": Damper("modified_bouc_wen", DYKE, "b", 'joint="j1"'),
        "c": Damper("bouc_wen", BOUC_WEN, "c", 'tendon="t"'),
    }
    tendon = (
        '<tendon><fixed name="t"><joint joint="j0" coef="1"/><joint joint="j1" coef="1"/></fixed></tendon>'
    )
    tracks = []
    for names in (tuple("abc"), order):
        text = document(
            chain([1.0, 0.5], [4e3, 3e3], [0.0, 0.0]), [parts[n] for n in names], (), extra=tendon
        )
        model, data = compiled(text)
        data.qvel[:] = [0.6, -0.2]
        tracks.append(step_through(model, data, 800).x)
    assert np.max(np.abs(tracks[0] - tracks[1])) < 2e-3 * np.max(np.abs(tracks[0]))
