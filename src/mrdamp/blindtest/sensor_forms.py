"""Forms of the effects of the sensors."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mrdamp.blindtest.scale import Form, Scale, Sized


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
    "sensor_gain": ("sensor", (_gain(1), _gain(2))),
    "sensor_offset": ("sensor", (_offset(1), _offset(2))),
    "sensor_leakage": ("sensor", (_leakage(1), _leakage(2))),
    "sensor_lag": ("sensor", (_sensor_lag(1), _sensor_lag(2), _sensor_lag(3))),
    "channel_shift": ("sensor", (_shift, _shift_filter)),
}
