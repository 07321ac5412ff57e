"""Pruning: weights, or whole neurons and lags, with the course of the free-run error.

Optimal brain surgeon (Hassibi, Stork and Wolff, ICNN 1993, doi 10.1109/ICNN.1993.298572): the weights whose removal
raises the objective least, the others corrected by the Hessian; then free-run retraining of what is left. By
"structure" the same measure is taken of all weights of a neuron, or of an input with its lag, at once.
The work that the foam-damper paper (Zapateiro, Luo, Taylor and Dyke, Section 6) leaves for the future.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure
from scipy import linalg
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from mrdamp.errors import InputError
from mrdamp.identify import pooled
from mrdamp.model.core import Array
from mrdamp.narx import network as nn
from mrdamp.narx.bayes import Posterior, minimise
from mrdamp.narx.data import Series
from mrdamp.narx.evaluation import START, free_run_error, one_step_error
from mrdamp.narx.network import Network
from mrdamp.narx.problems import FreeRun
from mrdamp.parallel import Progress, silent
from mrdamp.pictures import style

METHODS = ("surgeon", "magnitude", "structure")


@dataclass(frozen=True, eq=False)
class Step:
    """One network on the way: weights that are not zero, its errors (NRMSE, validation), units and inputs left."""

    network: Network
    weights: int
    one_step: float
    free_run: float
    units: tuple[int, ...]
    inputs: int


@dataclass(frozen=True, eq=False)
class Pruned:
    """The course from the whole network down, and the smallest one within `tolerance` of the best."""

    steps: tuple[Step, ...]
    smallest: Network
    tolerance: float

    @property
    def best(self) -> float:
        """Least free-run error on the way (NRMSE)."""
        return min(step.free_run for step in self.steps)


def prune(
    network: Network,
    train: Sequence[Series],
    validation: Sequence[Series],
    *,
    share: float = 0.12,
    tolerance: float = 0.1,
    least: int = 8,
    horizon: int | None = 100,
    most: int | None = 4000,
    iterations: int = 25,
    method: str = "surgeon",
    progress: Progress | None = None,
) -> Pruned:
    """Removes weights until the free-run error is far above the best, and gives the smallest good network.

    network: trained for free run. train: parts to retrain on; validation: for evaluation. share: part of the remaining
    weights that goes at a time. tolerance: how much worse than the best the smallest network may be, relative. least:
    weights at which it stops. horizon: samples of the free runs that it is retrained on, None: whole splits; most:
    samples at most; iterations: retraining steps each time. method: `surgeon`; `magnitude` (the smallest weights go);
    `structure` (whole neurons and lags, one by one). Raises InputError.
    """
    if method not in METHODS:
        raise InputError(f"pruning by '{method}'; allowed: {', '.join(METHODS)}")
    if not 0.0 < share < 1.0 or not tolerance > 0.0:
        raise InputError(
            f"pruning: share {share:g}, tolerance {tolerance:g}; allowed: 0 < share < 1, tolerance > 0"
        )
    if not train or not validation:
        raise InputError("pruning needs training and validation records")
    skip = int(START / network.sample_time)
    problem = FreeRun.of(network, train, horizon, most, skip=skip)
    free, say = network.theta != 0.0, progress or silent
    with threadpool_limits(limits=1):  # the same network on every machine
        # The whole network gets the same retraining first, so that the course compares like with like.
        posterior = minimise(problem, network.theta, free=free, iterations=2 * iterations, tolerance=1e-4)
        steps = [_step(network, network.theta, validation), _step(network, posterior.theta, validation)]
        begin = int(free.sum())
        while free.sum() > least:
            gone = float(np.log(free.sum() / begin) / np.log(least / begin))
            say(f"{int(free.sum())} weights, free-run error {100 * steps[-1].free_run:.2f} %", gone)
            number = min(max(1, int(share * free.sum())), int(free.sum()) - least)
            theta = _without(network, posterior, free, number, method)
            theta, free = _drop_dead(network, theta, free)
            if not np.isfinite(problem.cost(theta)):
                theta = np.where(free, posterior.theta, 0.0)  # the correction went too far: without it
                if not np.isfinite(problem.cost(theta)):
                    break
            posterior = minimise(
                problem, theta, alpha=posterior.alpha, free=free, iterations=iterations, tolerance=1e-4
            )
            # Retrained on the training records, it may be worse on the others than it was.
            found = [_step(network, p, validation) for p in (theta, posterior.theta)]
            steps.append(min(found, key=lambda s: s.free_run))
            if steps[-1].free_run > 5.0 * min(s.free_run for s in steps):
                break
    limit = (1.0 + tolerance) * min(s.free_run for s in steps)
    good = min((s for s in steps if s.free_run <= limit), key=lambda s: s.weights)
    return Pruned(tuple(steps), good.network, tolerance)


def compact(network: Network) -> Network:
    """The same function without units that nothing reads and inputs that no unit reads.

    A unit that reads nothing is a constant and becomes part of the next layer's bias.
    """
    layers = [(weight.copy(), bias.copy()) for weight, bias in network.layers]
    changed = True
    while changed and len(layers) > 1:
        changed = False
        for k in range(len(layers) - 1):
            weight, bias = layers[k]
            after, next_bias = layers[k + 1]
            constant = np.asarray(~weight.any(axis=1))
            dead = np.asarray(constant | ~after.any(axis=0))
            if dead.any() and len(bias) > 1:
                if dead.all():
                    dead[0] = False
                next_bias = next_bias + after[:, constant & dead] @ np.tanh(bias[constant & dead])
                layers[k] = (weight[~dead], bias[~dead])
                layers[k + 1] = (after[:, ~dead], next_bias)
                changed = changed or bool(dead.any())
    used = np.asarray(layers[0][0].any(axis=0))
    if not used.any():
        used[0] = True
    layers[0] = (layers[0][0][:, used], layers[0][1])
    keep = np.flatnonzero(used)
    return Network(
        network.sample_time, tuple(network.inputs[k] for k in keep), network.offset[keep], network.scale[keep],
        network.force_offset, network.force_scale, tuple(len(bias) for _, bias in layers[:-1]), nn.pack(layers),
    )  # fmt: skip


@style.styled
def draw_pruning(pruned: Pruned) -> Figure:
    """Validation error over the number of weights, with the smallest good network marked."""
    fig = style.figure(2.6)
    axes = style.axes_grid(fig, 1, 1)[0][0]
    weights = [s.weights for s in pruned.steps]
    for k, (label, name) in enumerate((("free run", "free_run"), ("one step ahead", "one_step"))):
        values = [100.0 * min(getattr(s, name), 10.0) for s in pruned.steps]
        axes.plot(weights, values, color=style.COLOURS[k], ls=style.DASHES[k], marker=style.MARKERS[k], ms=3.5,
                  label=label)  # fmt: skip
    axes.axhline(100.0 * (1.0 + pruned.tolerance) * pruned.best, color=style.REFERENCE, lw=0.8)
    axes.axvline(pruned.smallest.nonzero, color=style.REFERENCE, lw=0.8)
    style.log_percent(axes)
    axes.set_xlabel("weights and biases left")
    axes.set_ylabel("error, % of std")
    note = f"smallest: {pruned.smallest.topology}, {pruned.smallest.nonzero} weights"
    style.row_title(axes, axes, "Pruning", note)
    handles, texts = axes.get_legend_handles_labels()
    style.legend(fig, handles, texts)
    return fig


def _step(network: Network, theta: Array, validation: Sequence[Series]) -> Step:
    net = compact(network.with_theta(theta))
    one, free = (pooled([error(net, s) for s in validation]) for error in (one_step_error, free_run_error))
    free = free if np.isfinite(free) else float("inf")
    return Step(net, net.nonzero, one, free, net.hidden, len(net.inputs))


def _without(network: Network, posterior: Posterior, free: Array, number: int, method: str) -> Array:
    """Weights (M,) with some of the free ones zero, the others corrected: `number` of them, or one group."""
    moving = np.flatnonzero(free)
    theta = posterior.theta.copy()
    if method == "magnitude":
        theta[moving[np.argsort(np.abs(theta[moving]), kind="stable")[:number]]] = 0.0
        return theta
    p = theta[moving]
    # Directions that the data say nothing about count as barely known.
    values, vectors = linalg.eigh(posterior.hessian, check_finite=False)
    inverse = vectors / np.maximum(values, 1e-12 * values[-1]) @ vectors.T
    if method == "structure":
        place = np.full(len(theta), -1)
        place[moving] = np.arange(len(moving))
        groups = [place[group[free[group]]] for group in _groups(network)]
        # Of the least rise of the objective per weight when these go and the others make up for it.
        out = min(filter(len, groups), key=lambda g: p[g] @ np.linalg.solve(inverse[np.ix_(g, g)], p[g]) / len(g))
    else:
        out = np.argsort(p**2 / np.diag(inverse), kind="stable")[:number]
    # All of them at once: the least rise of the quadratic model with these weights at zero.
    p = p - inverse[:, out] @ np.linalg.solve(inverse[np.ix_(out, out)], p[out])
    p[out] = 0.0
    theta[moving] = p
    return theta


def _groups(network: Network) -> list[Array]:
    """Positions in theta of the weights of every unit (into it, its bias, out of it) and of every input."""
    # Positions as floats, so that the same code takes them apart.
    numbers = nn.unpack(np.arange(len(network.theta), dtype=float), len(network.inputs), network.hidden)
    groups = [numbers[0][0][:, k] for k in range(len(network.inputs))]
    for (weight, bias), (after, _) in pairwise(numbers):
        groups += [np.concatenate([weight[k], bias[k : k + 1], after[:, k]]) for k in range(len(bias))]
    return [group.astype(int) for group in groups]


def _drop_dead(network: Network, theta: Array, free: Array) -> tuple[Array, Array]:
    """Takes out what cannot matter any more: weights into units that nothing reads, and out of units at zero."""
    free = free & (theta != 0.0)
    theta = np.where(free, theta, 0.0)
    while True:
        layers = nn.unpack(theta, len(network.inputs), network.hidden)
        before = np.count_nonzero(theta)
        for (weight, bias), (after, _) in pairwise(layers):
            unread = ~after.any(axis=0)
            weight[unread], bias[unread] = 0.0, 0.0
            after[:, ~weight.any(axis=1) & (bias == 0.0)] = 0.0
        if np.count_nonzero(theta) == before:
            return theta, theta != 0.0
