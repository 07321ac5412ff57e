"""Causes of a frame: its storeys, its accelerometers, and its damper."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from studies.blindtest import causes, unknown
from studies.blindtest.causes import Cause
from studies.blindtest.scale import Form, Scale, Sized

STOREYS = (1, 2, 3)
#: Effects of the damper in a frame case.
DAMPER = (
    "driver_lag",
    "command_delay",
    "saturation",
    "remanence",
    "asymmetry",
    "shear_thinning",
    "seal_friction",
    "mount_compliance",
)
SENSORS = ("sensor_gain", "sensor_offset", "sensor_leakage", "sensor_lag")


@dataclass(frozen=True)
class FrameScale:
    """Scales of a frame's causes: those of the damper; by storey or floor, RMS drift (m), drift rate (m/s),
    acceleration (m/s2) and storey force (N), stiffness (N/m), damping (N s/m) and mass (kg)."""

    damper: Scale
    drift: tuple[float, ...]
    rate: tuple[float, ...]
    acceleration: tuple[float, ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    mass: tuple[float, ...]


PlacedForm = Callable[[np.random.Generator, FrameScale, int], Sized]


def _stiffness(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    side = r.choice([-0.5, 0.5])
    return lambda s: {f"storey{j}.stiffness": side * s}


def _stiffness_bent(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    """Softer, and slightly more so at large drifts."""
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


def _friction_slipping(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    """A bolted joint with gradual slip (Iwan 1966)."""
    top, travel = 0.3 * c.stiffness[j - 1] * c.drift[j - 1], c.drift[j - 1] * r.uniform(0.1, 0.3)
    fixed = {f"storey{j}.friction_form": 3, f"storey{j}.friction_travel": travel}
    return lambda s: {**fixed, f"storey{j}.friction": top * s}


def _friction_bristles(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    """LuGre friction with a breakaway force above the sliding force."""
    fixed = {
        f"storey{j}.friction_form": 4,
        f"storey{j}.friction_travel": r.uniform(2e-5, 6e-5),
        f"storey{j}.friction_static": r.uniform(1.2, 1.6),
        f"storey{j}.friction_v": r.uniform(2e-3, 8e-3),
    }
    top = 0.3 * c.stiffness[j - 1] * c.drift[j - 1]
    return lambda s: {**fixed, f"storey{j}.friction": top * s}


def _mass(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    return lambda s: {f"storey{j}.mass": 0.5 * s}


def _mass_held(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    """A stiffly attached mass: moves with the floor up to far above the frame's own frequencies."""
    hz = r.uniform(45.0, 70.0)
    return lambda s: {f"storey{j}.hung_mass": 50 * s, f"storey{j}.hung_hz": hz, f"storey{j}.hung_ratio": 0.05}


def _sensor(effect: str) -> tuple[PlacedForm, ...]:
    """A force sensor's forms applied to an accelerometer."""

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
    "joint_friction": ("structure", (_friction(1), _friction(2), _friction_slipping, _friction_bristles)),
    "floor_mass": ("structure", (_mass, _mass_held)),
    **{name: ("sensor", _sensor(name)) for name in SENSORS},
}


def _hung(j: int, mass: float, hz: float, ratio: float) -> Sized:
    """A mass (kg, by size) on a spring and a dashpot."""
    fixed = {f"storey{j}.hung_hz": hz, f"storey{j}.hung_ratio": ratio}
    return lambda s: {f"storey{j}.hung_mass": mass * s, **fixed}


