"""A policy of a wanted force as a PyTorch module: what is exported to NumPy, and its slopes."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mrdamp.control.force_levels import ForceLevels
from mrdamp.control.least_command import LeastCommand
from mrdamp.control.networks import Network
from mrdamp.control.observe import Observer

Array = NDArray[np.float64]


class SoftPolicy(torch.nn.Module):
    """As `mrdamp.control.policy.Policy` with a teacher: action = t h + v tanh(W h + b) + c, h = transform observation.

    The slopes are those of the pieces that the inverse of the damper is made of; its jump where the force changes its
    sign has none. W and b are drawn, v begins at zero: the first actions are the teacher's. Parameters are single
    precision, as the observations are.
    """

    def __init__(
        self,
        observer: Observer,
        transform: NDArray[np.float32],
        teacher: Array,
        hidden: int,
        levels: ForceLevels,
        command_max: float,
        least: LeastCommand | None,
        rng: np.random.Generator,
    ) -> None:
        super().__init__()
        inputs = len(teacher)
        self._transform = _tensor(transform)
        self.teacher = torch.nn.Parameter(_tensor(teacher))
        self.weight = torch.nn.Parameter(_tensor(rng.standard_normal((hidden, inputs)) / np.sqrt(inputs)))
        self.bias = torch.nn.Parameter(_tensor(0.3 * rng.standard_normal(hidden)))
        self.out = torch.nn.Parameter(torch.zeros(hidden))
        self.offset = torch.nn.Parameter(torch.zeros(1))
        self._forces, self._commands = _tensor(levels.forces), _tensor(levels.commands)
        self._force_max, self._command_max, self._least = levels.force_max, command_max, least
        self._force = observer.signals.index("force")
        self._unit = observer.scales[self._force]
        self._peak = list(observer.names).index(f"force^{observer.peaks['force']:g}") if least else 0

    def forward(self, observations: Any) -> Any:
        """(...) A or V from observations (..., size)."""
        h = observations @ self._transform.T
        action = h @ self.teacher + torch.tanh(h @ self.weight.T + self.bias) @ self.out + self.offset
        wanted = self._force_max * torch.clamp(action, -1.0, 1.0)
        size = wanted.abs()
        after = torch.searchsorted(self._forces, size.detach().contiguous()).clamp(1, len(self._forces) - 1)
        low, high = self._forces[after - 1], self._forces[after]
        share = ((size - low) / (high - low).clamp(min=1e-9)).clamp(0.0, 1.0)
        ends = self._commands
        found = ends[after - 1] + share * (ends[after] - ends[after - 1])
        found = torch.where(wanted * observations[..., self._force] > 0, found, torch.zeros_like(found))
        if self._least is not None:
            peak = (self._unit * observations[..., self._peak]).detach().double().numpy()
            found = torch.maximum(found, _tensor(self._least(peak)))
        return found.clamp(max=self._command_max)

    def commands(self, observations: NDArray[np.float32]) -> Array:
        """(n,) of observations (n, size), without slopes."""
        with torch.no_grad():
            return np.asarray(self(torch.from_numpy(observations)).numpy(), dtype=np.float64)

    def network(self) -> Network:
        """What corrects the teacher, for export."""
        own = [p.detach().double().numpy() for p in (self.weight, self.bias, self.out, self.offset)]
        return Network(((own[0], own[1]), (own[2][None], own[3])), "tanh")

    def taught(self) -> Array:
        """(inputs,) the teacher's weights, which are trained too."""
        return np.asarray(self.teacher.detach().double().numpy())


def _tensor(values: Any) -> Any:
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))
