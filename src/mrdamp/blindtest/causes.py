"""Causes of the damper: each effect of the catalogue in the rig's own forms, at least two where that makes sense.

A form is a function of the scale of the case: it draws what is random about it and returns how its numbers follow
from one size, from 0 (neutral) to 1 (as strong as a rig would have it). Names with `sensor.`, `command.`,
`reading.` and `rod.` are the bench's (`bench.py`); all others are the rig's own (`rig.c`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mrdamp.blindtest.rig import Numbers

#: Numbers of the truth for a size.
Sized = Callable[[float], dict[str, float]]


@dataclass(frozen=True)
class Scale:
    """What sizes are measured by: RMS force (N), power (W), RMS stroke (m), acceleration (m/s2), largest command, and
    the mass of a piston behind a mount (kg), as light as the steps of the rig allow."""

    force: float
    power: float
    stroke: float
    acceleration: float
    command: float
    piston: float = 0.1


Form = Callable[[np.random.Generator, Scale], Sized]


@dataclass(frozen=True)
class Cause:
    """A cause as a label names it, with the stage that it sits in."""

    label: str
    stage: str
    sized: Sized


def _lag_poles(r: np.random.Generator, c: Scale) -> Sized:
    share = r.uniform(0.2, 1.0)
    return lambda s: {"lag_form": 1, "lag_tau": 0.05 * s, "lag_tau2": 0.05 * s * share}


def _lag_limit(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"lag_form": 2, "lag_tau": 0.02 * s, "lag_rate": c.command / (0.25 * s)}


def _lag_unequal(r: np.random.Generator, c: Scale) -> Sized:
    ratio = r.choice([0.4, 0.6, 1.6, 2.5])
    span = c.command
    return lambda s: {"lag_form": 3, "lag_tau": 0.05 * s, "lag_tau2": 0.05 * s * ratio, "lag_span": span}


def _delay(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"command.delay": 0.06 * s}


def _delay_held(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"command.delay": 0.05 * s, "command.period": 0.03 * s}


def _saturation(form: int) -> Form:
    return lambda r, c: lambda s: {"sat_form": form, "sat_level": 0.4 * c.command / s}


def _plays(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"rem_form": 1, "rem_width": 0.35 * c.command * s, "rem_share": 1.0}


def _relays(r: np.random.Generator, c: Scale) -> Sized:
    width = 0.2 * c.command
    return lambda s: {"rem_form": 2, "rem_width": width, "rem_share": s, "rem_span": c.command}


def _heat_arrhenius(r: np.random.Generator, c: Scale) -> Sized:
    # a rise of about 30 K in half a minute, less what the body takes
    fluid, body = c.power * r.uniform(0.2, 0.4), c.power * r.uniform(0.6, 1.2)
    return lambda s: {
        "heat_form": 1,
        "heat_capacity": fluid,
        "heat_body": body,
        "heat_link": c.power / 8,
        "heat_loss": body / 200,
        "heat_visc": 12_000 * s,
        "heat_yield": 0.015 * s,
    }


def _heat_rational(r: np.random.Generator, c: Scale) -> Sized:
    capacity = c.power * r.uniform(0.6, 1.1)
    return lambda s: {
        "heat_form": 2,
        "heat_capacity": capacity,
        "heat_loss": capacity / 90,
        "heat_visc": 0.2 * s,
        "heat_yield": 0.015 * s,
    }


def _asymmetry(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        side = r.choice([-1.0, 1.0])
        width = c.force * r.uniform(0.05, 0.3)
        return lambda s: {"asym_form": form, "asym_share": 0.35 * s * side, "asym_width": width}

    return draw


def _thin_cross(r: np.random.Generator, c: Scale) -> Sized:
    m = r.uniform(0.8, 1.3)
    return lambda s: {"thin_form": 1, "thin_v": 0.02 / s, "thin_m": m}


def _thin_eyring(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"thin_form": 2, "thin_v": 0.008 / s}


def _gas(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        side, stroke = r.choice([-1.0, 1.0]), c.stroke * r.uniform(0.15, 0.45) * form
        return lambda s: {"gas_form": form, "gas_sign": side, "gas_stroke": stroke, "gas_loss": s**0.5}

    return draw


def _spring_polytropic(r: np.random.Generator, c: Scale) -> Sized:
    length = c.stroke * r.uniform(4.0, 6.0)
    return lambda s: {"spring_form": 1, "spring_f0": 0.4 * c.force * s, "spring_length": length}


def _spring_power(r: np.random.Generator, c: Scale) -> Sized:
    k, end, power = r.uniform(0.1, 0.3) * c.force / c.stroke, r.uniform(0.05, 0.12) * c.force, r.uniform(2.0, 4.0)
    f0, fixed = r.uniform(0.0, 0.3) * c.force, {"spring_form": 2, "spring_length": c.stroke, "spring_power": power}
    return lambda s: {**fixed, "spring_f0": f0 * s, "spring_k": k * s, "spring_end": end * s}


def _seal(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        fixed = {
            "seal_form": form,
            "seal_static": r.uniform(1.1, 1.7),
            "seal_v": r.uniform(0.002, 0.01),
            "seal_slide": r.uniform(15e-6, 60e-6) * (2 if form == 2 else 1),
        }
        return lambda s: {**fixed, "seal_coulomb": 0.4 * c.force * s}

    return draw


def _mass(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        spring = r.uniform(70.0, 140.0) if form == 2 else 0.0
        return lambda s: {"rod.mass": 0.5 * c.force / c.acceleration * s, "rod.mass_hz": spring}

    return draw


def _mount(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        power = r.uniform(1.0, 2.5)
        fixed = {"mount_form": form, "mount_c": 0.2 * c.force, "mount_mass": c.piston, "mount_power": power}

        def sized(s: float) -> dict[str, float]:
            k = c.force / (0.5 * c.stroke * s)
            return {**fixed, "mount_k": k, "mount_scale": 1.5 * c.force / k}

        return sized

    return draw


def _play(form: int) -> Form:
    """A pin with clearance: at the RMS force it is pressed in by 10 um (form 3) or, by Hertz's law, 15 um (form 4)."""

    def draw(r: np.random.Generator, c: Scale) -> Sized:
        k = c.force / 1e-5 if form == 3 else c.force / 1.5e-5**1.5
        fixed = {"mount_form": form, "mount_k": k, "mount_c": 0.3 * c.force if form == 3 else 1.0}
        return lambda s: {**fixed, "mount_gap": 0.5 * c.stroke * s, "mount_mass": c.piston}

    return draw


