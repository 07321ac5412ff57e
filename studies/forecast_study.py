"""What the shipped `adjoint` gains by further training, without and with a part of the ground motion known in advance.

    python -m studies.forecast_study [--ahead MS[,MS...] ...] [--seeds N] [--steps N] [-o out/forecast.md]

Every training goes on from a shipped seed with 21 motions a step; the ground's acceleration so many milliseconds later
is given to the network besides its observations, without noise. Peaks are means over 12 motions at 7 amplitudes on the
chain at 1 ms, on which nothing was trained or chosen; differences are from the shipped policy, with 95 % intervals over
motions and seeds.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mrdamp.commands import progress_bar
from mrdamp.compare.comparison import interval
from mrdamp.envs.training_loads import by_motion, reported_motions
from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.parallel import Progress
from mrdamp.train.adjoint import AdjointRun, SoftPolicy
from mrdamp.train.closed_loop import ClosedLoop
from mrdamp.train.settings import Options, settings
from mrdamp.train.worlds import World

#: Of the 84 of the shipped training: the same periods give four times the steps. The rate is below the shipped one's,
#: as the weights are trained already; neither was searched for.
_LOADS, _RATE = 21, 2e-3
_PERIODS = 136_000  # of a step, slopes included
AHEAD = "", "0", "0,5,10", "0,5,10,15,20"


class Foreseeing(ClosedLoop):
    """The ground's acceleration so much later, `ahead` in s, follows every observation, in m/s2."""

    def __init__(self, world: World, n: int, ahead: Sequence[float]) -> None:
        super().__init__(world, n)
        self.ahead = ahead

    def besides(self, loads: Sequence[Any], t: int) -> NDArray[np.float32]:
        time = self.task.rows.period * np.arange(t)[:, None] + np.array(self.ahead)
        each = [np.interp(time, m.time, m.acceleration, right=0.0) for m in loads]
        return np.stack(each, axis=1).astype(np.float32)


def extend(soft: SoftPolicy, more: int) -> None:
    """By inputs with a sign that follow the observations; they count for nothing at first."""
    soft._transform = torch.block_diag(soft._transform, torch.eye(more))
    soft._mirror = torch.block_diag(soft._mirror, -torch.eye(more))
    soft._signs = np.append(soft._signs, -np.ones(more))
    pad = torch.nn.functional.pad
    soft.teacher = torch.nn.Parameter(pad(soft.teacher.detach(), (0, more)))
    soft.weights[0] = torch.nn.Parameter(pad(soft.weights[0].detach(), (0, more)))


def peaks(run: AdjointRun, ahead: Sequence[float]) -> np.ndarray:
    """(motions, 2) drift and acceleration over the uncontrolled ones."""
    loads = reported_motions()
    loop = Foreseeing(run.loop.world, len(loads), ahead)
    found = loop.run(loads, run.soft.commands, 0.0, np.random.default_rng(0))
    alive = (np.arange(len(found.channels))[:, None] <= found.lasts)[:, :, None]
    largest = [(np.abs(found.channels[:, :, group]) * alive).max(axis=(0, 2)) for group in loop.groups]
    return np.asarray(np.stack(largest, axis=1) / loop.references())


def trained(seed: int, ahead: Sequence[float], steps: int, progress: Progress) -> tuple[np.ndarray, np.ndarray]:
    """`peaks` before and after."""
    overrides = f"loads={_LOADS}", f"learning_rate={_RATE}", "start=adjoint"
    options = Options(algorithm="adjoint", seed=seed, overrides=overrides, timesteps=steps * _PERIODS)
    with tempfile.TemporaryDirectory() as folder:
        run = AdjointRun(options, settings(options), Path(folder))
    run.loop = Foreseeing(run.loop.world, run.loop.n, ahead)
    extend(run.soft, len(ahead))
    run._begin_descent()
    before = peaks(run, ahead)
    for k in range(steps):
        progress(f"seed {seed}, {1e3 * max(ahead, default=0):g} ms ahead", k / steps)
        run.step()
    return before, peaks(run, ahead)


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints a row of the table for each time ahead."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--ahead", nargs="+", default=AHEAD, metavar="MS", help="'': nothing (default: %(default)s)")
    p.add_argument("--seeds", type=int, default=2, metavar="N")
    p.add_argument("--steps", type=int, default=60, metavar="N")
    p.add_argument("-o", "--out", type=Path, help="file of the table")
    a = p.parse_args(arguments)
    head = "| known of the ground, ms ahead | drift | acceleration | mean of both less shipped |"
    lines = [head, "|---|---:|---:|---|"]
    try:
        several = [tuple(1e-3 * float(ms) for ms in text.split(",") if ms.strip()) for text in a.ahead]
        if a.seeds < 1 or a.steps < 1 or not all(0 <= s < 10 for one in several for s in one):
            raise InputError("allowed: seeds and steps 1 or more, milliseconds from 0 to 9999")
    except ValueError as error:  # InputError is one
        p.exit(2, f"forecast_study: {error}\n")
    with progress_bar() as progress:
        for text, ahead in zip(a.ahead, several, strict=True):
            both = np.array([trained(seed, ahead, a.steps, progress) for seed in range(a.seeds)])
            if len(lines) == 2:
                lines.append("| shipped | {:.3f} | {:.3f} | |".format(*both[:, 0].mean(axis=(0, 1))))
            less = (both[:, 1] - both[:, 0]).mean(axis=-1)
            low, high = interval(by_motion(less))
            drift, acceleration = both[:, 1].mean(axis=(0, 1))
            change = f"{less.mean():+.4f} ({low:+.4f} to {high:+.4f})"
            lines.append(f"| {text or 'nothing'} | {drift:.3f} | {acceleration:.3f} | {change} |")
    print("\n".join(lines))
    if a.out:
        write_atomic(a.out, "\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
