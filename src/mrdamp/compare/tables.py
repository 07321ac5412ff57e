"""A comparison as text: Markdown, CSV (means, and every run) and JSON."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Container, Mapping, Sequence
from typing import Any, NamedTuple

from mrdamp.compare.bench import RUN, Bench
from mrdamp.compare.comparison import Comparison, Summary, difference
from mrdamp.files import csv_text

Row = tuple[str, ...]


def short(value: float) -> str:
    if math.isnan(value):
        return "–"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:#.3g}"


class Table(NamedTuple):
    """heads of the columns, the first of which names the rows; note: what it holds."""

    heads: Row
    rows: list[Row]
    note: str = ""

    def markdown(self) -> str:
        return markdown(self.heads, self.rows)

    def aligned(self) -> str:
        """Text in columns: the first flush left, the others flush right."""
        widths = [max(map(len, column)) for column in zip(self.heads, *self.rows, strict=True)]
        return "\n".join(
            "  ".join(f"{cell:{'>' if k else '<'}{w}}" for k, (cell, w) in enumerate(zip(row, widths, strict=True)))
            for row in (self.heads, *self.rows)
        )


def means(result: Comparison, bench: Bench, keys: Container[str] | None = None) -> Table:
    """Means over seeds, motions and amplitudes; the worst case in parentheses for the ratios. keys: of some measures
    alone; else the budget and, where there are bounds, the share of the way to the first one come behind them."""
    measures = [m for m in result.measures if keys is None or m.key in keys]
    heads = ["controller", *(m.title.format(unit=bench.command_unit) for m in measures)]
    heads += ["budget (1e6 periods)"] if keys is None else []
    first = next(iter(result.bounds), None) if keys is None else None
    heads += [] if first is None else ["way to clairvoyant"]
    rows = []
    for c in result.contenders:
        cells = [c.name]
        for m in measures:
            s = result.summary(c.name, m.key)
            cells.append(f"{short(s.mean)} ({short(s.worst)})" if m.ratio else short(s.mean))
        if keys is None:
            cells.append("–" if c.periods is None or c.bound else f"{c.periods / 1e6:.3g}")
        if first is not None:
            cells.append(short(result.share(c.name, first).mean))
        rows.append(tuple(cells))
    over = f"Ratios are over {bench.reference}"
    if bench.environment == "frame":
        over = "J1 to J6 and J12 are over the structure without a damper, J11 over its weight"
    note = f"Mean over motions (or loads), amplitudes and seeds, the worst case in parentheses. {over}."
    return Table(tuple(heads), rows, note)


def intervals(result: Comparison, titles: Mapping[str, str]) -> Table:
    """Mean and its 95 % interval for some measures. titles: of them, by key."""
    rows = [(c.name, *(_spread(result.summary(c.name, key)) for key in titles)) for c in result.contenders]
    note = "Means with 95 % bootstrap intervals over motions or loads, and over seeds where there are several."
    return Table(("controller", *titles.values()), rows, note)


def claims(result: Comparison, learned: str, titles: Mapping[str, str]) -> Table:
    """A learned controller less each other one, with intervals of the paired difference. titles: as of `intervals`."""
    rows = [
        (c.name, *(_spread(result.against(learned, c.name, key), sign=True) for key in titles))
        for c in result.contenders
        if c.name != learned
    ]
    note = "Run by run, with 95 % bootstrap intervals; below zero the learned one has less."
    return Table(("less", *titles.values()), rows, note)


def spread(result: Comparison) -> Table:
    """The objective less that of the base on the same structure, with 95 % intervals of the paired difference."""
    rows = [
        (c.name, *(_spread(other.gain(c.name), sign=True) for other in result.others.values()))
        for c in next(iter(result.others.values())).contenders
        if c.name != result.base
    ]
    note = (
        f"The mean of {' and '.join(result.objective)} less that of {result.base} on the same structure, which "
        "controllers do not know: below 0 a controller keeps a gain."
    )
    return Table(("controller", *result.others), rows, note)


def shares(result: Comparison) -> Table:
    """Of the way from the base to each bound, with 95 % intervals, over all runs."""
    rows = [(c.name, *(_spread(result.share(c.name, bound)) for bound in result.bounds)) for c in result.contenders]
    words = "; ".join(f"{name}: {_weighted(weights)}" for name, weights in result.bounds.items())
    note = (
        f"Share of the way from {result.base} (0) to the clairvoyant command (1), a ratio of means over all runs, with "
        f"its 95 % interval. Each bound makes its own measure small: {words} (the mean of several). It is a local "
        "optimum for a motion known in advance: the true limit is as low or lower, the true share as large or smaller."
    )
    return Table(("controller", *(f"way to {name}" for name in result.bounds)), rows, note)


def load_shares(result: Comparison) -> Table:
    """Of the way to the first bound, by load: one row a load, one column a controller that is no bound."""
    first, names = next(iter(result.bounds)), [c.name for c in result.contenders if not c.bound]
    each = [result.load_shares(name, first) for name in names]
    rows = [(load, *map(short, values)) for load, *values in zip(result.loads, *each, strict=True)]
    return Table(("load", *names), rows, "The same by load, to the first bound.")


def _weighted(weights: Mapping[str, float]) -> str:
    """The measures, with their weights where these differ."""
    alike = len(set(weights.values())) == 1
    return " and ".join(key if alike else f"{w:g} {key}" for key, w in weights.items())


def shares_csv(result: Comparison) -> str:
    """One row a controller, bound and load (`all`: over all runs): the share, and its interval over all runs."""
    lines = []
    for c in result.contenders:
        for bound in result.bounds:
            s = result.share(c.name, bound)
            lines.append((c.name, bound, "all", *map(_plain, (s.mean, s.low, s.high))))
            each = zip(result.loads, result.load_shares(c.name, bound), strict=True)
            lines += [(c.name, bound, load, _plain(float(value)), "", "") for load, value in each]
    return csv_text(("controller", "bound", "load", "share", "low", "high"), lines)


def paths_csv(result: Comparison) -> str:
    """How the bounds were found: one row a step of a search."""
    lines = [
        (load, f"{amplitude:g}", bound, path["start"], str(k), _plain(value), path["ended"])
        for (load, amplitude), bounds in result.paths.items()
        for bound, paths in bounds.items()
        for path in paths
        for k, value in enumerate(path["values"])
    ]
    return csv_text(("load", "amplitude", "bound", "start", "step", "value", "ended"), lines)


def markdown(heads: Sequence[str], rows: Sequence[Row]) -> str:
    """A table; the first column names the rows."""
    rule = ["---", *(["---:"] * (len(heads) - 1))]
    return "".join(f"| {' | '.join(row)} |\n" for row in (heads, rule, *rows))


def report(result: Comparison, bench: Bench, about: str) -> str:
    keys = {key: key for key in bench.claimed}
    table = means(result, bench)
    parts = [f"# Controllers compared\n\n{about}\n", table.markdown()]
    parts.append(f"{table.note}\n")
    if result.has_intervals:
        parts += ["## 95 % intervals of the means\n", intervals(result, keys).markdown()]
    if result.bounds:
        way = shares(result)
        parts += [f"## Way to the clairvoyant command\n\n{way.note}\n", way.markdown()]
        parts.append(load_shares(result).markdown())
    if result.others:
        other = spread(result)
        parts.append(f"## On structures that are not as controllers are told\n\n{other.note}\n")
        parts.append(other.markdown())
    for c in result.contenders:
        if c.learned:
            parts.append(f"## {c.name} less the others, 95 % intervals of the paired difference\n")
            parts.append(claims(result, c.name, keys).markdown())
    return "\n".join(parts)


def means_csv(result: Comparison) -> str:
    """One row a controller and measure: mean, worst, low and high end of the mean's interval."""
    lines = [
        (c.name, m.key, *(_plain(v) for v in (s.mean, s.worst, s.low, s.high)))
        for c in result.contenders
        for m in result.measures
        for s in (result.summary(c.name, m.key),)
    ]
    return csv_text(("controller", "measure", "mean", "worst", "low", "high"), lines)


