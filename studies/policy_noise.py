"""Policies of the frame under noise of their sensors: peak drift and peak acceleration on 12 motions at 7 amplitudes.

    python -m studies.policy_noise [--noise S ...] POLICY.json ...

White noise on every measurement, S times the observer's unit of it (5 m/s2, 4.3 mm, 1.4 kN), on the chain at 1 ms. The
policies are seeds of one training. Prints the means over motions and seeds, and the mean of both less passive-on's,
with its 95 % interval over motions and seeds. No policy was trained or chosen on these motions.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from mrdamp.compare.comparison import interval
from mrdamp.control.policy import Policy
from mrdamp.envs.frame import Frame
from mrdamp.envs.task import Task, episodes
from mrdamp.envs.training_loads import by_motion, reported_motions
from mrdamp.errors import InputError
from mrdamp.train.worlds import World, forces

_STEP = 1e-3  # s, of the chain: peaks are within .3 % of those of a quarter of it


def peaks(policies: list[Policy], noise: float) -> tuple[np.ndarray, np.ndarray]:
    """(seeds, motions, 2) drift and acceleration over the uncontrolled ones, and (motions, 2) those of passive-on."""
    first = policies[0]
    o, world = first.observer, World(Frame, {"period": first.period, "timestep": _STEP, "observer": first.observer})
    loads = reported_motions()
    deviation = {name: noise * unit for name, unit in zip(o.signals, o.scales, strict=True)}
    found = []
    for policy in [None, *policies]:
        given = {**world.arguments, **({"observer": policy.observer} if policy else {}), "noise": deviation}
        own = World(Frame, given)
        task = own.searching(len(loads))

        def act(seen: np.ndarray, policy: Policy | None = policy, task: Task = task) -> np.ndarray:
            if policy is None:
                return np.full(len(seen), first.command_max)
            return policy.commands(seen, forces(task, seen))

        if policy is not None:
            policy.reset()
        values = episodes(task, own.measures, loads, act)
        found.append(np.column_stack([values["drift_ratio"], values["acceleration_ratio"]]))
    return np.array(found[1:]), found[0]


def main(arguments: list[str] | None = None) -> int:
    """Prints a row of the table for each noise."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("policies", nargs="+", type=Path, metavar="POLICY.json")
    p.add_argument("--noise", nargs="+", type=float, default=[0.0, 2e-4, 5e-4, 1e-3], metavar="S")
    a = p.parse_args(arguments)
    if not all(0 <= s < np.inf for s in a.noise):
        p.exit(2, f"policy_noise: noise is {a.noise}; allowed: numbers >= 0\n")
    try:
        policies = [Policy.read(file) for file in a.policies]
        if any(q.observer.signals != policies[0].observer.signals for q in policies):
            raise InputError("the policies' signals differ; give seeds of one training")
    except InputError as error:
        p.exit(2, f"policy_noise: {error}\n")
    print("| noise | drift | acceleration | mean of both less passive-on |\n|---|---:|---:|---|")
    for noise in a.noise:
        found, base = peaks(policies, noise)
        less = (found - base).mean(axis=2)
        low, high = interval(by_motion(less))
        drift, acceleration = found.mean(axis=(0, 1))
        print(
            f"| {noise:g} | {drift:.3f} | {acceleration:.3f} | {less.mean():+.3f} ({low:+.3f} to {high:+.3f}) |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
