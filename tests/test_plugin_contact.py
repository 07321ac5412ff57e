"""A damper beside contacts, limits and other actuators.

The truth for linear laws is the engine's own element at a step of 20 us: damping of a joint or tendon, an actuator with
`biasprm`. For the others it is Runge-Kutta at 20 us, which takes the present force. A step of 1 or 2 ms may be off by
2 mm and twice what the engine's own element is off by at that step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import mujoco
import numpy as np
import pytest

from excitation import Array
from mjcf_builders import BOUC_WEN, DYKE, config, dashpot

HARD = 'solref="-200000 -400"'
FREE = 'contype="0" conaffinity="0"'
TANH = {"k0a": 500, "k0b": 0, "k1a": 2e5, "k1b": 0, "c0a": 800, "c0b": 0, "c1a": 1500, "c1b": 0}
TANH |= {"m0": 0.5, "f0a": 300, "f0b": 400, "v_ref": 0.01}
LAWS: Mapping[str, Mapping[str, float]] = {
    "bingham": dashpot(1400.0, 680.0),
    "bouc_wen": BOUC_WEN,
    "modified_bouc_wen": DYKE,
    "hyperbolic_tangent": TANH,
}


def option(dt: float, integrator: str = "implicitfast", cone: str = "pyramidal", flag: str = "") -> str:
    return f'<option timestep="{dt!r}" integrator="{integrator}" cone="{cone}">{flag}</option>'


def with_dampers(
    model: Callable[[float], str],
    law: str,
    values: Mapping[str, float],
    on: Mapping[str, str],
    more: str = "",
) -> str:
    """The model without damping of its own, and an actuator of the plugin on each transmission."""
    instances = "".join(f'<instance name="{name}">{config({"law": law, **values})}</instance>' for name in on)
    plugin = f'<extension><plugin plugin="mrdamp.damper">{instances}</plugin></extension>'
    dampers = "".join(
        f'<plugin name="{name}" {where} plugin="mrdamp.damper" instance="{name}" {more}/>'
        for name, where in on.items()
    )
    text = model(0.0)
    if "</actuator>" not in text:
        text = text.replace("</mujoco>", "<actuator></actuator></mujoco>")
    return text.replace("</actuator>", f"{dampers}</actuator>").replace("<worldbody>", f"{plugin}<worldbody>")


def quarter_car(options: str, c: float, wheel: float = 36.0, geom: str = HARD) -> str:
    return f"""<mujoco>{options}<worldbody><geom type="plane" size="5 5 1" {geom}/>
<body pos="0 0 .3"><joint name="w" type="slide" axis="0 0 1"/><geom type="sphere" size=".3" mass="{wheel}" {geom}/>
<body pos="0 0 .4"><joint name="s" type="slide" axis="0 0 1" stiffness="20000" damping="{c}"/>
<geom type="box" size=".3 .3 .1" mass="300" {FREE}/></body></body></worldbody></mujoco>"""


WHEELS = {"fl": (1.0, 0.7), "fr": (1.0, -0.7), "rl": (-1.0, 0.7), "rr": (-1.0, -0.7)}


def vehicle(options: str, c: float) -> str:
    wheels = "".join(
        f'<body pos="{x} {y} -.3"><joint name="{name}" type="slide" axis="0 0 1" stiffness="20000" damping="{c}"/>'
        f'<geom type="sphere" size=".3" mass="10" {HARD} friction=".8"/></body>'
        for name, (x, y) in WHEELS.items()
    )
    return f"""<mujoco>{options}<worldbody><geom type="plane" size="50 50 1" {HARD} friction=".8"/>
<body pos="0 0 .7"><freejoint/><geom type="box" size="1.2 .6 .2" mass="1200" {FREE}/>{wheels}</body>
</worldbody></mujoco>"""


def hung(options: str, c: float, clutter: int = 0) -> str:
    """A tendon between a guided body and a box on the ground, and boxes around that a damper does not feel."""
    boxes = "".join(
        f'<body pos="{3 + 0.5 * (k % 4)} {0.5 * (k // 4)} .1"><freejoint/>'
        '<geom type="box" size=".1 .1 .1" mass="1"/></body>'
        for k in range(clutter)
    )
    return f"""<mujoco>{options}<worldbody><geom type="plane" size="9 9 1" {HARD}/>
<body pos="0 0 1"><joint type="slide" axis="0 0 1"/><geom type="box" size=".2 .2 .1" mass="50" {FREE}/>
<site name="a" pos="0 0 -.1"/></body>
<body pos=".1 0 .31"><freejoint/><geom type="box" size=".2 .2 .2" mass="5" {HARD} friction=".5"/>
<site name="b" pos="0 0 .2"/></body>
{boxes}</worldbody><tendon><spatial name="t" stiffness="8000" springlength=".5" damping="{c}">
<site site="a"/><site site="b"/></spatial></tendon></mujoco>"""


def crank(options: str, c: float) -> str:
    own = f'<general {CRANK} biastype="affine" biasprm="0 0 -{c}"/>' if c else ""
    return f"""<mujoco>{options}<worldbody><geom type="plane" size="5 5 1" {HARD}/>
