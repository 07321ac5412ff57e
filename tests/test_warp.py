"""Dampers in MuJoCo Warp, on its CPU device, against the plugin in MuJoCo: engine, precision and solver are others."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from excitation import Array
from mrdamp import models_xml
from mrdamp.envs.frame import default_damper
from mrdamp.envs.frame_xml import frame_models, frame_xml
from mrdamp.structures import ShearFrame
from mrdamp.warp.convert import convert
from refusals import refuses

FRAME = models_xml.path("frame3").read_text(encoding="utf-8")


def kicked(m: mujoco.MjModel) -> Array:
    return np.asarray(0.05 * np.sin(1.0 + np.arange(m.nv)))


def levels(m: mujoco.MjModel, dampers: list[int], k: int) -> Array:
    """Controls (nu,) in the step k: a current for the dampers, and a ground motion or nothing for the rest."""
    out: Array = np.where(np.arange(m.nu) == 0, 3.0 * np.sin(0.01 * k), 0.0)
    out[dampers] = 1.0 + (k // 50 % 2)
    return out


def off(source: Any, steps: int, kick: bool = True, **values: Any) -> Array:
    """RMS of the difference of the dampers' forces over their RMS, in Warp's second world and MuJoCo."""
    pytest.importorskip("mujoco_warp", reason="the extra `warp` is not installed")
    import mujoco_warp

    from mrdamp.warp import put_model

    spec = mujoco.MjSpec.from_string(source) if source.startswith("<") else mujoco.MjSpec.from_file(source)
    for name, value in values.items():
        for plugin in spec.plugins:
            if plugin.plugin_name == "mrdamp.damper":
                plugin.config = dict(plugin.config) | {name: repr(value)}
    m = spec.compile()
    d = mujoco.MjData(m)
    model, dampers = put_model(source)
    data = dampers.make_data(2)
    for name, value in values.items():
        dampers.set(data, {name: np.array([0.5 * value, value])})
    controls = [one.control for one in dampers.converted.dampers]
    columns = [one.actuator for one in dampers.converted.dampers]
    if kick:
        d.qvel[:] = kicked(m)
        data.qvel.assign(np.tile(kicked(m), (2, 1)).astype(np.float32))
    forces = np.empty((2, steps, len(columns)))
    for k in range(steps):
        d.ctrl[:] = levels(m, controls, k)
        data.ctrl.assign(np.tile(d.ctrl, (2, 1)).astype(np.float32))
        mujoco.mj_step(m, d)
        mujoco_warp.step(model, data)
        forces[:, k] = d.actuator_force[columns], data.actuator_force.numpy()[1, columns]
    apart, own = forces[1] - forces[0], forces[0]
    return np.asarray(np.sqrt(np.mean(apart**2, axis=0) / np.mean(own**2, axis=0)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["frame3", "cable", "quarter_car", "car"])
def test_the_shipped_models_have_the_plugins_forces(name: str) -> None:
    apart = off(str(models_xml.path(name)), 300, kick=name != "car")
    assert apart.max() < 5e-3


@pytest.mark.slow
def test_two_dampers_that_act_on_each_other() -> None:
    mass, stiffness, damping = np.array([98.3, 98.3]), np.array([5e5, 7e5]), np.array([125.0, 50.0])
    frame = ShearFrame(mass=mass, stiffness=stiffness, damping=damping, damper_between=(0, 1))
    models = frame_models([default_damper(), default_damper()], frame, [(0, 1), (1, 2)])
    assert off(frame_xml(models, 5e-4), 300).max() < 5e-3


def dashpots(values: list[float], bodies: int) -> str:
    config = "".join(f'<config key="{key}" value="0"/>' for key in ("c0b", "fya", "fyb"))
    instances = "".join(
        f'<instance name="d{k}"><config key="law" value="bingham"/><config key="c0a" value="{c}"/>'
        f'<config key="v_ref" value="0.1"/>{config}</instance>'
        for k, c in enumerate(values)
    )
    inertia = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    body = '<body pos="{0} 0 0"><joint name="j{0}" type="slide"/>' + inertia + "</body>"
    plugins = "".join(
        f'<plugin joint="j{k % bodies}" plugin="mrdamp.damper" instance="d{k}"/>' for k in range(len(values))
    )
    return (
        f'<mujoco><option timestep="0.001" gravity="0 0 0"/><extension><plugin plugin="mrdamp.damper">{instances}'
        f"</plugin></extension><worldbody>{''.join(body.format(k) for k in range(bodies))}</worldbody>"
        f"<actuator>{plugins}</actuator></mujoco>"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "bodies", "sum_of_c"),
    [([500.0, 500.0], 2, 500.0), ([5000.0, 5000.0], 1, 1e4), ([1000.0] * 8, 1, 8e3)],
)
def test_linear_dashpots_take_the_exact_impulse(values: list[float], bodies: int, sum_of_c: float) -> None:
    """1 kg at 1 m/s loses 1 - exp(-c h) in a step of h, with one damper and with several, in every world."""
    mujoco_warp = pytest.importorskip("mujoco_warp", reason="the extra `warp` is not installed")
    from mrdamp.warp import put_model

    model, dampers = put_model(dashpots(values, bodies))
    data = dampers.make_data(3)
    data.qvel.fill_(1.0)
    mujoco_warp.step(model, data)
    np.testing.assert_allclose(data.qvel.numpy(), np.exp(-1e-3 * sum_of_c), atol=1e-5)


@pytest.mark.slow
def test_parameters_of_each_world() -> None:
    """The second world has the parameter of MuJoCo's model, the first another one."""
    assert off(FRAME, 200, c0a=4000.0).max() < 5e-3


@pytest.mark.slow
def test_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """With fewer worlds and steps, on the CPU device."""
    pytest.importorskip("mujoco_warp", reason="the extra `warp` is not installed")
    page = (Path(__file__).parents[1] / "docs" / "how-to" / "gpu.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", page, re.S | re.M)
    (tmp_path / "frame.xml").write_text(FRAME)
    monkeypatch.chdir(tmp_path)
    exec(compile(code.replace("4096", "4").replace("1000", "3"), "gpu.md", "exec"), {})
    assert capsys.readouterr().out.splitlines()[-1].startswith("[")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (FRAME.replace('integrator="Euler"', 'integrator="RK4"'), "integrator mjINT_RK4: dampers in Warp take Euler"),
        (FRAME.replace("<option ", '<option actuatorgroupdisable="0" '), "its group 0 is disabled"),
        ("<mujoco/>", "no actuator is a mrdamp.damper"),
        ("no such file.xml", "'no such file.xml' is neither an MJCF file nor its text"),
    ],
)
def test_refusals(text: str, message: str) -> None:
    refuses(lambda: convert(text), message)
