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
from mrdamp.diagnosis.hypotheses.terms import (
    Coordinate,
    Form,
    Settings,
    Sizes,
    Term,
    declared,
    linear,
    positive,
)
from mrdamp.model.core import Array


def damper_terms(s: Sizes) -> tuple[Term, ...]:
    """All effects from driver to sensor, in the order of the chain, in the forms that the sampling of the
    records can show: a form whose resonances are above the sampling limit has no starts."""
    terms = (*current_terms(s), *fluid_terms(s), *_mechanics(s), *_mount(s), *_sensor(s.force, s.sample_time))
    return tuple(term for term in terms if term.starts)


def _mechanics(s: Sizes) -> tuple[Term, ...]:
    k, f, v, stroke = s.force / s.stroke, s.force, s.velocity, s.stroke
    friction = (
        linear("seal_friction_coulomb", 0.03 * f, 0.0, 2 * f),
        positive("seal_friction_breakaway", 1.2, 1.0, 4.0, 0.3),
        positive("seal_friction_v_s", 0.1 * v, 1e-3 * v, 2 * v),
    )
    return (
        *declared(
            "gas_spring",
            Form(
                "",
                (
                    linear("gas_spring_k", 0.05 * k, -3 * k, 3 * k),
                    linear("gas_spring_k2", 0.3 / stroke, -3 / stroke, 3 / stroke),
                    linear("gas_spring_k3", 0.3 / stroke**2, -5 / stroke**2, 50 / stroke**2),
                    linear("gas_spring_f0", 0.05 * f, -2 * f, 2 * f),
                ),
                (
                    (0.1 * k, 0.3 / stroke, 0.0, 0.0),
                    (0.1 * k, -0.3 / stroke, 0.0, 0.0),
                    (0.03 * k, 0.0, 3.0 / stroke**2, 0.0),
                    (0.0, 0.0, 0.0, 0.05 * f),
                ),
            ),
        ),
        *declared(
            "seal_friction",
            Form(
                "",
                (*friction, positive("seal_friction_presliding", 2e-3 * stroke, 2e-4 * stroke, 0.2 * stroke)),
                ((0.08 * f, 1.2, 0.1 * v, 2e-3 * stroke),),
            ),
            Form(
                "slipping at once",
                (*friction, positive("seal_friction_width", 0.02 * v, 1e-3 * v, 0.5 * v)),
                ((0.08 * f, 1.2, 0.1 * v, 0.02 * v),),
            ),
        ),
        *_mass_terms(s.force / s.acceleration, s.sample_time),
    )


def _mount(s: Sizes) -> tuple[Term, ...]:
    k, f, stroke = s.force / s.stroke, s.force, s.stroke
    mount = positive("mount_compliance_k", 30 * k, 0.5 * k, 3000 * k)
    clearance = partial(_is_clearance, f)
    return (
        *declared(
            "mount_compliance",
            Form("", (mount,), ((30 * k,), (200 * k,), (1000 * k,))),
            Form(
                "hardening",
                (
                    mount,
                    positive("mount_compliance_k3", (30 / stroke) ** 2, 0.1 / stroke**2, 1e8 / stroke**2, 1.0),
                ),
                ((20 * k, (20 / stroke) ** 2), (130 * k, (130 / stroke) ** 2)),
                is_other=clearance,
            ),
            Form(
                "with a stop",
                (
                    mount,
                    positive("mount_compliance_stop", 0.02 * stroke, 1e-5 * stroke, 0.5 * stroke),
                    positive("mount_compliance_stiffer", 2.0, 0.2, 10.0),
                ),
                ((20 * k, 0.03 * stroke, 2.0), (130 * k, 5e-3 * stroke, 2.0)),
                is_other=clearance,
            ),
            Form(
                "with friction inside",
                (
                    mount,
                    positive("mount_compliance_friction", 0.2 * f, 3e-3 * f, 3 * f),
                    positive("mount_compliance_slide", 1e-3 * stroke, 1e-5 * stroke, 0.1 * stroke),
                ),
                ((30 * k, 0.2 * f, 3e-3 * stroke), (200 * k, 0.2 * f, 1e-3 * stroke)),
            ),
            Form(
                "letting go",
                (
                    mount,
                    positive("mount_compliance_loss", 1.0, 0.05, 20.0),
                    positive("mount_compliance_time", 0.03, 1e-3, 1.0),
                ),
                ((30 * k, 1.0, 0.03), (200 * k, 1.0, 0.03)),
            ),
        ),
        *declared(
            "backlash",
            Form(
                "",
                (
                    positive("backlash_gap", 0.03 * stroke, 2e-4 * stroke, 0.5 * stroke),
                    positive("backlash_k", 300 * k, 10 * k, 1e4 * k),
                ),
                ((0.005 * stroke, 300 * k), (0.02 * stroke, 300 * k), (0.06 * stroke, 300 * k)),
            ),
        ),
    )


