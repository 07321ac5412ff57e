"""Writes the tables of plugin_cpp/README.md from the C table: `python tools/attribute_table.py [--check]`.

The laws, the effects and the attributes stand between two marker lines each. With `--check` nothing is written, and
the exit code is 1 where the file and the C table disagree.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from pathlib import Path

from mrdamp.model import core
from mrdamp.model.attributes import effects, law_row
from mrdamp.model.citations import Reference, references

README = Path(__file__).resolve().parents[1] / "plugin_cpp" / "README.md"

#: Groups of the C table that are no effect, with what stands over their table.
_TITLES = {
    "law": "Parameters of the laws. A law needs all of its own and takes no other's.",
    "dependence": (
        "Optional: a dependence on the field `b` beyond the straight line, "
        "`p(b) = p_a + p_b b + p_c b^2 + p_e (1 - exp(-p_r b))`, and the decrease of `gamma` and `beta`."
    ),
    "effects": "Range of the commands, effects, numerics: for every law.",
}


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


def users(name: str) -> str:
    """The laws that need an attribute or may take it."""
    return ", ".join(
        f"`{law}`" for law in core.laws() if name in core.law_parameters(law) or name in core.law_options(law)
    )


def rows(kind: str) -> Iterator[str]:
    """Lines of one table, the head first."""
    with_default = kind != "law"
    head = ["attribute", *(["law"] if kind != "effects" else ["group"]), "unit"]
    head += ["default"] if with_default else []
    head += ["range", "meaning"]
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in core.attributes():
        if (row.group if row.group in _TITLES else "effects") != kind:
            continue
        cells = [f"`{row.name}`", users(row.name) if kind != "effects" else row.group, row.unit]
        if with_default:
            cells.append("not given" if row.default is None else number(row.default))
        yield "| " + " | ".join([*cells, span(row.minimum, row.maximum), row.meaning]) + " |"


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


def effect_table() -> str:
    """The effects with their equations, in the order of the chain."""
    lines = ["| effect | stage | equations |", "|---|---|---|"]
    return "\n".join([*lines, *(f"| `{e.name}` | {e.stage} | {e.equations} |" for e in effects().values())])


def attribute_tables() -> str:
    """The attributes by what they are for."""
    return "\n\n".join(part for kind, title in _TITLES.items() for part in (title, "\n".join(rows(kind))))


_TABLES = {"laws": law_table, "effects": effect_table, "attributes": attribute_tables}


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
