"""A learned controller from a small JSON file, computed with NumPy alone.

o = observer(y, last command)      measurements, scaled and stacked (`mrdamp.control.observe`)
h = W o                            W as it was when the policy was trained
m = memory(h, m)                   where the policy has one, else h itself
a = layers(m)                      cut off at -1 and 1, or through tanh
a = t h + reach a                  where it corrects a linear teacher of weights t, cut off at -1 and 1
command = command_max (a + 1) / 2, or that of the wanted force a force_max (`mrdamp.control.force_levels`)
command + command_max b            where the layers have a second output b, cut off as a; 0 at least
command >= a least one for weak motion, where the policy has one (`mrdamp.control.force_levels`)
command held back by a first-order lag, on a driver that is faster than the one of the training (`Policy.matched`)
measured force before a first-order lag of its sensor, where that lag is known (`Policy.matched`)
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mrdamp.control.base import OWN, Unlagged, sensor_name
from mrdamp.control.force_levels import ForceLevels, LeastCommand
from mrdamp.control.observe import Observer
from mrdamp.errors import InputError, refuse, require_one_of, require_positive
from mrdamp.files import read_json, write_atomic
from mrdamp.model.core import Array

#: A list of numbers as `json.dumps` indents it.
_ROW = re.compile(r"\[\n([-+.\deE,\s]+)\]")

FORMAT = "mrdamp policy 1"
VELOCITY = "stroke_velocity"  #: The signal that levels with damping need.


def velocities(observer: Observer, observations: NDArray[np.float32], ahead: Mapping[str, float]) -> Array:
    """(n,) m/s, of the stroke, as observations (n, observer.size) hold it; ahead: as of `Policy`."""
    now = observer.measured(observations, VELOCITY)
    return now + sum(s * observer.measured(observations, name) for name, s in ahead.items())


class Policy:
    """A `Controller`; read with `Policy.read`. With several dampers in its observer each output is the action of one,
    which is its command: no levels, least, teacher or added share, and command_max is that of each.

    name; period: of control, s; observer; transform: W (k, observer.size); network: k in, or the memory's cells, 1 or 2
    out; command_max: A or V; levels: None where the action is the command itself; about: how it was made, any JSON;
    least: for weak motion, of an observer with a leaky peak of the force; teacher: (k,) weights t whose action the
    network corrects by `reach` at most; memory: before the network. ahead: for levels with damping, s by signal: the
    stroke's velocity is `stroke_velocity` plus these times the signals, that of a little later where the signals are
    its rate. command_lag: s, of the current behind the command in the plant of the training (`Model.command_lag`);
    None: not known. Raises InputError.
    """

    def __init__(
        self,
        name: str,
        period: float,
        observer: Observer,
        transform: Array,
        network: Network,
        command_max: float,
        levels: ForceLevels | None = None,
        about: Mapping[str, Any] | None = None,
        least: LeastCommand | None = None,
        teacher: Array | None = None,
        reach: float = 1.0,
        memory: Memory | None = None,
        ahead: Mapping[str, float] | None = None,
        command_lag: float | None = None,
    ) -> None:
        require_positive(f"policy {name}", period=period, command_max=command_max, reach=reach)
        self.name, self.period, self.observer, self.whose = name, period, observer, f"policy {name}"
        self.transform, self.network, self.memory = transform, network, memory
        self.command_max, self.levels, self.least = command_max, levels, least
        self.teacher, self.reach = teacher, reach
        self.ahead = {signal: float(s) for signal, s in dict(ahead or {}).items()}
        self.dampers, outputs = len(observer.command_max), len(network.layers[-1][1])
        more = outputs != self.dampers or (levels, least) != (None, None) or teacher is not None
        inputs = memory.inputs if memory is not None else network.inputs
        fits = network.inputs == (memory.cells if memory is not None else inputs)
        seconds = np.array(list(self.ahead.values()))
        refuse(
            self.whose,
            (self.dampers > 1 and more,
             f"it is for {self.dampers} dampers; allowed: a command of each, no levels, least command and teacher"),
            (outputs > max(2, self.dampers), "its network has more than two outputs; allowed: one or two"),
            (levels is not None and "force" not in observer.signals,
             "its action is a force, and its observer sees no force"),
            (levels is not None and levels.damping and VELOCITY not in observer.signals,
             f"its force levels have damping, and its observer sees no {VELOCITY}"),
            (least is not None and "force" not in observer.peaks,
             "it has a least command, and its observer no peak of the force"),
            (not fits or (len(transform), observer.size) != (inputs, transform.shape[-1]),
             f"observer, transform {transform.shape} and network do not fit together"),
            (teacher is not None and teacher.shape != (inputs,),
             f"teacher has {getattr(teacher, 'shape', ())} weights; allowed: ({inputs},)"),
            (not set(self.ahead) <= set(observer.signals) or not np.isfinite(seconds).all(),
             f"ahead is {self.ahead}; allowed: observed signals, and seconds"),
            (command_lag is not None and not 0 <= command_lag < math.inf,
             f"command_lag is {command_lag}; allowed: a number >= 0, s"),
        )  # fmt: skip
        self.command_lag, self._added = command_lag, 0.0
        self._unlagged = Unlagged(period, 0.0)
        self.about = dict(about or {})
        self._facing: Mapping[str, float] = {}
        self.reset()

    def reset(self) -> None:
        """Forget the past, of the rows of `commands` too."""
        self.observer.reset()
        self._command: Any = 0.0
        self._state: State | None = None
        self._held: Array | None = None
        self._unlagged.reset()

    def require(self, environment: str) -> None:
        """InputError where it was trained in another environment, or structure of one's own, than this, by its name."""
        options = self.about.get("options")
        trained = str(options.get("environment", "")) if isinstance(options, Mapping) else ""
        if trained and trained.rpartition(":")[2] != environment:
            raise InputError(f"{self.whose}: it was trained in {trained}; allowed here: {environment}")

    def matched(self, command_lag: float, sensor_lag: float = 0.0) -> Policy:
        """The same object for a driver and a force sensor with other lags, s (`Model.command_lag`, `Model.sensor_lag`).

        What a faster driver lacks of the training's lag is added to the command: the measured force is fed back, and
        with the gains of a slow driver that loop is unstable on a fast one. A slower driver is left as it is.
        Of a sensor with a first-order lag `command` takes the force before it (`Unlagged`); `commands` takes its forces
        as they are.
        """
        if not 0 <= command_lag < math.inf:
            raise InputError(f"policy {self.name}: a driver's lag is {command_lag}; allowed: a number >= 0, s")
        self._added = max(0.0, (self.command_lag or 0.0) - command_lag)
        self._unlagged = Unlagged(self.period, sensor_lag)
        return self

    def facing(self, places: Sequence[tuple[int, int]]) -> None:
        """For dampers between these floors: one that is mounted the other way round than in training has the other sign
        of stroke and force."""
        upward = self.about.get("upward") or [True] * len(places)  # in training, from the lower floor to the upper
        turned = [k for k, (own, (a, b)) in enumerate(zip(upward, places, strict=False)) if own != (b > a)]
        self._facing = {sensor_name(signal, k): -1.0 for k in turned for signal in OWN}

    def command(self, t: float, y: Mapping[str, float]) -> Any:
        y = {**y, **{name: sign * y[name] for name, sign in self._facing.items() if name in y}}
        missing = [name for name in self.observer.signals if name not in y]
        if missing:
            raise InputError(f"{self.whose}: it needs the measurement {missing[0]}; there are here: {', '.join(y)}")
        wrong = [name for name in self.observer.signals if not np.isfinite(y[name]).all()]
        if wrong:  # its memory would keep it for ever
            raise InputError(f"{self.whose}: the measurement {wrong[0]} is {y[wrong[0]]}; allowed: finite numbers")
        y = self._unlagged(y)
        seen = self.observer(y, self._command)
        found = self.commands(np.atleast_2d(seen), y.get("force", 0.0))
        self._command = found if seen.ndim > 1 else found[0]
        return self._command.T  # of rows (dampers, n)

    def commands(self, observations: NDArray[np.float32], force: ArrayLike = 0.0) -> Array:
        """(n,), of several dampers (n, m), A or V for observations (n, observer.size) and forces (n,) N with them.

        With a memory or an added lag the rows go on where they were at the last call; `reset` before others begin.
        """
        found = self._at_once(observations, force)
        if not self._added:
            return found
        held = np.zeros_like(found) if self._held is None else self._held
        self._held = found + math.exp(-self.period / self._added) * (held - found)
        return self._held

    def _at_once(self, observations: NDArray[np.float32], force: ArrayLike) -> Array:
        """(n,) A or V, without an added lag."""
        inputs = self.inputs(observations)
        if self.memory is not None:
            before = self.memory.start(len(inputs)) if self._state is None else self._state
            self._state = self.memory(inputs, before)
            inputs = self._state[0]
        out = self.network(inputs)
        if self.dampers > 1:
            return self.driven(out, observations)
        return self.driven(out[:, 0], observations, force, out[:, 1] if out.shape[1] > 1 else 0.0)

    def inputs(self, observations: NDArray[np.float32]) -> Array:
        """(n, k) h."""
        return np.asarray(observations.astype(np.float64) @ self.transform.T)

    def driven(
        self,
        actions: Array,
        observations: NDArray[np.float32],
        force: ArrayLike = 0.0,
        added: ArrayLike = 0.0,
    ) -> Array:
        """A or V, of the shape of actions (n,) or (n, m) in [-1, 1], as the network gives them, with observations and
        forces.

        added: (n,) shares of the largest command, the network's second output.
        """
        if self.teacher is not None:
            actions = np.clip(self.inputs(observations) @ self.teacher + self.reach * actions, -1.0, 1.0)
        if self.levels is None:
            found = 0.5 * (actions + 1.0) * self.command_max
        else:
            velocity = velocities(self.observer, observations, self.ahead) if self.levels.damping else 0.0
            found = self.levels.command(actions * self.levels.force_max, force, velocity)
        found = np.maximum(found + self.command_max * np.asarray(added), 0.0)
        if self.least is not None:
            found = np.maximum(found, self.least(self.observer.peak(observations, "force")))
        return np.minimum(found, self.command_max)

    @classmethod
    def read(cls, path: Path | str) -> Policy:
        """From a file of `write`. Raises InputError naming the file."""
        path = Path(path)
        data = read_json(path)
        try:
            found = cls.from_dict(data)
        except ValueError as error:  # InputError is one
            raise InputError(f"{path}: {error}") from None
        found.whose = str(path)
        return found

    def write(self, path: Path | str) -> None:
        """As JSON, in one go; a row of numbers in one line."""
        text = json.dumps(self.to_dict(), indent=1)
        write_atomic(Path(path), _ROW.sub(lambda row: f"[{' '.join(row[1].split())}]", text) + "\n")

    def to_dict(self) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "name": self.name,
            "period": self.period,
            "command_max": self.command_max,
            "observer": self.observer.to_dict(),
            "levels": self.levels.to_dict() if self.levels else None,
            "least": self.least.to_dict() if self.least else None,
            "teacher": rows(self.teacher[None])[0] if self.teacher is not None else None,
            "reach": self.reach,
            "memory": self.memory.to_dict() if self.memory else None,
            "ahead": self.ahead,
            "command_lag": self.command_lag,
            "activation": self.network.activation,
            "squash": self.network.squash,
            "transform": rows(self.transform),
            "layers": [{"weight": rows(w), "bias": rows(b[None])[0]} for w, b in self.network.layers],
            "about": self.about,
        }

    @classmethod
    def from_dict(cls, data: Any) -> Policy:
        """From `to_dict`. Raises InputError where an entry is missing or does not fit."""
        if not isinstance(data, Mapping) or data.get("format") != FORMAT:
            raise InputError(f"not a policy: its format is not {FORMAT!r}")
        try:
            layers = tuple((matrix(x["weight"]), matrix([x["bias"]])[0]) for x in data["layers"])
            return cls(
                str(data["name"]),
                float(data["period"]),
                Observer.from_dict(data["observer"]),
                matrix(data["transform"]),
                Network(layers, data["activation"], bool(data["squash"])),
                float(data["command_max"]),
                ForceLevels.from_dict(data["levels"]) if data["levels"] is not None else None,
                data["about"],
                LeastCommand.from_dict(data["least"]) if data.get("least") is not None else None,
                matrix([data["teacher"]])[0] if data.get("teacher") is not None else None,
                float(data.get("reach", 1.0)),
                Memory.from_dict(data["memory"]) if data.get("memory") is not None else None,
                data.get("ahead"),
                float(data["command_lag"]) if data.get("command_lag") is not None else None,
            )
        except KeyError as error:
            raise InputError(f"policy: no entry {error}") from None
        except (TypeError, AttributeError) as error:
            raise InputError(f"policy: {error}") from None


