"""Catalogue of a damper: every effect with its coordinates, ranges and starting values, as plugin attributes.

Ranges are scaled by the records (force, stroke, velocity, acceleration, command). If the exact form of an
effect differs between rigs, the attributes of the form are free too: the second pole of a lag, the knee of a
saturation, the presliding distance of friction. A cause is then identified by its behaviour and not by one
equation.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from itertools import chain

import numpy as np

from mrdamp.diagnosis.constants import CLEARANCE, ELASTIC
from mrdamp.diagnosis.hypotheses.current_effects import current_terms
from mrdamp.diagnosis.hypotheses.fluid_effects import fluid_terms
from mrdamp.diagnosis.hypotheses.terms import (
    Coordinate,
    Settings,
    Sizes,
    Term,
    catalogue,
    linear,
    positive,
    term,
)
from mrdamp.model.core import Array


def damper_terms(s: Sizes) -> tuple[Term, ...]:
    """All effects from driver to sensor, in the order of the chain, in the forms that the sampling of the
    records can show: a form whose resonances are above the sampling limit has no starts."""
    inertia, dt = s.force / s.acceleration, s.sample_time
    parts = _mechanics(s), _mass_terms(inertia, dt), _mount(s), sensor_terms(s.force, dt)
    terms = chain(current_terms(s), fluid_terms(s), *parts, _motion_terms(dt))
    return catalogue(t for t in terms if t.starts)


def _mechanics(s: Sizes) -> Iterator[Term]:
    k, f, v, x = s.force / s.stroke, s.force, s.velocity, s.stroke
    spring = (
        linear("k", 0.05 * k, -3 * k, 3 * k),
        linear("k2", 0.3 / x, -3 / x, 3 / x),
        linear("k3", 0.3 / x**2, -5 / x**2, 50 / x**2),
        linear("f0", 0.05 * f, -2 * f, 2 * f),
    )
    yield term(
        "gas_spring",
        spring,
        (0.1 * k, 0.3 / x, 0.0, 0.0),
        (0.1 * k, -0.3 / x, 0.0, 0.0),
        (0.03 * k, 0.0, 3.0 / x**2, 0.0),
        (0.0, 0.0, 0.0, 0.05 * f),
    )
    friction = (
        linear("coulomb", 0.03 * f, 0.0, 2 * f),
        positive("breakaway", 1.2, 1.0, 4.0, 0.3),
        positive("v_s", 0.1 * v, 1e-3 * v, 2 * v),
    )
    presliding = positive("presliding", 2e-3 * x, 2e-4 * x, 0.2 * x)
    width = positive("width", 0.02 * v, 1e-3 * v, 0.5 * v)
    yield term("seal_friction", (*friction, presliding), (0.08 * f, 1.2, 0.1 * v, 2e-3 * x))
    yield term("seal_friction:slipping at once", (*friction, width), (0.08 * f, 1.2, 0.1 * v, 0.02 * v))


def _mass_terms(inertia: float, dt: float) -> Iterator[Term]:
    mass = linear("m", 0.03 * inertia, 0.0, 3 * inertia)
    ratio = positive("ratio", 0.05, 2e-3, 0.9)
    m, highest = 0.1 * inertia, 0.4 / dt
    # The mass lies beyond the mount, as a fixture does; this matters only with a mount.
    beyond = partial(term, fixed={"beyond": 1.0})
    yield beyond("moving_mass", (mass,), (m,))
    clamp = positive("hz", min(80.0, 0.4 / dt), 10.0, 0.45 / dt, 0.2)
    one = mass, clamp, ratio, linear("share", 0.1, 0.05, 1.0, 0.9)
    # A fit finds a low resonance only from a start with high damping.
    resonances = ((30.0, 0.3), (70.0, 0.1), (100.0, 0.05), (140.0, 0.05), (190.0, 0.05))
    yield beyond("moving_mass:on a spring", one, *((m, hz, wide, 0.9) for hz, wide in resonances if hz < highest))
    clamps = positive("hz", 35.0, 8.0, 0.3 / dt, 0.2), positive("hz2", 80.0, 10.0, 0.45 / dt, 0.2)
    two = mass, *clamps, ratio, linear("share2", 0.1, 0.02, 0.98, 0.5)
    pairs = ((30.0, 70.0, 0.2), (35.0, 85.0, 0.07), (40.0, 110.0, 0.05))
    yield beyond("moving_mass:in two clamps", two, *((m, *pair, 0.5) for pair in pairs if pair[1] < highest))


def _mount(s: Sizes) -> Iterator[Term]:
    k, f, x = s.force / s.stroke, s.force, s.stroke
    mount = positive("k", 30 * k, 0.5 * k, 3000 * k)
    yield term("mount_compliance", (mount,), (30 * k,), (200 * k,), (1000 * k,))
    stiff = partial(term, is_other=partial(_is_clearance, f))
    cubic = positive("k3", (30 / x) ** 2, 0.1 / x**2, 1e8 / x**2, 1.0)
    hardened = (20 * k, (20 / x) ** 2), (130 * k, (130 / x) ** 2)
    yield stiff("mount_compliance:hardening", (mount, cubic), *hardened)
    stop = positive("stop", 0.02 * x, 1e-5 * x, 0.5 * x), positive("stiffer", 2.0, 0.2, 10.0)
    stops = (20 * k, 0.03 * x, 2.0), (130 * k, 5e-3 * x, 2.0)
    yield stiff("mount_compliance:with a stop", (mount, *stop), *stops)
    inside = positive("friction", 0.2 * f, 3e-3 * f, 3 * f), positive("slide", 1e-3 * x, 1e-5 * x, 0.1 * x)
    slides = (30 * k, 0.2 * f, 3e-3 * x), (200 * k, 0.2 * f, 1e-3 * x)
    yield term("mount_compliance:with friction inside", (mount, *inside), *slides)
    letting_go = positive("loss", 1.0, 0.05, 20.0), positive("time", 0.03, 1e-3, 1.0)
    yield term("mount_compliance:letting go", (mount, *letting_go), (30 * k, 1.0, 0.03), (200 * k, 1.0, 0.03))
    backlash = positive("gap", 0.03 * x, 2e-4 * x, 0.5 * x), positive("k", 300 * k, 10 * k, 1e4 * k)
    gaps = ((share * x, 300 * k) for share in (0.005, 0.02, 0.06))
    yield term("backlash", backlash, *gaps, is_other=partial(_is_mount, f))


def sensor_terms(size: float, dt: float, place: int | None = None) -> Iterator[Term]:
    """Effects of a force sensor or of a floor's accelerometer. size: RMS of what it measures; dt: sample time (s)."""
    at = partial(term, place=place)
    yield at("sensor_gain", (linear("g", 0.05, 0.2, 5.0, 1.0),), (1.1,))
    f = 0.05 * size
    offset = linear("f", 0.4 * f, -5 * size, 5 * size)
    settling = offset, linear("settle", 0.4 * f, -10 * size, 10 * size), positive("time", 1.0, 0.02, 100.0)
    yield at("sensor_offset", (offset,), (f,))
    yield at("sensor_offset:settling", settling, (f, f, 1.0))
    leakage = positive("tau", 1.0, 0.01, 200.0)
    other = linear("share", 0.1, 0.0, 0.9), positive("tau2", 10.0, 0.05, 1000.0)
    yield at("sensor_leakage", (leakage,), (2.0,), (0.4,), (0.1,))
    yield at("sensor_leakage:two shares", (leakage, *other), (1.0, 0.2, 10.0), (0.2, 0.2, 2.0))
    lag = positive("tau", 2 * dt, 0.1 * dt, 50 * dt)
    yield at("sensor_lag", (lag, positive("tau2", 0.3 * dt, 0.05 * dt, 25 * dt)), (2 * dt, 0.2 * dt), (5 * dt, dt))
    second = lag, positive("ratio", 0.8, 0.3, 0.98, 0.2), positive("tau2", 0.3 * dt, 0.02 * dt, 25 * dt)
    starts = (dt, 0.8, 0.1 * dt), (3 * dt, 0.75, 0.5 * dt), (6 * dt, 0.65, 3 * dt)
    yield at("sensor_lag:second order", second, *starts)


