"""A comparison as text: Markdown, CSV (means, and every run) and JSON."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from mrdamp.compare.bench import Bench
from mrdamp.compare.comparison import Comparison
from mrdamp.compare.shares import by_load, share
from mrdamp.compare.summary import Summary, difference

Row = tuple[str, ...]


def note(bench: Bench) -> str:
    """What the table of means holds."""
    over = f"Ratios are over {bench.reference}"
    if bench.environment == "frame":
        over = "J1 to J6 and J12 are over the structure without a damper, J11 over its weight"
    return f"Mean over motions (or loads), amplitudes and seeds, the worst case in parentheses. {over}."


def short(value: float) -> str:
    """Three digits, a dash where there is no value."""
    if math.isnan(value):
        return "–"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:#.3g}"


def columns(result: Comparison, unit: str) -> tuple[str, ...]:
    """Heads of the table of means."""
    way = ("way to clairvoyant",) if result.bounds else ()
    return ("controller", *(m.title.format(unit=unit) for m in result.measures), "budget (1e6 periods)", *way)


def mean_rows(result: Comparison) -> list[Row]:
    """Means over seeds, motions and amplitudes; the worst case in parentheses for the ratios.

    Where there are bounds, the share of the way to the first one at the end.
    """
    rows = []
    first = next(iter(result.bounds), None)
    for c in result.contenders:
        cells = []
        for m in result.measures:
            s = result.summary(c.name, m.key)
            cells.append(f"{short(s.mean)} ({short(s.worst)})" if m.ratio else short(s.mean))
        cells.append("–" if c.periods is None or c.bound else f"{c.periods / 1e6:.3g}")
        if first is not None:
            cells.append(short(share(result, c.name, first).mean))
        rows.append((c.name, *cells))
    return rows


def interval_rows(result: Comparison, keys: Sequence[str]) -> list[Row]:
    """Mean and its 95 % interval for some measures."""
    return [(c.name, *(_spread(result.summary(c.name, key)) for key in keys)) for c in result.contenders]


def claim_rows(result: Comparison, learned: str, keys: Sequence[str]) -> list[Row]:
    """A learned controller less each other one, with intervals of the paired difference."""
    return [
        (c.name, *(_spread(result.against(learned, c.name, key), sign=True) for key in keys))
        for c in result.contenders
        if c.name != learned
    ]


def spread_columns(result: Comparison) -> tuple[str, ...]:
    """Heads of the table of other structures."""
    return ("controller", *result.others)


def spread_rows(result: Comparison) -> list[Row]:
    """The objective less that of the base on the same structure, with 95 % intervals of the paired difference."""
    return [
        (c.name, *(_spread(other.gain(c.name), sign=True) for other in result.others.values()))
        for c in next(iter(result.others.values())).contenders
        if c.name != result.base
    ]


def spread_note(result: Comparison) -> str:
    """What that table holds."""
    made_of = " and ".join(result.objective)
    return (
        f"The mean of {made_of} less that of {result.base} on the same structure, which controllers do not know: "
        "below 0 a controller keeps a gain."
    )


def share_columns(result: Comparison) -> tuple[str, ...]:
    """Heads of the table of shares."""
    return ("controller", *(f"way to {name}" for name in result.bounds))


def share_rows(result: Comparison) -> list[Row]:
    """Of the way from the base to each bound, with 95 % intervals, over all runs."""
    return [
        (c.name, *(_spread(share(result, c.name, bound)) for bound in result.bounds))
        for c in result.contenders
    ]


def load_share_rows(result: Comparison) -> list[Row]:
    """Of the way to the first bound, by load: one row a load, one column a controller that is no bound."""
    first = next(iter(result.bounds))
    shares = [by_load(result, c.name, first) for c in result.contenders if not c.bound]
    return [(load, *map(short, values)) for load, *values in zip(result.loads, *shares, strict=True)]


def share_note(result: Comparison) -> str:
    """What the shares are."""
    words = "; ".join(f"{name}: {_weighted(weights)}" for name, weights in result.bounds.items())
    return (
        f"Share of the way from {result.base} (0) to the clairvoyant command (1), a ratio of means over all runs, with "
        f"its 95 % interval. Each bound makes its own measure small: {words} (the mean of several). It is a local "
        "optimum for a motion known in advance: the true limit is as low or lower, the true share as large or smaller."
    )


def _weighted(weights: Mapping[str, float]) -> str:
    """The measures, with their weights where these differ."""
    alike = len(set(weights.values())) == 1
    return " and ".join(key if alike else f"{w:g} {key}" for key, w in weights.items())


def shares_csv(result: Comparison) -> str:
    """One row a controller, bound and load (`all`: over all runs): the share, and its interval over all runs."""
    lines = []
    for c in result.contenders:
        for bound in result.bounds:
            s = share(result, c.name, bound)
            lines.append((c.name, bound, "all", *map(_plain, (s.mean, s.low, s.high))))
            each = zip(result.loads, by_load(result, c.name, bound), strict=True)
            lines += [(c.name, bound, load, _plain(float(value)), "", "") for load, value in each]
    return _csv(("controller", "bound", "load", "share", "low", "high"), lines)


def paths_csv(result: Comparison) -> str:
    """How the bounds were found: one row a step of a search."""
    lines = [
        (load, f"{amplitude:g}", bound, path["start"], str(k), _plain(value), path["ended"])
        for (load, amplitude), bounds in result.paths.items()
        for bound, paths in bounds.items()
        for path in paths
        for k, value in enumerate(path["values"])
    ]
    return _csv(("load", "amplitude", "bound", "start", "step", "value", "ended"), lines)


def markdown(heads: Sequence[str], rows: Sequence[Row]) -> str:
    """A table; the first column names the rows."""
    rule = ["---", *(["---:"] * (len(heads) - 1))]
    return "".join(f"| {' | '.join(row)} |\n" for row in (heads, rule, *rows))


def report(result: Comparison, bench: Bench, about: str) -> str:
    """The Markdown page of a comparison."""
    keys = bench.claimed
    parts = [
        f"# Controllers compared\n\n{about}\n",
        markdown(columns(result, bench.command_unit), mean_rows(result)),
    ]
    parts.append(f"{note(bench)}\n\n## 95 % intervals of the means\n")
    parts.append(markdown(("controller", *keys), interval_rows(result, keys)))
    if result.bounds:
        parts.append(f"## Way to the clairvoyant command\n\n{share_note(result)}\n")
        parts.append(markdown(share_columns(result), share_rows(result)))
        heads = ("load", *(c.name for c in result.contenders if not c.bound))
        parts.append(markdown(heads, load_share_rows(result)))
    if result.others:
        parts.append(f"## On structures that are not as controllers are told\n\n{spread_note(result)}\n")
        parts.append(markdown(spread_columns(result), spread_rows(result)))
    for c in result.contenders:
        if c.learned:
            parts.append(f"## {c.name} less the others, 95 % intervals of the paired difference\n")
            parts.append(markdown(("less", *keys), claim_rows(result, c.name, keys)))
    return "\n".join(parts)


def means_csv(result: Comparison) -> str:
    """One row a controller and measure: mean, worst, low and high end of the mean's interval."""
    lines = [
        (c.name, m.key, *(_plain(v) for v in (s.mean, s.worst, s.low, s.high)))
        for c in result.contenders
        for m in result.measures
        for s in (result.summary(c.name, m.key),)
    ]
    return _csv(("controller", "measure", "mean", "worst", "low", "high"), lines)


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
    return _csv(("controller", "less", "measure", "mean", "low", "high"), lines)


