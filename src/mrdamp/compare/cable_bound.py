"""Clairvoyant commands of a cable's damper: searched for on the chain, evaluated in the bench's own engine."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_lyapunov
from scipy.signal import cont2discrete

from mrdamp.compare.beam import judged, search, started
from mrdamp.compare.bench import UNCONTROLLED
from mrdamp.compare.cable import CableBench
from mrdamp.envs.linear_rows import CableChain
from mrdamp.envs.loads import CableLoad
from mrdamp.model.core import Array
from mrdamp.simulation.rows import ChainRows
from mrdamp.structures.cables import StayCable

#: s, of the chain at most. The motion is up to 2.2 % below that in MuJoCo at 0.25 ms, .2 % in the median of 18
#: cases; at 1 ms it was 3 % in one of two.
_STEP = 5e-4
#: Damping of the modes in the estimate of what is to come: about what the damper adds. Of .01 to .1 the one with the
#: least motion under one ambient load, and among .01, .02 and .05 under one wind load.
_RATIO = 0.05


def cable_bound(
    bench: CableBench, starts: Mapping[str, Sequence[str]], load: CableLoad, amplitude: float
) -> dict[str, Any]:
    """For `mrdamp.compare.bound`. The best start takes the place of a found run that is worse."""
    scaled, whole = load.scaled(amplitude), bench.cable.mass * bench.cable.length
    uncontrolled = bench.run(UNCONTROLLED, load, amplitude)
    rows = partial(started, bench, CableChain, _STEP, scaled)
    periods = int(rows(1).steps[0])
    forces = bench.cable.forces(scaled.force, scaled.places)
    to_come = ToCome(bench.cable, forces, scaled.sample_time, bench.period, periods)

    def cost(plants: ChainRows) -> Array:
        return np.asarray(np.square(plants.coordinates()).sum(axis=1))

    found = search(lambda n: rows(n).plants, periods, np.array([0.0, bench.command_max]), cost, to_come)
    values = [math.sqrt(c / periods / whole) / uncontrolled["motion"] for c in found.costs]
    return {
        name: judged(bench, name, starts[name][0], load, amplitude, found.commands, values)
        for name in bench.bounds
    }


class ToCome:
    """Sum of the squares of the modes' coordinates at the ends of the periods to come, up to what depends on no state:
    of modes that are damped by _RATIO, without the damper, under the load. Linear-quadratic, backwards in time.

    forces (samples, modes), N, every sample_time, s.
    """

    def __init__(
        self, cable: StayCable, forces: Array, sample_time: float, period: float, periods: int
    ) -> None:
        damped = replace(cable, ratio=_RATIO)
        many = len(damped.natural)
        a, self._square, b = np.empty((many, 2, 2)), np.empty((many, 2, 2)), np.empty((many, 2))
        for i, w in enumerate(damped.natural):
            system = np.array([[0.0, 1.0], [-w * w, -2 * _RATIO * w]]), np.array([[0.0], [1.0]])
            a[i], step = cont2discrete((*system, np.eye(2), np.zeros((2, 1))), period)[:2]
            b[i] = step[:, 0]
            # Without the present coordinate, which is among what was so far.
            self._square[i] = solve_discrete_lyapunov(a[i].T, a[i].T @ np.diag([1.0, 0.0]) @ a[i])
        middle = period * (np.arange(periods) + 0.5)
        samples = sample_time * np.arange(len(forces))
        push = np.stack([np.interp(middle, samples, column) for column in forces.T], axis=1)
        now = self._square + np.diag([1.0, 0.0])
        self._linear = np.zeros((periods + 1, many, 2))
        for k in range(periods - 1, -1, -1):
            after = self._linear[k + 1] + np.einsum("nij,nj->ni", now, b * push[k][:, None])
            self._linear[k] = np.einsum("nij,ni->nj", a, after)

    def __call__(self, plants: ChainRows, period: int) -> Array:
        """(n,) after a number of periods."""
        x = np.stack([plants.coordinates(), plants.velocities()], axis=-1)
        square = np.einsum("mni,nij,mnj->m", x, self._square, x)
        return np.asarray(square + 2 * np.einsum("mni,ni->m", x, self._linear[period]))
