"""Share of the way to the clairvoyant command over the time that the ground motion is known ahead, of the frame.

    python -m studies.preview_study [--motions FILE ... --amplitudes A ...] [--seconds S ...] -o out/compare

Commands are planned again and again through the rows from the true state, with the motion known for S seconds ahead
and at rest behind (`receding.py`). Every run is kept in the folder, which may be that of `mrdamp compare
frame --bound`; a study stopped there goes on. Writes preview.md and preview.png.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from matplotlib.figure import Figure

from mrdamp.commands import progress_bar, save_picture
from mrdamp.compare import tuning
from mrdamp.compare.bench import UNCONTROLLED
from mrdamp.compare.benches import with_bounds
from mrdamp.compare.comparison import Comparison, Summary, compare
from mrdamp.compare.contenders import Contender, contenders, shipped_policies
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import PERIOD, FrameBench, Scales, frame_rollouts
from mrdamp.control.passive import Replay
from mrdamp.envs.training_loads import read_motions
from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.motions import GroundMotion
from mrdamp.parallel import How, Job, run_all
from mrdamp.pictures import style
from studies.receding import Receding

SECONDS = (0.0, 0.01, 0.02, 0.05, 0.1, 0.3, 1.0)
TITLES = {"clairvoyant": "both", "clairvoyant-drift": "drift", "clairvoyant-acceleration": "acceleration"}
_VERSION = 1  # of the plans
#: s between two plans over the time known ahead, and periods of a block and blocks between two plans at most.
_BETWEEN, _MOST = 0.15, 6
_STARTS = "passive-on", "passive-off"  # runs that tell how long a motion is strong
_DRAWN = "adjoint", "learned", "force-tracking-tuned"


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs what is missing, prints the table."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--motions", nargs="+", type=Path, metavar="FILE", help="as of mrdamp compare")
    p.add_argument("--amplitudes", nargs="+", type=float, metavar="A")
    p.add_argument("--seconds", nargs="+", type=float, default=SECONDS, metavar="S")
    p.add_argument("--controllers", nargs="+", metavar="NAME", help="default: all, as of mrdamp compare")
    p.add_argument("--jobs", type=int, default=1)
    p.add_argument("-o", "--out", type=Path, required=True)
    a = p.parse_args(arguments)
    try:
        if not all(0 <= s < np.inf for s in a.seconds):
            raise InputError(f"seconds is {a.seconds}; allowed: numbers >= 0")
        result = study(a)
    except InputError as error:
        p.exit(2, f"preview_study: {error}\n")
    text = table(result, a.seconds)
    print(text)
    write_atomic(a.out / "preview.md", text + "\n")
    save_picture(figure(result, a.seconds), a.out / "preview.png")
    return 0


def study(a: argparse.Namespace) -> Comparison:
    """The comparison with the bounds and a row for each time known ahead."""
    bench = FrameBench(frame_model())
    loads = read_motions(a.motions) if a.motions else bench.unseen_loads()
    amplitudes = a.amplitudes or ([1.0] if a.motions else bench.unseen_amplitudes)
    shipped = shipped_policies("frame")
    rows = contenders(
        bench, a.controllers or [*bench.default, *shipped], tuning.shipped(bench) or {}, shipped
    )
    a.out.mkdir(parents=True, exist_ok=True)
    keep = a.out / "kept.jsonl"
    with progress_bar() as progress:
        found = compare(bench, rows, loads, amplitudes, jobs=a.jobs, keep=keep, progress=progress)
        found = with_bounds(bench, found, loads, jobs=a.jobs, keep=keep, progress=progress)
        return with_previews(bench, found, loads, a.seconds, jobs=a.jobs, keep=keep, progress=progress)


@dataclass(frozen=True)
class Known:
    """A run with plans on a bench, under a motion of which `seconds` ahead are known, in the frame's own time."""

    bench: FrameBench
    load: GroundMotion
    amplitude: float
    seconds: float

    def key(self) -> str:
        own = self.bench.key("passive-on", self.load, self.amplitude)
        return hashlib.sha256(
            json.dumps([_VERSION, asdict(receding(self.seconds)), own]).encode()
        ).hexdigest()[:32]

    def run(self) -> dict[str, Any]:
        """Every measure of the commands in the bench's engine."""
        bench, load, amplitude = self.bench, self.load, self.amplitude
        free = bench.history(UNCONTROLLED, load, amplitude)
        played, period = bench.played(load, amplitude), min(bench.period, PERIOD)
        rollouts, scales = frame_rollouts(bench, played, period), Scales(free)
        runs = [bench.history(spec, load, amplitude) for spec in _STARTS]
        rollouts.periods = min(rollouts.periods, 1 + max(scales.last(run, period) for run in runs))
        found = receding(self.seconds).commands(
            rollouts, scales.objective(bench.bounds["clairvoyant"]), period
        )
        whole = np.zeros(int(np.floor(played.duration / period + 1e-9)) + 1)
        whole[: len(found)] = found[: len(whole)]
        replay = bench.driven(Replay(whole, period, row_name(self.seconds)), load, amplitude)
        values = bench.values(bench.kept(row_name(self.seconds), replay), bench.kept(UNCONTROLLED, free))
        return {"values": dict(values)}


