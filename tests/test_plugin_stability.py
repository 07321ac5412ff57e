"""Light structures: the step neither grows nor rings, and takes no energy from nowhere, a moving mass's included."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from dampers import attributes, commands, size
from mjcf_builders import (
    Damper,
    Values,
    compiled,
    config,
    dashpot,
    document,
    oscillator,
    slider,
    step_through,
)
from mrdamp import sets
from mrdamp.model import core
from networks import Network
from twin_laws import value

INTEGRATORS = ("Euler", "implicitfast")


C = 700.0  # N s/m, of a law and of a network that is a dashpot, F = C v
NET = Network(5e-4, (("v", 0),), np.zeros(1), np.ones(1), 0.0, C, ((np.ones((1, 1)), np.zeros(1)),))
EXTRA = f'<custom><text name="net" data="{NET.text()}"/></custom>'


@pytest.mark.parametrize("damper", [Damper("bingham", dashpot(C)), Damper("narx", {"weights": "text:net"})])
@pytest.mark.parametrize(("timestep", "integrator"), [(1e-3, "Euler"), (5e-3, "implicitfast")])
@pytest.mark.parametrize("ratio", [0.01, 1.0, 30.0])
def test_linear_damper_decays_exactly(damper: Damper, ratio: float, timestep: float, integrator: str) -> None:
    """m v' = -c v: v falls by exp(-c h / m) in every step, however large c h / m is."""
    body = slider(C * timestep / ratio)
    model, data = compiled(document(body, [damper], timestep=timestep, integrator=integrator, extra=EXTRA))
    data.qvel[0] = 0.8
    v = step_through(model, data, 20).v[:, 0]
    exact = damper.law == "bingham"
    np.testing.assert_allclose(
        v, 0.8 * np.exp(-ratio * np.arange(20)), rtol=1e-9 if exact else 1e-6, atol=1e-12 if exact else 1e-9
    )


def resistance(id: str, u: float) -> tuple[float, float]:
    """Force (N) at the speed (m/s) of the set's own tests, after a stroke at that speed."""
    stroke, frequency = size(id)
    speed = 2.0 * math.pi * frequency * stroke
    x = np.linspace(0.0, stroke, 200)
    force = core.run(sets.load(id).law, attributes(id), stroke / speed / 199, x, np.full(200, speed), u=u)[
        "force"
    ]
    return abs(float(force[-1])), speed


@pytest.mark.parametrize(
    ("level", "ratio", "integrator"), [(1.0, 1.0, "Euler"), (0.0, 10.0, "implicitfast"), (1.0, 30.0, "implicitfast")]
)
@pytest.mark.parametrize("id", sets.names())
def test_light_mass_is_stopped(id: str, level: float, ratio: float, integrator: str) -> None:
    """A body so light that c h / m = ratio: it is stopped, and does not swing from step to step."""
    law, p, timestep = sets.load(id).law, attributes(id), 1e-3
    low, high = commands(id)
    u = low + level * (high - low)
    force, speed = resistance(id, u)
    mass = force / speed * timestep / ratio
    model, data = oscillator(law, p, mass, 0.0, timestep, integrator=integrator)
    data.qvel[0], data.ctrl[0] = speed, u
    track = step_through(model, data, 10_000)
    v = track.v[:, 0]
    assert np.all(np.isfinite(v))
    # the springs beside the hysteresis go on relaxing: their force over the dashpot is the speed left
    preload = p.get("k1", 0.0) * abs(p.get("x0", 0.0)) if law == "modified_bouc_wen" else 0.0
    rest = preload / (value(p, "c0", u) + 1e-9) if preload else 1e-4 * speed
    assert np.max(np.abs(v[5000:])) < max(1.05 * rest, 1e-4 * speed)
    turns = v[:-1] * v[1:] < 0.0  # four in a row, with nothing lost, are no oscillation of the structure
    row = turns[:-3] & turns[1:-2] & turns[2:-1] & turns[3:]
    assert not np.any(row & (np.abs(v[4:]) > 0.8 * np.abs(v[:-4])) & (np.abs(v[4:]) > 1e-6 * speed))


