"""The classical rivals of the frame's policies, tuned on loads as the policies are trained on, by the same score.

    python -m mrdamp.train.baselines -o out/baselines.jsonl

prints the best constant command and the best clipped-optimal controller as specs for `mrdamp compare --controllers`.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import numpy as np

from mrdamp.commands.output import progress_bar
from mrdamp.compare.frame import FrameBench
from mrdamp.compare.tuning import run_grid
from mrdamp.control import registry
from mrdamp.envs.plant import placed
from mrdamp.train.evaluate import Judge
from mrdamp.train.loads import some_motions
from mrdamp.train.settings import Options, settings
from mrdamp.train.worlds import FrameWorld

LOADS = 32  # of clipped-optimal's grid
MANY = 160  # of the constant commands, which all run at once


def grid(bench: FrameBench) -> list[str]:
    """Specs of clipped-optimal: weight of the drifts to the accelerations, of the force, and of the filter's noises."""
    unit = 1 / float(bench.site.frame.mass.sum()) ** 2
    options = itertools.product((0.3, 1.0, 3.0, 10.0, 100.0, 300.0), (1e-3 * unit, 1e-1 * unit), (5.0, 50.0))
    names = ("balance", "r", "noise_ratio")
    return [registry.spec("clipped-optimal", dict(zip(names, point, strict=True))) for point in options]


def best_constant(world: FrameWorld, rng: np.random.Generator) -> tuple[str, float]:
    """The best of 20 constant commands on MANY motions as generations of the evolution strategy draw them."""
    judge = Judge(world, [motion for _ in range(MANY // 20) for motion in some_motions(rng, 20)])
    largest = float(judge.task.command_max[0])
    scores = {}
    for command in largest * np.arange(1, 21) / 20:
        means = {name: float(v.mean()) for name, v in judge(float(command)).items()}
        scores[f"constant:value={command:.6g}"] = world.score(means)
    best = min(scores, key=scores.__getitem__)
    return best, scores[best]


def best_clipped_optimal(
    world: FrameWorld, rng: np.random.Generator, out: Path, jobs: int
) -> tuple[str, float]:
    """The best of `grid` on LOADS such motions; `out` keeps the runs."""
    bench = FrameBench(placed(None, None, None)[0], compression=1.0)
    cases = [(load, 1.0) for load in some_motions(rng, LOADS)]
    with progress_bar() as progress:
        found = run_grid(bench, grid(bench), cases, jobs=jobs, keep=out, progress=progress, what="clipped-optimal")
    scores = {}
    for spec, rows in found.items():
        drift, acceleration = (float(np.mean([row[key] for row in rows])) for key in ("J1", "J2"))
        scores[spec] = world.score({"drift_ratio": drift, "acceleration_ratio": acceleration})
    best = min(scores, key=scores.__getitem__)
    return best, scores[best]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("-o", "--out", type=Path, required=True, help="file that keeps the runs")
    a = parser.parse_args()
    drawn = np.random.default_rng(np.random.SeedSequence(a.seed).spawn(3)[0])
    frame = FrameWorld(settings(Options(algorithm="es")).env_kwargs)
    for spec, score in (best_constant(frame, drawn), best_clipped_optimal(frame, drawn, a.out, a.jobs)):
        print(f"{score:.4f}  {spec}", flush=True)