def _sensor(f: float, dt: float) -> tuple[Term, ...]:
    """f: RMS force (N); dt: sample time (s)."""
    offset = linear("sensor_offset_f", 0.02 * f, -2 * f, 2 * f)
    settling = linear("sensor_offset_settle", 0.02 * f, -4 * f, 4 * f)
    tau = positive("sensor_lag_tau", 2 * dt, 0.1 * dt, 50 * dt)
    gain = Form("", (linear("sensor_gain_g", 0.05, 0.2, 5.0, 1.0),), ((1.1,),))
    shift = Form("", (linear("channel_shift_d", dt, -25 * dt, 25 * dt),), ((2 * dt,), (-2 * dt,)))
    return (
        *declared("sensor_gain", gain),
        *declared(
            "sensor_offset",
            Form("", (offset,), ((0.05 * f,),)),
            Form(
                "settling",
                (offset, settling, positive("sensor_offset_time", 1.0, 0.02, 100.0)),
                ((0.05 * f, 0.05 * f, 1.0),),
            ),
        ),
        *declared(
            "sensor_leakage",
            Form("", (positive("sensor_leakage_tau", 2.0, 0.02, 200.0),), ((2.0,), (0.3,))),
            Form(
                "two shares",
                (
                    positive("sensor_leakage_tau", 1.0, 0.02, 200.0),
                    linear("sensor_leakage_share", 0.1, 0.0, 0.9),
                    positive("sensor_leakage_tau2", 10.0, 0.05, 1000.0),
                ),
                ((1.0, 0.2, 10.0), (0.2, 0.2, 2.0)),
            ),
        ),
        *declared(
            "sensor_lag",
            Form(
                "",
                (tau, positive("sensor_lag_tau2", 0.3 * dt, 0.05 * dt, 25 * dt)),
                ((2 * dt, 0.2 * dt), (5 * dt, dt)),
            ),
            Form(
                "second order",
                (
                    tau,
                    positive("sensor_lag_ratio", 0.8, 0.3, 0.98, 0.2),
                    positive("sensor_lag_tau2", 0.3 * dt, 0.02 * dt, 25 * dt),
                ),
                ((dt, 0.8, 0.1 * dt), (3 * dt, 0.75, 0.5 * dt), (6 * dt, 0.65, 3 * dt)),
            ),
        ),
        *declared("channel_shift", shift),
    )


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


def _mass_terms(inertia: float, dt: float) -> tuple[Term, ...]:
    mass = linear("moving_mass_m", 0.03 * inertia, 0.0, 3 * inertia)
    ratio = positive("moving_mass_ratio", 0.05, 2e-3, 0.9)
    # The mass lies beyond the mount, as a fixture does; this matters only with a mount.
    beyond = {"moving_mass_beyond": 1.0}
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
    m, highest = 0.1 * inertia, 0.4 / dt
    return declared(
        "moving_mass",
        Form("", (mass,), ((m,),), beyond),
        Form("on a spring", one, tuple((m, f, wide, 0.9) for f, wide in resonances if f < highest), beyond),
        Form("in two clamps", two, tuple((m, *pair, 0.5) for pair in pairs if pair[1] < highest), beyond),
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
