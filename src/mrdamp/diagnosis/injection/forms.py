"""Effects that can be inserted exactly into measured records. No law is simulated, so that the base remains
the rig's own.

Four methods are exact:

- a force that depends on the motion alone is added;
- a reading is filtered, scaled or delayed;
- the rod's displacement is computed from the piston's and the force between them (`x + F / k`);
- the logged command is replaced by the one that a saturated, delayed or hysteretic circuit would have needed
  for the actual current.

The forms differ from the simulator's own if possible; the same forms would be an inverse crime.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import bessel, cont2discrete, lfilter

from mrdamp.diagnosis.injection.signals import FORCES, Scales, Signals
from mrdamp.model import Model
from mrdamp.model.attributes import effects
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.smoothing import smoothed

Parameters = Mapping[str, float]
Put = Callable[[Signals, Parameters, Scales], Record]
#: From random numbers and a strength (about the effect's share of the force) to the effect's parameters. The numbers
#: are the same at every strength.
Draw = Callable[[np.random.Generator, Scales, Model, float], dict[str, float]]


@dataclass(frozen=True)
class Form:
    """An effect in one exact form: how its parameters are drawn at a strength, and how it is
    inserted.

    varies: requires a command that varies within a record. levels: least number of command levels.
    """

    effect: str
    draw: Draw
    put: Put
    varies: bool = False
    levels: int = 0

    @property
    def stage(self) -> str:
        return effects()[self.effect].stage


_FORMS: dict[str, Form] = {}


def _form(effect: str, draw: Draw, *, varies: bool = False, levels: int = 0) -> Callable[[Put], Put]:
    """Declares the form of an effect that a function puts into a record."""

    def declared(put: Put) -> Put:
        _FORMS[effect] = Form(effect, draw, put, varies, levels)
        return put

    return declared


def _changed(s: Signals, change: Callable[[Array], Array], channels: Sequence[str]) -> Record:
    """The record with changed channels, those of them that it has."""
    found = {c: change(np.asarray(s.record.channel(c))) for c in channels if c in s.record.channels}
    return s.record.with_channels(found)


def _added(s: Signals, force: Array) -> Record:
    """Adds a force (n,) on the rod, which every force sensor reads."""
    return _changed(s, lambda f: f + force, FORCES)


def _read(s: Signals, change: Callable[[Array], Array]) -> Record:
    """Changes the reading of the damper's own sensor; a separate load cell is unchanged."""
    return _changed(s, change, FORCES[:1])


def _side(r: np.random.Generator) -> float:
    return float(r.choice([-1.0, 1.0]))


# --- forces added ------------------------------------------------------------------------------------------------


def _draw_spring(r: np.random.Generator, c: Scales, _: Model, s: float) -> dict[str, float]:
    length, exponent = c.stroke * r.uniform(2.5, 5.0), r.uniform(1.0, 1.4)
    return {"f0": c.force * s * length / c.stroke, "length": length, "exponent": exponent}


@_form("gas_spring", _draw_spring)
def _spring(s: Signals, p: Parameters, _: Scales) -> Record:
    """Polytropic accumulator without its preload."""
    squeezed = np.maximum(1 + s.x / p["length"], 0.2)
    return _added(s, p["f0"] * (1 - squeezed ** -p["exponent"]))


@_form(
    "seal_friction",
    lambda r, c, _, s: {
        "coulomb": c.force * s,
        "presliding": c.stroke * float(np.exp(r.uniform(np.log(3e-3), np.log(0.02)))),
        "breakaway": r.uniform(1.0, 1.6),
        "stribeck": c.velocity * r.uniform(0.05, 0.3),
    },
)
def _friction(s: Signals, p: Parameters, _: Scales) -> Record:
    """LuGre bristle (Canudas de Wit et al. 1995, 10.1109/9.376053): exact over each sample's path at constant
    level."""
    v = 0.5 * (s.v[1:] + s.v[:-1])
    level = 1 + (p["breakaway"] - 1) * np.exp(-((v / p["stribeck"]) ** 2))  # relative to the Coulomb force
    path = v * s.record.sample_time / p["presliding"]
    kept = np.exp(-np.abs(path) / level)
    bristle = np.zeros(len(s.v))
    for k in range(len(v)):
        end = level[k] * np.sign(path[k])
        bristle[k + 1] = end + (bristle[k] - end) * kept[k]
    return _added(s, p["coulomb"] * bristle)


@_form("moving_mass", lambda r, c, _, s: {"m": s * c.force / c.acceleration})
def _mass(s: Signals, p: Parameters, _: Scales) -> Record:
    return _added(s, p["m"] * s.a)


@_form(
    "shear_thinning",
    lambda r, c, model, s: {
        "m": r.uniform(0.2, 0.6),
        "v_s": 0.3 * c.velocity / s,
        **{name: model.parameters.get(name, 0.0) for name in ("c0a", "c0b", "c0c")},
    },
)
def _thinning(s: Signals, p: Parameters, _: Scales) -> Record:
    """Difference between Cross's fluid and the simulator's dashpot, which is parallel to the rest in these
    laws."""
    u = np.asarray(s.record.command)
    dashpot = np.maximum(p["c0a"] + p["c0b"] * u + p["c0c"] * u**2, 0.0) * s.v
    return _added(s, dashpot * (1 / (1 + np.abs(s.v / p["v_s"]) ** (1 - p["m"])) - 1))


