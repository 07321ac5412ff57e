"""Files of a comparison: a page, tables and the runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mrdamp.compare.bench import UNCONTROLLED, Bench, Load
from mrdamp.compare.comparison import Comparison
from mrdamp.compare.frame import FrameBench
from mrdamp.compare.page import add_frame_runs, add_settings, comparison_page
from mrdamp.compare.tables import differences_csv, means_csv, paths_csv, report, runs_csv, shares_csv, to_json
from mrdamp.files import write_atomic
from mrdamp.motions import GroundMotion
from mrdamp.simulation.criteria import Criteria
from mrdamp.simulation.stepping import FrameRun

_SHOWN = ("best-constant", "clipped-optimal", "clipped-optimal-tuned")
_MOST_SHOWN = 3


def write_comparison(
    folder: Path, bench: Bench, result: Comparison, loads: Sequence[Load], about: str, command: str
) -> Path:
    """Writes index.html, table.md, table.csv, differences.csv, runs.csv, result.json and, where there are bounds,
    shares.csv and paths.csv; returns the page. Raises InputError.

    loads: those of the result; command: what made it.
    """
    write_atomic(folder / "table.md", report(result, bench, about))
    write_atomic(folder / "table.csv", means_csv(result))
    write_atomic(folder / "differences.csv", differences_csv(result))
    write_atomic(folder / "runs.csv", runs_csv(result))
    if result.bounds:
        write_atomic(folder / "shares.csv", shares_csv(result))
        write_atomic(folder / "paths.csv", paths_csv(result))
    write_atomic(folder / "result.json", to_json(result, bench.command_unit, about))
    page = comparison_page(result, bench, command)
    if isinstance(bench, FrameBench) and not bench.places[1:]:
        amplitude = min(result.amplitudes, key=lambda a: abs(a - 1))
        case = f"{loads[0].name} at amplitude {amplitude:g}"
        assert isinstance(loads[0], GroundMotion)
        add_frame_runs(page, bench.command_unit, _histories(bench, result, loads[0], amplitude), case)
    add_settings(page, result, about)
    path = folder / "index.html"
    page.write(path)
    return path


def _histories(
    bench: FrameBench, result: Comparison, motion: GroundMotion, amplitude: float
) -> dict[str, tuple[FrameRun, Criteria]]:
    """Runs to look at: the uncontrolled one, learned ones first, then the usual baselines."""
    rows = {c.name: c.specs[0] for c in result.contenders if not c.bound}
    chosen = [c.name for c in result.contenders if c.learned] + [name for name in _SHOWN if name in rows]
    chosen = list(dict.fromkeys([*chosen, *rows]))[:_MOST_SHOWN]
    specs = {UNCONTROLLED: UNCONTROLLED} | {name: rows[name] for name in chosen}
    runs = {name: (spec, bench.history(spec, motion, amplitude)) for name, spec in specs.items()}
    return {name: (run, bench.criteria(spec, run)) for name, (spec, run) in runs.items()}
