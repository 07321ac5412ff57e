"""A learned controller from a small JSON file, computed with NumPy alone.

o = observer(y, last command)      measurements, scaled and stacked (`mrdamp.control.observe`)
h = W o                            W as it was when the policy was trained
a = layers(h)                      cut off at -1 and 1, or through tanh
command = command_max (a + 1) / 2, or that of the wanted force a force_max (`mrdamp.control.force_levels`)
command >= a least one for weak motion, where the policy has one (`mrdamp.control.least_command`)
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mrdamp.control.force_levels import ForceLevels
from mrdamp.control.least_command import LeastCommand
from mrdamp.control.observe import Observer
from mrdamp.errors import InputError
from mrdamp.files import decode, read_bytes, write_atomic

Array = NDArray[np.float64]

FORMAT = "mrdamp policy 1"
_SIZE_LIMIT = 50_000_000  # bytes
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
        if self.activation not in ACTIVATIONS:
            raise InputError(f"network: activation is {self.activation!r}; allowed: {', '.join(ACTIVATIONS)}")
        if not self.layers:
            raise InputError("network: there is no layer")
        width = None
        for k, (weight, bias) in enumerate(self.layers):
            if weight.ndim != 2 or bias.shape != weight.shape[:1] or width not in (None, weight.shape[1]):
                raise InputError(f"network: layer {k + 1} has weights {weight.shape} and biases {bias.shape}")
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise InputError(f"network: layer {k + 1} has a number that is not finite")
            width = weight.shape[0]

    def __call__(self, x: Array) -> Array:
        """(..., out) in [-1, 1] from (..., in)."""
        activate = ACTIVATIONS[self.activation]
        for weight, bias in self.layers[:-1]:
            x = activate(x @ weight.T + bias)
        weight, bias = self.layers[-1]
        out = x @ weight.T + bias
        return np.asarray(np.tanh(out) if self.squash else np.clip(out, -1.0, 1.0))


class Policy:
    """A `Controller` of one damper; read with `Policy.read`.

    name; period: of control, s; observer; transform: W (k, observer.size); network: k in, 1 out; command_max: A or V;
    levels: None where the action is the command itself; about: how it was made, any JSON; least: for weak motion, of
    an observer with a leaky peak of the force. Raises InputError.
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
    ) -> None:
        for what, value in (("period", period), ("command_max", command_max)):
            if not 0 < value < math.inf:
                raise InputError(f"policy {name}: {what} is {value}; allowed: a finite number > 0")
        if len(observer.command_max) != 1 or len(network.layers[-1][1]) != 1:
            raise InputError(f"policy {name}: it is for several dampers; a controller gives one command")
        if levels is not None and "force" not in observer.signals:
            raise InputError(f"policy {name}: its action is a force, and its observer sees no force")
        if least is not None and "force" not in observer.peaks:
            raise InputError(f"policy {name}: it has a least command, and its observer no peak of the force")
        if transform.shape != (network.layers[0][0].shape[1], observer.size):
            raise InputError(
                f"policy {name}: observer, transform {transform.shape} and network do not fit together"
            )
        self.name, self.period, self.observer = name, period, observer
        self.transform, self.network = transform, network
        self.command_max, self.levels, self.least = command_max, levels, least
        self.about = dict(about or {})
        self.reset()

    def reset(self) -> None:
        self.observer.reset()
        self._command = 0.0

    def command(self, t: float, y: Mapping[str, float]) -> float:
        self._command = float(self.commands(self.observer(y, self._command)[None], y.get("force", 0.0))[0])
        return self._command

    def commands(self, observations: NDArray[np.float32], force: ArrayLike = 0.0) -> Array:
        """(n,) A or V for observations (n, observer.size) and the forces (n,) N measured with them."""
        action = self.network(observations.astype(np.float64) @ self.transform.T)[:, 0]
        if self.levels is None:
            found = 0.5 * (action + 1.0) * self.command_max
        else:
            found = self.levels.command(action * self.levels.force_max, force)
        if self.least is not None:
            found = np.maximum(found, self.least(self.observer.peak(observations, "force")))
        return np.minimum(found, self.command_max)

    @classmethod
    def read(cls, path: Path | str) -> Policy:
        """From a file of `write`. Raises InputError naming the file."""
        path = Path(path)
        data = read_bytes(path)
        if len(data) > _SIZE_LIMIT:
            raise InputError(f"{path}: {len(data)} bytes; a policy has at most {_SIZE_LIMIT}")
        try:
            return cls.from_dict(json.loads(decode(str(path), data)))
        except ValueError as error:  # InputError is one
            why = str(error) if isinstance(error, InputError) else f"not JSON: {error}"
            raise InputError(why if why.startswith(str(path)) else f"{path}: {why}") from None

    def write(self, path: Path | str) -> None:
        """As JSON, in one go."""
        write_atomic(Path(path), json.dumps(self.to_dict(), indent=1) + "\n")

    def to_dict(self) -> dict[str, Any]:
        """For JSON; weights with eight digits, more than single precision holds."""
        return {
            "format": FORMAT,
            "name": self.name,
            "period": self.period,
            "command_max": self.command_max,
            "observer": self.observer.to_dict(),
            "levels": self.levels.to_dict() if self.levels else None,
            "least": self.least.to_dict() if self.least else None,
            "activation": self.network.activation,
            "squash": self.network.squash,
            "transform": _rows(self.transform),
            "layers": [{"weight": _rows(w), "bias": _rows(b[None])[0]} for w, b in self.network.layers],
            "about": self.about,
        }

    @classmethod
    def from_dict(cls, data: Any) -> Policy:
        """From `to_dict`. Raises InputError where an entry is missing or does not fit."""
        if not isinstance(data, Mapping) or data.get("format") != FORMAT:
            raise InputError(f"not a policy: its format is not {FORMAT!r}")
        try:
            layers = tuple((_matrix(x["weight"]), _matrix([x["bias"]])[0]) for x in data["layers"])
            return cls(
                str(data["name"]),
                float(data["period"]),
                Observer.from_dict(data["observer"]),
                _matrix(data["transform"]),
                Network(layers, data["activation"], bool(data["squash"])),
                float(data["command_max"]),
                ForceLevels.from_dict(data["levels"]) if data["levels"] is not None else None,
                data["about"],
                LeastCommand.from_dict(data["least"]) if data.get("least") is not None else None,
            )
        except KeyError as error:
            raise InputError(f"policy: no entry {error}") from None
        except (TypeError, AttributeError) as error:
            raise InputError(f"policy: {error}") from None


def _rows(matrix: Array) -> list[list[float]]:
    return [[float(f"{v:.8g}") for v in row] for row in matrix.tolist()]


def _matrix(rows: Sequence[Sequence[float]]) -> Array:
    """(rows, columns). Raises InputError where rows are of different lengths or hold no numbers."""
    try:
        matrix = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("policy: a matrix is not rows of numbers of one length") from None
    if matrix.ndim != 2 or not matrix.size or not np.isfinite(matrix).all():
        raise InputError("policy: a matrix is not rows of finite numbers")
    return matrix