def ratio_of_damping(
    model: mujoco.MjModel, data: mujoco.MjData, first: float, cycles: int, omega: float
) -> float:
    """Damping ratio from the peaks of a free oscillation."""
    data.qpos[0] = first
    x = step_through(model, data, round(cycles * 2.0 * math.pi / omega / model.opt.timestep)).x[:, 0]
    at = np.flatnonzero((x[1:-1] > x[:-2]) & (x[1:-1] >= x[2:])) + 1
    bend = x[at + 1] - 2.0 * x[at] + x[at - 1]
    peaks = x[at] - (x[at + 1] - x[at - 1]) ** 2 / (8.0 * bend)
    fall = math.log(peaks[0] / peaks[-1]) / (len(peaks) - 1) / (2.0 * math.pi)
    return fall / math.sqrt(1.0 + fall**2)


@pytest.mark.parametrize("share", [0.0, 0.1, 1.0])
@pytest.mark.parametrize(
    ("frequency", "timestep", "integrator"),
    [(5.0, 2e-4, "Euler"), (5.0, 2e-3, "Euler"), (5.0, 2e-3, "implicitfast"), (1.0, 2e-3, "implicitfast")],
)
def test_one_per_cent_of_damping_stays_one_per_cent(
    frequency: float, timestep: float, integrator: str, share: float
) -> None:
    """Also where a share of the structure's stiffness, or all of it, is the damper's gas spring."""
    mass, omega = 10.0, 2.0 * math.pi * frequency
    stiffness = mass * omega**2
    law = {**dashpot(2 * 0.01 * mass * omega), "gas_spring_k": share * stiffness}
    model, data = oscillator("bingham", law, mass, (1.0 - share) * stiffness, timestep, integrator=integrator)
    found = ratio_of_damping(model, data, 0.01, 30, omega)
    assert found == pytest.approx(0.01, rel=0.02 if share else 0.005)


@pytest.mark.parametrize("v_ref", [0.0, 1e-4])
@pytest.mark.parametrize("c", [0.0, 400.0])
@pytest.mark.parametrize("mass", [0.01, 1.0, 30.0])
def test_dry_friction_holds_a_load(mass: float, c: float, v_ref: float) -> None:
    """A load of 0.6 of the yield force: the sliding body stops, and creeps no faster than v_ref allows."""
    law = {"c0a": c, "c0b": 0.0, "fya": 50.0, "fyb": 0.0, "v_ref": v_ref}
    model, data = oscillator("bingham", law, mass, 0.0, 1e-3)
    data.qvel[0] = 0.05
    data.qfrc_applied[0] = 30.0
    v = step_through(model, data, 3000).v[:, 0]
    assert np.max(np.abs(v)) <= 0.05 + 1e-9
    creep = v_ref * math.atanh(0.6)  # where yield tanh(v / v_ref) is the load
    late = v[2000:]
    assert np.max(late) < 1.02 * creep + 1e-6
    assert np.min(late) > (0.98 * creep if not c else 0.0) - 1e-6


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("timestep", [2e-4, 1e-3])
def test_coulomb_damper_takes_the_same_from_every_swing(timestep: float, integrator: str) -> None:
    """Dry friction alone: amplitudes fall by 2 f / k a half cycle, and the end lies within f / k."""
    stiffness, yielding = 4000.0, 8.0
    law = {"c0a": 0.0, "c0b": 0.0, "fya": yielding, "fyb": 0.0, "v_ref": 0.0}
    model, data = oscillator("bingham", law, 10.0, stiffness, timestep, integrator=integrator)
    data.qpos[0] = 0.0435
    x = step_through(model, data, round(3.0 / timestep)).x[:, 0]
    turns: list[float] = []
    half = math.pi / math.sqrt(stiffness / 10.0)
    for k in range(8):
        inside = x[round(k * half / timestep) : round((k + 1) * half / timestep) + 2]
        turns.append(float(np.max(np.abs(inside))))
    fall = 2.0 * yielding / stiffness
    np.testing.assert_allclose(turns, 0.0435 - fall * np.arange(8), atol=0.03 * fall)
    assert abs(x[-1]) < 1.01 * yielding / stiffness
    assert np.ptp(x[-round(0.5 / timestep) :]) < 1e-6