# --- factors of the fluid's force --------------------------------------------------------------------------------


def _scaled(s: Signals, factor: Array, c: Scales) -> Record:
    """The fluid's force times a factor (n,); preload and seal friction are unchanged."""
    return _changed(s, lambda f: c.preload + (f - c.preload) * factor, FORCES)


@_form(
    "asymmetry",
    lambda r, c, _, s: {"a": _side(r) * min(s, 0.8), "width": c.velocity * r.uniform(0.02, 0.2)},
)
def _asymmetry(s: Signals, p: Parameters, c: Scales) -> Record:
    return _scaled(s, 1 + p["a"] * s.v / np.hypot(s.v, p["width"]), c)


def _draw_gas(r: np.random.Generator, c: Scales, _: Model, s: float) -> dict[str, float]:
    side, length = _side(r), c.stroke * r.uniform(0.15, 0.5)
    return {"d": min(1.5 * s, 0.95), "length": length, "direction": side, "width": c.velocity * 0.05}


@_form("trapped_gas", _draw_gas)
def _gas(s: Signals, p: Parameters, c: Scales) -> Record:
    """Force lost at the start of a stroke in one direction, as a function of the path since the reversal."""
    path = since_turn(s.x, 0.01 * c.stroke)
    side = 0.5 * (1 + np.tanh(p["direction"] * s.v / p["width"]))
    return _scaled(s, 1 - p["d"] * side / (1 + (path / p["length"]) ** 2) ** 2, c)


def since_turn(x: Array, least: float) -> Array:
    """Path (n,) since the last reversal of a motion x (n,) in m. Reversals of less than `least` are ignored.
    """
    turns, extreme, direction = [0], 0, 0.0
    for k in range(len(x)):
        back = direction * (x[extreme] - x[k])
        if direction == 0.0:
            if abs(x[k] - x[0]) > least:
                direction, extreme = float(np.sign(x[k] - x[0])), k
        elif back < 0:
            extreme = k
        elif back > least:
            turns.append(extreme)
            direction, extreme = -direction, k
    last = np.repeat(turns, np.diff([*turns, len(x)]))
    return np.asarray(np.abs(x - x[last]))


# --- displacement of the machine ------------------------------------------------------------------------------------


def _moved(record: Record, x: Array) -> Record:
    """Another displacement (n,) in m, without measured derivatives, which would contradict it."""
    old = ("velocity_m_s", "acceleration_m_s2")
    kept = {n: c for n, c in record.channels.items() if n not in old}
    return Record(record.name, record.path, record.sample_time, {**kept, "displacement_m": x}, record.ignored)


@_form(
    "mount_compliance",
    lambda r, c, _, s: {
        "k": c.force / (0.3 * s * c.stroke),
        "hardening": float(c.force * r.choice([1e3, 1.0, 2.0])),
    },
)
def _mount(s: Signals, p: Parameters, _: Scales) -> Record:
    """The rod leads the piston by the mount's deflection, whose rate increases with the force."""
    stretch = p["hardening"] / p["k"] * np.arcsinh(s.force / p["hardening"])
    return _moved(s.record, np.asarray(s.record.displacement) + stretch)


@_form("backlash", lambda r, c, _, s: {"gap": 0.4 * s * c.stroke, "contact": c.force * r.uniform(0.02, 0.08)})
def _backlash(s: Signals, p: Parameters, _: Scales) -> Record:
    """The pin lies on the side to which the force presses it. contact: N, over which it changes sides."""
    pin = 0.5 * p["gap"] * s.force / np.hypot(s.force, p["contact"])
    return _moved(s.record, np.asarray(s.record.displacement) + pin)


@_form("channel_shift", lambda r, c, _, s: {"d": _side(r) * s * 0.2 * c.stroke / c.velocity})
def _shift(s: Signals, p: Parameters, _: Scales) -> Record:
    """The displacement delayed by d; samples that would lie outside the record are left out."""
    record, lost = s.record, int(np.ceil(abs(p["d"]) / s.record.sample_time))
    spline = CubicSpline(record.time, record.displacement)
    moved = _moved(record, spline(record.time - p["d"]))
    keep = slice(lost, None) if p["d"] > 0 else slice(None, record.n - lost)
    return moved.part(record.time[keep][0], record.time[keep][-1])


@_form("motion_lag", lambda r, c, _, s: {"width": float(s * 0.6 * c.stroke / c.velocity * r.uniform(0.8, 1.2))})
def _averaged(s: Signals, p: Parameters, _: Scales) -> Record:
    """A moving average of the path between the samples over width, at the ends over what there is on both sides."""
    record = s.record
    path = CubicSpline(record.time, record.displacement).antiderivative()
    inside = np.minimum(record.time - record.time[0], record.time[-1] - record.time)
    half = np.minimum(p["width"] / 2, inside)
    some = half > 0
    mean = (path(record.time + half) - path(record.time - half)) / np.where(some, 2 * half, 1.0)
    return _moved(record, np.where(some, mean, record.displacement))


