"""`python -m benchmarks`: runs the benchmarks, prints the tables and writes docs/benchmarks.md."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks import c_entry, callback, environments, errors, fits, frame_step, narx, opensees, rows, start
from benchmarks.result import Section, machine, markdown, text
from benchmarks.timing import Effort

PAGE = Path(__file__).resolve().parents[1] / "docs" / "benchmarks.md"


def benchmarks(effort: Effort, python: str, end: float = 3.0) -> dict[str, Callable[[], list[Section]]]:
    """Every benchmark by its name. end: length of the accuracy runs, s; python: has openseespy."""
    return {
        "start": lambda: start.measure(effort),
        "frame": lambda: frame_step.measure(effort),
        "python": lambda: callback.measure(effort, end),
        "environments": lambda: environments.measure(effort),
        "rows": lambda: rows.measure(effort),
        "opensees": lambda: opensees.measure(effort, python, end),
        "c_entry": lambda: c_entry.measure(effort),
        "narx": lambda: narx.measure(effort),
        "fits": lambda: fits.measure(effort),
        "accuracy": lambda: errors.measure(end),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """0 also where a target is not reached: the tables say so."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "names", nargs="*", help="which to run (default: all, and only then the page is written)"
    )
    parser.add_argument("--rounds", type=int, default=Effort.rounds, help="rounds of every comparison")
    parser.add_argument("--steps", type=int, default=Effort.steps, help="steps of each side in a round")
    parser.add_argument(
        "--opensees-python", default=sys.executable, metavar="PATH", help="has openseespy installed"
    )
    parser.add_argument("-o", "--output", type=Path, default=PAGE, help="the page to write")
    options = parser.parse_args(arguments)
    if options.rounds < 1 or options.steps < 10:
        parser.error("--rounds must be at least 1, --steps at least 10")
    effort = Effort(options.rounds, options.steps)
    there = benchmarks(effort, options.opensees_python)
    unknown = [name for name in options.names if name not in there]
    if unknown:
        parser.error(f"'{unknown[0]}' is no benchmark; there are: {', '.join(there)}")
    print(machine(), flush=True)
    sections: list[Section] = []
    for name in options.names or there:
        found = there[name]()
        print("\n" + text(found), flush=True)
        sections += found
    if not options.names:
        options.output.parent.mkdir(parents=True, exist_ok=True)
        options.output.write_text(markdown(sections, effort.rounds), encoding="utf-8")
        print(f"page: {options.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
