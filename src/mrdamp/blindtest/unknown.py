"""Causes outside the catalogue: what a rig may also have, each with its stage."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mrdamp.blindtest.causes import Cause, Form, Scale, Sized


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
    return lambda s: {"command.dropouts": 0.5 * s}


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


#: Cause -> its stage and form, for a damper.
DAMPER: Mapping[str, tuple[str, Form]] = {
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
}


def draw(rng: np.random.Generator, name: str, scale: Scale) -> Cause:
    """A cause outside the catalogue; its label begins with a tilde."""
    stage, form = DAMPER[name]
    return Cause(f"~{name}", stage, form(rng, scale))
