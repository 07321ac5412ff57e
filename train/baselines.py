"""The classical rivals of the frame's policies, tuned on loads as the policies are trained on, by the same score.

    python -m mrdamp.train.baselines -o out/baselines

prints the best constant command and the best clipped-optimal controller as specs for `mrdamp compare --controllers`.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from mrdamp.commands.output import progress_bar
from mrdamp.compare.frame import FrameBench
from mrdamp.compare.tuning import run_grid
from mrdamp.control import registry
from mrdamp.envs.plant import placed
from mrdamp.train.loads import some_motions
from mrdamp.train.worlds import FrameWorld

LOADS = 16


def grids(bench: FrameBench) -> Mapping[str, Sequence[str]]:
    """Specs tried by kind: weight of the drifts to the accelerations, of the force, and of the filter's noises."""
    unit = 1 / float(bench.site.frame.mass.sum()) ** 2
    options = itertools.product((0.3, 1.0, 3.0, 10.0, 100.0, 300.0), (1e-5 * unit, 1e-1 * unit), (5.0, 50.0))
    names = ("balance", "r", "noise_ratio")
    return {
        "constant": bench.grid("constant"),
        "clipped-optimal": [
            registry.spec("clipped-optimal", dict(zip(names, point, strict=True))) for point in options
        ],
    }


def tuned(out: Path, seed: int = 0, jobs: int = 1) -> dict[str, tuple[str, float]]:
    """Best spec and its score by kind, on LOADS motions that `seed` draws as a training does; out keeps the runs."""
    bench = FrameBench(placed(None, None, None)[0], compression=1.0)
    loads = some_motions(np.random.default_rng(np.random.SeedSequence(seed).spawn(3)[0]), LOADS)
    cases = [(load, 1.0) for load in loads]
    tried = grids(bench)
    world = FrameWorld({})
    with progress_bar() as progress:
        every = [spec for specs in tried.values() for spec in specs]
        found = run_grid(bench, every, cases, jobs=jobs, keep=out, progress=progress, what="baselines")
    scores = {}
    for spec, rows in found.items():
        means = {key: float(np.mean([row[key] for row in rows])) for key in ("J1", "J2")}
        scores[spec] = world.score({"drift_ratio": means["J1"], "acceleration_ratio": means["J2"]})
    best = {kind: min(specs, key=scores.__getitem__) for kind, specs in tried.items()}
    return {kind: (spec, scores[spec]) for kind, spec in best.items()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("-o", "--out", type=Path, required=True)
    arguments = parser.parse_args()
    for kind, (spec, score) in tuned(arguments.out, arguments.seed, arguments.jobs).items():
        print(f"{kind:16s} {score:.4f}  {spec}")
