"""A moving mass where the moment turns with the motion, and of several dampers: energy, the engine's armature."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from mjcf_builders import config, dashpot

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
