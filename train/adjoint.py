"""Trainings of the frame's policies by gradients through the chain: the adjoint of the linearised closed loop.

The criteria of an episode are peaks, which the rewards of single steps say little about, and an evolution strategy
needs many runs for every weight. The slopes of the chain give the exact gradient of all weights from one run and a
sweep backwards, as backpropagation through time does for networks (Werbos, Proc. IEEE 78 (1990) 1550-1560).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import block_diag

from mrdamp.compare.contenders import shipped_policies
from mrdamp.control.force_levels import ForceLevels, LeastCommand
from mrdamp.control.observe import Observer
from mrdamp.control.policy import Network, Policy
from mrdamp.envs.frame import Frame
from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.model.core import Array
from mrdamp.train.closed_loop import ClosedLoop, Trajectory
from mrdamp.train.run import StepRun, reading
from mrdamp.train.settings import Options, Settings


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
        found = np.where(wanted * observations[:, self._force] > 0, found, 0.0)
        found = np.maximum(found + self._command_max * share, 0.0)
        if self._least is not None:
            found = np.maximum(found, self._least(self._unit * observations[:, self._peak].astype(np.float64)))
        return np.asarray(np.minimum(found, self._command_max), dtype=np.float64)

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


#: What the hyperparameters hold besides `Settings`. start: a set of shipped policies, or a folder of an earlier
#: training; a training begins with the weights of its seed's policy, none: with the teacher's. loads: of a step;
#: learning_rate: of Adam at first, it falls along half a cosine to a twentieth; current, noise: as of the evolution
#: strategy.
DEFAULTS: Mapping[str, Any] = {"start": None, "loads": 84, "learning_rate": 5e-3, "current": 0.02, "noise": 5e-4}

#: Exponent of the norm over time in place of a peak: a tenth above it, and every near-peak has a slope. As the
#: learning rate it was not searched for.
_NORM = 20
#: Of the slopes of a load over the median of all: where the closed loop is nearly unstable, they say nothing of a step.
_LOUD = 3.0
_LEAST_RATE = 0.05  # share of the learning rate at the end
_PEAK = 3.0  # of the leaky peak among the network's inputs, so that it is as large as the others


class AdjointRun(StepRun):
    """One training. A step counts the control periods of all rows, those that slopes are taken with included."""

    def __init__(self, options: Options, chosen: Settings, out: Path) -> None:
        own = chosen.learner_over(DEFAULTS, "adjoint")
        self._loads, self._rate = int(own["loads"]), float(own["learning_rate"])
        self._current, self._noise = float(own["current"]), float(own["noise"])
        if self._loads < 1 or not 0 < self._rate < math.inf or not self._noise >= 0:
            raise InputError(
                "adjoint: hyperparameters: allowed: loads 1 or more, learning_rate > 0, noise >= 0"
            )
        given = _earlier(own["start"], options.seed)
        self._earlier = given if given is not None and len(given.network.layers) > 1 else None
        super().__init__(options, chosen, out, 1)
        torch.set_num_threads(1)  # the matrices are small
        if self.world.kind is not Frame or not chosen.teacher or self.levels is None:
            raise InputError("adjoint: allowed: mrdamp/Frame-v0, action: force, and a teacher")
        if chosen.viscous or chosen.switch:
            raise InputError("adjoint: hyperparameters: viscous and switch are not allowed")
        hidden = chosen.hidden("adjoint")
        if not hidden:
            raise InputError("adjoint: policy_kwargs.net_arch is []; allowed: sizes of hidden layers")
        self.loop = ClosedLoop(self.world, self._loads)
        rng = np.random.default_rng(self.seed)
        o, plain = self.task.observer, self.inputs - len(self.task.observer.peaks)
        begin = np.zeros(self.inputs) if self._earlier is not None else self._begin(plain, given)
        self.soft = SoftPolicy(o, self.matrix, begin, hidden, self.levels, self.command_max, self.least(), rng)
        if self._earlier is not None:
            self.soft.load(self._earlier)
        self._begin_descent()
        self._steps = 0
        if self.resumed:
            with reading(self.checkpoint):
                kept = torch.load(self.checkpoint, weights_only=True)
                self.loop.moving, self.loop.scale = kept["moving"].numpy(), kept["scale"].numpy()
                self.soft.load_state_dict(kept["policy"])
                self._adam.load_state_dict(kept["adam"])
                self._periods, self._steps = kept["periods"], kept["steps"]

    def _begin_descent(self) -> None:
        self._adam = torch.optim.Adam(self.soft.parameters(), lr=self._rate, betas=(0.9, 0.98))

    def _begin(self, plain: int, start: Policy | None) -> Array:
        """(inputs,) weights to begin with; none on the leaky peaks, which come behind the `plain` ones."""
        found, whole = np.zeros(self.inputs), self.matrix
        self.matrix = whole[:plain]
        try:
            found[:plain] = self.taught() if start is None else self._linear(start)
        finally:
            self.matrix = whole
        return found

    def _linear(self, policy: Policy) -> Array:
        """(inputs,) weights whose action is that of a linear policy. Raises InputError."""
        names, layers = self.task.observer.names, policy.network.layers
        unseen = [n for n in policy.observer.names if n not in names]
        same = policy.period == self.task.rows.period and _alike(policy.levels, self.levels)
        if len(layers) != 1 or policy.teacher is not None or unseen or not same:
            raise InputError(
                f"adjoint: start ({policy.name}): no linear policy of these observations and damper; set start=null"
            )
        row = np.zeros(len(names))
        row[[names.index(n) for n in policy.observer.names]] = (layers[0][0] @ policy.transform)[0]
        return np.asarray(np.linalg.lstsq(self.matrix.T.astype(np.float64), row, rcond=1e-9)[0])

    def _matrix(self, rng: np.random.Generator) -> NDArray[np.float32]:
        """The peaks, which have no sign and are left out elsewhere, are inputs of the network too."""
        matrix = super()._matrix(rng)
        if self.matrix_file.is_file():
            return matrix
        o = self.task.observer
        if self._earlier is not None:
            return _continued(self._earlier, o, matrix)
        columns = [j for j in range(o.size) if j not in o.without_peaks]
        return np.vstack([matrix, _PEAK * np.eye(o.size, dtype=np.float32)[columns]])

    def network(self) -> Network:
        return self.soft.network()

    def transform(self) -> Array:
        return self.soft.transform()

    def teacher(self) -> Array:
        return self.soft.taught()

    def save(self) -> None:
        kept = {
            "policy": self.soft.state_dict(), "adam": self._adam.state_dict(), "periods": self._periods,
            "steps": self._steps, "moving": torch.from_numpy(self.loop.moving),
            "scale": torch.from_numpy(self.loop.scale),
        }  # fmt: skip
        write_atomic(self.checkpoint, lambda file: torch.save(kept, file))

    def step(self) -> float:
        """One step of Adam under loads drawn anew; the value before it."""
        rng = self.numbers(self._steps)
        loads = self.world.structure.some(rng, self._loads)
        worlds = self.sharing(rng, self._loads)
        value, periods = 0.0, 0
        self._adam.zero_grad()
        for k, world in enumerate(worlds):
            some = loads[k :: len(worlds)]
            if world is not self.loop.world:
                self.loop = ClosedLoop(world, len(some), like=self.loop)
            before = self.loop.periods
            run = self.loop.run(some, self.soft.commands, self._noise, rng)
            part, by_channel = self.value(run)
            self.backward(run, by_channel)
            value, periods = value + part, periods + self.loop.periods - before
        torch.nn.utils.clip_grad_norm_(self.soft.parameters(), 1.0)
        share = min(1.0, self._periods / self.chosen.n_timesteps)
        fallen = _LEAST_RATE + (1 - _LEAST_RATE) * 0.5 * (1 + math.cos(math.pi * share))
        for group in self._adam.param_groups:
            group["lr"] = self._rate * fallen
        self._adam.step()
        self._steps += 1
        self._periods += periods
        return value

    def value(self, run: Trajectory) -> tuple[float, Array]:
        """What the loop's run adds to a step's score, and its slopes by channel.

        Norms over time stand in place of peaks, and the current is left out.
        """
        by_channel = np.zeros(run.channels.shape)
        references = self.loop.references()
        alive = np.arange(len(run.channels))[:, None] <= run.lasts
        total = 0.0
        for k, (group, part) in enumerate(zip(self.loop.groups, self.world.shares, strict=True)):
            size = np.abs(run.channels[:, :, group]) * alive[:, :, None]
            largest = size.max(axis=(0, 2), keepdims=True)
            near = (size / largest) ** _NORM
            whole = near.sum(axis=(0, 2), keepdims=True)
            norm = largest * whole ** (1 / _NORM)
            share = part / (self._loads * references[None, :, k, None])
            total += float((share * norm).sum())
            slope = share * norm / whole * near / np.maximum(size, 1e-30)
            by_channel[:, :, group] = slope * np.sign(run.channels[:, :, group])
        return total, by_channel

    def backward(self, run: Trajectory, by_channel: Array) -> None:
        """Adds to the gradients of the weights."""
        periods, n = run.commands.shape
        seen = torch.from_numpy(run.observations.reshape(periods * n, -1)).requires_grad_(True)
        commands = self.soft(seen)
        slopes = torch.autograd.grad(commands.sum(), seen, retain_graph=True)[0].numpy().astype(np.float64)
        price = self._current / (self.command_max * run.periods)
        each = self.loop.adjoint(run, by_channel, slopes.reshape(periods, n, -1), price)
        size = np.sqrt((each**2).sum(axis=0))
        each = each * np.minimum(1.0, _LOUD * np.median(size) / np.maximum(size, 1e-30))
        (torch.from_numpy(each.reshape(-1).astype(np.float32)) * commands).sum().backward()


def _earlier(start: str | None, seed: int) -> Policy | None:
    """Of a seed in a shipped set or in a folder of an earlier training; none: None. Raises InputError."""
    if start is None:
        return None
    files = shipped_policies("frame").get(start, ())
    if not files and not Path(start).is_dir():
        raise InputError(
            f"adjoint: hyperparameters: start is {start!r}; allowed: none, a shipped set, or a folder of a training"
        )
    return Policy.read(files[seed % len(files)] if files else Path(start) / f"seed_{seed}" / "policy.json")


def _continued(policy: Policy, observer: Observer, own: NDArray[np.float32]) -> NDArray[np.float32]:
    """(inputs, observer.size): the inputs of an earlier policy, then the states of filters that there are besides.

    own: (columns with a sign, observer.size), a whitening of them, whose rows the new states take. Raises InputError.
    """
    before = policy.observer
    first, second = (o.filter.matrices[0] if o.filter else np.zeros((0, 0)) for o in (before, observer))
    many = len(first)
    same = before.names == observer.names[: before.size] and np.allclose(second[:many, :many], first)
    if not same or policy.network.layers[-1][1].shape != (2,) or policy.teacher is None:
        raise InputError(
            "adjoint: start: not a policy of this learner whose observations these begin with; "
            "set env_kwargs, estimator and ground as there"
        )
    kept = policy.transform[: len(policy.transform) // 2]
    fresh = own[[list(observer.without_peaks).index(j) for j in range(before.size, observer.size)]].copy()
    fresh[:, : before.size] = 0.0
    return np.vstack([np.pad(kept, ((0, 0), (0, len(fresh)))), fresh]).astype(np.float32)


def _alike(one: ForceLevels | None, other: ForceLevels | None) -> bool:
    """True for the same levels of force but for rounding."""
    if one is None or other is None:
        return one is other
    near = len(one.forces) == len(other.forces) and np.allclose(one.forces, other.forces, rtol=1e-9, atol=0.0)
    return near and replace(one, forces=other.forces) == other
