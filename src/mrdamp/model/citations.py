"""What to cite: the sources of the force laws and of the parameter sets, and the package itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mrdamp import __version__, sets
from mrdamp.errors import InputError


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
        """One line."""
        names = [" ".join(reversed(author.split(", ", 1))) for author in self.authors]
        who = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
        where = " ".join(part for part in (self.journal, self.volume) if part)
        pages = f", {self.pages}" if self.pages else ""
        doi = f", doi:{self.doi}" if self.doi else ""
        return f"{who}, {self.title}, {where} ({self.year}){pages}{doi}"

    def bibtex(self) -> str:
        """A BibTeX entry."""
        fields = {
            "author": " and ".join(self.authors), "title": f"{{{self.title}}}", "journal": self.journal,
            "year": str(self.year), "volume": self.volume, "pages": self.pages.replace("-", "--"), "doi": self.doi,
        }  # fmt: skip
        lines = [f"  {name} = {{{value}}}," for name, value in fields.items() if value]
        return "\n".join([f"@article{{{self.key},", *lines, "}"])


_SPENCER = Reference(
    "spencer1997", ("Spencer, B. F.", "Dyke, S. J.", "Sain, M. K.", "Carlson, J. D."),
    "Phenomenological model for magnetorheological dampers", "Journal of Engineering Mechanics", 1997, "123",
    "230-238", "10.1061/(ASCE)0733-9399(1997)123:3(230)",
)  # fmt: skip
_WEN = Reference(
    "wen1976", ("Wen, Y.-K.",), "Method for random vibration of hysteretic systems",
    "Journal of the Engineering Mechanics Division", 1976, "102", "249-263", "10.1061/JMCEA3.0002106",
)  # fmt: skip
_STANWAY = Reference(
    "stanway1987", ("Stanway, R.", "Sproston, J. L.", "Stevens, N. G."),
    "Non-linear modelling of an electro-rheological vibration damper", "Journal of Electrostatics", 1987, "20",
    "167-184", "10.1016/0304-3886(87)90056-8",
)  # fmt: skip
_GAMOTA = Reference(
    "gamota1991", ("Gamota, D. R.", "Filisko, F. E."),
    "Dynamic mechanical studies of electrorheological materials: moderate frequencies", "Journal of Rheology", 1991,
    "35", "399-425", "10.1122/1.550221",
)  # fmt: skip
_ZAPATEIRO = Reference(
    "zapateiro2010", ("Zapateiro, M.", "Luo, N.", "Taylor, E.", "Dyke, S. J."),
    "Modeling and identification of a class of MR fluid foam dampers", "Smart Structures and Systems", 2010, "6",
    "101-113",
)  # fmt: skip
_CHEN = Reference(
    "chen2015", ("Chen, Z. H.", "Ni, Y. Q.", "Or, S. W."),
    "Characterization and modeling of a self-sensing MR damper under harmonic loading",
    "Smart Structures and Systems", 2015,
)  # fmt: skip
_MACKAY = Reference(
    "mackay1992", ("MacKay, D. J. C.",), "Bayesian interpolation", "Neural Computation", 1992, "4", "415-447",
    "10.1162/neco.1992.4.3.415",
)  # fmt: skip

#: Sources by law, the law's own first.
LAWS: Mapping[str, tuple[Reference, ...]] = {
    "bingham": (_STANWAY,),
    "bouc_wen": (_WEN, _SPENCER),
    "hyperbolic_tangent": (_GAMOTA, _ZAPATEIRO),
    "modified_bouc_wen": (_SPENCER,),
    "narx": (_CHEN, _MACKAY),
}

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
    elif name not in LAWS:
        raise InputError(
            f"'{name}' is no law and no parameter set; there are {', '.join((*LAWS, *sets.names()))}"
        )
    # A set's own source may be the law's.
    lines += [r.text() for r in LAWS[law] if not any(r.title.lower() in line.lower() for line in lines)]
    return lines, list(LAWS[law])