<body pos="0 0 .45"><joint type="hinge" axis="0 1 0" stiffness="60"/>
<geom type="capsule" fromto="0 0 0 .4 0 0" size=".02" mass="1" {FREE}/>
<site name="cs" pos=".2 0 0"/><geom pos=".4 0 0" size=".1" mass="1" {HARD} friction=".4"/></body>
<site name="ss" pos="0 0 .8" zaxis=".3 0 -1"/></worldbody>
<actuator>{own}</actuator></mujoco>"""


CRANK = 'cranksite="cs" slidersite="ss" cranklength=".5"'


def drop(text: str, seconds: float, height: float, speed: float = 0.0, command: float = 0.0) -> Array:
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    free = model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
    data.qpos[2 if free else 0] += height
    if free:
        data.qvel[[0, 3, 4]] = speed, 0.1 * speed, 0.07 * speed
    data.ctrl[:] = command
    every, out = round(0.01 / model.opt.timestep), []
    for k in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        if (k + 1) % every == 0:
            out.append(data.qpos.copy())
    return np.array(out)


def feet(options: str, c: float) -> str:
    """A foot of 36 points: 144 rows of contacts on two degrees of freedom."""
    points = "".join(
        f'<geom size=".02" pos="{0.1 * (k % 6)} {0.1 * (k // 6)} -.3" mass="0" {HARD}/>' for k in range(36)
    )
    return quarter_car(options, c, 10.0, "").replace('<body pos="0 0 .4">', points + '<body pos="0 0 .4">')


SPRING = {"mr": 'joint="s"'}
#: A model, where its dampers are, and the height (m, or rad) and speed of the release.
DROPS: Mapping[str, tuple[Callable[[str, float], str], Mapping[str, str], float, float]] = {
    "vehicle on four dampers": (vehicle, {n: f'joint="{n}"' for n in WHEELS}, 0.1, 3.0),
    "slider-crank": (crank, {"mr": CRANK}, -0.3, 0.0),
    "wheel": (quarter_car, SPRING, 0.05, 0.0),
    "light wheel": (partial(quarter_car, wheel=1.0), SPRING, 0.05, 0.0),
    "tendon between bodies": (hung, {"mr": 'tendon="t"'}, 0.1, 0.0),
    "more contacts than degrees of freedom": (feet, SPRING, 0.05, 0.0),
}


@pytest.mark.parametrize(
    ("what", "c", "integrator", "cone"),
    [
        ("vehicle on four dampers", 1500.0, "Euler", "pyramidal"),
        ("vehicle on four dampers", 8000.0, "implicitfast", "elliptic"),
        ("vehicle on four dampers", 8000.0, "implicit", "pyramidal"),
        ("slider-crank", 50.0, "implicitfast", "elliptic"),
        ("slider-crank", 500.0, "implicitfast", "pyramidal"),
        ("wheel", 5000.0, "implicitfast", "pyramidal"),
        ("light wheel", 1400.0, "implicitfast", "pyramidal"),
        ("light wheel", 5000.0, "implicitfast", "pyramidal"),
        ("tendon between bodies", 500.0, "implicitfast", "pyramidal"),
        ("more contacts than degrees of freedom", 3000.0, "implicitfast", "pyramidal"),
    ],
)
def test_a_drop_is_that_with_the_engines_own_damping(what: str, c: float, integrator: str, cone: str) -> None:
    model, on, height, speed = DROPS[what]

    def own(dt: float) -> Array:
        return drop(model(option(dt, integrator, cone), c), 0.6, height, speed)

    truth = own(2e-5)
    for dt in (1e-3, 2e-3):
        text = with_dampers(partial(model, option(dt, integrator, cone)), "bingham", dashpot(c), on)
        off, native = (np.max(np.abs(a - truth)) for a in (drop(text, 0.6, height, speed), own(dt)))
        assert off < 2e-3 + 2.0 * native, dt


@pytest.mark.parametrize(("law", "wheel"), [*((law, 1.0) for law in LAWS), ("modified_bouc_wen", 36.0)])
def test_each_law_against_runge_kutta(law: str, wheel: float) -> None:
    """A drop onto the wheel, at a constant command: 1 ms is off by less than 2 mm of some 45 mm of stroke."""

    def fall(dt: float, integrator: str) -> Array:
        options = option(dt, integrator)
        text = with_dampers(lambda c: quarter_car(options, c, wheel), law, LAWS[law], SPRING)
        return drop(text, 0.6, 0.05, command=1.0)

    truth = fall(2e-5, "RK4")
    off = [np.max(np.abs(fall(dt, "implicitfast") - truth)) for dt in (1e-3, 5e-4)]
    assert off[0] < 2e-3
    assert off[1] < 0.65 * off[0]


def test_light_body_at_a_soft_stop() -> None:
    """30 g against the limit of its joint under 600 N, behind a stiff damper: where Runge-Kutta leaves it."""

    def place(dt: float, integrator: str) -> float:
        body = f"""<mujoco><option timestep="{dt!r}" integrator="{integrator}" gravity="0 0 0"/><worldbody><body>