def _appendage(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    return _hung(j, 25.0, r.uniform(6.0, 16.0), r.uniform(0.01, 0.04))


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


def _base_rocking(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    """The foundation rocks, and each floor moves in proportion to its height."""
    mass, ratio, k = r.uniform(20.0, 60.0), r.uniform(0.02, 0.06), 4 * c.stiffness[0]
    return lambda s: {"storey1.rock_mass": mass, "storey1.rock_k": k / s, "storey1.rock_ratio": ratio}


def _loose_panel(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    """A loose panel on the floor that slides between two edges and hits them."""
    fixed = {
        f"storey{j}.hung_hz": r.uniform(25.0, 50.0),
        f"storey{j}.hung_ratio": r.uniform(0.1, 0.3),
        f"storey{j}.hung_gap": r.uniform(1e-3, 3e-3),
        f"storey{j}.hung_rub": r.uniform(0.5, 1.5),
    }
    return lambda s: {**fixed, f"storey{j}.hung_mass": 50 * s}


def _slack_brace(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    """A brace with clearance: the storey is softer around its rest position."""
    slack = c.drift[j - 1] * r.uniform(0.4, 0.9)
    return lambda s: {f"storey{j}.slack": slack, f"storey{j}.slack_share": 0.9 * s}


def _ground_misaligned(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    """A misaligned accelerometer of the table that also measures its transverse motion."""
    side, hz = r.choice([-1.0, 1.0]), r.uniform(7.0, 14.0)
    return lambda s: {"ground.angle": side * 0.25 * s, "ground.hz": hz}


def _sloshing(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    """An open tank whose water sloshes near the frame's first frequency."""
    return _hung(j, 15.0, r.uniform(2.5, 5.5), r.uniform(0.005, 0.02))


def _floppy_floor(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    """A flexible floor: part of its mass is on a slab that bends."""
    hz, mass, part = r.uniform(10.0, 20.0), c.mass[j - 1], r.uniform(0.4, 0.6)
    fixed = {f"storey{j}.hung_hz": hz, f"storey{j}.hung_ratio": 0.02}
    return lambda s: {**fixed, f"storey{j}.mass": -part * s, f"storey{j}.hung_mass": part * mass * s}


def _slipping_bolts(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    """A bolted joint that slips within its holes at large storey forces and stays displaced."""
    hold = c.drift[j - 1] * r.uniform(0.6, 1.2)
    return lambda s: {f"storey{j}.bolt_hold": hold, f"storey{j}.bolt_gap": 1.5 * c.drift[j - 1] * s}


def _clipped(r: np.random.Generator, c: FrameScale, j: int) -> Sized:
    """An accelerometer with too small a range."""
    return lambda s: {f"floor{j}.clip": c.acceleration[j - 1] * (0.4 + 0.15 / s)}


def _of_damper(name: str) -> PlacedForm:
    form = unknown.DAMPER[name][1]
    return lambda r, c, j: form(r, c.damper)


_FIRST: Mapping[str, tuple[str, PlacedForm]] = {
    "appendage": ("structure", _appendage),
    "pounding": ("structure", _pounding),
    "yielding_storey": ("structure", _yielding),
    "breathing_crack": ("structure", _crack),
    "cross_axis": ("sensor", _cross_axis),
    "dropouts": ("driver", _of_damper("dropouts")),
    "supply_sag": ("driver", _of_damper("supply_sag")),
    "base_rocking": ("structure", _base_rocking),
    "loose_panel": ("structure", _loose_panel),
    "slack_brace": ("structure", _slack_brace),
    "ground_misaligned": ("sensor", _ground_misaligned),
    "poppet_valve": ("fluid", _of_damper("poppet_valve")),
}
_SECOND: Mapping[str, tuple[str, PlacedForm]] = {
    "sloshing": ("structure", _sloshing),
    "floppy_floor": ("structure", _floppy_floor),
    "slipping_bolts": ("structure", _slipping_bolts),
    "clipped_range": ("sensor", _clipped),
    "coil_drift": ("driver", _of_damper("coil_drift")),
}
#: Cause outside the catalogue -> its stage and its form.
UNKNOWN: Mapping[str, tuple[str, PlacedForm]] = {**_FIRST, **_SECOND}
#: As `unknown.GROUPS`.
GROUPS = (tuple(_FIRST), tuple(_SECOND))


def labels() -> list[str]:
    """Every single effect of a frame with its place."""
    placed = [f"{name}@{j}" for name in PLACED for j in STOREYS]
    return [*placed, *DAMPER, *DAMPER]  # the damper's effects twice: they have no places


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
