"""Controllers of a stay cable with one damper: those of a frame on the cable's natural modes.

Johnson, Baker, Spencer and Fujino, J. Eng. Mech. 133 (2007) 1-11, doi 10.1061/(ASCE)0733-9399(2007)133:1(1), with the
law of mrdamp.control.clipped_optimal. The states are the natural coordinates and their velocities,

    q'' + 2 zeta w q' + w^2 q = -phi_d f + load,        |q|^2 = m int v^2 dx,

and what is regulated is the RMS motion over the cable's length. The damper stands on the ground: a dashpot to a fixed
point in space (skyhook) is an ordinary one here, whose size matters.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.clipped_optimal import plant_force
from mrdamp.control.estimator import Estimator
from mrdamp.control.force_control import Follower, ForceController, Modulated, OnOff, Tracking
from mrdamp.control.lyapunov import bang_bang, plant_lyapunov_matrix
from mrdamp.control.passive import Constant, passive_off, passive_on
from mrdamp.control.plant import Plant
from mrdamp.control.skyhook import SkyhookForce
from mrdamp.errors import InputError, require_positive
from mrdamp.inverse import LawInverse
from mrdamp.model import Model
from mrdamp.structures import FloatArray
from mrdamp.structures.cables import StayCable

#: Places x / L at which the load that the filter expects is independent, as ambient noise is.
_LOAD_PLACES = np.linspace(0.0, 1.0, 11)
_ACCELERATION_NOISE = 0.05  # m/s2
_STROKE_NOISE = 2e-5  # m


@dataclass(frozen=True)
class CableSite:
    """What a controller is made for: the cable, the largest command (A or V), the places x / L where its motion is
    measured (as in `mrdamp.envs.cable_task.CablePlant`), the control period, s, and the force at the largest command,
    N. damper: its model, for an inverse."""

    cable: StayCable
    command_max: float
    places: tuple[float, ...]
    force_max: float
    period: float = 5e-3
    damper: Model | None = None


def cable_plant(cable: StayCable) -> Plant:
    """First-order form in the natural coordinates; e (2N+2, 11) per N/m at `_LOAD_PLACES`."""
    n, w = len(cable.natural), cable.natural
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(w**2), -np.diag(2 * cable.ratio * w)]])
    load = cable.load_matrix(_LOAD_PLACES).T
    return Plant(
        a, np.concatenate([np.zeros(n), -cable.at(cable.damper_at)]), np.vstack([np.zeros_like(load), load])
    )


def cable_outputs(
    cable: StayCable, places: Sequence[float], names: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """Rows c (p, 2N+2) and feedthrough d (p,) of measurements by name: acceleration_j, velocity_j, displacement_j at
    place j (from 1), stroke, stroke_velocity, and mode_k, the k-th coordinate over the root of the cable's mass, whose
    squares sum to the mean square of the motion over the length, m2. Raises InputError."""
    linear, n = cable_plant(cable), len(cable.natural)
    c, d = np.zeros((len(names), 2 * n)), np.zeros(len(names))
    for row, name in enumerate(names):
        match = re.fullmatch(r"(acceleration|velocity|displacement|mode)_([1-9]\d*)", name)
        kind, number = (match[1], int(match[2])) if match else (name, 0)
        if kind == "mode" and number <= n:
            c[row, number - 1] = 1 / math.sqrt(cable.mass * cable.length)
            continue
        if kind in ("stroke", "stroke_velocity"):
            shape = cable.at(cable.damper_at)
        elif kind != "mode" and 1 <= number <= len(places):
            shape = cable.at(places[number - 1])
        else:
            raise InputError(
                f"measurement {name!r} is unknown; allowed: acceleration_j, velocity_j, displacement_j with j = 1.."
                f"{len(places)}, mode_k with k = 1..{n}, stroke, stroke_velocity"
            )
        if kind == "acceleration":
            c[row], d[row] = shape @ linear.a[n:], float(shape @ linear.b[n:])
        elif kind in ("velocity", "stroke_velocity"):
            c[row, n:] = shape
        else:
            c[row, :n] = shape
    return c, d


def cable_clipped_optimal(
    site: CableSite,
    r: float = 1e-9,
    noise_ratio: float = 10.0,
    follower: Follower | None = None,
    name: str = "clipped-optimal",
    level: float = 1.0,
) -> ForceController:
    """Clipped-optimal control of the RMS motion, from the accelerations at the site's places, stroke and force.

    r: weight of the force squared, m2/N2, against the mean square motion. noise_ratio: intensity of each load's noise
    ((N/m)^2 s) over that of the measurements', in units of 0.05 m/s2 and 0.02 mm. follower: of the wanted force, on/off
    switching between 0 and level, of the largest command, by default. Raises InputError.
    """
    names, deviation = _measured(site)
    aim = plant_force(
        cable_plant(site.cable), lambda rows: cable_outputs(site.cable, site.places, rows), _motion(site), r,
        noise_ratio, site.period, names, deviation,
    )  # fmt: skip
    return ForceController(aim, follower or OnOff(level * site.command_max), site.period, name)


def cable_force_tracking(site: CableSite, r: float = 1e-9, noise_ratio: float = 10.0) -> ForceController:
    """The same aim, followed by the inverse model of the site's damper. Raises InputError."""
    if site.damper is None:
        raise InputError("force-tracking: give the damper's model")
    inverse = LawInverse(site.damper, site.period, commands=(0.0, site.command_max))
    return cable_clipped_optimal(site, r, noise_ratio, Tracking(inverse), "force-tracking")


