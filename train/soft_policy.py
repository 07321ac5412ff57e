"""A policy of a wanted force as a PyTorch module: what is exported to NumPy, and its slopes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import block_diag

from mrdamp.control.force_levels import ForceLevels
from mrdamp.control.least_command import LeastCommand
from mrdamp.control.networks import Network
from mrdamp.control.observe import Observer
from mrdamp.control.policy import Policy
from mrdamp.errors import InputError
from mrdamp.model.core import Array


class SoftPolicy(torch.nn.Module):
    """As `mrdamp.control.policy.Policy` with a teacher, for observations o and those with the opposite signs, o*:

        action = t h + n1(h) - n1(h*)      share = n2(h) + n2(h*) + c      h = transform o, h* = transform o*

    n1 and n2 are the outputs of one network with tanh. The wanted force is an odd function of the signals, and the
    share of the largest command, which is added to that of the wanted force, an even one: a motion and its mirror image
    are commanded alike. The command of the wanted force jumps where the force changes its sign, the share does not.

    The slopes are those of the pieces that the inverse of the damper is made of. Its jump has none: a run is smooth in
    the weights between those at which a period's sign changes, and steps there. Weights are drawn,
    those of the last layer are zero: the first actions are the teacher's. Parameters are single precision, as the
    observations are.
    """

    def __init__(
        self,
        observer: Observer,
        transform: NDArray[np.float32],
        teacher: Array,
        hidden: Sequence[int],
        levels: ForceLevels,
        command_max: float,
        least: LeastCommand | None,
        rng: np.random.Generator,
    ) -> None:
        super().__init__()
        sizes = [len(teacher), *hidden]
        signed = np.full(observer.size, False)
        signed[list(observer.without_peaks)] = True
        signed[[name == "command" for name in observer.names]] = False
        self._signs = np.where(signed, -1.0, 1.0)
        self._transform, self._mirror = _tensor(transform), _tensor(transform * self._signs)
        self.teacher = torch.nn.Parameter(_tensor(teacher))
        drawn = [(b, rng.standard_normal((b, a)) / np.sqrt(a)) for a, b in pairwise(sizes)]
        self.weights = torch.nn.ParameterList([torch.nn.Parameter(_tensor(w)) for _, w in drawn])
        self.biases = torch.nn.ParameterList(
            [torch.nn.Parameter(_tensor(0.3 * rng.standard_normal(b))) for b, _ in drawn]
        )
        self.out = torch.nn.Parameter(torch.zeros(2, sizes[-1]))
        self.offset = torch.nn.Parameter(torch.zeros(1))
        self._forces, self._commands = _tensor(levels.forces), _tensor(levels.commands)
        self._force_max, self._command_max, self._least = levels.force_max, command_max, least
        self._force = observer.signals.index("force")
        self._unit = observer.scales[self._force]
        self._peak = list(observer.names).index(f"force^{observer.peaks['force']:g}") if least else 0

    def forward(self, observations: Any) -> Any:
        """(...) A or V from observations (..., size)."""
        h = observations @ self._transform.T
        one, other = self._outputs(h), self._outputs(observations @ self._mirror.T)
        correction = torch.clamp(one[..., 0] - other[..., 0], -1.0, 1.0)
        share = torch.clamp(one[..., 1] + other[..., 1] + self.offset, -1.0, 1.0)
        wanted = self._force_max * torch.clamp(h @ self.teacher + correction, -1.0, 1.0)
        size = wanted.abs()
        after = torch.searchsorted(self._forces, size.detach().contiguous()).clamp(1, len(self._forces) - 1)
        low, high = self._forces[after - 1], self._forces[after]
        part = ((size - low) / (high - low).clamp(min=1e-9)).clamp(0.0, 1.0)
        ends = self._commands
        found = ends[after - 1] + part * (ends[after] - ends[after - 1])
        found = torch.where(wanted * observations[..., self._force] > 0, found, torch.zeros_like(found))
        found = (found + self._command_max * share).clamp(min=0.0)
        if self._least is not None:
            peak = (self._unit * observations[..., self._peak]).detach().double().numpy()
            found = torch.maximum(found, _tensor(self._least(peak)))
        return found.clamp(max=self._command_max)

    def load(self, policy: Policy) -> None:
        """The weights of an exported policy, whose inputs these begin with; the others count for nothing at first.

        Raises InputError for other layers.
        """
        layers, last = policy.network.layers[:-1], policy.network.layers[-1]
        sizes = [len(b) // 2 for _, b in layers]
        if sizes != [len(b) for b in self.biases] or policy.teacher is None:
            raise InputError(f"adjoint: start has layers {sizes}; set policy_kwargs.net_arch to them")
        with torch.no_grad():
            for own, bias, (w, b) in zip(self.weights, self.biases, layers, strict=True):
                inputs = w.shape[1] // 2
                own.zero_()
                own[:, :inputs] = _tensor(w[: len(w) // 2, :inputs])
                bias.copy_(_tensor(b[: len(b) // 2]))
            self.out.copy_(_tensor(last[0][:, : sizes[-1]]))
            self.offset.fill_(float(last[1][1]))
            self.teacher.zero_()
            self.teacher[: len(policy.teacher) // 2] = _tensor(policy.teacher[: len(policy.teacher) // 2])

    def _outputs(self, h: Any) -> Any:
        for weight, bias in zip(self.weights, self.biases, strict=True):
            h = torch.tanh(h @ weight.T + bias)
        return h @ self.out.T

    def commands(self, observations: NDArray[np.float32]) -> Array:
        """(n,) of observations (n, size), without slopes: `forward` in NumPy, which is faster for few."""
        own, mirrored = (t.numpy() for t in (self._transform, self._mirror))
        h, other = observations @ own.T, observations @ mirrored.T
        x = np.concatenate([h, other])
        for weight, bias in zip(self.weights, self.biases, strict=True):
            x = np.tanh(x @ weight.detach().numpy().T + bias.detach().numpy())
        out = x @ self.out.detach().numpy().T
        one, other = out[: len(h)], out[len(h) :]
        correction = np.clip(one[:, 0] - other[:, 0], -1.0, 1.0)
        share = np.clip(one[:, 1] + other[:, 1] + self.offset.detach().numpy(), -1.0, 1.0)
        wanted = self._force_max * np.clip(h @ self.teacher.detach().numpy() + correction, -1.0, 1.0)
        found = np.interp(np.abs(wanted), self._forces.numpy(), self._commands.numpy())
        found = np.where(self._along(wanted, observations), found, 0.0)
        found = np.maximum(found + self._command_max * share, 0.0)
        if self._least is not None:
            found = np.maximum(found, self._least(self._unit * observations[:, self._peak].astype(np.float64)))
        return np.asarray(np.minimum(found, self._command_max), dtype=np.float64)

    def _along(self, wanted: NDArray[np.float32], observations: NDArray[np.float32]) -> NDArray[np.bool_]:
        """(n,) whether the damper's force has the sign of the wanted one: where this changes, the command jumps."""
        return np.asarray(wanted * observations[:, self._force] > 0)

    def transform(self) -> Array:
        """(2 inputs, size) of `Policy`: h, then h*."""
        own = self._transform.double().numpy()
        return np.vstack([own, own * self._signs])

    def network(self) -> Network:
        """What corrects the teacher and adds to the command, for export: n1 and n2 of h and of h* side by side."""
        layers = [
            (block_diag(w, w), np.tile(b, 2))
            for w, b in zip(map(_array, self.weights), map(_array, self.biases), strict=True)
        ]
        force, share = _array(self.out)
        last = np.array([[*force, *-force], [*share, *share]]), np.array([0.0, *_array(self.offset)])
        return Network((*layers, last), "tanh")

    def taught(self) -> Array:
        """(2 inputs,) the teacher's weights, which are trained too."""
        return np.append(_array(self.teacher), np.zeros(len(self.teacher)))


def _array(values: Any) -> Array:
    return np.asarray(values.detach().double().numpy())


def _tensor(values: Any) -> Any:
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))
