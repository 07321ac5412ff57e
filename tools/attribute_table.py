"""Writes the tables and lists of plugin_cpp/README.md from the C table: `python tools/attribute_table.py [--check]`.

The laws, the effects and the attributes stand between two marker lines each. With `--check` nothing is written, and
the exit code is 1 where the file and the C table disagree.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from mrdamp.model import core
from mrdamp.model.attributes import effects, law_row
from mrdamp.model.citations import Reference, references

README = Path(__file__).resolve().parents[1] / "plugin_cpp" / "README.md"

#: What stands over the tables.
_LAWS = """Coefficients of the [laws](#laws). `p*` has the suffixes a, b, c, e, r:
`p(b) = pa + pb b + pc b^2 + pe (1 - exp(-pr b))`. The unit given is that of `a` and `e`; `b` is per command, `c` per
command squared, `r` 1 per command. `c`, `e`, `r` are optional (0, 0, 1); `r` is from 0."""
_REST = "For every law:"


def number(value: float) -> str:
    """A number in as few digits as give it back."""
    return f"{value:.12g}"


def span(low: float, high: float) -> str:
    """The range of an attribute."""
    if math.isinf(high):
        return "" if math.isinf(low) else f"≥{number(low)}"
    return f"≤{number(high)}" if math.isinf(low) else f"{number(low)}..{number(high)}"


def value(row: core.Attribute) -> str:
    """Unit, range, and of what is no law's the default but zero."""
    unit = row.unit.removeprefix("1 ") if row.unit != "1" else ""
    default = f"default {number(row.default)}" if row.group != "law" and row.default else ""
    return ", ".join(filter(None, (unit, span(row.minimum, row.maximum), default)))


def coefficients() -> str:
    """The table of the laws' parameters; those that differ by their suffix alone share a row, as `c0*`."""
    lines = ["| attribute | unit, range | meaning |", "|---|---|---|"]
    known = {row.name: row for row in core.attributes() if row.group in ("law", "dependence")}
    stems = {name[:-1] for name in known if {f"{name[:-1]}a", f"{name[:-1]}b"} <= set(known)}
    for name, row in known.items():
        if name[:-1] in stems and name[-1] != "a":
            continue
        shown = f"{name[:-1]}*" if name[:-1] in stems else name
        lines.append(f"| `{shown}` | {value(row)} | {row.meaning.replace(' at zero field', '')} |")
    return "\n".join(lines)


def items(group: str) -> list[str]:
    """Name, meaning, unit, range and default of a group's attributes."""
    rows = [row for row in core.attributes() if row.group == group]
    return [f"- `{row.name}`: {row.meaning}" + (f" [{value(row)}]" if value(row) else "") for row in rows]


def law_table() -> str:
    """The laws with their equations, parameters and sources."""
    lines = ["| law | equations | parameters | source |", "|---|---|---|---|"]
    for law, sources in references().items():
        needs = " ".join(core.law_parameters(law)) or "weights"
        lines.append(f"| `{law}` | {law_row(law, 'equations')} | `{needs}` | {'; '.join(map(short, sources))} |")
    return "\n".join(lines)


def short(source: Reference) -> str:
    """Names, year and DOI."""
    names = ", ".join(author.partition(",")[0] for author in source.authors)
    return f"{names} {source.year}" + (f", doi:{source.doi}" if source.doi else "")


def effect_list() -> str:
    """The effects in the order of the chain: stage, equations and attributes."""
    found = []
    for e in effects().values():
        found += [f"**`{e.name}`** ({e.stage}): {e.equations}", "\n".join(items(e.name))]
    return "\n\n".join(found)


def attribute_lists() -> str:
    """The attributes that are no effect's."""
    others = "\n".join([*items("command"), *items("numerics")])
    return "\n\n".join([_LAWS, coefficients(), _REST, others])


_TABLES = {"laws": law_table, "effects": effect_list, "attributes": attribute_lists}


def replaced(text: str) -> str:
    """The README's text with the tables of now; ValueError where the markers are missing."""
    for name, table in _TABLES.items():
        begin, end = f"<!-- {name}: written by tools/attribute_table.py -->", f"<!-- end of {name} -->"
        head, found, rest = text.partition(begin)
        _, closed, tail = rest.partition(end)
        if not found or not closed:
            raise ValueError(f"{README.name}: the markers of the table of {name} are missing")
        text = f"{head}{begin}\n\n{table()}\n\n{end}{tail}"
    return text


def main() -> int:
    """The command: 0, or 1 where `--check` finds a difference."""
    parser = argparse.ArgumentParser(description="Writes the tables of plugin_cpp/README.md.")
    parser.add_argument("--check", action="store_true", help="write nothing; exit code 1 where they differ")
    check = parser.parse_args().check
    old = README.read_text(encoding="utf-8")
    new = replaced(old)
    if check and new != old:
        print(
            f"{README.name}: its tables are out of date: python tools/attribute_table.py",
            file=sys.stderr,
        )
        return 1
    if not check:
        README.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
