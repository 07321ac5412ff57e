"""Causes outside the catalogue (rivals), with which its effects are compared before one is named.

Each acts outside the chain, on the command before it or on the force after it; the plugin has no attribute
for them. If a rival explains the gap better than the catalogue's effects, it is no correction of the
simulator. The answer is then `unknown`, with the rival as a hint. The list contains common faults and cannot
be complete.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from mrdamp.diagnosis.hypotheses.terms import Settings, Sizes, Term, linear, positive, term
from mrdamp.model.core import Array
from mrdamp.records.sampling import memory

#: Prefix of the settings' names.
PREFIX = "outside_"

#: Description of each cause.
PLAIN: Mapping[str, str] = {
    "supply_sag": "a supply that sinks under a lasting command",
    "command_threshold": "a command that does nothing below a threshold",
    "end_stop": "an end stop inside the stroke",
    "force_limit": "a valve or a cavity that limits the force",
    "worn_bore": "a bore that is worn at one place",
    "side_load": "friction that grows with the distance from a position",
    "cross_talk": "the command in the reading of the force",
    "clock_drift": "two clocks that run apart, of the displacement and of the force",
    "settled_particles": "particles that have settled and are stirred up by the motion",
    "storey_crack": "a crack that opens and closes",
    "storey_yield": "a spring that yields",
    "storey_hardening": "a spring that hardens or softens with the drift",
    "foundation": "a foundation",  # with its form
    "ground_delay": "a ground acceleration that is recorded late or early",
}


def plain(one: Term) -> str:
    """Description of a rival, with its storey."""
    words = f"{PLAIN[one.effect]} {one.form}" if one.effect == "foundation" else PLAIN[one.effect]
    return words + ("" if one.place is None else f" in storey {one.place}")


#: A term with the names of its settings after the prefix.
rival = partial(term, prefix=PREFIX)


def command_rivals(s: Sizes) -> Iterator[Term]:
    """Rivals that act on the command, for any rig."""
    c = s.command
    sag = (
        linear("sag_share", 0.1, 0.0, 0.95),
        positive("sag_time", 0.5, 0.2, 20.0),
        positive("sag_power", 2.0, 0.5, 5.0),
    )
    yield rival("supply_sag", sag, (0.2, 0.4, 2.0), (0.2, 3.0, 2.0), stage="driver", fixed={"sag_command": c})
    threshold = positive("threshold", 0.1 * c, 5e-3 * c, 0.7 * c)
    yield rival("command_threshold", (threshold,), (0.05 * c,), (0.2 * c,), stage="driver")


def force_rivals(s: Sizes) -> Iterator[Term]:
    """Rivals that act on the force, for an imposed motion."""
    k, f, x = s.force / s.stroke, s.force, s.stroke
    stop = linear("stop_k", 0.5 * k, 0.0, 300 * k), linear("stop_x", 0.1 * x, 0.4 * x, x, 0.7 * x)
    stops = (0.5 * k, 0.6 * x), (3.0 * k, 0.85 * x)
    limit = positive("limit_force", f, 0.2 * f, 5 * f), positive("limit_knee", 6.0, 2.0, 30.0)
    limits = (1.3 * f, 6.0), (0.8 * f, 6.0)
    for form, side in (("extension", 1.0), ("compression", -1.0), ("both", 0.0)):
        yield rival(f"end_stop:{form}", stop, *stops, stage="mechanics", fixed={"stop_side": side})
        yield rival(f"force_limit:{form}", limit, *limits, stage="fluid", fixed={"limit_side": side})
    wear = (
        linear("wear_loss", 0.1, -0.9, 0.9),
        linear("wear_x", 0.3 * x, -x, x),
        positive("wear_width", 0.4 * x, 0.05 * x, 2 * x),
    )
    yield rival("worn_bore", wear, *((0.2, at * x, 0.4 * x) for at in (-0.5, 0.0, 0.5)), stage="fluid")
    load = linear("side_force", 0.1 * k, 0.0, 20 * k), linear("side_x", 0.3 * x, -x, x)
    yield rival("side_load", load, (0.2 * k, 0.0), stage="mechanics", fixed={"side_v": 0.03 * s.velocity})
    settled = linear("settled_loss", 0.1, 0.0, 0.95), positive("settled_path", 5 * x, 0.3 * x, 300 * x)
    yield rival("settled_particles", settled, (0.2, 3 * x), (0.2, 20 * x), stage="fluid")
    # Started together: with a shift of its own it would contain the catalogue's channel_shift.
    clock = linear("clock_rate", 5e-4, -0.02, 0.02)
    yield rival("clock_drift", (clock,), (1e-3,), (-1e-3,), stage="sensor")
    heard = f / s.command
    yield rival("cross_talk", (linear("talk", 0.05 * heard, -4 * heard, 4 * heard),), (0.1 * heard,), stage="sensor")


def grouped(settings: Sequence[Settings]) -> list[tuple[Settings, list[int]]]:
    """Groups of settings with equal values outside the chain: these values, and the numbers of the sets."""
    groups: dict[tuple[tuple[str, float], ...], list[int]] = {}
    for k, one in enumerate(settings):
        own = tuple(sorted((name, value) for name, value in one.items() if name.startswith(PREFIX)))
        groups.setdefault(own, []).append(k)
    return [(dict(own), rows) for own, rows in groups.items()]


def inside_of(settings: Mapping[str, float]) -> Settings:
    """The settings of the chain."""
    return {k: v for k, v in settings.items() if not k.startswith(PREFIX)}


def commanded(settings: Mapping[str, float], command: Array, sample_time: float) -> Array:
    """The command (n,) at the driver of a rig with a rival."""
    out = command
    if "outside_sag_share" in settings:
        # A test starts from rest: the supply has not sagged yet.
        load = np.concatenate(
            [[0.0], np.abs(command / settings["outside_sag_command"]) ** settings["outside_sag_power"]]
        )
        sunk = memory(load, sample_time, settings["outside_sag_time"])[1:]
        out = out * (1 - settings["outside_sag_share"] * sunk)
    if "outside_threshold" in settings:
        out = np.sign(out) * np.maximum(np.abs(out) - settings["outside_threshold"], 0.0)
    return out


def forced(settings: Mapping[str, float], force: Array, x: Array, v: Array) -> Array:
    """The force (..., n) of a rig with a rival, from the chain's force and the motion x (m), v (m/s), (n,)
    each."""
    out = force
    if "outside_settled_loss" in settings:
        path = np.cumsum(np.abs(np.diff(x, prepend=x[0])))
        out = out * (1 - settings["outside_settled_loss"] * np.exp(-path / settings["outside_settled_path"]))
    if "outside_stop_k" in settings:
        beyond = _one_side(x, settings["outside_stop_side"]) - settings["outside_stop_x"]
        out = out + settings["outside_stop_k"] * np.sign(x) * np.maximum(beyond, 0.0)
    if "outside_limit_force" in settings:
        knee = settings["outside_limit_knee"]
        load = (
            np.maximum(_one_side(out, settings["outside_limit_side"]), 0.0) / settings["outside_limit_force"]
        )
        out = out / (1 + load**knee) ** (1 / knee)
    if "outside_wear_loss" in settings:
        off = (x - settings["outside_wear_x"]) / settings["outside_wear_width"]
        out = out * (1 - settings["outside_wear_loss"] * np.exp(-(off**2)))
    if "outside_side_force" in settings:
        away = np.abs(x - settings["outside_side_x"])
        out = out + settings["outside_side_force"] * away * np.tanh(v / settings["outside_side_v"])
    return out


def moved(settings: Mapping[str, float], channels: Sequence[Array], sample_time: float) -> tuple[Array, ...]:
    """Channels (n,) of the motion at the damper of a rig with a rival, from those that the transducer recorded."""
    if "outside_clock_rate" not in settings:
        return tuple(channels)
    t = sample_time * np.arange(len(channels[0]))
    read_at = (1 + settings["outside_clock_rate"]) * t
    return tuple(np.interp(read_at, t, values) for values in channels)


def read(settings: Mapping[str, float], name: str, force: Array, command: Array) -> Array:
    """Column `name` (..., n) of a rig with a rival, from its force and command: the damper's own sensor may
    have crosstalk."""
    talk = settings.get("outside_talk", 0.0) if name == "force" else 0.0
    return force + talk * command


def _one_side(values: Array, side: float) -> Array:
    return np.abs(values) if side == 0 else side * values
