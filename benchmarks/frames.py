"""The three-storey frame of `mrdamp.models_xml`, with and without parts, and stepping it at little cost."""

from __future__ import annotations

import contextlib
import ctypes
import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import numpy.typing as npt

from benchmarks.timing import clock
from mrdamp import models_xml, sets
from mrdamp.model.core import Array

DYKE = sets.load("dyke1996_3kN")  # the damper of the shipped frame
BLOCK = 10  # steps of the engine in one call, over which ground and command are held


def frame(
    timestep: float,
    *,
    damper: bool = True,
    sensor: bool = True,
    bare: bool = False,
    law: tuple[str, dict[str, float]] | None = None,
) -> mujoco.MjModel:
    """The shipped frame at a time step (s). bare: without what is drawn and without its other sensors.

    law: name and attributes that take the place of the damper's.
    """
    root = ElementTree.fromstring(models_xml.path("frame3").read_text(encoding="utf-8"))
    instance = root.find(".//instance")
    if law is not None and instance is not None:
        name, attributes = law
        instance[:] = [ElementTree.Element("config", key="law", value=name)]
        instance.extend(
            ElementTree.Element("config", key=key, value=repr(value)) for key, value in attributes.items()
        )
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.option.timestep = timestep
    if not (damper and sensor):
        spec.delete(spec.sensor("damper_force"))
    if not damper:
        spec.delete(spec.actuator("damper"))
    if bare:
        others = [s for s in spec.sensors if s.name != "damper_force"]
        for item in (*others, *spec.sites, *spec.geoms, *spec.cameras):
            spec.delete(item)
    return spec.compile()


def multisine(t: npt.NDArray[np.floating], seed: int = 1, peak: float = 3.4) -> Array:
    """Ground acceleration at the times t (n,), m/s2: 40 sines from 1 to 10 Hz with random phases."""
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, 40)
    angles = 2.0 * math.pi * np.multiply.outer(t, np.linspace(1.0, 10.0, 40)) + phases
    pushes: Array = peak / 15.0 * np.sin(angles).sum(axis=-1)
    return pushes


class Stepper:
    """Steps a frame under a multisine ground motion, scaled, and a command switched on and off at random."""

    def __init__(self, model: mujoco.MjModel, steps: int, scale: float = 1.0) -> None:
        self.model, self.data, self.blocks = model, mujoco.MjData(model), max(steps // BLOCK, 1)
        names = [model.actuator(k).name for k in range(model.nu)]
        self.ground = names.index("ground")
        self.damper = names.index("damper") if "damper" in names else None
        self.now, n = 0, 4096
        self.pushes = (scale * multisine(np.arange(n) * BLOCK * model.opt.timestep)).tolist()
        self.commands = (2.25 * np.random.default_rng(2).integers(0, 2, n)).tolist()

    def __call__(self) -> float:
        """Cost of a step, us."""
        m, d, step = self.model, self.data, mujoco.mj_step
        begin = clock()
        for k in range(self.now, self.now + self.blocks):
            d.ctrl[self.ground] = self.pushes[k % 4096]
            if self.damper is not None:
                d.ctrl[self.damper] = self.commands[k % 4096]
            step(m, d, BLOCK)
        cost = (clock() - begin) / (self.blocks * BLOCK)
        self.now += self.blocks
        # Four storeys' worth of drift and no more: neither diverged nor at rest.
        if not 1e-9 < np.abs(d.qpos[1:]).max() < 0.5:
            raise RuntimeError(f"the frame does not move as it should: {d.qpos[1:]}")
        return cost


@contextlib.contextmanager
def profiling_clock(on: bool) -> Iterator[None]:
    """The engine's clock for its own timers, which `import mujoco` installs and every step reads several times."""
    folder = Path(mujoco.__file__).parent
    hook = ctypes.c_void_p.in_dll(ctypes.CDLL(str(next(folder.glob("libmujoco.so*")))), "mjcb_time")
    before = hook.value
    if not on:
        hook.value = None
    try:
        yield
    finally:
        hook.value = before
