"""Policies of the frame on other stiffnesses and masses: the mean of J1 and J2 less passive-on's, by paired intervals.

    python tools/structure_study.py [--shares -0.1 0 0.1] NAME=FILE [FILE ...] ...

All storeys alike by each share. Twelve synthetic motions at seven amplitudes that no training or choice has seen
(`reported_motions` of `mrdamp.envs.training_loads`), on the C++ chain at .5 ms; 95 % over motions and seeds. The files
of a name are seeds of one training.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.compare.comparison import difference
from mrdamp.control.policy import Policy
from mrdamp.envs import Frame, default_damper
from mrdamp.envs.randomise import varied
from mrdamp.envs.task import episodes
from mrdamp.envs.training_loads import by_motion, reported_motions
from mrdamp.model import Model
from mrdamp.structures import dyke1996
from mrdamp.train.worlds import World, forces

PERIOD = 0.002


def main(arguments: list[str] | None = None) -> int:
    """Prints a row for each structure."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("policies", nargs="+", metavar="NAME=FILE", help="a policy's seeds; further FILEs belong to it")
    p.add_argument("--shares", nargs="+", type=float, default=[-0.1, -0.05, 0.0, 0.05, 0.1])
    a = p.parse_args(arguments)
    named: dict[str, list[Policy]] = {}
    for each in a.policies:
        name, equals, file = each.rpartition("=")
        named.setdefault(name if equals else list(named)[-1], []).append(Policy.read(Path(file)))
    loads = reported_motions()
    print("| structure | passive-on |", *(f"{name} | less passive-on | worse |" for name in named))
    print("|---|---:|", *("---:|---|---:|" for _ in named))
    rows: list[tuple[str, dict[str, float]]] = [("as trained", {})] if 0.0 in a.shares else []
    rows += [(f"{what} {100 * x:+.0f} %", {what: 1 + x}) for what in ("stiffness", "mass") for x in a.shares if x]
    for said, factors in rows:
        model = varied(_frame(), factors)
        on = _score(model, loads, None)
        cells = [f"| {said} | {on.mean():.4f} |"]
        for seeds in named.values():
            found = np.array([_score(model, loads, policy) for policy in seeds])
            less = difference(by_motion(found), by_motion(on[None]))
            worse = int((found.mean(axis=0) > on).sum())
            cells.append(f"{found.mean():.4f} | {less.mean:+.4f} ({less.low:+.4f} to {less.high:+.4f}) | {worse} |")
        print(" ".join(cells), flush=True)
    return 0


def _frame() -> Model:
    damper = default_damper()
    return Model(damper.law, damper.parameters, damper.effects, "frame", dyke1996(), name="frame")


def _score(model: Model, loads: list[Any], policy: Policy | None) -> NDArray[np.float64]:
    """(loads,) means of J1 and J2; None: the largest command."""
    own = {"model": model, "period": PERIOD}
    world = World(Frame, own if policy is None else {**own, "period": policy.period, "observer": policy.observer})
    task = world.searching(len(loads))
    if policy is not None:
        policy.reset()

    def act(seen: NDArray[np.float32]) -> NDArray[np.float64]:
        if policy is None:
            return np.full(len(seen), float(task.command_max[0]))
        return policy.commands(seen, forces(task, seen))

    found = episodes(task, world.measures, loads, act)
    return np.asarray((found["drift_ratio"] + found["acceleration_ratio"]) / 2)


if __name__ == "__main__":
    sys.exit(main())
