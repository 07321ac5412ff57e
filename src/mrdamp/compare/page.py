"""The HTML page of a comparison."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mrdamp.compare.bench import Bench
from mrdamp.compare.comparison import Comparison
from mrdamp.compare.contenders import Contender
from mrdamp.compare.frame import SAMPLE_TIME
from mrdamp.compare.shares import by_load, share
from mrdamp.compare.summary import difference
from mrdamp.compare.tables import (
    claim_rows,
    columns,
    interval_rows,
    load_share_rows,
    mean_rows,
    note,
    share_columns,
    share_note,
    share_rows,
    spread_columns,
    spread_note,
    spread_rows,
)
from mrdamp.model.core import Array
from mrdamp.pictures.bound import Share, search_paths, shares
from mrdamp.pictures.compare import Bar, by_amplitude, ranking, trade_off
from mrdamp.pictures.structure import command_history, drifts, profile
from mrdamp.report import Page
from mrdamp.simulation.criteria import Criteria
from mrdamp.simulation.stepping import FrameRun

_FEW = 6  # controllers that lines distinguish


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
    page.table("Table", columns(result, bench.command_unit), mean_rows(result), note(bench))
    heads = [_words(key, titles[key]) for key in bench.claimed]
    page.table(
        "",
        ("controller", *heads),
        interval_rows(result, bench.claimed),
        "Means with 95 % bootstrap intervals over motions or loads, and over seeds where there are several.",
    )
    for name in learned:
        page.table(
            f"{name} less the others",
            ("less", *heads),
            claim_rows(result, name, bench.claimed),
            "Run by run, with 95 % bootstrap intervals; below zero the learned one has less.",
        )
    if result.others:
        page.table("Other structures", spread_columns(result), spread_rows(result), spread_note(result))
    if result.bounds:
        _add_bounds(page, result)
    if len(result.amplitudes) > 1:
        ratios = [m.key for m in result.measures if m.ratio and m.key in bench.headline][:2]
        few = _few(result)
        page.figure(
            "By amplitude",
            by_amplitude(
                result.amplitudes,
                {
                    _words(key, titles[key]): {name: result.by_amplitude(name, key) for name in few}
                    for key in ratios
                },
                learned,
            ),
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
    page.table("", share_columns(result), share_rows(result), share_note(result))
    heads = ("load", *(c.name for c in result.contenders if not c.bound))
    page.table("", heads, load_share_rows(result), "The same by load, to the first bound.")
    load, amplitude = _shown_case(result)
    page.figure(
        "",
        paths_picture(result),
        f"What each bound makes small over the steps of its searches, {load} at amplitude {amplitude:g}. "
        "All searches: paths.csv. Searches that end apart show local optima.",
        "Value of the objective over steps, a line a start.",
    )


def means_picture(result: Comparison) -> Figure:
    """The means of the ratios by controller."""
    return ranking({_words(m.key, m.title): _bars(result, m.key) for m in result.measures if m.ratio})


def shares_picture(result: Comparison) -> Figure:
    """Of a comparison with bounds."""
    shown = [c for c in result.contenders if not c.bound]
    return shares({bound: [_share(result, c, bound) for c in shown] for bound in result.bounds})


def _share(result: Comparison, c: Contender, bound: str) -> Share:
    s = share(result, c.name, bound)
    return Share(c.name, s.mean, s.low, s.high, by_load(result, c.name, bound), c.learned)


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


def add_settings(page: Page, result: Comparison, about: str) -> None:
    """What was run, and with which settings: the page's end. about: in words."""
    page.text("What was run", about)
    rows = [
        (c.name, f"{len(c.specs)} files: {_files(c)}" if c.learned else c.specs[0]) for c in result.contenders
    ]
    page.table("", ("controller", "setting"), rows)


def _files(contender: Contender) -> str:
    return ", ".join(Path(spec.partition(":")[2]).name for spec in contender.specs)


def add_frame_runs(page: Page, unit: str, shown: Mapping[str, tuple[FrameRun, Criteria]], case: str) -> None:
    """Histories of one case of a frame. shown: controller -> run and criteria, the uncontrolled one first."""
    # Runs of different periods end within a sample of each other.
    time = np.arange(min(len(run.time) for run, _ in shown.values())) * SAMPLE_TIME
    time = time[time <= min(run.time[-1] for run, _ in shown.values())]

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


def _bars(result: Comparison, key: str) -> list[Bar]:
    out = []
    for c in result.contenders:
        s = result.summary(c.name, key)
        out.append(Bar(c.name, s.mean, s.low, s.high, s.worst, c.learned))
    return out


def _few(result: Comparison) -> list[str]:
    """Learned ones first, then the usual baselines, then whoever is left."""
    usual = (
        "passive-off",
        "passive-on",
        "best-constant",
        "clipped-optimal",
        "clipped-optimal-tuned",
        "skyhook-tuned",
    )
    names = [c.name for c in result.contenders]
    first = [c.name for c in result.contenders if c.learned] + [name for name in usual if name in names]
    return list(dict.fromkeys([*first, *names]))[:_FEW]


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
    of = " and ".join(m.title for m in result.measures if m.key in result.objective)
    least = f"{best} has the least {of} in the mean with a damper, {np.mean(rated[best]):.0%} of {bench.reference}"
    if ties:
        return f"{text}: {least}; 95 % intervals of this mean do not separate it from {', '.join(ties)}."
    return f"{text}: {least}; 95 % intervals of this mean separate it from all others."
