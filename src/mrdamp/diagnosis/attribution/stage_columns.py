"""Possible force errors of each stage of a damper's chain: columns of an additive model in the stage's own
variables.

- driver: functions of the history of the command and of time;
- magnetics: functions of the current's path, independent of time;
- fluid: forces times functions of the motion, of the path since the last reversal and of the load history;
- mechanics: forces independent of the current;
- mount: motion lost in proportion to the force;
- sensor: functions of the measured force.

A change of the current is converted to a force by the slope of the simulated force with the command, a change
of the motion by the simulator's response to it. The model assumes no form: hat functions (linear splines),
first-order filters and play operators approximate any function.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array
from mrdamp.records.motion import stroke_since_reversal
from mrdamp.records.sampling import derivative, memory

#: Increments of the command and of the motion, as shares of the largest command and of the stroke's
#: amplitude.
_STEP_COMMAND, _STEP_MOTION = 0.02, 0.01
#: s, time constants of filters on the command, on its square, on the force, and on the displacement.
_COMMAND, _LOAD, _FORCE = (0.005, 0.02, 0.1, 0.5, 2.0), (0.1, 0.5, 2.0), (0.005, 0.02, 0.1, 0.5, 2.0, 10.0)
_MOTION = (0.02, 0.1, 0.5)
#: Widths of the region about zero command and of play operators on the command, as shares of the largest
#: command.
_SMALL, _LOOPS = (0.05, 0.1, 0.2, 0.35), (0.03, 0.1, 0.3)
#: Quantisation steps of a source with few levels, as shares of the largest command.
_STEPS = np.geomspace(0.06, 0.6, 24)
#: Widths of play operators on the motion (shares of the stroke) in a mount and on the rod.
_GAPS, _SLACK = (0.01, 0.03, 0.1), (0.02, 0.1)
#: Velocity (over its RMS) at which friction is fully developed; reversal of the command that counts as a
#: turn.
_SLIP, _TURN = 0.1, 0.01
#: Forces (over the RMS force) at which a valve may open, and times (s) in which it closes again.
_OPENS, _CLOSES = (1.1, 1.4, 1.7), (0.3, 0.8)
#: Velocities (over the RMS velocity) at which an orifice in parallel with the fluid carries the RMS force.
_ORIFICES = (0.1, 0.25, 0.6)
#: s, unit of time.
_TIME = 10.0


@dataclass
class Columns:
    """Columns of one stage.

    columns: (n, columns) N for each record. gains: for each record several (n,) by which a time-varying error
    of the stage would be multiplied.
    """

    columns: list[Array] = field(default_factory=list)
    gains: list[tuple[Array, ...]] = field(default_factory=list)

    def add(self, columns: Sequence[Array], gains: tuple[Array, ...]) -> None:
        """Adds a record."""
        self.columns.append(np.nan_to_num(np.column_stack(columns), posinf=0.0, neginf=0.0))
        self.gains.append(gains)


def columns_of(problem: Problem, rig: DamperRig) -> dict[str, Columns]:
    """Columns by stage, for the residuals in the last channel of a problem's records.

    `reading` is the measurement of the displacement and `sensor` that of the force. `sensor` has no columns
    if the last channel is a separate load cell.
    """
    states = [_states(problem, rig, k) for k in problem.records]
    scale = {n: np.concatenate([s[n] for s, _ in states]) for n in ("u", "x", "v", "force")}
    size = float(np.sqrt(np.mean(scale["force"] ** 2))) or 1.0
    top = float(np.quantile(np.abs(scale["force"]), 0.995)) or 1.0
    knots = {n: _knots(scale[n], count) for n, count in (("u", 6), ("x", 7), ("v", 9))}
    knots["force"] = np.linspace(-top, top, 9)
    out = {n: Columns() for n in ("driver", "magnetics", "fluid", "mechanics", "mount", "reading", "sensor")}
    for s, moved in states:
        # Failures and fluctuations of the force due to the command scale with the current.
        made = s["force"] - s["still"]
        out["driver"].add(_driver(s), (made, s["slope"], s["slope"] * s["u"]))
        out["magnetics"].add(_magnetics(s, knots), (made,))
        out["fluid"].add(_fluid(s, knots, size), (s["force"],))
        out["mechanics"].add(_mechanics(s, knots), (np.ones(len(made)),))
        out["mount"].add(moved["mount"], (moved["mount"][0],))
        out["reading"].add(moved["reading"], (moved["reading"][0], moved["reading"][-1]))
        out["sensor"].add(_sensor(s, size), (np.ones(len(made)), s["force rate"]))
    if rig.channels[-1] != "force_N":
        del out["sensor"]
    return out


def _driver(s: Mapping[str, Array]) -> list[Array]:
    """Functions of the filtered command and of time; all vanish where the command is zero for long."""
    u = s["u"]
    late = [u - s[f"u {tau}"] for tau in _COMMAND]
    lags = [*(np.maximum(d, 0) for d in late), *(np.minimum(d, 0) for d in late)]
    sunk = [*(u * s[f"load {tau}"] for tau in _LOAD), *(u * s[f"u {tau}"] for tau in _LOAD), u * s["t"]]
    coarse = [step * np.round(u / step) - u for step in _STEPS]
    return [s["slope"] * c for c in (*lags, *sunk, *coarse, *(np.minimum(u, d) / d for d in _SMALL))]


def _magnetics(s: Mapping[str, Array], knots: Mapping[str, Array]) -> list[Array]:
    """Functions of the current and of its path, also at zero current, and the field's effect on the rod."""
    u, turn = s["u"], s["turn of u"]
    loops = [s[f"loop {width}"] for width in _LOOPS]
    path = [*loops, loops[-1] * u, np.tanh(turn / 0.1), np.tanh(turn / 0.4), u * np.tanh(turn / 0.2)]
    field = [*_hats(u, knots["u"]), u**2, u**3, *path]
    small = [np.minimum(u, d) / d for d in _SMALL]
    pull = [u**2 * c for c in (*_hats(s["x"], knots["x"]), s["x"], s["slip"])]
    return [*(s["slope"] * c for c in (*field, *small)), *pull]


