"""Share of the way to the clairvoyant command over the time that the ground motion is known ahead, of the frame.

    python tools/preview_study.py [--motions FILE ... --amplitudes A ...] [--seconds S ...] -o out/compare

Commands are planned again and again through the rows from the true state, with the motion known for S seconds ahead
and at rest behind (`mrdamp.compare.receding`). Every run is kept in the folder, which may be that of `mrdamp compare
frame --bound`; a study stopped there goes on. Writes preview.md and preview.png.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mrdamp.commands.output import progress_bar, save_picture
from mrdamp.compare import tuning
from mrdamp.compare.bound import share, with_bounds
from mrdamp.compare.comparison import Comparison, compare
from mrdamp.compare.contenders import contenders, shipped_policies
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import FrameBench
from mrdamp.compare.motions import read_motions
from mrdamp.compare.preview import row_name, with_previews
from mrdamp.compare.summary import Summary
from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.pictures import style

SECONDS = (0.0, 0.01, 0.02, 0.05, 0.1, 0.3, 1.0)
TITLES = {"clairvoyant": "both", "clairvoyant-drift": "drift", "clairvoyant-acceleration": "acceleration"}
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
        ways = (_text(share(result, name, bound)) for bound in TITLES)
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
        ways = [share(result, row_name(s), bound) for s in seconds]
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
            ax.axhline(share(result, name, bound).mean, color=colour, linestyle=style.DASHES[1], label=name)
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