@pytest.mark.parametrize("mass", [0.02, 0.5, 20.0])
def test_seal_friction_holds_a_load(mass: float) -> None:
    """Stick under a load below the friction; slip above the breakaway force, damped."""
    more = {"seal_friction_coulomb": 40.0, "seal_friction_breakaway": 1.5, "seal_friction_presliding": 1e-4}
    model, data = oscillator("bingham", {**dashpot(20.0), **more}, mass, 0.0, 1e-3)
    data.qfrc_applied[0] = 30.0
    held = step_through(model, data, 3000)
    assert abs(held.x[2000, 0]) < 1e-3
    assert np.ptp(held.x[2000:, 0]) < 1e-4  # a heavy body goes on trembling in the bristles
    data.qfrc_applied[0] = 65.0
    slid = step_through(model, data, 8000)
    assert slid.v[-1, 0] == pytest.approx((65.0 - 40.0) / 20.0, rel=0.01)


@pytest.mark.parametrize("mass", [0.05, 1.0, 50.0])
@pytest.mark.parametrize(
    "more",
    [
        {"mount_compliance_k": 2e5},
        {"backlash_gap": 5e-4, "backlash_k": 2e5},
        {"mount_compliance_k": 2e5, "backlash_gap": 2e-4, "moving_mass_m": 0.2},
    ],
)
def test_mounts_are_stable_on_light_masses(more: Values, mass: float) -> None:
    """A stiff mount on a light mass: energy falls, and what still moves does so in the gap."""
    timestep = 1e-3
    gap = float(more.get("backlash_gap", 0.0))
    law = attributes("dyke1996_3kN")
    model, data = oscillator("modified_bouc_wen", {**law, **more}, mass, 2000.0, timestep)
    data.qvel[0], data.ctrl[0] = 0.3, 1.0
    track = step_through(model, data, 10_000)
    energy = 0.5 * mass * track.v[:, 0] ** 2 + 0.5 * 2000.0 * track.x[:, 0] ** 2
    force = track.sensors[:, model.sensor("true_force").adr[0]]
    assert np.all(np.isfinite(energy))
    most = float(np.max(force**2)) / (2.0 * 2e5)
    assert np.max(energy - np.minimum.accumulate(energy)) < most + 0.02 * energy[0]
    assert np.max(np.abs(track.v[5000:])) < 1.05 * math.sqrt(2000.0 / mass) * gap / 2.0 + 0.001


TIED = '<body><joint name="j" type="slide" axis="1 0 0"/><geom size=".05" mass="1"/><site name="end"/></body>'
CRANK = (
    '<body><joint name="j" type="hinge" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 .1" size=".01" mass="1"/>'
    '<site name="end" pos="0 0 .1" zaxis="1 0 1"/></body>'
)
PENDULUM = (
    '<body><joint name="j" type="hinge" axis="0 1 0"/>'
    '<geom type="capsule" fromto="0 0 0 0 0 -.4" size=".02" mass=".5"/>'
    '<body pos="0 0 -.4"><joint type="hinge" axis="0 1 0"/>'
    '<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass=".3"/><site name="end" pos="0 0 -.3"/></body></body>'
)
TENDON = '<tendon><spatial name="t" {own}><site site="base"/><site site="end"/></spatial></tendon>'


def plugin(c: float, mass: float) -> str:
    return config({"law": "bingham", **dashpot(c), "moving_mass_m": mass})


def path(m: mujoco.MjModel, q: tuple[float, float], v: tuple[float, float], steps: int) -> np.ndarray:
    """Positions (steps, nq) of a free run."""
    d, out = mujoco.MjData(m), []
    d.qpos[:], d.qvel[:] = q, v
    for _ in range(steps):
        mujoco.mj_step(m, d)
        out.append(d.qpos.copy())
    return np.array(out)


def scene(
    body: str, along: str, mass: float, integrator: str, step: float, *, c: float = 0.0, own: str = ""
) -> str:
    """along: the actuator's transmission, empty without a damper; own: of the tendon."""
    damper = f'<plugin name="d" plugin="mrdamp.damper" {along}>{plugin(c, mass)}</plugin>' if along else ""
    sensor = (
        '<sensor><plugin plugin="mrdamp.force_sensor" objtype="actuator" objname="d"/></sensor>'
        if along
        else ""
    )
    return f"""<mujoco><extension><plugin plugin="mrdamp.damper"/><plugin plugin="mrdamp.force_sensor"/></extension>
      <option integrator="{integrator}" timestep="{step}" gravity="0 0 0"/>
      <worldbody><site name="base" pos="0 0 .3"/><site name="rail" pos=".3 0 0" zaxis="1 0 0"/>{body}</worldbody>
      {TENDON.format(own=own)}<actuator>{damper}</actuator>{sensor}</mujoco>"""