def _motion_terms(dt: float) -> Iterator[Term]:
    """Effects of the displacement channel. dt: sample time (s)."""
    yield term("channel_shift", (linear("d", dt, -25 * dt, 25 * dt),), (2 * dt,), (-2 * dt,))
    yield term("motion_lag", (positive("tau", 2 * dt, 0.1 * dt, 25 * dt),), (2 * dt,))
    # An average that is taken back over a tenth too much fits worse than none: its valley is narrow, with walls.
    starts = ((float(width),) for width in dt * np.geomspace(1.5, 90, 37))
    yield term("motion_lag:average", (positive("width", 10 * dt, dt, 100 * dt),), *starts)


def _is_mount(force: float, settings: Settings) -> bool:
    """True if half of a clearance is less than ELASTIC times what its ends give way by under the RMS force (N)."""
    return 0.5 * settings["backlash_gap"] < ELASTIC * force / settings["backlash_k"]


def _is_clearance(force: float, settings: Settings) -> bool:
    """True if a mount is CLEARANCE times as stiff under the RMS force (N), or at its stop, as without a force."""
    slope = math.sqrt(3 * settings.get("mount_compliance_k3", 0.0)) * force / settings["mount_compliance_k"]
    # d of k d (1 + k3 d^2) = force by the hyperbolic solution of the cubic equation.
    hardening = 4 * math.sinh(math.asinh(1.5 * slope) / 3) ** 2
    return 1 + max(hardening, settings.get("mount_compliance_stiffer", 0.0)) > CLEARANCE


