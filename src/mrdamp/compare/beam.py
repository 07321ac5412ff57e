"""The best command sequence for a load that is known in advance, by beam search on the chain.

Period by period every level of the command is tried from each of the runs that are kept, and those with the least cost
are kept: what it was so far and an estimate of what is to come. No slopes are needed: with a damper that sticks they
hold for changes of about a hundredth of the command alone. What is found can be reached, and the true optimum is as
good or better.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from mrdamp.compare.bench import UNCONTROLLED, WINDOW, PlantBench
from mrdamp.control.passive import Replay
from mrdamp.model.core import Array
from mrdamp.simulation.rows import ChainRows, Stepping

#: Of the rows, (n,): what the last period cost, and what is to come after a number of periods.
Cost = Callable[[ChainRows], Array]
Estimate = Callable[[ChainRows, int], Array]


#: Runs that are kept, one search after the other: their values show how far the search has converged.
WIDTHS = (4, 16, 64)


@dataclass(frozen=True)
class Found:
    """commands (periods,) and cost of the best run; costs: the least after each search."""

    commands: Array
    cost: float
    costs: tuple[float, ...]


class ToCome:
    """Sum of squares to come, up to what depends on no state: of x+ = a x + b w, with x^T cost x at the start of each
    step, that of now among them or not. Linear-quadratic, backwards in time.

    a (n, n), b (n, k), cost (n, n); pushes (steps, k): w; inner: steps a period; states: (rows, n) x of rows.
    """

    def __init__(
        self, a: Array, b: Array, cost: Array, pushes: Array, inner: int, states: Callable[[ChainRows], Array],
        *, now: bool,
    ) -> None:  # fmt: skip
        whole = solve_discrete_lyapunov(a.T, cost)
        self._square, self._states = whole if now else whole - cost, states
        self._linear = np.zeros((len(pushes) // inner + 1, len(a)))
        x, pushed = np.zeros(len(a)), whole @ b
        for k in range(len(pushes) - 1, -1, -1):
            x = a.T @ (x + pushed @ pushes[k])
            if k % inner == 0:
                self._linear[k // inner] = x

    def __call__(self, plants: ChainRows, period: int) -> Array:
        """(rows,) after a number of periods."""
        x = self._states(plants)
        return np.asarray(np.einsum("ni,ij,nj->n", x, self._square, x) + 2 * x @ self._linear[period])


def search(
    make: Callable[[int], ChainRows],
    periods: int,
    levels: Array,
    cost: Cost,
    to_come: Estimate,
    widths: Sequence[int] = WIDTHS,
) -> Found:
    """The best commands out of levels (levels,) that beams of each width find.

    make: rows at the start under the load, from their number.
    """
    found = [_one(make(width * len(levels)), periods, width, levels, cost, to_come) for width in widths]
    commands, least = min(found, key=lambda pair: pair[1])
    costs = np.minimum.accumulate([value for _, value in found])
    return Found(commands, least, tuple(costs.tolist()))


def _one(
    rows: ChainRows, periods: int, width: int, levels: Array, cost: Cost, to_come: Estimate
) -> tuple[Array, float]:
    """Commands (periods,) and their cost."""
    many = len(levels)
    given = np.tile(levels, width)[:, None]
    states, so_far = rows.state[:1].copy(), np.zeros(1)
    parents, chosen = [], []
    for k in range(periods):
        used = len(states) * many
        rows.state[:used] = np.repeat(states, many, axis=0)
        rows.advance(given)
        total = np.repeat(so_far, many) + cost(rows)[:used]
        kept = np.argsort(total + to_come(rows, k + 1)[:used], kind="stable")[:width]
        states, so_far = rows.state[kept].copy(), total[kept]
        parents.append(kept // many)
        chosen.append(kept % many)
    at = best = int(np.argmin(so_far))
    commands = np.empty(periods)
    for k in range(periods - 1, -1, -1):
        commands[k] = levels[chosen[k][at]]
        at = parents[k][at]
    return commands, float(so_far[best])


def least(judged: Sequence[Mapping[str, float]], weights: Mapping[str, float]) -> dict[str, float]:
    """Measures of the run with the least weighted sum of them."""
    return dict(min(judged, key=lambda values: sum(w * values[key] for key, w in weights.items())))


def started(bench: PlantBench, chain: Callable[[Any, Stepping], Any], step: float, load: Any, n: int) -> Any:
    """n of a bench's structures on the chain, in steps of `step` (s) at most, at the start of a load."""
    stepping = Stepping(bench.period, min(bench.period, step), np.array([bench.command_max]), n)
    made = chain(bench.structure, stepping)
    made.window = WINDOW
    for row in range(n):
        made.start(row, load)
    return made


def judged(
    bench: PlantBench, name: str, start: str, load: Any, amplitude: float, commands: Array, values: Sequence[float]
) -> dict[str, Any]:
    """A bound's entry of what a search gives: found commands (periods,) in the bench's engine, or a better run.

    start: spec of a controller; values: what was made small after every step of the search.
    """
    uncontrolled = bench.run(UNCONTROLLED, load, amplitude)
    replayed = bench.driven(Replay(commands, bench.period, name), load, amplitude)
    runs = replayed, bench.run(start, load, amplitude)
    return {
        "values": least([bench.values(run, uncontrolled) for run in runs], bench.bounds[name]),
        "paths": [{"start": "beam", "values": list(values), "ended": "widest beam"}],
    }