#: What a memory holds between two calls: output and cell, (n, hidden) each.
State = tuple[Array, Array]

ACTIVATIONS: Mapping[str, Callable[[Array], Array]] = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0.0),
    "elu": lambda x: np.where(x > 0, x, np.expm1(np.minimum(x, 0.0))),
    "identity": lambda x: x,
}


@dataclass(frozen=True, eq=False)
class Network:
    """Layers W (out, in) and b (out,), an activation after all but the last; squash: tanh after the last."""

    layers: tuple[tuple[Array, Array], ...]
    activation: str = "tanh"
    squash: bool = False

    def __post_init__(self) -> None:
        require_one_of("network", ACTIVATIONS, activation=self.activation)
        if not self.layers:
            raise InputError("network: there is no layer")
        width = None
        for k, (weight, bias) in enumerate(self.layers):
            if weight.ndim != 2 or bias.shape != weight.shape[:1] or width not in (None, weight.shape[1]):
                raise InputError(f"network: layer {k + 1} has weights {weight.shape} and biases {bias.shape}")
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise InputError(f"network: layer {k + 1} has a number that is not finite")
            width = weight.shape[0]

    @property
    def inputs(self) -> int:
        return int(self.layers[0][0].shape[1])

    def __call__(self, x: Array) -> Array:
        """(..., out) in [-1, 1] from (..., in)."""
        activate = ACTIVATIONS[self.activation]
        for weight, bias in self.layers[:-1]:
            x = activate(x @ weight.T + bias)
        weight, bias = self.layers[-1]
        out = x @ weight.T + bias
        return np.asarray(np.tanh(out) if self.squash else np.clip(out, -1.0, 1.0))


