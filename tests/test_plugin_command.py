"""The command on its way into the damper in MuJoCo, and the arrow that the plugin draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import mujoco
import numpy as np
import pytest

from excitation import Array
from mjcf_builders import BINGHAM, HEAVY, Damper, compiled, document, signals, slider


def commanded(
    setting: Mapping[str, float],
    more: str,
    command: Callable[[float], float],
    seconds: float,
    signal: str = "current",
) -> Array:
    """Coil current, or another signal, before each 1 ms step under a command."""
    model, data = compiled(
        document(slider(HEAVY), [Damper("bingham", {**BINGHAM, **setting}, more=more)], signals())
    )
    out = np.empty(round(seconds / 1e-3))
    for k in range(len(out)):
        data.ctrl[0] = command(k * 1e-3)
        mujoco.mj_step(model, data)
        out[k] = data.sensor(signal).data[0]
    return out


def step_at(time: float, low: float, high: float) -> Callable[[float], float]:
    return lambda t: high if t > time - 1e-9 else low


def test_engine_delay_of_the_actuator_acts() -> None:
    """MuJoCo's own `delay` with its history buffer, a step of the command after a while at rest."""
    found = commanded({}, 'delay="0.02" nsample="40"', step_at(0.1, 0.3, 1.1), 0.3)
    np.testing.assert_array_equal(found[30:119], 0.3)
    np.testing.assert_array_equal(found[121:], 1.1)


def test_commands_are_clamped() -> None:
    """By ctrlrange, by the parameters' own range, and by both; ctrlrange has its flag."""
    both = {"command_min": 0.6, "command_max": 1.5}
    cases: tuple[tuple[Mapping[str, float], str, float, float], ...] = (
        ({}, "", -3.0, 5.0),
        ({}, 'ctrllimited="true" ctrlrange="0 2"', 0.0, 2.0),
        (both, "", 0.6, 1.5),
        (both, 'ctrllimited="true" ctrlrange="0 1"', 0.6, 1.0),
        ({"command_max": 1.5}, "", -1.5, 1.5),
        ({"command_min": 0.6}, "", 0.6, 5.0),
    )
    for setting, more, low, high in cases:
        found = commanded(setting, more, step_at(0.01, -3.0, 5.0), 0.02)
        assert (found[5], found[15]) == (low, high), (setting, more)
    limited = Damper("bingham", BINGHAM, more='ctrllimited="true" ctrlrange="0 2"')
    model, data = compiled(document(slider(HEAVY), [limited], signals()))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    data.ctrl[0] = 5.0
    mujoco.mj_forward(model, data)
    assert data.sensor("current").data[0] == 5.0


@pytest.mark.parametrize(
    "effect",
    [{}, {"driver_lag_tau": 0.01}, {"saturation_i_s": 0.8}, {"remanence_b": 0.1, "remanence_d": 0.3}],
)
def test_the_sign_of_a_current_does_not_matter_to_the_fluid(effect: Mapping[str, float]) -> None:
    """(c0a + c0b |i|) v + (fya + fyb |i|) tanh(v / v_ref); with a least command the sign counts."""

    def force(u: float, more: Mapping[str, float]) -> float:
        damper = Damper("bingham", {**BINGHAM, **effect, **more})
        model, data = compiled(document(slider(HEAVY), [damper], signals()))
        data.qvel[0], data.ctrl[0] = 0.1, u
        mujoco.mj_step(model, data, 200)
        return float(data.sensor("true_force").data[0])

    assert force(-0.5, {}) == pytest.approx(force(0.5, {}), rel=1e-9)
    if not effect:
        assert force(-0.5, {}) == pytest.approx((150 + 40) * 0.1 + (40 + 30), rel=1e-6)
        assert force(-0.5, {"command_min": -1.0}) == pytest.approx((150 - 40) * 0.1 + (40 - 30), rel=1e-6)
        assert force(-0.5, {"command_min": 0.0}) == pytest.approx(150 * 0.1 + 40, rel=1e-6)


def test_a_current_that_changes_its_sign_passes_zero() -> None:
    """From 1 to -1 A behind a lag: |2 exp(-t / tau) - 1|."""
    found = commanded(
        {"driver_lag_tau": 0.02, "command_start": 1.0}, "", step_at(0.05, 1.0, -1.0), 0.2, "field"
    )
    since = np.maximum(np.arange(len(found)) * 1e-3 - 0.05, 0.0)
    np.testing.assert_allclose(found, np.abs(2.0 * np.exp(-since / 0.02) - 1.0), atol=1e-9)


COLOURED = {"c0a": 100.0, "c0b": 200.0, "fya": 0.0, "fyb": 50.0, "v_ref": 0.01, "command_max": 2.0}
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
        [Damper("bingham", COLOURED, on=transmission[on])],
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