def cable_lyapunov(site: CableSite, noise_ratio: float = 10.0, level: float = 1.0) -> ForceController:
    """Control by the Lyapunov function of the mean square motion. Raises InputError."""
    linear = cable_plant(site.cable)
    p = plant_lyapunov_matrix(
        linear, lambda rows: cable_outputs(site.cable, site.places, rows), _motion(site)
    )
    return _bang_bang(site, -p @ linear.b, noise_ratio, level, "lyapunov")


def cable_max_dissipation(site: CableSite, noise_ratio: float = 10.0, level: float = 1.0) -> ForceController:
    """The field on wherever the damper's force resists the cable's motion. Raises InputError."""
    shape = site.cable.at(site.cable.damper_at)
    return _bang_bang(site, np.concatenate([np.zeros(len(shape)), shape]), noise_ratio, level, "max-dissipation")


def cable_skyhook(
    site: CableSite, damping: float | None = None, leak: float | None = None, level: float = 1.0
) -> ForceController:
    """A dashpot at the damper, from the first place's accelerometer, with on/off switching.

    damping: N s/m, by default the best for the first mode, 0.1 m L w1 / (x_d / L) (Pacheco, Fujino and Sulekh 1993,
    doi 10.1061/(ASCE)0733-9445(1993)119:6(1961)). leak: of the integrator, s, by default a period of the first mode.
    Raises InputError.
    """
    c = site.cable
    best = 0.1 * c.mass * c.length * c.first / c.damper_at if damping is None else damping
    tau = 2 * math.pi / c.first if leak is None else leak
    aim = SkyhookForce(1, 1.0, best, tau, site.period)
    return ForceController(aim, OnOff(level * site.command_max), site.period, "skyhook")


def _measured(site: CableSite) -> tuple[tuple[str, ...], FloatArray]:
    """What the Kalman filter gets, and the noise on it."""
    names = (*(f"acceleration_{j}" for j in range(1, len(site.places) + 1)), "stroke")
    return names, np.array([_ACCELERATION_NOISE] * len(site.places) + [_STROKE_NOISE])


def _motion(site: CableSite) -> dict[str, float]:
    """Weights of the mean square motion."""
    return {f"mode_{k}": 1.0 for k in range(1, len(site.cable.natural) + 1)}


def _bang_bang(
    site: CableSite, direction: FloatArray, noise_ratio: float, level: float, name: str
) -> ForceController:
    names, deviation = _measured(site)
    require_positive(name, noise_ratio=noise_ratio)
    rows = cable_outputs(site.cable, site.places, names)
    estimator = Estimator(cable_plant(site.cable), *rows, names, noise_ratio, site.period, deviation)
    return bang_bang(direction, estimator, level * site.command_max, site.period, name)


_LEVEL = {"level": 1.0}  # of on/off switching, over the largest command
_OPTIMAL = {"r": 1e-9, "noise_ratio": 10.0}
#: Kind -> options with their defaults; NaN: worked out from the site.
OPTIONS: Mapping[str, Mapping[str, float]] = {
    "passive-off": {},
    "passive-on": {},
    "constant": {"value": 0.0},
    "clipped-optimal": {**_OPTIMAL, **_LEVEL},
    "modulated-optimal": {**_OPTIMAL, "force_max": math.nan},
    "force-tracking": _OPTIMAL,
    "lyapunov": {"noise_ratio": 10.0, **_LEVEL},
    "max-dissipation": {"noise_ratio": 10.0, **_LEVEL},
    "skyhook": {"damping": math.nan, "leak": math.nan, **_LEVEL},
}


def make(spec: str, site: CableSite) -> Controller:
    """The controller of a spec (see `mrdamp.control.registry`) for a cable. Raises InputError."""
    kind, path, options = registry.parse(spec, OPTIONS)
    if kind == registry.POLICY:
        return registry.policy(path)
    o = {**OPTIONS[kind], **options}
    largest = site.force_max if math.isnan(o.get("force_max", math.nan)) else o["force_max"]
    given = {key: None if math.isnan(o[key]) else o[key] for key in ("damping", "leak") if key in o}
    builders: Mapping[str, Callable[[], Controller]] = {
        "passive-off": lambda: passive_off(site.period),
        "passive-on": lambda: passive_on(site.command_max, site.period),
        "constant": lambda: Constant(o["value"], f"constant {o['value']:g}", site.period),
        "clipped-optimal": lambda: cable_clipped_optimal(site, o["r"], o["noise_ratio"], level=o["level"]),
        "modulated-optimal": lambda: cable_clipped_optimal(
            site, o["r"], o["noise_ratio"], Modulated(site.command_max, largest), "modulated-optimal"
        ),
        "force-tracking": lambda: cable_force_tracking(site, o["r"], o["noise_ratio"]),
        "lyapunov": lambda: cable_lyapunov(site, o["noise_ratio"], o["level"]),
        "max-dissipation": lambda: cable_max_dissipation(site, o["noise_ratio"], o["level"]),
        "skyhook": lambda: cable_skyhook(site, **given, level=o["level"]),
    }
    return builders[kind]()