@pytest.mark.parametrize(
    ("integrator", "step", "most"), [("RK4", 1e-3, 2e-6), ("Euler", 2e-4, 2e-3), ("implicitfast", 2e-4, 2e-3)]
)
@pytest.mark.parametrize(
    ("body", "along"),
    [
        (TIED, 'tendon="t"'),
        (CRANK, 'cranksite="end" slidersite="rail" cranklength=".6"'),
        (PENDULUM, 'site="end" gear="1 0 1 0 0 0"'),
    ],
    ids=["tendon", "slider-crank", "site"],
)
def test_a_moving_mass_keeps_its_energy(
    body: str, along: str, integrator: str, step: float, most: float
) -> None:
    """Without damping, kinetic energy of the bodies and m (dL/dt)^2 / 2 of the mass."""
    m = mujoco.MjModel.from_xml_string(scene(body, along, 1.0, integrator, step))
    d = mujoco.MjData(m)
    d.qpos[:], d.qvel[:] = {TIED: (-0.5, 2.0), CRANK: (0.4, 6.0), PENDULUM: ((0.8, 0.5), (1.0, -2.0))}[body]

    def energy() -> float:
        mujoco.mj_forward(m, d)
        mass = np.zeros((m.nv, m.nv))
        mujoco.mj_fullM(m, d, mass)
        return float(0.5 * d.qvel @ mass @ d.qvel + 0.5 * d.actuator_velocity[0] ** 2)

    before, found = energy(), []
    for _ in range(round(0.4 / step)):
        mujoco.mj_step(m, d)
        found.append(energy())
    assert np.max(np.abs(np.array(found) - before)) < most * before


def test_the_load_cell_reads_what_turns_the_mass() -> None:
    """At x = 0 the tendon of length h stands across the motion: its length accelerates by v^2 / h, by hand."""
    m = mujoco.MjModel.from_xml_string(scene(TIED, 'tendon="t"', 1.0, "RK4", 1e-3))
    d = mujoco.MjData(m)
    d.qvel[0] = 2.0
    mujoco.mj_forward(m, d)
    assert d.sensordata[0] == pytest.approx(2.0**2 / 0.3, rel=1e-5)


@pytest.mark.parametrize("integrator", ["RK4", "implicitfast"])
def test_a_mass_on_a_tendon_is_the_tendons_armature(integrator: str) -> None:
    own = scene(PENDULUM, "", 0.0, integrator, 1e-4, own='armature="0.3" damping="2"')
    ours = scene(PENDULUM, 'tendon="t"', 0.3, integrator, 1e-4, c=2.0)
    truth, found = (
        path(mujoco.MjModel.from_xml_string(text), (0.8, 0.5), (1.0, -2.0), 5000) for text in (own, ours)
    )
    assert np.abs(found - truth).max() < (1e-6 if integrator == "RK4" else 2e-3)


@pytest.mark.parametrize("mass", [0.5, 2.0])
def test_masses_that_move_each_other_under_runge_kutta(mass: float) -> None:
    """Two slides in a chain against the engine's joint armature and damping."""

    def chain(own: str, dampers: str) -> np.ndarray:
        geom = '<geom size=".1" mass="1" contype="0" conaffinity="0"/>'
        slide = f'<joint name="{{}}" type="slide" axis="1 0 0" stiffness="500" {own}/>{geom}'
        m = mujoco.MjModel.from_xml_string(
            f"""<mujoco><extension><plugin plugin="mrdamp.damper"/></extension>
            <option integrator="RK4" timestep=".001"/>
            <worldbody><body>{slide.format("a")}<body>{slide.format("b")}</body></body></worldbody>
            <actuator>{dampers}</actuator></mujoco>"""
        )
        return path(m, (0.1, 0.05), (0.0, 0.0), 1000)

    dampers = "".join(f'<plugin joint="{j}" plugin="mrdamp.damper">{plugin(1.0, mass)}</plugin>' for j in "ab")
    truth = chain(f'damping="1" armature="{mass}"', "")
    np.testing.assert_allclose(chain("", dampers), truth, atol=1e-9)
