"""Writes the attribute tables of plugin_cpp/README.md from the C table: `python tools/attribute_table.py [--check]`.

The tables stand between two marker lines. With `--check` nothing is written, and the exit code is 1 where the
file and the C table disagree.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from pathlib import Path

from mrdamp.model import core

README = Path(__file__).resolve().parents[1] / "plugin_cpp" / "README.md"
BEGIN = "<!-- attribute tables: written by tools/attribute_table.py -->"
END = "<!-- end of the attribute tables -->"

#: What stands over the tables.
_LAWS = """Coefficients of the laws; the [table of laws](#laws) says which law needs which. A coefficient with suffixes
is `p(b) = p_a + p_b b + p_c b^2 + p_e (1 - exp(-p_r b))`. Units: that given for `a` and `e`, per command for `b`,
per command squared for `c`, 1 per command for `r`. `c`, `e`, `r` are optional (0, 0, 1); `r` is from 0."""
_REST = "For every law."


def number(value: float) -> str:
    """A number in as few digits as give it back."""
    return f"{value:.12g}"


def span(low: float, high: float) -> str:
    """The range of an attribute in words."""
    if math.isinf(low) and math.isinf(high):
        return "any"
    if math.isinf(high):
        return f"from {number(low)}"
    if math.isinf(low):
        return f"to {number(high)}"
    return f"{number(low)} to {number(high)}"


def line(names: list[str], row: core.Attribute, meaning: str) -> str:
    """One row of a table: attributes that differ by their suffix alone share it."""
    limits = span(row.minimum, row.maximum)
    if row.group != "law":
        limits = f"{'not given' if row.default is None else number(row.default)}; {limits}"
    return f"| {' '.join(f'`{name}`' for name in names)} | {row.unit} | {limits} | {meaning} |"


def rows(of_laws: bool) -> Iterator[str]:
    """Lines of one table, the head first."""
    yield f"| attribute | unit | {'range' if of_laws else 'default; range'} | meaning |"
    yield "|---|---|---|---|"
    known = {row.name: row for row in core.attributes()}
    stems = {name[:-1] for name in known if {f"{name[:-1]}a", f"{name[:-1]}b"} <= set(known)}
    for name, row in known.items():
        if (row.group in ("law", "dependence")) != of_laws:
            continue
        if name[:-1] not in stems:
            yield line([name], row, row.meaning)
        elif name.endswith("a"):
            family = [name[:-1] + suffix for suffix in "abcer" if name[:-1] + suffix in known]
            yield line(family, row, row.meaning.replace(" at zero field", ""))


def tables() -> str:
    """The text between the markers, markers included."""
    return "\n\n".join([BEGIN, _LAWS, "\n".join(rows(True)), _REST, "\n".join(rows(False)), END])


def replaced(text: str) -> str:
    """The README's text with the tables of now; ValueError where the markers are missing."""
    head, begin, rest = text.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{README.name}: the markers of the attribute tables are missing")
    return head + tables() + tail


def main() -> int:
    """The command: 0, or 1 where `--check` finds a difference."""
    parser = argparse.ArgumentParser(description="Writes the attribute tables of plugin_cpp/README.md.")
    parser.add_argument("--check", action="store_true", help="write nothing; exit code 1 where they differ")
    check = parser.parse_args().check
    old = README.read_text(encoding="utf-8")
    new = replaced(old)
    if check and new != old:
        print(
            f"{README.name}: the attribute tables are out of date: python tools/attribute_table.py",
            file=sys.stderr,
        )
        return 1
    if not check:
        README.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