def _gain(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        side, bend = r.choice([-1.0, 1.0]), (0.02 * r.choice([-1.0, 1.0]) if form == 2 else 0.0)
        return lambda s: {
            "sensor.gain": 0.35 * s * side,
            "sensor.bend": bend * s,
            "sensor.scale": 2 * c.force,
        }

    return draw


def _offset(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        side, wander = r.choice([-1.0, 1.0]), (0.1 if form == 2 else 0.0)
        return lambda s: {"sensor.offset": 0.35 * c.force * s * side, "sensor.offset_wander": wander}

    return draw


def _leakage(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        slow = r.uniform(0.2, 0.4) if form == 2 else 0.0
        return lambda s: {"sensor.leakage": 0.2 / s, "sensor.leakage_slow": slow}

    return draw


def _sensor_lag(form: int) -> Form:
    return lambda r, c: lambda s: {"sensor.lag": 0.025 * s, "sensor.lag_form": form}


def _shift(r: np.random.Generator, c: Scale) -> Sized:
    side = r.choice([-1.0, 1.0])
    return lambda s: {"reading.shift": 0.02 * s * side}


def _shift_filter(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"reading.bessel": 0.02 * s}


#: Effect -> its stage and its forms.
EFFECTS: Mapping[str, tuple[str, tuple[Form, ...]]] = {
    "driver_lag": ("driver", (_lag_poles, _lag_limit, _lag_unequal)),
    "command_delay": ("driver", (_delay, _delay_held)),
    "saturation": ("magnetics", (_saturation(1), _saturation(2), _saturation(3))),
    "remanence": ("magnetics", (_plays, _relays)),
    "heating": ("fluid", (_heat_arrhenius, _heat_rational)),
    "asymmetry": ("fluid", (_asymmetry(1), _asymmetry(2))),
    "shear_thinning": ("fluid", (_thin_cross, _thin_eyring)),
    "trapped_gas": ("fluid", (_gas(1), _gas(2))),
    "gas_spring": ("mechanics", (_spring_polytropic, _spring_power)),
    "seal_friction": ("mechanics", (_seal(1), _seal(2), _seal(3))),
    "moving_mass": ("mechanics", (_mass(1), _mass(2))),
    "mount_compliance": ("mount", (_mount(1), _mount(2))),
    "backlash": ("mount", (_play(3), _play(4))),
    "sensor_gain": ("sensor", (_gain(1), _gain(2))),
    "sensor_offset": ("sensor", (_offset(1), _offset(2))),
    "sensor_leakage": ("sensor", (_leakage(1), _leakage(2))),
    "sensor_lag": ("sensor", (_sensor_lag(1), _sensor_lag(2), _sensor_lag(3))),
    "channel_shift": ("sensor", (_shift, _shift_filter)),
}


def draw(rng: np.random.Generator, effect: str, scale: Scale) -> Cause:
    """An effect in one of its forms."""
    stage, forms = EFFECTS[effect]
    return Cause(effect, stage, forms[int(rng.integers(len(forms)))](rng, scale))


def merged(parts: list[Numbers]) -> dict[str, float]:
    """Numbers of several causes; none of them sets another's."""
    out: dict[str, float] = {}
    for part in parts:
        if out.keys() & part.keys():
            raise ValueError(f"two causes set {sorted(out.keys() & part.keys())}")
        out |= part
    return out