<joint name="s" type="slide" axis="1 0 0" limited="true" range="-1 .01"/><geom size=".05" mass=".03"/>
</body></worldbody></mujoco>"""
        model = mujoco.MjModel.from_xml_string(with_dampers(lambda c: body, "modified_bouc_wen", DYKE, SPRING))
        data = mujoco.MjData(model)
        data.qfrc_applied[0] = 600.0
        mujoco.mj_step(model, data, round(0.5 / dt))
        return float(data.qpos[0])

    truth = place(2e-5, "RK4")
    for dt in (1e-3, 1e-4):
        assert place(dt, "implicitfast") == pytest.approx(truth, rel=2e-3)


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_only_what_a_damper_feels_matters(cone: str) -> None:
    """Forty boxes beside it, with 500 rows of contacts, islands or not: the same motion."""

    def fall(clutter: int, flag: str) -> Array:
        options = option(1e-3, cone=cone, flag=flag)
        text = with_dampers(
            lambda c: hung(options, c, clutter), "bingham", dashpot(5000.0), {"mr": 'tendon="t"'}
        )
        return drop(text, 0.5, 0.1)[:, :8]

    alone = fall(0, "")
    assert np.ptp(alone[:, 0]) > 0.02
    for flag in ("", '<flag island="disable"/>'):
        np.testing.assert_allclose(fall(40, flag), alone, atol=1e-6)


def test_sleeping_body_wakes_with_the_right_force() -> None:
    """Asleep by its own leave, woken by a push: as with damping of its joint."""

    def run(text: str) -> Array:
        text = text.replace('<body pos="0 0 .3">', '<body pos="0 0 .3" sleep="allowed">')
        model = mujoco.MjModel.from_xml_string(text)
        data, out, slept = mujoco.MjData(model), [], 0
        for _ in range(8000):
            data.xfrc_applied[2, 2] = 2500.0 * np.sin(20.0 * (data.time - 6.0)) if data.time > 6.0 else 0.0
            mujoco.mj_step(model, data)
            slept += data.tree_asleep[0] >= 0
            out.append(data.qpos[1])
        assert slept > 100
        return np.array(out)

    options = option(1e-3, flag='<flag sleep="enable"/>')
    car = partial(quarter_car, options, geom="")
    damped = run(with_dampers(car, "bingham", dashpot(1400.0), SPRING))
    own = run(car(1400.0))
    assert np.max(np.abs(damped - own)) < 0.02 * np.ptp(own[6000:])


def beside(
    dt: float, integrator: str, c: float, mass: float, damper: bool, more: str, joint: str, by: str
) -> Array:
    """Positions (n,) of a body that an actuator moves, with a dashpot of the engine or the plugin on its joint."""

    def body(own: float) -> str:
        dashpot = f'<velocity joint="s" kv="{own}" {more}/>' if own else ""
        return f"""<mujoco>{option(dt, integrator)}<worldbody>
<body><joint name="s" type="slide" axis="1 0 0" stiffness="50" {joint}/><geom size=".1" mass="{mass}"/></body>
</worldbody><actuator>{by}{dashpot}</actuator></mujoco>"""

    text = with_dampers(body, "bingham", dashpot(c), SPRING, more) if damper else body(c)
    model = mujoco.MjModel.from_xml_string(text)
    data, out = mujoco.MjData(model), []
    for _ in range(round(0.6 / dt)):
        data.ctrl[0] = np.sin(20.0 * data.time) * (200.0 if "motor" in by else 0.1)
        mujoco.mj_step(model, data)
        out.append(data.qpos[0])
    return np.array(out)[round(0.01 / dt) - 1 :: round(0.01 / dt)]


LIMIT = 'forcelimited="true" forcerange="-40 40"'
JOINT_LIMIT = 'actuatorfrclimited="true" actuatorfrcrange="-40 40"'
MOTOR = '<motor joint="s"/>'
OTHERS = {
    "servo": ("", "", '<position joint="s" kp="2000" kv="200"/>'),
    "stiff servo": ("", "", '<position joint="s" kp="2000" kv="2000"/>'),
    "limited servo": ("", "", f'<position joint="s" kp="2000" kv="20" {LIMIT}/>'),
    "limited damper": (LIMIT, "", MOTOR),
    "limited joint": ("", JOINT_LIMIT, MOTOR),
}


@pytest.mark.parametrize("mass", [1.0, 0.1])
@pytest.mark.parametrize("c", [20.0, 1000.0])
@pytest.mark.parametrize("other", OTHERS)
def test_beside_another_actuator(other: str, c: float, mass: float) -> None:
    """The engine's velocity actuator has the same force, limits included: at 1 ms no further off than that."""
    more, joint, by = OTHERS[other]
    truth = beside(2e-5, "implicitfast", c, mass, False, more, joint, by)
    own, ours = (beside(1e-3, "implicitfast", c, mass, d, more, joint, by) for d in (False, True))
    size = np.ptp(truth)
    assert np.max(np.abs(ours - truth)) < np.max(np.abs(own - truth)) + 3e-3 * size