# --- force sensor ---------------------------------------------------------------------------------------------------


@_form("sensor_gain", lambda r, c, _, s: {"g": (1 + s) ** _side(r)})
def _gain(s: Signals, p: Parameters, _: Scales) -> Record:
    return _read(s, lambda f: p["g"] * f)


@_form("sensor_offset", lambda r, c, _, s: {"f": _side(r) * s * c.force})
def _offset(s: Signals, p: Parameters, _: Scales) -> Record:
    return _read(s, lambda f: f + p["f"])


@_form("sensor_leakage", lambda r, c, _, s: {"tau": 0.5 * c.stroke / c.velocity / s})
def _leakage(s: Signals, p: Parameters, _: Scales) -> Record:
    """High-pass of the charge, exact for a force that is linear between samples."""

    def change(f: Array) -> Array:
        decay = np.exp(-s.record.sample_time / p["tau"])
        gain = p["tau"] / s.record.sample_time * (1 - decay)
        return np.asarray(lfilter([gain, -gain], [1.0, -decay], f, zi=np.array([(1 - gain) * f[0]]))[0])

    return _read(s, change)


@_form(
    "sensor_lag",
    lambda r, c, _, s: {"tau": 0.2 * s * c.stroke / c.velocity, "order": float(r.choice([1, 2, 3]))},
)
def _lag(s: Signals, p: Parameters, _: Scales) -> Record:
    """Bessel low-pass of group delay tau, from rest at the first reading; first-order hold between samples.
    """

    def change(f: Array) -> Array:
        b, a = bessel(int(p["order"]), 1 / p["tau"], analog=True, norm="delay")
        num, den, _dt = cont2discrete((b, a), s.record.sample_time, method="foh")
        return np.asarray(f[0] + lfilter(np.ravel(num), den, f - f[0]))

    return _read(s, change)


# --- logged command -------------------------------------------------------------------------------------------------


def _sent(s: Signals, command: Array) -> Record:
    """Another command if the coil's current follows it and the field does not: a measured current is replaced too."""
    return _changed(s, lambda _: command, ("command", "current_A"))


@_form(
    "saturation",
    lambda r, c, _, s: {"span": c.command, "bend": 4 * s, "froehlich": float(r.random() < 0.5)},
    levels=3,
)
def _saturation(s: Signals, p: Parameters, _: Scales) -> Record:
    """The field relative to that at the largest command, by Froehlich or an arctangent; the inverse is
    logged."""
    u = np.asarray(s.record.command) / p["span"]
    bend = p["bend"]
    # Froehlich: b = (1 + bend) u / (1 + bend u).
    froehlich = u / (1 + bend * (1 - np.abs(u)))
    return _sent(s, p["span"] * (froehlich if p["froehlich"] else np.tan(u * np.arctan(bend)) / bend))


@_form("driver_lag", lambda r, c, _, s: {"tau": 0.1 * s}, varies=True, levels=4)
def _driver(s: Signals, p: Parameters, _: Scales) -> Record:
    """The command whose first-order lag is the actual current."""
    rate = CubicSpline(s.record.time, smoothed_command(s))(s.record.time, 1)
    return s.record.with_channels({"command": s.record.command + p["tau"] * rate})


def smoothed_command(s: Signals) -> Array:
    """The command without quantisation steps."""
    return smoothed(np.asarray(s.record.command))


@_form("command_delay", lambda r, c, _, s: {"d": 0.1 * s}, varies=True)
def _delay(s: Signals, p: Parameters, _: Scales) -> Record:
    """The command logged early by d; the last d of the record is left out."""
    record = s.record
    lost = int(np.ceil(p["d"] / record.sample_time))
    early = record.with_channels({"command": np.interp(record.time + p["d"], record.time, record.command)})
    return early.part(record.time[0], record.time[record.n - 1 - lost])


@_form(
    "remanence",
    lambda r, c, _, s: {"width": 0.5 * s * c.command, "reach": c.command * r.uniform(0.1, 0.3)},
    varies=True,
    levels=4,
)
def _remanence(s: Signals, p: Parameters, _: Scales) -> Record:
    """i = b + width h, h' = (b' / reach)(1 - sign(b') h): a decreasing field is larger than an increasing
    one."""
    b = smoothed_command(s)
    step = np.diff(b) / p["reach"]
    kept, end = np.exp(-np.abs(step)), np.sign(step)
    loop = np.zeros(len(b))
    for k in range(len(step)):
        loop[k + 1] = end[k] + (loop[k] - end[k]) * kept[k]
    return _sent(s, np.asarray(s.record.command) + p["width"] * loop)


#: In the order of the chain.
FORMS: Mapping[str, Form] = {effect: _FORMS[effect] for effect in effects() if effect in _FORMS}