def differences_csv(result: Comparison) -> str:
    """One row a pair of controllers and a measure, and what is tuned for (`objective`): mean of the paired difference,
    and its interval. Learned controllers less all others, the rest less those before them."""
    lines = [
        (c.name, other.name, name, *(_plain(v) for v in (s.mean, s.low, s.high)))
        for k, c in enumerate(result.contenders)
        for j, other in enumerate(result.contenders)
        if (j != k if c.learned else j < k and not other.learned)
        for name, s in (
            *((m.key, result.against(c.name, other.name, m.key)) for m in result.measures),
            *([("objective", difference(result.rated(c.name), result.rated(other.name)))] * bool(result.objective)),
        )
    ]
    return csv_text(("controller", "less", "measure", "mean", "low", "high"), lines)


def runs_csv(result: Comparison) -> str:
    """One row a run: controller, seed (of `Contender.seeds`), motion, amplitude and every measure."""
    lines = []
    for c in result.contenders:
        cases = itertools.product(c.seeds, result.loads, result.amplitudes)
        values = zip(*(result.values[c.name][m.key].ravel() for m in result.measures), strict=True)
        for (seed, load, amplitude), row in zip(cases, values, strict=True):
            lines.append((c.name, str(seed), load, f"{amplitude:g}", *map(_plain, row)))
    return csv_text((*RUN, *(m.key for m in result.measures)), lines)


def to_json(result: Comparison, unit: str, about: str) -> str:
    """Everything: means, intervals and every run; a missing value is null."""

    def number(value: float) -> float | None:
        return None if math.isnan(value) else value

    def mean_of(each: Mapping[str, Summary]) -> dict[str, Any]:
        return {name: {key: number(getattr(s, key)) for key in ("mean", "low", "high")} for name, s in each.items()}

    rows: dict[str, Any] = {}
    for c in result.contenders:
        measures = {}
        for m in result.measures:
            runs = result.values[c.name][m.key].tolist()
            measures[m.key] = {key: number(value) for key, value in vars(result.summary(c.name, m.key)).items()} | {
                "runs": [[[number(v) for v in line] for line in seed] for seed in runs]
            }
        gains = {name: other.gain(c.name) for name, other in result.others.items() if c.name in other.values}
        way = {bound: result.share(c.name, bound) for bound in result.bounds}
        rows[c.name] = {
            "specs": list(c.specs), "periods": c.periods, "measures": measures, "spread": mean_of(gains),
            "way": mean_of(way),
        }  # fmt: skip
    head = {"about": about, "command_unit": unit, "loads": result.loads, "amplitudes": result.amplitudes}
    return json.dumps({**head, "controllers": rows}, indent=1) + "\n"


def _spread(s: Summary, *, sign: bool = False) -> str:
    if math.isnan(s.mean):
        return "–"
    form = "+.3f" if sign else ".3f"
    if math.isnan(s.low):
        return f"{s.mean:{form}}"
    return f"{s.mean:{form}} [{s.low:{form}}, {s.high:{form}}]"


def _plain(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6g}"
