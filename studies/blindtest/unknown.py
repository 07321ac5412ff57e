"""Causes outside the catalogue, each with its stage."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from studies.blindtest.causes import Cause
from studies.blindtest.scale import Form, Scale, Sized


def _bore_wear(r: np.random.Generator, c: Scale) -> Sized:
    x, width = c.stroke * r.uniform(-0.8, 0.8), c.stroke * r.uniform(0.4, 0.8)
    return lambda s: {"wear_loss": 0.8 * s, "wear_x": x, "wear_width": width}


def _relief_valve(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"relief_force": c.force * (0.6 + 0.15 / s)}


def _cavitation(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"cavity_force": c.force * (0.35 + 0.2 / s)}


def _valve_chatter(r: np.random.Generator, c: Scale) -> Sized:
    frequency = r.uniform(18.0, 60.0)
    return lambda s: {"chatter_share": 0.5 * s, "chatter_hz": frequency}


def _settled_particles(r: np.random.Generator, c: Scale) -> Sized:
    path = c.stroke * r.uniform(8, 25)
    return lambda s: {"settle_loss": 0.9 * s, "settle_path": path}


def _unsteady_yield(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"rod.unsteady": 0.4 * s}


def _bent_rod(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"bent_force": 0.9 * c.force / c.stroke * s}


def _end_stop(r: np.random.Generator, c: Scale) -> Sized:
    x = c.stroke * r.uniform(0.9, 1.2)
    return lambda s: {"stop_x": x, "stop_k": 2 * c.force / (0.5 * c.stroke) ** 1.5 * s}


def _dead_zone(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"dead_zone": 0.5 * c.command * s}


def _supply_sag(r: np.random.Generator, c: Scale) -> Sized:
    time = r.uniform(0.5, 2.0)
    return lambda s: {"sag_share": 3 * s / c.command**2, "sag_time": time}


def _dropouts(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"command.dropouts": s}


def _hum(r: np.random.Generator, c: Scale) -> Sized:
    mains = r.choice([50.0, 60.0])
    return lambda s: {"sensor.hum": 0.4 * c.force * s, "sensor.hum_hz": mains}


def _wander(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"sensor.wander": 0.5 * c.force * s}


def _cross_talk(r: np.random.Generator, c: Scale) -> Sized:
    side = r.choice([-1.0, 1.0])
    return lambda s: {"sensor.talk": side * 0.5 * c.force / c.command * s}


def _clock_drift(r: np.random.Generator, c: Scale) -> Sized:
    side = r.choice([-1.0, 1.0])
    return lambda s: {"reading.drift": side * 4e-3 * s}


def _coarse_steps(r: np.random.Generator, c: Scale) -> Sized:
    """A current source with few levels."""
    return lambda s: {"command.step": 0.7 * c.command * s}


def _bias_magnet(r: np.random.Generator, c: Scale) -> Sized:
    """A permanent magnet against the coil: the field decreases up to the current that cancels it."""
    return lambda s: {"bias_current": 0.5 * c.command * s}


def _pole_pull(r: np.random.Generator, c: Scale) -> Sized:
    """The coil attracts the piston to a pole of its housing, with or without motion."""
    side, at, width = r.choice([-1.0, 1.0]), c.stroke * r.uniform(-0.7, 0.7), c.stroke * r.uniform(0.5, 1.2)
    force = side * 3.0 * c.force / c.command**2
    return lambda s: {"pull_force": force * s, "pull_x": at, "pull_width": width}


def _poppet_valve(r: np.random.Generator, c: Scale) -> Sized:
    """A valve that opens at a pressure, releases at half of it, and closes slowly."""
    fixed = {"poppet_force": c.force * r.uniform(1.3, 1.6), "poppet_time": r.uniform(0.3, 0.8)}
    return lambda s: {**fixed, "poppet_share": 0.7 * s}


def _yield_overshoot(r: np.random.Generator, c: Scale) -> Sized:
    """Particle chains with a higher yield force at the start of a stroke, which break along it."""
    path = c.stroke * r.uniform(0.2, 0.6)
    return lambda s: {"peak_gain": 1.5 * s, "peak_path": path}


def _leaking_accumulator(r: np.random.Generator, c: Scale) -> Sized:
    """A spring that relaxes through an orifice."""
    time = r.uniform(0.06, 0.2)
    return lambda s: {"leak_k": 0.8 * c.force / c.stroke * s, "leak_time": time, "leak_length": c.stroke}


def _intermittent_leak(r: np.random.Generator, c: Scale) -> Sized:
    """A piston ring that intermittently loses part of the force."""
    return lambda s: {"rod.leaks": 0.8 * s}


def _transducer_slack(r: np.random.Generator, c: Scale) -> Sized:
    """The displacement transducer's core has play on its rod."""
    return lambda s: {"reading.slack": 0.2 * c.stroke * s}