def runs_csv(result: Comparison) -> str:
    """One row a run: controller, seed (from 1), motion, amplitude and every measure."""
    lines = []
    for c in result.contenders:
        for s in range(len(c.specs)):
            for i, load in enumerate(result.loads):
                for j, amplitude in enumerate(result.amplitudes):
                    values = (result.values[c.name][m.key][s, i, j] for m in result.measures)
                    lines.append((c.name, str(s + 1), load, f"{amplitude:g}", *map(_plain, values)))
    return _csv(("controller", "seed", "load", "amplitude", *(m.key for m in result.measures)), lines)


def to_json(result: Comparison, unit: str, about: str) -> str:
    """Everything: means, intervals and every run; a missing value is null."""

    def number(value: float) -> float | None:
        return None if math.isnan(value) else value

    rows: dict[str, Any] = {}
    for c in result.contenders:
        rows[c.name] = {"specs": list(c.specs), "periods": c.periods, "measures": {}}
        for m in result.measures:
            s = result.summary(c.name, m.key)
            runs = result.values[c.name][m.key]
            rows[c.name]["measures"][m.key] = {
                **{key: number(value) for key, value in vars(s).items()},
                "runs": [[[number(float(v)) for v in line] for line in seed] for seed in runs],
            }
        gains = {name: other.gain(c.name) for name, other in result.others.items() if c.name in other.values}
        rows[c.name]["spread"] = {
            name: {key: number(getattr(gain, key)) for key in ("mean", "low", "high")} for name, gain in gains.items()
        }
    for name, row in rows.items():
        shares = {bound: share(result, name, bound) for bound in result.bounds}
        row["way"] = {
            b: {key: number(getattr(s, key)) for key in ("mean", "low", "high")} for b, s in shares.items()
        }
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


def _csv(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(lines)
    return out.getvalue()