def _fluid(s: Mapping[str, Array], knots: Mapping[str, Array], size: float) -> list[Array]:
    """Forces times functions of the motion, of the path since a reversal, of the load history and of the
    force."""
    turn, speed, one = s["turn"], np.abs(s["v"]), np.ones(len(s["t"]))
    gone = [s["t"], s["heat"], np.exp(-s["path"] / 3), np.exp(-s["path"] / 20)]
    near = [np.exp(-np.abs(turn) / 0.1), np.exp(-np.abs(turn) / 0.4)]
    open_ = [s[f"open {force} {tau}"] for force in _OPENS for tau in _CLOSES]
    since = [np.tanh(turn / 0.1), np.tanh(turn / 0.5), *near, *gone, *open_]
    passed = [s["v"] ** 2 / d**2 for d in _ORIFICES]
    past = [o / np.hypot(s["force"] / size, o + 1e-9) - 1 for o in passed]
    motion = [one, s["slip"], *_hats(s["v"], knots["v"])[:-1], *_hats(s["x"], knots["x"])[:-1], *past]
    whole = [*motion, *since, *_hats(s["force"], knots["force"])]
    viscous = [one, speed, np.exp(-speed), np.exp(-3 * speed)]
    parts = (s["force"], whole), (s["force"] - s["still"], [one, s["slip"], *since]), (s["still"], viscous)
    return [force / size * c for force, factors in parts for c in factors]


def _mechanics(s: Mapping[str, Array], knots: Mapping[str, Array]) -> list[Array]:
    """Functions of the motion alone and of its history (springs that release)."""
    places = _hats(s["x"], knots["x"])[:-1]
    plain = [np.ones(len(s["t"])), s["slip"], s["a"], s["t"], s["x"] * s["t"], s["v"]]
    slack = [s[f"slack {gap}"] for gap in _SLACK]
    late = [s["x"] - s[f"x {tau}"] for tau in _MOTION]
    return [*plain, *_hats(s["v"], knots["v"])[:-1], *places, *(s["slip"] * c for c in places), *slack, *late]


