"""Forms of the effects of the sensors."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from studies.blindtest.scale import Form, Scale, Sized


def _settling(r: np.random.Generator, form: int) -> dict[str, float]:
    """For form 2: the amplifier is still warming up at the start of a record."""
    return (
        {"sensor.settle": r.uniform(0.05, 0.15), "sensor.settle_time": r.uniform(1.0, 4.0)}
        if form == 2
        else {}
    )


def _gain(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        side, settling = r.choice([-1.0, 1.0]), _settling(r, form)
        return lambda s: {"sensor.gain": 0.35 * s * side, **settling}

    return draw


def _offset(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        side, settling = r.choice([-1.0, 1.0]), _settling(r, form)
        return lambda s: {"sensor.offset": 0.35 * c.force * s * side, **settling}

    return draw


def _leakage(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        again = r.uniform(4.0, 10.0) if form == 2 else 0.0
        return lambda s: {"sensor.leakage": (0.4 if again else 0.2) / s, "sensor.leakage_again": again}

    return draw


def _sensor_lag(form: int) -> Form:
    return lambda r, c: lambda s: {"sensor.lag": 0.025 * s, "sensor.lag_form": form}


def _shift(r: np.random.Generator, c: Scale) -> Sized:
    side = r.choice([-1.0, 1.0])
    return lambda s: {"reading.shift": 0.02 * s * side}


def _shift_average(r: np.random.Generator, c: Scale) -> Sized:
    """A transducer that averages over some time."""
    return lambda s: {"reading.average": 0.02 * s}


#: Effect -> its stage and its forms.
EFFECTS: Mapping[str, tuple[str, tuple[Form, ...]]] = {
    "sensor_gain": ("sensor", (_gain(1), _gain(2))),
    "sensor_offset": ("sensor", (_offset(1), _offset(2))),
    "sensor_leakage": ("sensor", (_leakage(1), _leakage(2))),
    "sensor_lag": ("sensor", (_sensor_lag(1), _sensor_lag(2), _sensor_lag(3))),
    "channel_shift": ("sensor", (_shift, _shift_average)),
}