@dataclass(frozen=True, eq=False)
class Memory:
    """A long short-term memory of H cells: gates i, f, g, o in this order, as PyTorch's `LSTM` has them.

    given: (4 H, in) and kept: (4 H, H) weights, bias: (4 H,).
    """

    given: Array
    kept: Array
    bias: Array

    def __post_init__(self) -> None:
        four, cells = self.kept.shape if self.kept.ndim == 2 else (0, 0)
        if not cells or four != 4 * cells or self.given.shape[0] != four or self.bias.shape != (four,):
            raise InputError(
                f"memory: weights {self.given.shape}, {self.kept.shape}, biases {self.bias.shape} do not fit together"
            )
        if not all(np.isfinite(part).all() for part in (self.given, self.kept, self.bias)):
            raise InputError("memory: it has a number that is not finite")

    @property
    def cells(self) -> int:
        return int(self.kept.shape[1])

    @property
    def inputs(self) -> int:
        return int(self.given.shape[1])

    def start(self, n: int) -> State:
        """Of n rows that have no past."""
        return np.zeros((n, self.cells)), np.zeros((n, self.cells))

    def __call__(self, x: Array, state: State) -> State:
        """The state after inputs (n, in); its first part is the output."""
        out, cell = state
        i, f, g, o = np.split(x @ self.given.T + out @ self.kept.T + self.bias, 4, axis=1)
        cell = _sigmoid(f) * cell + _sigmoid(i) * np.tanh(g)
        return _sigmoid(o) * np.tanh(cell), cell

    def to_dict(self) -> dict[str, Any]:
        return {"given": rows(self.given), "kept": rows(self.kept), "bias": rows(self.bias[None])[0]}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Memory:
        return cls(matrix(data["given"]), matrix(data["kept"]), matrix([data["bias"]])[0])


def _sigmoid(x: Array) -> Array:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * x)))


def rows(values: Array) -> list[list[float]]:
    """For JSON, with eight digits: more than single precision holds."""
    return [[float(f"{v:.8g}") for v in row] for row in values.tolist()]


def matrix(given: Sequence[Sequence[float]]) -> Array:
    """(rows, columns). Raises InputError where rows are of different lengths or hold no numbers."""
    try:
        found = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("policy: a matrix is not rows of numbers of one length") from None
    if found.ndim != 2 or not found.size or not np.isfinite(found).all():
        raise InputError("policy: a matrix is not rows of finite numbers")
    return found
