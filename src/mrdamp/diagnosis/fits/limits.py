"""Width of a search for causes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """Width of a search.

    singles: number of single causes fitted, with fixed and with free nominal parameters. beam: number of sets
    that are extended. additions: causes added to each. forms: of each cause. depth: largest number of causes.
    polished: fits with free nominal parameters whose full Jacobian is computed. freed: fits with fixed
    nominal parameters, for each number of causes, that are repeated with free ones. base: iterations for the
    nominal parameters alone. rivals: fits of causes outside the catalogue. reformed: other forms
    tried for a cause.
    """

    singles: int = 8
    beam: int = 3
    additions: int = 4
    forms: int = 2
    depth: int = 2
    polished: int = 3
    freed: int = 2
    base: int = 15
    rivals: int = 3
    reformed: int = 4


#: Limits if no fit so far reaches the noise: for causes beside free nominal parameters, for pairs, and for a cause
#: beside an established one.
FREE, NARROW = Limits(forms=1), Limits(singles=3, beam=2, additions=3, forms=1, polished=1)
BESIDE = Limits(additions=2, forms=1, polished=1)
