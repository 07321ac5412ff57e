"""Clairvoyant commands of a quarter car's damper: searched for on the chain, evaluated in the bench's own engine."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import expm, solve_discrete_lyapunov

from mrdamp.compare.beam import Beam, judged, search, started
from mrdamp.compare.bench import UNCONTROLLED
from mrdamp.compare.car import CarBench
from mrdamp.envs.frame_rows import PERIOD, CarChain
from mrdamp.model.core import Array
from mrdamp.simulation.comfort import STATES, wk_sections
from mrdamp.simulation.roads import Road
from mrdamp.simulation.rows import ChainRows
from mrdamp.structures.cars import QuarterCar

_STEP = 1e-3  # s, of the chain at most
#: Dashpots of the estimate of what is to come, over the critical one. The narrowest beam tries all of them, the wider
#: ones go on with the best. On three to five validation roads .35 is better than .1, .2 and .5 for both criteria, and
#: .25 than .35 for comfort.
_DASHPOTS = (0.15, 0.25, 0.35)
#: Commands over the largest: fine where the damper is near a passive suspension's. Other ones were not tried.
_LEVELS = (0.0, 0.025, 0.05, 0.1, 0.2, 0.4, 1.0)
_COLUMNS = {key: PERIOD.index(key) for key in ("comfort", "load")}


def car_bound(
    bench: CarBench, starts: Mapping[str, Sequence[str]], road: Road, amplitude: float
) -> dict[str, Any]:
    """For `mrdamp.compare.bound`. The best start takes the place of a found run that is worse.

    A bound's weights are of ratios of RMS values, a beam's cost is a sum of squares: it is that of the slopes at the
    ratios that were found before.
    """
    scaled, linear = road.scaled(amplitude), bench.run(UNCONTROLLED, road, amplitude)
    rows = partial(started, bench, CarChain, _STEP, scaled)
    first = rows(1)
    periods, levels = int(first.steps[0]), bench.command_max * np.array(_LEVELS)
    pushes = first.pushes(scaled)

    def ratios(commands: Array) -> dict[str, float]:
        plants, total = rows(1).plants, np.zeros(len(PERIOD))
        for command in commands:
            total += plants.advance(np.array([[command]]))[0][0]
        return {key: math.sqrt(total[k] / periods / linear[key]) for key, k in _COLUMNS.items()}

    def beam(width: int, dashpot: float, slopes: Mapping[str, float]) -> Array:
        to_come = ToCome(bench.car, pushes, first.plants.inner, periods, slopes, dashpot)

        def cost(plants: ChainRows) -> Array:
            return np.asarray(sum(s * plants.criteria[:, _COLUMNS[key]] for key, s in slopes.items()))

        return search(lambda n: rows(n).plants, periods, levels, cost, to_come, Beam((width,))).commands

    out = {}
    for name, weights in bench.bounds.items():
        found: list[tuple[float, dict[str, float], float, Array]] = []
        dashpots: tuple[float, ...] = _DASHPOTS
        values: list[float] = []
        for width in Beam().widths:
            at = found[0][1] if found else dict.fromkeys(weights, 1.0)
            slopes = {key: w / (2 * at[key] * linear[key]) for key, w in weights.items()}
            for dashpot in dashpots:
                commands = beam(width, dashpot, slopes)
                reached = ratios(commands)
                value = sum(w * reached[key] for key, w in weights.items())
                found.append((value, reached, dashpot, commands))
            found.sort(key=lambda one: one[0])
            values.append(found[0][0])
            dashpots = (found[0][2],)
        out[name] = judged(bench, name, starts[name][0], road, amplitude, found[0][3], values)
    return out


class ToCome:
    """Sum of weighted squares to come, up to what depends on no state: of the car with a dashpot in the damper's place
    and a tyre that holds contact, on the road. Linear-quadratic, backwards in time.

    pushes: (steps,) of the road's acceleration, m/s2, means over the chain's steps; inner: steps a period; slopes: of
    the period's means, `comfort` and `load`; dashpot: over the critical one.
    """

    def __init__(
        self,
        car: QuarterCar,
        pushes: Array,
        inner: int,
        periods: int,
        slopes: Mapping[str, float],
        dashpot: float,
    ) -> None:
        a, b, out = weighted_car(car, dashpot * car.critical_damping, _STEP)
        cost = sum(s / inner * np.outer(out[key], out[key]) for key, s in slopes.items())
        self._square = solve_discrete_lyapunov(a.T, cost)
        self._linear = np.zeros((periods + 1, len(a)))
        now, pushed = np.zeros(len(a)), self._square @ b
        for k in range(inner * periods - 1, -1, -1):
            now = a.T @ (now + pushed * pushes[k])
            if k % inner == 0:
                self._linear[k // inner] = now

    def __call__(self, plants: ChainRows, period: int) -> Array:
        """(n,) after a number of periods."""
        x = np.concatenate([plants.coordinates(), plants.velocities(), plants.weighting()], axis=1)
        return np.asarray(np.einsum("ni,ij,nj->n", x, self._square, x) + 2 * x @ self._linear[period])


def weighted_car(car: QuarterCar, dashpot: float, step: float) -> tuple[Array, Array, dict[str, Array]]:
    """Discrete a (12, 12) and b (12,) of the car with its weighting filter, from the road's acceleration.

    Returns them and rows (12,) of the weighted acceleration (`comfort`, m/s2) and the tyre load over its static value,
    less one (`load`).

    dashpot: N s/m in the damper's place; step: s. States: heights of wheel and body over the road, their rates, and the
    filter's states in the order of `mrdamp.simulation.rows.ChainRows.weighting`.
    """
    k, c, kt, ct = car.stiffness, car.damping + dashpot, car.tyre_stiffness, car.tyre_damping
    strut = np.array([-k, k, -c, c])
    tyre = np.array([kt, 0.0, ct, 0.0])
    system = np.zeros((5, 5))
    system[0, 2] = system[1, 3] = 1.0
    system[2, :4], system[3, :4] = (strut - tyre) / car.wheel, -strut / car.body
    system[2:4, 4] = -1.0
    moved = expm(step * system)
    n = 4 + STATES
    a, b = np.zeros((n, n)), np.zeros(n)
    a[:4, :4], b[:4] = moved[:4, :4], moved[:4, 4]
    signal = np.zeros(n)
    signal[:4] = -strut / car.body  # of the body, absolute
    unit = np.eye(n)
    for i, (b0, b1, b2, _, a1, a2) in enumerate(wk_sections(step)):
        one, two = 4 + 2 * i, 5 + 2 * i
        passed = b0 * signal + unit[one]
        a[one] = b1 * signal - a1 * passed + unit[two]
        a[two] = b2 * signal - a2 * passed
        signal = passed
    return a, b, {"comfort": signal, "load": np.append(-tyre / car.weight, np.zeros(STATES))}
