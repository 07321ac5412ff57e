"""Forms of the effects between command and field: driver and magnetics."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mrdamp.blindtest.scale import Form, Scale, Sized


def _lag_poles(r: np.random.Generator, c: Scale) -> Sized:
    share = r.uniform(0.2, 1.0)
    return lambda s: {"lag_form": 1, "lag_tau": 0.05 * s, "lag_tau2": 0.05 * s * share}


def _lag_limit(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"lag_form": 2, "lag_tau": 0.02 * s, "lag_rate": c.command / (0.25 * s)}


def _lag_unequal(r: np.random.Generator, c: Scale) -> Sized:
    ratio = r.choice([0.4, 0.6, 1.6, 2.5])
    span = c.command
    return lambda s: {"lag_form": 3, "lag_tau": 0.05 * s, "lag_tau2": 0.05 * s * ratio, "lag_span": span}


def _lag_controller(r: np.random.Generator, c: Scale) -> Sized:
    """A coil under an integral current controller that overshoots a little."""
    ratio = r.uniform(0.4, 0.75)
    return lambda s: {"lag_form": 4, "lag_tau": 0.07 * s, "lag_ratio": ratio}


def _lag_eddies(r: np.random.Generator, c: Scale) -> Sized:
    """A coil coupled to the eddy currents of its core: part of the field comes soon, part late."""
    share, ratio = r.uniform(0.35, 0.6), r.uniform(5.0, 9.0)
    return lambda s: {"lag_form": 5, "lag_tau": 0.018 * s, "lag_tau2": 0.018 * s * ratio, "lag_ratio": share}


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


def _pinning(r: np.random.Generator, c: Scale) -> Sized:
    fixed = {"rem_form": 3, "rem_share": r.uniform(0.75, 0.95), "rem_span": c.command}
    return lambda s: {**fixed, "rem_width": 0.35 * c.command * s}


def _plays_widening(r: np.random.Generator, c: Scale) -> Sized:
    fixed = {"rem_form": 4, "rem_share": 1.0, "rem_span": c.command}
    return lambda s: {**fixed, "rem_width": 0.5 * c.command * s}


#: Effect -> its stage and its forms.
EFFECTS: Mapping[str, tuple[str, tuple[Form, ...]]] = {
    "driver_lag": ("driver", (_lag_poles, _lag_limit, _lag_unequal, _lag_controller, _lag_eddies)),
    "command_delay": ("driver", (_delay, _delay_held)),
    "saturation": ("magnetics", (_saturation(1), _saturation(2), _saturation(3))),
    "remanence": ("magnetics", (_plays, _relays, _pinning, _plays_widening)),
}