def nominal_coordinates(
    parameters: Settings, command: float, stroke: float, *, one_command: bool = False
) -> tuple[Coordinate, ...]:
    """The nominal parameters, free about their nominal values: range of a factor of 8, prior standard
    deviation of a factor of 1.35.

    An exponent of 1 or 2 is fixed: the hysteresis then has a closed form, which is five times as fast. So is the centre
    of a spring at zero: a preload that the simulator does not have is a cause and no wrong number. one_command: with
    the same command in all records a coefficient is known as a whole only: its part at zero command is free.
    """
    out = []
    for name, value in parameters.items():
        if one_command and name[-1] in "bcer" and parameters.get(f"{name[:-1]}a"):
            continue
        if name in ("command_min", "command_max") or (name, value) in (("n", 1), ("n", 2), ("x0", 0)):
            continue
        if name == "n":
            out.append(Coordinate(name, value, 1.0, 8.0, 0.05, log=True, prior=3.0))
        elif name == "x0":
            out.append(
                Coordinate(name, value, value - 2 * stroke, value + 2 * stroke, 0.1 * stroke, prior=3.0)
            )
        elif value > 0:
            out.append(Coordinate(name, value, value / 8, 8 * value, 0.1, log=True, prior=3.0))
        else:
            size = _size(name, parameters, command)
            out.append(Coordinate(name, value, value - 2 * size, value + 2 * size, 0.1 * size, prior=3.0))
    return tuple(out)


def _size(name: str, parameters: Settings, command: float) -> float:
    """Scale of a parameter that is zero or negative: its absolute value, or that of its partner at the
    largest command."""
    value = abs(parameters[name])
    if name.endswith("b") and name[:-1] + "a" in parameters:
        value = max(value, abs(parameters[name[:-1] + "a"]) / max(command, 1e-9))
    elif name.endswith("a") and name[:-1] + "b" in parameters:
        value = max(value, abs(parameters[name[:-1] + "b"]) * command)
    return value or 1.0


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
