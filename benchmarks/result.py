"""A measured figure, and how it is shown."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.timing import Ratio


@dataclass(frozen=True)
class Figure:
    """One row. unit: "x" for a ratio, "us" for a time; target: with its sense, "<= 2"; none is for comparison only.

    skipped: why there is no figure.
    """

    what: str
    value: float = float("nan")
    unit: str = "x"
    target: str = ""
    detail: str = ""
    skipped: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the target is reached; None where there is none, or no figure."""
        if not self.target or self.skipped:
            return None
        sense, limit = self.target.split()[:2]
        return self.value <= float(limit) if sense == "<=" else self.value >= float(limit)

    def cells(self) -> tuple[str, str, str, str]:
        """What, figure, target and whether it is missed, detail."""
        number = f"{self.value:.2f}" if abs(self.value) >= 0.1 else f"{self.value:.2g}"
        shown = "skipped" if self.skipped else f"{number} {self.unit}"
        target = f"{self.target}, missed" if self.met is False else self.target
        return self.what, shown, target, self.skipped or self.detail


@dataclass(frozen=True)
class Section:
    """A table with what it needs to be understood."""

    title: str
    text: str
    figures: tuple[Figure, ...]


def of_ratio(what: str, r: Ratio, target: str = "", note: str = "") -> Figure:
    """A ratio with its quartiles and both costs."""
    top, bottom = (f"{cost:.0f}" if cost >= 1000 else f"{cost:.2f}" for cost in (r.top, r.bottom))
    detail = f"{r.low:.2f}-{r.high:.2f}; {top}/{bottom} us"
    return Figure(what, r.value, "x", target, f"{detail}; {note}" if note else detail)


def machine() -> str:
    """Processor and versions, one line, without the machine's name."""
    cpu = Path("/proc/cpuinfo")
    lines = cpu.read_text().splitlines() if cpu.is_file() else []
    model = next(
        (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine()
    )
    versions = ", ".join(
        f"{name} {importlib.metadata.version(name)}" for name in ("mujoco", "numpy", "scipy")
    )
    return f"{model}, {os.cpu_count()} cores, {platform.system()}; Python {platform.python_version()}, {versions}"


def text(sections: Sequence[Section]) -> str:
    """For a terminal."""
    out = []
    for section in sections:
        rows = [("", "figure", "target", ""), *(f.cells() for f in section.figures)]
        widths = [max(len(row[k]) for row in rows) for k in range(3)]
        out += [section.title]
        for row in rows:
            out.append("  " + "  ".join(row[k].ljust(widths[k]) for k in range(3)) + "  " + row[3])
        out.append("")
    return "\n".join(out)


def markdown(sections: Sequence[Section], rounds: int) -> str:
    """The page docs/benchmarks.md: a summary, then a table for each section with targets, of what they are for."""
    out = [
        "# Speed",
        "",
        f"Written by `make bench`. Ratios: medians of {rounds} rounds, both sides in turn, in CPU time of the "
        "measuring thread, with quartiles and both costs. It prints further rows.",
        "",
        f"Machine: {machine()}.",
        "",
        *_summary(sections),
    ]
    for section in sections:
        if aimed := [f for f in section.figures if f.target]:
            out += [f"## {section.title}", "", section.text, "", *table(aimed), ""]
    return "\n".join(out)


def table(figures: Sequence[Figure]) -> list[str]:
    """Lines of a table; a target stands beside its figure."""
    out = ["| | figure (target) | |", "|---|---|---|"]
    for what, shown, target, detail in (f.cells() for f in figures):
        cells = (what, f"{shown} ({target})" if target else shown, detail)
        out.append("| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |")
    return out


def _summary(sections: Sequence[Section]) -> list[str]:
    """How many targets are reached."""
    met = [f.met for section in sections for f in section.figures if f.met is not None]
    return [f"**{sum(met)} of {len(met)} targets are reached.**", ""] if met else []
