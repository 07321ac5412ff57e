"""Catalogue of a damper: every effect with its coordinates, ranges and starting values, as plugin attributes.

Ranges are scaled by the records (force, stroke, velocity, acceleration, command). If the exact form of an
effect differs between rigs, the attributes of the form are free too: the second pole of a lag, the knee of a
saturation, the presliding distance of friction. A cause is then identified by its behaviour and not by one
equation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from mrdamp.diagnosis.constants import CLEARANCE
from mrdamp.diagnosis.hypotheses.current_effects import current_terms
from mrdamp.diagnosis.hypotheses.fluid_effects import fluid_terms
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Settings, Sizes, Term, linear, positive
from mrdamp.model.core import Array


def damper_terms(s: Sizes) -> tuple[Term, ...]:
    """All effects from driver to sensor, in the order of the chain, in the forms that the sampling of the
    records can show."""
    return tuple(term for term in _terms(s) if term.starts)


def _is_clearance(force: float, settings: Settings) -> bool:
    """True if a mount is CLEARANCE times as stiff under the RMS force (N), or at its stop, as without a force."""
    slope = math.sqrt(3 * settings.get("mount_compliance_k3", 0.0)) * force / settings["mount_compliance_k"]
    # d of k d (1 + k3 d^2) = force by the hyperbolic solution of the cubic equation.
    hardening = 4 * math.sinh(math.asinh(1.5 * slope) / 3) ** 2
    return 1 + max(hardening, settings.get("mount_compliance_stiffer", 0.0)) > CLEARANCE


def _terms(s: Sizes) -> tuple[Term, ...]:
    """All forms; a form whose resonances are above the sampling limit has no starts."""
    k = s.force / s.stroke
    inertia = s.force / s.acceleration
    dt = s.sample_time
    friction = (
        linear("seal_friction_coulomb", 0.03 * s.force, 0.0, 2 * s.force),
        positive("seal_friction_breakaway", 1.2, 1.0, 4.0, 0.3),
        positive("seal_friction_v_s", 0.1 * s.velocity, 1e-3 * s.velocity, 2 * s.velocity),
    )
    mount = positive("mount_compliance_k", 30 * k, 0.5 * k, 3000 * k)
    return (
        *current_terms(s),
        *fluid_terms(s),
        Term(
            "gas_spring",
            "mechanics",
            (
                linear("gas_spring_k", 0.05 * k, -3 * k, 3 * k),
                linear("gas_spring_k2", 0.3 / s.stroke, -3 / s.stroke, 3 / s.stroke),
                linear("gas_spring_k3", 0.3 / s.stroke**2, -5 / s.stroke**2, 50 / s.stroke**2),
                linear("gas_spring_f0", 0.05 * s.force, -2 * s.force, 2 * s.force),
            ),
            (
                (0.1 * k, 0.3 / s.stroke, 0.0, 0.0),
                (0.1 * k, -0.3 / s.stroke, 0.0, 0.0),
                (0.03 * k, 0.0, 3.0 / s.stroke**2, 0.0),
                (0.0, 0.0, 0.0, 0.05 * s.force),
            ),
        ),
        Term(
            "seal_friction",
            "mechanics",
            (
                *friction,
                positive("seal_friction_presliding", 2e-3 * s.stroke, 2e-4 * s.stroke, 0.2 * s.stroke),
            ),
            ((0.08 * s.force, 1.2, 0.1 * s.velocity, 2e-3 * s.stroke),),
        ),
        Term(
            "seal_friction",
            "mechanics",
            (
                *friction,
                positive("seal_friction_width", 0.02 * s.velocity, 1e-3 * s.velocity, 0.5 * s.velocity),
            ),
            ((0.08 * s.force, 1.2, 0.1 * s.velocity, 0.02 * s.velocity),),
            form="slipping at once",
        ),
        *_mass_terms(inertia, dt),
        Term(
            "mount_compliance",
            "mount",
            (mount,),
            ((30 * k,), (200 * k,), (1000 * k,)),
        ),
        Term(
            "mount_compliance",
            "mount",
            (
                mount,
                positive(
                    "mount_compliance_k3", (30 / s.stroke) ** 2, 0.1 / s.stroke**2, 1e8 / s.stroke**2, 1.0
                ),
            ),
            ((20 * k, (20 / s.stroke) ** 2), (130 * k, (130 / s.stroke) ** 2)),
            form="hardening",
            is_other=partial(_is_clearance, s.force),
        ),
        Term(
            "mount_compliance",
            "mount",
            (
                mount,
                positive("mount_compliance_stop", 0.02 * s.stroke, 1e-5 * s.stroke, 0.5 * s.stroke),
                positive("mount_compliance_stiffer", 2.0, 0.2, 10.0),
            ),
            ((20 * k, 0.03 * s.stroke, 2.0), (130 * k, 5e-3 * s.stroke, 2.0)),
            form="with a stop",
            is_other=partial(_is_clearance, s.force),
        ),
        Term(
            "mount_compliance",
            "mount",
            (
                mount,
                positive("mount_compliance_friction", 0.2 * s.force, 3e-3 * s.force, 3 * s.force),
                positive("mount_compliance_slide", 1e-3 * s.stroke, 1e-5 * s.stroke, 0.1 * s.stroke),
            ),
            ((30 * k, 0.2 * s.force, 3e-3 * s.stroke), (200 * k, 0.2 * s.force, 1e-3 * s.stroke)),
            form="with friction inside",
        ),
        Term(
            "mount_compliance",
            "mount",
            (
                mount,
                positive("mount_compliance_loss", 1.0, 0.05, 20.0),
                positive("mount_compliance_time", 0.03, 1e-3, 1.0),
            ),
            ((30 * k, 1.0, 0.03), (200 * k, 1.0, 0.03)),
            form="letting go",
        ),
        Term(
            "backlash",
            "mount",
            (
                positive("backlash_gap", 0.03 * s.stroke, 2e-4 * s.stroke, 0.5 * s.stroke),
                positive("backlash_k", 300 * k, 10 * k, 1e4 * k),
            ),
            ((0.005 * s.stroke, 300 * k), (0.02 * s.stroke, 300 * k), (0.06 * s.stroke, 300 * k)),
        ),
        Term("sensor_gain", "sensor", (linear("sensor_gain_g", 0.05, 0.2, 5.0, 1.0),), ((1.1,),)),
        Term(
            "sensor_offset",
            "sensor",
            (linear("sensor_offset_f", 0.02 * s.force, -2 * s.force, 2 * s.force),),
            ((0.05 * s.force,),),
        ),
        Term(
            "sensor_offset",
            "sensor",
            (
                linear("sensor_offset_f", 0.02 * s.force, -2 * s.force, 2 * s.force),
                linear("sensor_offset_settle", 0.02 * s.force, -4 * s.force, 4 * s.force),
                positive("sensor_offset_time", 1.0, 0.02, 100.0),
            ),
            ((0.05 * s.force, 0.05 * s.force, 1.0),),
            form="settling",
        ),
        Term(
            "sensor_leakage", "sensor", (positive("sensor_leakage_tau", 2.0, 0.02, 200.0),), ((2.0,), (0.3,))
        ),
        Term(
            "sensor_leakage",
            "sensor",
            (
                positive("sensor_leakage_tau", 1.0, 0.02, 200.0),
                linear("sensor_leakage_share", 0.1, 0.0, 0.9),
                positive("sensor_leakage_tau2", 10.0, 0.05, 1000.0),
            ),
            ((1.0, 0.2, 10.0), (0.2, 0.2, 2.0)),
            form="two shares",
        ),
        Term(
            "sensor_lag",
            "sensor",
            (
                positive("sensor_lag_tau", 2 * dt, 0.1 * dt, 50 * dt),
                positive("sensor_lag_tau2", 0.3 * dt, 0.05 * dt, 25 * dt),
            ),
            ((2 * dt, 0.2 * dt), (5 * dt, dt)),
        ),
        Term(
            "sensor_lag",
            "sensor",
            (
                positive("sensor_lag_tau", 2 * dt, 0.1 * dt, 50 * dt),
                positive("sensor_lag_ratio", 0.8, 0.3, 0.98, 0.2),
                positive("sensor_lag_tau2", 0.3 * dt, 0.02 * dt, 25 * dt),
            ),
            ((dt, 0.8, 0.1 * dt), (3 * dt, 0.75, 0.5 * dt), (6 * dt, 0.65, 3 * dt)),
            form="second order",
        ),
        Term(
            "channel_shift",
            "sensor",
            (linear("channel_shift_d", dt, -25 * dt, 25 * dt),),
            ((2 * dt,), (-2 * dt,)),
        ),
    )


def nominal_coordinates(
    law: str, parameters: Settings, command: float, stroke: float
) -> tuple[Coordinate, ...]:
    """The nominal parameters, free about their nominal values: range of a factor of 8, prior standard
    deviation of a factor of 1.35.

    An exponent of 1 or 2 is fixed: the hysteresis then has a closed form, which is five times as fast. So is the centre
    of a spring at zero: a preload that the simulator does not have is a cause and no wrong number.
    """
    out = []
    for name, value in parameters.items():
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


def _mass_terms(inertia: float, dt: float) -> tuple[Term, ...]:
    mass = linear("moving_mass_m", 0.03 * inertia, 0.0, 3 * inertia)
    ratio = positive("moving_mass_ratio", 0.05, 2e-3, 0.9)

    def term(
        coordinates: tuple[Coordinate, ...], starts: tuple[tuple[float, ...], ...], form: str = ""
    ) -> Term:
        # The mass lies beyond the mount, as a fixture does; this matters only with a mount.
        fixed = {"moving_mass_beyond": 1.0}
        return Term("moving_mass", "mechanics", coordinates, starts, form=form, fixed=fixed)

    one = (
        mass,
        positive("moving_mass_hz", min(80.0, 0.4 / dt), 10.0, 0.45 / dt, 0.2),
        ratio,
        linear("moving_mass_share", 0.1, 0.05, 1.0, 0.9),
    )
    # A fit finds a low resonance only from a start with high damping.
    resonances = ((30.0, 0.3), (70.0, 0.1), (100.0, 0.05), (140.0, 0.05), (190.0, 0.05))
    two = (
        mass,
        positive("moving_mass_hz", 35.0, 8.0, 0.3 / dt, 0.2),
        positive("moving_mass_hz2", 80.0, 10.0, 0.45 / dt, 0.2),
        ratio,
        linear("moving_mass_share2", 0.1, 0.02, 0.98, 0.5),
    )
    pairs = ((30.0, 70.0, 0.2), (35.0, 85.0, 0.07), (40.0, 110.0, 0.05))
    highest = 0.4 / dt
    return (
        term((mass,), ((0.1 * inertia,),)),
        term(one, tuple((0.1 * inertia, f, wide, 0.9) for f, wide in resonances if f < highest), "on a spring"),
        term(two, tuple((0.1 * inertia, *pair, 0.5) for pair in pairs if pair[1] < highest), "in two clamps"),
    )


def widened(
    law: tuple[Coordinate, ...], factor: float, which: Callable[[str], bool]
) -> tuple[Coordinate, ...]:
    """Coordinates with wider ranges, by a factor to either side, if they are logarithmic and `which` accepts
    their name."""
    return tuple(
        replace(c, low=c.low / factor, high=c.high * factor) if c.log and which(c.name) else c for c in law
    )


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