def receding(seconds: float) -> Receding:
    """Plans for so much known ahead."""
    given = Receding(seconds)
    between = given.effort.holds[0] * PERIOD
    return replace(given, blocks=int(np.clip(round(_BETWEEN * seconds / between), 1, _MOST)))


def row_name(seconds: float) -> str:
    """Of the row of a comparison."""
    return f"known-{seconds:g}"


def with_previews(
    bench: FrameBench,
    result: Comparison,
    loads: Sequence[GroundMotion],
    seconds: Sequence[float],
    **how: Unpack[How],
) -> Comparison:
    """A comparison with a row for each time that the motion is known ahead."""
    cases = list(itertools.product(loads, result.amplitudes))
    shape = 1, len(loads), len(result.amplitudes)
    values = dict(result.values)
    for known in seconds:
        runs = [Known(bench, load, amplitude, known) for load, amplitude in cases]
        tasks = [Job(run.key(), run.run) for run in runs]
        found = run_all(tasks, f"{known:g} s known", **how)
        values[row_name(known)] = {
            m.key: np.array([f["values"][m.key] for f in found]).reshape(shape) for m in bench.measures
        }
    rows = tuple(Contender(row_name(k), (row_name(k),), bound=True) for k in seconds)
    return replace(result, contenders=(*result.contenders, *rows), values=values)


def table(result: Comparison, seconds: Sequence[float]) -> str:
    """Markdown: peaks, mean command and shares with 95 % intervals."""
    lines = [
        "| known ahead | J1 | J2 | mean V | way, both | way, drift | way, acceleration |",
        "|---|---:|---:|---:|---|---|---|",
    ]
    rows = {f"{s:g} s": row_name(s) for s in seconds}
    rows |= {c.name: c.name for c in result.contenders if c.name not in rows.values()}
    for head, name in rows.items():
        means = (f"{result.values[name][key].mean():.3f}" for key in ("J1", "J2", "mean_command"))
        ways = (_text(result.share(name, bound)) for bound in TITLES)
        lines.append(f"| {head} | {' | '.join((*means, *ways))} |")
    return "\n".join(lines)


def _text(s: Summary) -> str:
    return f"{s.mean:.2f} ({s.low:.2f} to {s.high:.2f})"


@style.styled
def figure(result: Comparison, seconds: Sequence[float]) -> Figure:
    """Shares over the time known ahead, with 95 % intervals; across, those of controllers that know nothing ahead.

    Shares below -1 are drawn at -1.
    """
    fig = style.figure(3.1)
    axes = style.axes_grid(fig, 1, len(TITLES), sharey=True)[0]
    place = np.arange(len(seconds), dtype=np.float64)
    drawn = [name for name in _DRAWN if name in result.values]
    looks: Mapping[str, str] = dict(zip(drawn, (style.COLOURS[3], style.SIMULATED, style.COLOURS[2]), strict=False))
    for ax, (bound, title) in zip(axes, TITLES.items(), strict=True):
        ways = [result.share(row_name(s), bound) for s in seconds]
        low, high = ([max(getattr(w, key), -1.0) for w in ways] for key in ("low", "high"))
        ax.fill_between(place, low, high, color=style.COLOURS[0], alpha=0.2, linewidth=0)
        ax.plot(
            place,
            [max(w.mean, -1.0) for w in ways],
            "o-",
            color=style.COLOURS[0],
            markersize=4,
            label="plans",
        )
        for name, colour in looks.items():
            ax.axhline(result.share(name, bound).mean, color=colour, linestyle=style.DASHES[1], label=name)
        ax.axhline(0.0, color=style.MUTED, linewidth=0.7)
        ax.axhline(1.0, color=style.MUTED, linewidth=0.7, linestyle=style.DASHES[2])
        ax.set_xticks(place, [f"{1e3 * s:g}" for s in seconds], rotation=60)
        ax.set_title(title)
        ax.set_ylim(-1.02, 1.06)
    axes[1].set_xlabel("ms of ground motion known ahead")
    axes[0].set_ylabel("share of the way")
    handles, names = axes[0].get_legend_handles_labels()
    style.legend(fig, handles, names)
    return fig


if __name__ == "__main__":
    sys.exit(main())
