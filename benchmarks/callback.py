"""The plugin against the same law in Python through `mujoco.set_mjcb_control`."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from benchmarks import accuracy
from benchmarks.frames import DYKE, Stepper, frame
from benchmarks.python_law import PythonDamper
from benchmarks.result import Figure, Section, of_ratio
from benchmarks.timing import Effort, Ratio, interleave, ratio

STEP = 5e-4  # s, of the shipped frame


@dataclass(frozen=True)
class Setting:
    """A way to run the law in Python: the engine's step (s), inner steps and `abreast` of `PythonDamper`."""

    what: str
    timestep: float
    inner: int
    abreast: bool = False
    scale: float = 1.0
    target: str = ""


class CallbackStepper:
    """A frame whose damper is Python; the callback is there only while it is measured."""

    def __init__(self, setting: Setting, steps: int) -> None:
        model = frame(setting.timestep, damper=False)
        self.stepper = Stepper(model, steps, setting.scale)
        self.damper = PythonDamper(DYKE.attributes(), setting.inner, setting.abreast)
        dof = int(model.joint("storey1").dofadr[0])
        self.control = self.damper.control(self.stepper.data, dof, setting.timestep)

    def __call__(self) -> float:
        """Cost of a step, us."""
        self.damper.command = 2.25 - self.damper.command
        mujoco.set_mjcb_control(self.control)
        try:
            return self.stepper()
        finally:
            mujoco.set_mjcb_control(None)


SETTINGS = (
    # One explicit step diverges under the full ground motion; what it costs is measured where it does not.
    Setting("one explicit step (diverges; timed at 1 % of the motion)", STEP, 0, scale=0.01),
    Setting("a step, both at 0.5 ms, velocity of the engine", STEP, 3, target=">= 3"),
    Setting(
        "a step at equal accuracy, velocity extrapolated by half a step", STEP, 3, abreast=True, target=">= 3"
    ),
    Setting("a simulated second, Python at 0.1 ms, velocity of the engine", 1e-4, 1, target=">= 3"),
)


def measure(effort: Effort, end: float = 3.0) -> list[Section]:
    """The table; `end`: length of the accuracy runs, s."""
    tasks = {s.what: CallbackStepper(s, effort.steps) for s in SETTINGS}
    costs = interleave({"plugin": Stepper(frame(STEP), effort.steps), **tasks}, effort.rounds)
    rows: list[Figure] = []
    for s in SETTINGS:
        r = ratio(costs[s.what], costs["plugin"])
        times = STEP / s.timestep
        r = Ratio(r.value * times, r.low * times, r.high * times, r.top, r.bottom)
        note = "" if s.scale < 1 else _errors(s, end)
        rows.append(of_ratio(s.what, r, s.target, note))
    return [
        Section(
            "Plugin against the law in Python",
            "The law as a `mjcb_control` callback in Python floats, explicit midpoint rule, three inner steps at "
            f"{STEP * 1e3:g} ms and one at 0.1 ms. The plugin steps at {STEP * 1e3:g} ms, with a force error of "
            f"{accuracy.frame_error(STEP, end):.2%}.",
            tuple(rows),
        )
    ]


def _errors(s: Setting, end: float) -> str:
    p = DYKE.attributes()
    whole = accuracy.frame_error(s.timestep, end, PythonDamper(p, s.inner, s.abreast))
    law = accuracy.python_law_error(PythonDamper(p, s.inner), s.timestep, end)
    return f"Python's force error: law alone {law:.3%}, frame {whole:.2%}"