def _sensor(s: Mapping[str, Array], size: float) -> list[Array]:
    """Functions of the measured force, of its filtered values and of time, and crosstalk from the command."""
    f = s["force"] / size
    before = [s[f"force {tau}"] / size - f for tau in _FORCE]
    return [np.ones(len(f)), s["t"], s["u"], f, f * np.abs(f), f**3, *before, s["force rate"] / size]


def _states(
    problem: Problem, rig: DamperRig, record: int
) -> tuple[dict[str, Array], dict[str, list[Array]]]:
    """Variables of a record's columns, (n,) each at the residuals' samples: motion over its range, command over its
    maximum, forces in N; and the columns of errors of the motion, in the mount and in its reading."""
    r, size, take = rig.records[record], rig.sizes, problem.taken(record)
    x, dt = rig.motions[record], r.sample_time
    v = rig.velocity(record)
    u, time = np.asarray(r.command) / size.command, np.asarray(r.time) - float(r.time[0])

    def force_at(command: Array, moved: Array | None = None) -> Array:
        return rig.through(record, size.command * command, {}, moved)["reference"]

    force, still = force_at(u), force_at(0 * u)
    f, w = force / size.force, v / size.velocity
    place = x / size.stroke
    gaps = [10 * (play(place, gap) - place) for gap in _GAPS]
    moves = {
        "mount": [f, f**3, np.tanh(5 * f), memory(f, dt, 0.1) - f, *gaps],
        "reading": [w, w * time / 5, np.tanh(w / _SLIP), place, place**2, time / _TIME, np.ones(r.n)],
    }
    changes = {n: [force_at(u, _STEP_MOTION * size.stroke * m) - force for m in some] for n, some in moves.items()}
    back = 0.01 * float(np.std(x))
    states = {
        "t": time / _TIME,
        "x": place,
        "v": w,
        "a": derivative(v, dt) / size.acceleration,
        "u": u,
        "force": force,
        "still": still,
        "slope": (force_at(u + _STEP_COMMAND) - force) / _STEP_COMMAND,
        "force rate": 0.01 * derivative(force, dt),
        "slip": np.tanh(w / _SLIP),
        "turn": stroke_since_reversal(x, back) / size.stroke,
        "path": np.cumsum(np.abs(np.diff(x, prepend=x[0]))) / size.stroke,
        "heat": np.cumsum(np.abs(force * v)) * dt / size.heat,
        "turn of u": stroke_since_reversal(u, _TURN),
        **{f"loop {width}": u - play(u, width) for width in _LOOPS},
        **{f"slack {gap}": place - play(place, gap) for gap in _SLACK},
        **{f"u {tau}": memory(u, dt, tau) for tau in _COMMAND},
        # A test starts from rest: a supply that sags under load has not sagged yet.
        **{f"load {tau}": memory(np.concatenate([[0.0], u**2]), dt, tau)[1:] for tau in _LOAD},
        **{f"force {tau}": memory(force, dt, tau) for tau in _FORCE},
        **{f"x {tau}": memory(place, dt, tau) for tau in _MOTION},
        **{f"open {a} {tau}": np.exp(-dt * _since(np.abs(f) > a) / tau) for a in _OPENS for tau in _CLOSES},
    }
    moved = {name: [(c / _STEP_MOTION)[take] for c in some] for name, some in changes.items()}
    return {name: values[take] for name, values in states.items()}, moved


def play(x: Array, width: float) -> Array:
    """Play operator (Prandtl) of half-width `width` on a signal; (n,), unit of the signal."""
    out, at = np.empty(len(x)), float(x[0])
    for k, value in enumerate(x.tolist()):
        at = min(max(at, value - width), value + width)
        out[k] = at
    return out


def _since(at: NDArray[np.bool_]) -> Array:
    """Samples (n,) since the condition was last true; infinite before the first time."""
    number = np.arange(len(at))
    last = np.maximum.accumulate(np.where(at, number, -1))
    return np.where(last < 0, np.inf, number - last)


def _knots(values: Array, count: int) -> Array:
    low, high = (float(q) for q in np.quantile(values, (0.01, 0.99)))
    return np.linspace(low, high if high > low else low + 1.0, count)


def _hats(values: Array, knots: Array) -> list[Array]:
    """Linear splines (n,), one for each knot; constant beyond the ends."""
    return [np.interp(values, knots, row) for row in np.eye(len(knots))]