def _auto_range(r: np.random.Generator, c: Scale) -> Sized:
    """An amplifier with two inconsistent ranges: the coarse one above a level, and for some time after."""
    side, hold = r.choice([-1.0, 1.0]), r.uniform(0.2, 0.8)
    level = c.force * r.uniform(1.2, 1.6)
    return lambda s: {"sensor.range": level, "sensor.range_gain": 0.5 * side * s, "sensor.range_hold": hold}


def _loose_contact(r: np.random.Generator, c: Scale) -> Sized:
    """A contact that opens in bursts while the rod moves fast."""
    return lambda s: {"command.contact": s}


def _coil_drift(r: np.random.Generator, c: Scale) -> Sized:
    """A voltage-driven coil whose resistance differs between records with the room temperature."""
    return lambda s: {"command.drift": 0.6 * s}


def _bypass(r: np.random.Generator, c: Scale) -> Sized:
    """A worn piston seal with a leakage flow proportional to the root of the pressure."""
    speed = r.uniform(0.03, 0.06)
    return lambda s: {"bypass_force": c.force, "bypass_v": speed * s**2}


def _sticking_guide(r: np.random.Generator, c: Scale) -> Sized:
    """A guide bush that binds near one end of the stroke."""
    side, at, width = r.choice([-1.0, 1.0]), c.stroke * r.uniform(-0.2, 0.5), c.stroke * r.uniform(0.2, 0.6)
    fixed = {"rub_side": side, "rub_x": at, "rub_width": width}
    return lambda s: {**fixed, "rub_force": 0.9 * c.force * s}


def _cell_hysteresis(r: np.random.Generator, c: Scale) -> Sized:
    """An overloaded load cell with hysteresis."""
    width = c.force * r.uniform(0.4, 1.0)
    return lambda s: {"sensor.hysteresis": 0.9 * s, "sensor.hysteresis_width": width}


def _clipped_range(r: np.random.Generator, c: Scale) -> Sized:
    """A range too small for the force."""
    return lambda s: {"sensor.clip": c.force * (0.5 + 0.15 / s)}


def _thermal_zero(r: np.random.Generator, c: Scale) -> Sized:
    """A zero that drifts with the cell's temperature, differently in each record."""
    return lambda s: {"sensor.zero": 0.8 * c.force * s}


def _hanging_transmitter(r: np.random.Generator, c: Scale) -> Sized:
    """A transmitter that stops intermittently and repeats its last value."""
    return lambda s: {"sensor.hang": s}


_FIRST: Mapping[str, tuple[str, Form]] = {
    "bore_wear": ("fluid", _bore_wear),
    "relief_valve": ("fluid", _relief_valve),
    "cavitation": ("fluid", _cavitation),
    "valve_chatter": ("fluid", _valve_chatter),
    "settled_particles": ("fluid", _settled_particles),
    "unsteady_yield": ("fluid", _unsteady_yield),
    "bent_rod": ("mechanics", _bent_rod),
    "end_stop": ("mechanics", _end_stop),
    "dead_zone": ("driver", _dead_zone),
    "supply_sag": ("driver", _supply_sag),
    "dropouts": ("driver", _dropouts),
    "hum": ("sensor", _hum),
    "wander": ("sensor", _wander),
    "cross_talk": ("sensor", _cross_talk),
    "clock_drift": ("sensor", _clock_drift),
    "coarse_steps": ("driver", _coarse_steps),
    "bias_magnet": ("magnetics", _bias_magnet),
    "pole_pull": ("magnetics", _pole_pull),
    "poppet_valve": ("fluid", _poppet_valve),
    "yield_overshoot": ("fluid", _yield_overshoot),
    "intermittent_leak": ("fluid", _intermittent_leak),
    "leaking_accumulator": ("mechanics", _leaking_accumulator),
    "transducer_slack": ("sensor", _transducer_slack),
    "auto_range": ("sensor", _auto_range),
}
_SECOND: Mapping[str, tuple[str, Form]] = {
    "loose_contact": ("driver", _loose_contact),
    "coil_drift": ("driver", _coil_drift),
    "bypass": ("fluid", _bypass),
    "sticking_guide": ("mechanics", _sticking_guide),
    "cell_hysteresis": ("sensor", _cell_hysteresis),
    "clipped_range": ("sensor", _clipped_range),
    "thermal_zero": ("sensor", _thermal_zero),
    "hanging_transmitter": ("sensor", _hanging_transmitter),
}
#: Cause -> its stage and form, for a damper.
DAMPER: Mapping[str, tuple[str, Form]] = {**_FIRST, **_SECOND}
#: Two groups, drawn with equal frequency.
GROUPS = (tuple(_FIRST), tuple(_SECOND))


def draw(rng: np.random.Generator, name: str, scale: Scale) -> Cause:
    """A cause outside the catalogue; its label begins with a tilde."""
    stage, form = DAMPER[name]
    return Cause(f"~{name}", stage, form(rng, scale))
