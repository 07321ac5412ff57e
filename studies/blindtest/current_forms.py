"""Forms of the effects between command and field: driver and magnetics."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from studies.blindtest.scale import Form, Scale, Sized


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
    """A coil with a proportional-integral current controller and a supply voltage with little reserve."""
    gain, reset, spare = r.uniform(0.5, 1.5), r.uniform(0.3, 0.7), r.uniform(1.3, 2.5)
    fixed = {"lag_form": 4, "lag_gain": gain, "lag_span": spare * c.command}
    return lambda s: {**fixed, "lag_tau": 0.06 * s * gain / reset, "lag_tau2": 0.06 * s * gain}


def _lag_diffusion(r: np.random.Generator, c: Scale) -> Sized:
    """A coil around a solid core, with field diffusion and eddy currents."""
    share = r.uniform(0.1, 0.4)
    return lambda s: {"lag_form": 5, "lag_tau": 0.06 * s, "lag_tau2": 0.06 * s * share}


def _delay(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"command.delay": 0.06 * s}


def _delay_network(r: np.random.Generator, c: Scale) -> Sized:
    """A network: each packet has its own delay, in order."""
    spread, beat = r.uniform(0.15, 0.4), r.uniform(0.01, 0.04)
    fixed = {"command.jitter": spread, "command.beat": beat}
    return lambda s: {**fixed, "command.delay": 0.06 * s}


def _saturation(form: int) -> Form:
    return lambda r, c: lambda s: {"sat_form": form, "sat_level": 0.4 * c.command / s}


def _plays(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"rem_form": 1, "rem_width": 0.35 * c.command * s, "rem_share": 1.0}


def _relays(r: np.random.Generator, c: Scale) -> Sized:
    width = 0.2 * c.command
    return lambda s: {"rem_form": 2, "rem_width": width, "rem_share": s, "rem_span": c.command}


def _loop_closes(r: np.random.Generator, c: Scale) -> Sized:
    """A hysteresis loop that is widest at small currents and closes at saturation."""
    fixed = {"rem_form": 3, "rem_share": 1.0, "rem_span": c.command}
    return lambda s: {**fixed, "rem_width": 0.7 * c.command * s}


def _duhem(r: np.random.Generator, c: Scale) -> Sized:
    fixed = {"rem_form": 4, "rem_share": r.uniform(0.1, 0.4)}
    return lambda s: {**fixed, "rem_width": 0.3 * c.command * s}


#: Effect -> its stage and its forms.
EFFECTS: Mapping[str, tuple[str, tuple[Form, ...]]] = {
    "driver_lag": ("driver", (_lag_poles, _lag_limit, _lag_unequal, _lag_controller, _lag_diffusion)),
    "command_delay": ("driver", (_delay, _delay_network)),
    "saturation": ("magnetics", (_saturation(1), _saturation(2), _saturation(3))),
    "remanence": ("magnetics", (_plays, _relays, _loop_closes, _duhem)),
}
