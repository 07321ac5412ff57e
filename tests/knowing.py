"""Parts of controllers for tests: an estimator that knows the state, a controller that keeps what it is shown, a
policy that sees nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.control.observe import Observer
from mrdamp.control.policy import Network, Policy

Array = NDArray[np.float64]


class Known:
    def __init__(self, state: Array) -> None:
        self.state = state

    def reset(self) -> None:
        """Nothing to forget."""

    def __call__(self, y: Mapping[str, float]) -> Array:
        return self.state


class Watching:
    name = "watching"

    def __init__(self, played: Callable[[float], float], period: float = 1e-3) -> None:
        self.played, self.period = played, period
        self.seen: list[dict[str, float]] = []

    def reset(self) -> None:
        self.seen.clear()

    def command(self, t: float, y: Mapping[str, float]) -> float:
        self.seen.append(dict(y))
        return self.played(t)


def steady(path: Path, *actions: float, **more: Any) -> Path:
    """Writes a policy of no layers to speak of: the same actions whatever it sees, every 5 ms, of 2.25 V at most."""
    seen = Observer(("stroke", "force"), (1.0, 1.0), command_max=(2.25,) * len(actions))
    network = Network(((np.zeros((len(actions), seen.size)), np.array(actions)),))
    Policy("steady", 5e-3, seen, np.eye(seen.size), network, 2.25, **more).write(path)
    return path
