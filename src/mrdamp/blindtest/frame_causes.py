"""Causes of a frame: its storeys, its accelerometers, and those of the damper that stands in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mrdamp.blindtest import causes, unknown
from mrdamp.blindtest.causes import Cause, Form, Scale, Sized

STOREYS = (1, 2, 3)
#: Effects of the damper that a frame case may have.
DAMPER = (
    "driver_lag",
    "command_delay",
    "saturation",
    "remanence",
    "asymmetry",
    "seal_friction",
    "mount_compliance",
)
SENSORS = ("sensor_gain", "sensor_offset", "sensor_leakage", "sensor_lag")


@dataclass(frozen=True)
class FrameScale:
    """What sizes are measured by: the damper's, and RMS drift (m), drift rate (m/s), acceleration (m/s2), storey
    force (N), by storey or floor; storey stiffness (N/m) and damping (N s/m)."""

    damper: Scale
    drift: tuple[float, ...]
    rate: tuple[float, ...]
    acceleration: tuple[float, ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]


PlacedForm = Callable[[np.random.Generator, FrameScale, int], Sized]


def _stiffness(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    side = r.choice([-0.5, 0.5])
    return lambda s: {f"storey{j}.stiffness": side * s}


def _stiffness_bent(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    """Softer, and a little more so where the drift is large."""
    return lambda s: {f"storey{j}.stiffness": -0.5 * s, f"storey{j}.k3": -0.01 * s / c.drift[j - 1] ** 2}


def _damping(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    return lambda s: {f"storey{j}.damping": 25 * s}


def _damping_square(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    d = c.damping[j - 1]
    return lambda s: {f"storey{j}.damping": 18 * s, f"storey{j}.c2": 3 * d / c.rate[j - 1] * s}


def _friction(form: int) -> PlacedForm:
    def draw(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
        top = 0.3 * c.stiffness[j - 1] * c.drift[j - 1]
        return lambda s: {f"storey{j}.friction_form": form, f"storey{j}.friction": top * s}

    return draw


def _mass(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    return lambda s: {f"storey{j}.mass": 0.5 * s}


def _mass_held(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    """Held by something stiff: with the floor up to far above the frame's own frequencies."""
    hz = r.uniform(45.0, 70.0)
    return lambda s: {f"storey{j}.hung_mass": 50 * s, f"storey{j}.hung_hz": hz, f"storey{j}.hung_ratio": 0.05}


def _sensor(effect: str) -> tuple[PlacedForm, ...]:
    """A force sensor's forms at an accelerometer, with the floor's acceleration for the force."""

    def placed(form: Form) -> PlacedForm:
        def draw(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
            a = c.acceleration[j - 1]
            sized = form(r, Scale(a, a, a, a, c.damper.command))
            return lambda s: {key.replace("sensor.", f"floor{j}."): value for key, value in sized(s).items()}

        return draw

    return tuple(placed(form) for form in causes.EFFECTS[effect][1])


#: Effect with a place -> its stage and its forms.
PLACED: Mapping[str, tuple[str, tuple[PlacedForm, ...]]] = {
    "storey_stiffness": ("structure", (_stiffness, _stiffness_bent)),
    "storey_damping": ("structure", (_damping, _damping_square)),
    "joint_friction": ("structure", (_friction(1), _friction(2))),
    "floor_mass": ("structure", (_mass, _mass_held)),
    **{name: ("sensor", _sensor(name)) for name in SENSORS},
}


def _appendage(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    hz, ratio = r.uniform(6.0, 16.0), r.uniform(0.01, 0.04)
    return lambda s: {
        f"storey{j}.hung_mass": 25 * s,
        f"storey{j}.hung_hz": hz,
        f"storey{j}.hung_ratio": ratio,
    }


def _pounding(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    k, d = c.stiffness[j - 1], c.drift[j - 1]
    return lambda s: {f"storey{j}.gap": d * (0.3 + 0.3 / s), f"storey{j}.stop": 4 * k}


def _yielding(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    force = c.stiffness[j - 1] * c.drift[j - 1]
    return lambda s: {f"storey{j}.yield": 0.4 * force / s}


def _crack(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    return lambda s: {f"storey{j}.crack": 0.6 * s}


def _cross_axis(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    side = r.choice([-1.0, 1.0])
    return lambda s: {f"floor{j}.cross": 0.5 * side * s}


def _of_damper(name: str) -> PlacedForm:
    form = unknown.DAMPER[name][1]
    return lambda r, c, j: form(r, c.damper)


#: Cause outside the catalogue -> its stage and its form.
UNKNOWN: Mapping[str, tuple[str, PlacedForm]] = {
    "appendage": ("structure", _appendage),
    "pounding": ("structure", _pounding),
    "yielding_storey": ("structure", _yielding),
    "breathing_crack": ("structure", _crack),
    "cross_axis": ("sensor", _cross_axis),
    "dropouts": ("driver", _of_damper("dropouts")),
    "supply_sag": ("driver", _of_damper("supply_sag")),
}


def labels() -> list[str]:
    """Every single effect of a frame with its place."""
    placed = [f"{name}@{j}" for name in PLACED for j in STOREYS]
    return [*placed, *DAMPER, *DAMPER]  # the damper's twice: they have no places


def draw(rng: np.random.Generator, label: str, scale: FrameScale, *, outside: bool) -> Cause:
    """The cause of one part of a label."""
    name, _, place = label.partition("@")
    if outside:
        stage, form = UNKNOWN[name]
        return Cause(f"~{name}", stage, form(rng, scale, int(rng.integers(1, 4))))
    if not place:
        return causes.draw(rng, name, scale.damper)
    stage, forms = PLACED[name]
    return Cause(label, stage, forms[int(rng.integers(len(forms)))](rng, scale, int(place)))
