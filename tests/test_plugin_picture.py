"""What the plugin adds to a scene: the force as an arrow in the current's colour."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from mjcf_builders import Damper, compiled, document, slider

BINGHAM = {"c0a": 100.0, "c0b": 200.0, "fya": 0.0, "fyb": 50.0, "v_ref": 0.01, "command_max": 2.0}
METRES_A_NEWTON = 0.01 / 10.0  # of the models below: map.force over the mean mass
TENDON = """<tendon><spatial name="t"><site site="wall"/><site site="on_j0"/></spatial></tendon>"""


def scene(model: mujoco.MjModel, data: mujoco.MjData, most: int = 100) -> list[mujoco.MjvGeom]:
    made = mujoco.MjvScene(model, maxgeom=most)
    every = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), every, made)
    return [made.geoms[k] for k in range(made.ngeom)]


def arrows(model: mujoco.MjModel, data: mujoco.MjData) -> list[mujoco.MjvGeom]:
    return [geom for geom in scene(model, data) if geom.type == mujoco.mjtGeom.mjGEOM_ARROW]


def pushed(velocity: float, current: float, on: str = "joint") -> tuple[mujoco.MjModel, mujoco.MjData]:
    transmission = {"joint": 'joint="j0"', "tendon": 'tendon="t"', "site": 'site="on_j0" gear="1 0 0 0 0 0"'}
    wall = '<site name="wall" pos="-1 0 0"/>'
    text = document(
        wall + slider(10.0),
        [Damper("bingham", BINGHAM, on=transmission[on])],
        extra=TENDON if on == "tendon" else "",
    )
    model, data = compiled(text)
    model.vis.map.force, model.stat.meanmass = 0.01, 10.0
    data.qvel[0], data.ctrl[0] = velocity, current
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("on", ["joint", "tendon", "site"])
@pytest.mark.parametrize("velocity", [0.3, -0.3])
def test_arrow_is_as_long_as_the_force_and_against_the_motion(on: str, velocity: float) -> None:
    model, data = pushed(velocity, 1.0, on)
    (arrow,) = arrows(model, data)
    force = 50.0 + 300.0 * abs(velocity)  # the law, its yield force fully turned
    # The step is solved at its own end: a little less than the law at its start.
    assert abs(data.actuator_force[0]) == pytest.approx(force, rel=0.05)
    assert arrow.size[2] == pytest.approx(METRES_A_NEWTON * abs(data.actuator_force[0]), rel=1e-5)
    direction = arrow.mat.reshape(3, 3)[:, 2]
    np.testing.assert_allclose(direction, [-np.sign(velocity), 0, 0], atol=1e-6)


def test_colour_follows_the_current_up_to_the_largest() -> None:
    colours = [arrows(*pushed(0.3, current))[0].rgba for current in (0.0, 1.0, 2.0)]
    off, half, on = (np.asarray(c, dtype=float) for c in colours)
    np.testing.assert_allclose(half, (off + on) / 2, atol=1e-6)
    assert off[2] > off[0]  # blue
    assert on[0] > on[2]  # orange


def test_nothing_is_drawn_where_forces_are_not_to_be_or_the_scene_is_full() -> None:
    model, data = pushed(0.3, 1.0)
    assert len(scene(model, data, 1)) <= 1
    model.vis.map.force = 0.0
    assert arrows(model, data) == []
