"""What to cite: the sources of the force laws and of the parameter sets, and the package itself."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass

from mrdamp import __version__, sets
from mrdamp.errors import InputError
from mrdamp.model.attributes import law_row, laws
from mrdamp.model.native import rows


@dataclass(frozen=True)
class Reference:
    """A publication. doi: "" where none is known. pages: first-last."""

    key: str
    authors: tuple[str, ...]  # "Family, Given"
    title: str
    journal: str
    year: int
    volume: str = ""
    pages: str = ""
    doi: str = ""

    def text(self) -> str:
        names = [" ".join(reversed(author.split(", ", 1))) for author in self.authors]
        who = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
        where = " ".join(part for part in (self.journal, self.volume) if part)
        pages = f", {self.pages}" if self.pages else ""
        doi = f", doi:{self.doi}" if self.doi else ""
        return f"{who}, {self.title}, {where} ({self.year}){pages}{doi}"

    def bibtex(self) -> str:
        fields = {
            "author": " and ".join(self.authors), "title": f"{{{self.title}}}", "journal": self.journal,
            "year": str(self.year), "volume": self.volume, "pages": self.pages.replace("-", "--"), "doi": self.doi,
        }  # fmt: skip
        lines = [f"  {name} = {{{value}}}," for name, value in fields.items() if value]
        return "\n".join([f"@article{{{self.key},", *lines, "}"])


@functools.cache
def references() -> Mapping[str, tuple[Reference, ...]]:
    """Sources by law, the law's own first."""
    known = {
        key: Reference(key, tuple(authors.split("; ")), title, journal, int(year), *rest)
        for key, authors, title, journal, year, *rest in rows("source")
    }
    return {law: tuple(known[key] for key in law_row(law, "sources").split()) for law in laws()}


_SOFTWARE = f"mrdamp {__version__}: magnetorheological dampers for MuJoCo (see CITATION.cff)"


def citation(name: str) -> tuple[list[str], list[Reference]]:
    """Lines to cite for a law, or for a published parameter set with its law; and the law's references.

    Raises InputError for a name that is neither.
    """
    lines = [_SOFTWARE]
    law = name
    if name in sets.names():
        found = sets.load(name)
        law = found.law
        lines += list(found.sources)
    elif name not in references():
        raise InputError(
            f"'{name}' is no law and no parameter set; there are {', '.join((*references(), *sets.names()))}"
        )
    # A set's own source may be the law's.
    lines += [r.text() for r in references()[law] if not any(r.title.lower() in line.lower() for line in lines)]
    return lines, list(references()[law])
