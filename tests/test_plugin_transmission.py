"""Where a damper may act: several on one body, along chains, on tendons and sites, geared, under any load."""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np
import pytest
from scipy.linalg import expm

from dampers import rms
from excitation import Array
from mjcf_builders import (
    BOUC_WEN,
    DYKE,
    Damper,
    chain,
    compiled,
    config,
    dashpot,
    document,
    signals,
    slider,
    step_through,
)

APART = '<flag contact="disable"/>'  # bodies pass through each other
LAWS: Mapping[str, Mapping[str, float]] = {"bouc_wen": BOUC_WEN, "modified_bouc_wen": DYKE}


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("count", [2, 5])
@pytest.mark.parametrize("ratio", [0.2, 1.0, 30.0])
def test_stiff_dampers_on_one_joint_do_not_ring(ratio: float, count: int, integrator: str) -> None:
    """Each alone has c h / m = ratio: v falls as it should, and does not swing to the other side."""
    c, timestep = 500.0, 1e-3
    dampers = [Damper("bingham", dashpot(c), f"d{k}") for k in range(count)]
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


@pytest.mark.parametrize("scale", [1.0, 300.0])
def test_dampers_along_a_chain(scale: float) -> None:
    """Three bodies, a dashpot in each storey and one across two: the matrix exponential."""
    masses, c = np.array([3.0, 2.0, 1.0]), scale * np.array([8.0, 5.0, 12.0, 6.0])
    storeys = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0]])  # in drifts
    dampers = [Damper("bingham", dashpot(float(c[k])), f"d{k}", f'joint="j{k}"') for k in range(3)]
    dampers.append(Damper("bingham", dashpot(float(c[3])), "across", 'tendon="t"'))
    tendon = fixed_tendon(j1=1.0, j2=1.0)
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


START = np.array([0.4, -0.2])
ONE = slider(2.0, stiffness=900.0)


def fixed_tendon(**coefficients: float) -> str:
    over = "".join(f'<joint joint="{joint}" coef="{coef!r}"/>' for joint, coef in coefficients.items())
    return f'<tendon><fixed name="t">{over}</fixed></tendon>'


def run(bodies: str, damper: Damper, extra: str, steps: int = 1500) -> tuple[Array, Array, Array]:
    """Joint motion, stroke and the damper's force along the way."""
    model, data = compiled(document(bodies, [damper], signals(), extra=extra, options=APART))
    data.qvel[: min(2, model.nv)] = START[: model.nv]
    track = step_through(model, data, steps)
    address = {name: model.sensor(name).adr[0] for name in ("stroke", "true_force")}
    return track.x, track.sensors[:, address["stroke"]], track.sensors[:, address["true_force"]]


@pytest.mark.parametrize("law", LAWS)
def test_fixed_tendon_over_two_joints(law: str) -> None:
    """Length and force go through the coefficients; the work of the joints is the work of the damper."""
    masses, stiffness, coefficients = (2.0, 3.0), (900.0, 700.0), np.array([1.5, -0.5])
    bodies = ONE + slider(masses[1], stiffness=stiffness[1], name="j1")
    extra = fixed_tendon(j0=1.5, j1=-0.5)
    model, data = compiled(
        document(bodies, [Damper(law, LAWS[law], on='tendon="t"')], signals(), extra=extra, options=APART)
    )

    def energy() -> float:
        return float(0.5 * np.dot(masses, data.qvel**2) + 0.5 * np.dot(stiffness, data.qpos**2))

    data.qvel[:] = START
    taken, before = 0.0, energy()
    for _ in range(1500):
        v = data.qvel.copy()
        mujoco.mj_step(model, data)
        pull = float(data.actuator_force[0])
        np.testing.assert_allclose(data.qfrc_actuator, coefficients * pull, rtol=1e-12, atol=1e-12)
        assert data.sensor("stroke_velocity").data[0] == pytest.approx(coefficients @ v, abs=1e-12)
        taken -= pull * float(coefficients @ (0.5 * (v + data.qvel))) * 1e-3
    # the springs' energy wavers with the half step between x and v
    assert taken == pytest.approx(before - energy(), rel=0.02)
    assert taken > 0.1 * before


@pytest.mark.parametrize("gear", [0.5, 3.0])
@pytest.mark.parametrize("c", [4.0, 4000.0])
def test_geared_dashpot_is_a_stronger_one(c: float, gear: float) -> None:
    """c through a gear g is c g^2 on the joint, stiff or not."""
    x = run(slider(2.0), Damper("bingham", dashpot(c), more=f'gear="{gear!r}"'), "", 50)[0][:, 0]
    v = 0.4 * np.exp(-c * gear**2 / 2.0 * 1e-3 * np.arange(1, 50))
    np.testing.assert_allclose(x[1:], np.cumsum(v) * 1e-3, rtol=1e-5)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("on", ["spatial tendon", "site"])
