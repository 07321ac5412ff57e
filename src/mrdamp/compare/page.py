"""The files of a comparison: an HTML page, tables and the runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mrdamp.compare import tables
from mrdamp.compare.bench import UNCONTROLLED, Bench, Load
from mrdamp.compare.comparison import Comparison, Summary, difference
from mrdamp.compare.contenders import Contender
from mrdamp.compare.frame import FrameBench
from mrdamp.files import write_atomic
from mrdamp.model.core import Array
from mrdamp.motions import GroundMotion
from mrdamp.pictures.compare import Bar, by_amplitude, ranking, search_paths, share_ranking, trade_off
from mrdamp.pictures.structure import command_history, drifts, profile
from mrdamp.report import Page
from mrdamp.simulation.criteria import Criteria
from mrdamp.simulation.stepping import SAMPLE_TIME, FrameRun

_FEW = 6  # controllers that lines distinguish
_USUAL = (
    "passive-off", "passive-on", "best-constant", "clipped-optimal", "clipped-optimal-tuned", "skyhook-tuned",
)  # fmt: skip
#: Whose runs are shown, and how many.
_SHOWN, _MOST_SHOWN = ("best-constant", "clipped-optimal", "clipped-optimal-tuned"), 3


def write_comparison(
    folder: Path, bench: Bench, result: Comparison, loads: Sequence[Load], about: str, command: str
) -> Path:
    """Writes index.html, table.md, table.csv, differences.csv, runs.csv, result.json and, where there are bounds,
    shares.csv and paths.csv; returns the page. Raises InputError.

    loads: those of the result; command: what made it.
    """
    texts = {
        "table.md": tables.report(result, bench, about),
        "table.csv": tables.means_csv(result),
        "differences.csv": tables.differences_csv(result),
        "runs.csv": tables.runs_csv(result),
        "result.json": tables.to_json(result, bench.command_unit, about),
    }
    texts |= {"shares.csv": tables.shares_csv(result), "paths.csv": tables.paths_csv(result)} if result.bounds else {}
    for name, text in texts.items():
        write_atomic(folder / name, text)
    page = comparison_page(result, bench, command)
    if isinstance(bench, FrameBench) and not bench.places[1:]:
        amplitude = min(result.amplitudes, key=lambda a: abs(a - 1))
        case = f"{loads[0].name} at amplitude {amplitude:g}"
        assert isinstance(loads[0], GroundMotion)
        _add_frame_runs(page, bench.command_unit, _histories(bench, result, loads[0], amplitude), case)
    page.text("What was run", about)
    files = {c.name: ", ".join(Path(spec.partition(":")[2]).name for spec in c.specs) for c in result.contenders}
    page.table("", ("controller", "setting"), [
        (c.name, f"{len(c.specs)} files: {files[c.name]}" if c.learned else c.specs[0]) for c in result.contenders
    ])  # fmt: skip
    page.write(folder / "index.html")
    return folder / "index.html"


def _histories(
    bench: FrameBench, result: Comparison, motion: GroundMotion, amplitude: float
) -> dict[str, tuple[FrameRun, Criteria]]:
    """Runs to look at: the uncontrolled one, learned ones first, then the usual baselines."""
    rows = {c.name: c.specs[0] for c in result.contenders if not c.bound}
    chosen = _few(list(rows), [c.name for c in result.contenders if c.learned], _SHOWN, _MOST_SHOWN)
    specs = {UNCONTROLLED: UNCONTROLLED} | {name: rows[name] for name in chosen}
    runs = {name: (spec, bench.history(spec, motion, amplitude)) for name, spec in specs.items()}
    return {name: (run, bench.criteria(spec, run)) for name, (spec, run) in runs.items()}


def comparison_page(result: Comparison, bench: Bench, command: str) -> Page:
    """The page of any bench; command: the one that makes it."""
    learned = [c.name for c in result.contenders if c.learned]
    titles = {m.key: m.title.format(unit=bench.command_unit) for m in result.measures}
    page = Page("Controllers compared", _summary(result, bench), footer=f"Made by `{command}`.")
    page.text("", f"{bench.about()}.")
    page.figure(
        "Means",
        ranking({_words(key, titles[key]): _bars(result, key) for key in bench.headline}),
        f"Over motions or loads, amplitudes and seeds. Ratios are over {bench.reference}.",
        "Mean, interval and worst case of the main measures by controller.",
    )
    if {"J1", "J2"} <= set(titles):
        ratio = [
            {c.name: result.summary(c.name, key).mean for c in result.contenders} for key in ("J1", "J2")
        ]
        page.figure(
            "",
            trade_off(ratio[0], ratio[1], learned),
            "Drift against acceleration; better is below and to the left.",
            "Mean peak acceleration over mean peak drift, a point a controller.",
        )
    page.table("Table", *tables.means(result, bench))
    claimed = {key: _words(key, titles[key]) for key in bench.claimed}
    if result.has_intervals:
        page.table("", *tables.intervals(result, claimed))
    for name in learned:
        page.table(f"{name} less the others", *tables.claims(result, name, claimed))
    if result.others:
        page.table("Other structures", *tables.spread(result))
    if result.bounds:
        _add_bounds(page, result)
    if len(result.amplitudes) > 1:
        ratios = [m.key for m in result.measures if m.ratio and m.key in bench.headline][:2]
        few = _few([c.name for c in result.contenders], learned, _USUAL, _FEW)
        panels = {_words(key, titles[key]): {name: result.by_amplitude(name, key) for name in few} for key in ratios}
        page.figure(
            "By amplitude",
            by_amplitude(result.amplitudes, panels, learned),
            "Means over motions or loads, and seeds.",
            "The main ratios over the amplitude.",
        )
    return page


def _add_bounds(page: Page, result: Comparison) -> None:
    """The shares of the way, and how the bounds were found in one case."""
    page.figure(
        "Way to the clairvoyant command",
        shares_picture(result),
        f"From {result.base} (0) to the best command for a motion known in advance (1); a tick is a motion.",
        f"Share of the way from {result.base} to each bound by controller.",
    )
    page.table("", *tables.shares(result))
    page.table("", *tables.load_shares(result))
    load, amplitude = _shown_case(result)
    page.figure(
        "",
        paths_picture(result),
        f"What each bound makes small over the steps of its searches, {load} at amplitude {amplitude:g}. "
        "All searches: paths.csv. Searches that end apart show local optima.",
        "Value of the objective over steps, a line a start.",
    )


def means_picture(result: Comparison) -> Figure:
    return ranking({_words(m.key, m.title): _bars(result, m.key) for m in result.measures if m.ratio})


def shares_picture(result: Comparison) -> Figure:
    shown = [c for c in result.contenders if not c.bound]
    return share_ranking({
        bound: [_bar(c, result.share(c.name, bound), result.load_shares(c.name, bound)) for c in shown]
        for bound in result.bounds
    })  # fmt: skip


def _bars(result: Comparison, key: str) -> list[Bar]:
    each = ((c, result.summary(c.name, key)) for c in result.contenders)
    return [_bar(c, s, np.array([s.worst])) for c, s in each]


def _bar(c: Contender, s: Summary, single: Array) -> Bar:
    return Bar(c.name, s.mean, s.low, s.high, single, c.learned)


def paths_picture(result: Comparison) -> Figure:
    """How the bounds were found under the first load, at the amplitude nearest to 1."""
    return search_paths(
        {
            bound: {_short_start(path["start"]): path["values"] for path in paths}
            for bound, paths in result.paths[_shown_case(result)].items()
        }
    )


def _shown_case(result: Comparison) -> tuple[str, float]:
    return min(result.paths, key=lambda at: (at[0] != result.loads[0], abs(at[1] - 1)))


def _short_start(spec: str) -> str:
    head, _, rest = spec.partition(":")
    return Path(rest).stem if head == "policy" else head


def _add_frame_runs(page: Page, unit: str, shown: Mapping[str, tuple[FrameRun, Criteria]], case: str) -> None:
    """Histories of one case of a frame. shown: controller -> run and criteria, the uncontrolled one first."""
    # Runs of different periods end within a sample of each other.
    time = np.arange(0.0, min(run.time[-1] for run, _ in shown.values()) + 1e-9, SAMPLE_TIME)

    def at(run: FrameRun, values: Array) -> Array:
        return np.stack([np.interp(time, run.time, column) for column in values.T], axis=1)

    page.figure(
        "One of the runs",
        drifts(time, {name: at(run, run.drift) for name, (run, _) in shown.items()}),
        f"Storey drifts, {case}.",
        "Storey drifts over time under some of the controllers.",
    )
    page.figure(
        "",
        profile({name: c for name, (_, c) in shown.items()}),
        f"Peaks over the height, {case}.",
        "Peaks by floor.",
    )
    driven = {name: run for name, (run, _) in shown.items() if np.ptp(run.command) > 0}
    if driven:
        held = {n: np.searchsorted(run.time, time + 1e-9, side="right") - 1 for n, run in driven.items()}
        page.figure(
            "",
            command_history(
                time,
                {n: run.command[held[n]] for n, run in driven.items()},
                {n: np.interp(time, run.time, run.force) for n, run in driven.items()},
                unit,
                list(shown),
            ),
            "Commands of the controllers and the resulting forces.",
            "Command and force over time.",
        )


_WORDS = {"J1": "peak drift", "J2": "peak acceleration", "J4": "RMS drift", "J5": "RMS acceleration"}


def _words(key: str, title: str) -> str:
    return f"{title}, {_WORDS[key]}" if key in _WORDS else title


def _few(names: Sequence[str], learned: Sequence[str], usual: Sequence[str], most: int) -> list[str]:
    """Learned ones first, then the usual baselines, then whoever is left."""
    return list(dict.fromkeys([*learned, *(name for name in usual if name in names), *names]))[:most]


def _summary(result: Comparison, bench: Bench) -> str:
    loads, sizes = len(result.loads), len(result.amplitudes)
    rated = {
        c.name: result.rated(c.name)
        for c in result.contenders
        if np.isfinite(result.summary(c.name, "mean_command").mean) and not c.bound
    }
    text = (
        f"{sum(not c.bound for c in result.contenders)} controllers,"
        f" {loads} load{'s' * (loads != 1)} at {sizes} amplitude{'s' * (sizes != 1)}"
    )
    if not rated:
        return f"{text}."
    best = min(rated, key=lambda name: float(np.mean(rated[name])))
    apart = {name: difference(rated[best], other).high < 0 for name, other in rated.items() if name != best}
    ties = [name for name, clear in apart.items() if not clear]
    titles = [m.title for m in result.measures if m.key in result.objective]
    of = f"mean of {' and '.join(titles)}" if titles[1:] else titles[0]
    least = f"{best} has the least {of} with a damper, {np.mean(rated[best]):.0%} of {bench.reference}"
    if not result.has_intervals:
        return f"{text}: {least}; one motion or load gives no interval."
    if ties:
        return f"{text}: {least}; 95 % intervals of this mean do not separate it from {', '.join(ties)}."
    return f"{text}: {least}; 95 % intervals of this mean separate it from all others."