def test_a_transmission_along_the_slide_is_the_slide(on: str, law: str) -> None:
    """The tendon's length counts from the wall, 1 m away; a site's stroke is followed as well."""
    attributes = dict(LAWS[law])
    on_joint, far = run(ONE, Damper(law, attributes), ""), 0.0
    if on == "site":
        found = run(ONE, Damper(law, attributes, on='site="on_j0"', more='gear="1 0 0 0 0 0"'), "")
    else:
        far, wall = 1.0, '<site name="wall" pos="-1 0 0"/>'
        attributes["x0"] += far
        tendon = '<tendon><spatial name="t"><site site="wall"/><site site="on_j0"/></spatial></tendon>'
        found = run(wall + ONE, Damper(law, attributes, on='tendon="t"'), tendon)
    np.testing.assert_allclose(found[0], on_joint[0], atol=1e-4 * float(np.max(np.abs(on_joint[0]))))
    np.testing.assert_allclose(found[1], on_joint[1] + far, atol=1e-4 * float(np.max(np.abs(on_joint[0]))))
    assert rms(found[2] - on_joint[2]) < 1e-3 * rms(on_joint[2])


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_a_spring_on_a_site_takes_no_energy(integrator: str) -> None:
    """gas_spring_k alone, 50 kg at 1 m/s: v = cos(10 t)."""
    attributes = {**dashpot(1e-9), "gas_spring_k": 5000.0}
    damper = Damper("bingham", attributes, on='site="on_j0"', more='gear="1 0 0 0 0 0"')
    model, data = compiled(document(slider(50.0), [damper], (), integrator=integrator))
    data.qvel[0] = 1.0
    v = step_through(model, data, 10_000).v[:, 0]
    # The velocities of Euler stand half a step before the time.
    late = 5e-4 if integrator == "Euler" else 0.0
    np.testing.assert_allclose(v, np.cos(10.0 * (1e-3 * np.arange(10_000) - late)), atol=6e-3)


PUSH, C = 30.0, 600.0  # N, N s/m


@pytest.mark.parametrize("damping", [0.0, 3000.0])
@pytest.mark.parametrize(("mass", "integrator"), [(0.02, "implicitfast"), (1.0, "Euler")])
@pytest.mark.parametrize("way", ["qfrc", "xfrc", "motor", "gravity"])
def test_steady_speed_under_a_load(way: str, mass: float, damping: float, integrator: str) -> None:
    """A constant push P against dashpots c and the joint's d: v = P / (c + d), whatever pushes."""
    motor = '<actuator><motor name="motor" joint="j0"/></actuator>'
    bodies, dampers = slider(mass, damping=damping), [Damper("bingham", dashpot(C))]
    model, data = compiled(document(bodies, dampers, signals(), extra=motor, integrator=integrator))
    if way == "gravity":
        model.opt.gravity[0] = PUSH / mass
    elif way == "xfrc":
        data.xfrc_applied[1, 0] = PUSH
    elif way == "motor":
        data.ctrl[model.actuator("motor").id] = PUSH
    else:
        data.qfrc_applied[0] = PUSH
    v = step_through(model, data, 4000).v[:, 0]
    assert v[-1] == pytest.approx(PUSH / (C + damping), rel=1e-4)
    assert np.all(v < 1.01 * v[-1])
    assert data.sensor("true_force").data[0] == pytest.approx(C * v[-1], rel=1e-4)
    assert -data.actuator("mr").force[0] == pytest.approx(C * v[-1], rel=1e-4)


TIE = '<equality><joint joint1="j0" joint2="j1" solref="0.004 1" solimp="0.999 0.9999 0.0001"/></equality>'
#: What an equality ties to the damper's body.
OTHER = slider(1.0, name="j1")


@pytest.mark.parametrize(
    ("bodies", "extra", "force"),
    [
        *((slider(mass) + OTHER, TIE, PUSH) for mass in (5.0, 0.03)),
        *((slider(mass).replace("slide", 'slide" frictionloss="5', 1), "", PUSH - 5.0) for mass in (5.0, 0.5)),
    ],
    ids=["tie, heavy", "tie, light", "friction, heavy", "friction, light"],
)
def test_steady_speed_with_the_engines_constraints(bodies: str, extra: str, force: float) -> None:
    """The load through an equality, or against the engine's own dry friction in the joint."""
    text = document(bodies, [Damper("bingham", dashpot(C))], signals(), extra=extra, options=APART)
    model, data = compiled(text)
    data.qfrc_applied[-1] = PUSH
    v = step_through(model, data, 4000).v[:, 0]
    assert v[-1] == pytest.approx(force / C, rel=0.01)
    assert data.sensor("true_force").data[0] == pytest.approx(force, rel=0.01)


LATE = pytest.mark.xfail(reason="the engine computes later plugins later", strict=True)


@pytest.mark.parametrize("first", [True, pytest.param(False, marks=LATE)], ids=["controller first", "damper first"])
def test_steady_speed_under_another_plugin(first: bool) -> None:
    """MuJoCo's own PID plugin pushes, whichever of the two stands first in the file."""
    values = {"kp": 0.0, "kd": 0.0, "ki": 1e9, "imax": PUSH}
    pid = f'<plugin plugin="mujoco.pid"><instance name="pid">{config(values)}</instance></plugin>'
    text = document(slider(0.03), [Damper("bingham", dashpot(C))], ())
    edge = "<extension>" if first else "</extension>"
    text = text.replace(edge, edge + pid if first else pid + edge)
    motor = '<plugin name="pid" joint="j0" plugin="mujoco.pid" instance="pid" actdim="1"/>'
    model, data = compiled(text.replace("</actuator>", motor + "</actuator>"))
    data.ctrl[model.actuator("pid").id] = 100.0
    v = step_through(model, data, 3000).v[:, 0]
    assert v[-1] == pytest.approx(PUSH / C, rel=1e-3)
