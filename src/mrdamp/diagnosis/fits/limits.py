"""How wide a search for causes goes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """How wide the search goes.

    singles: causes fitted alone of those screened, for each flavour; beam: sets carried on; additions: causes fitted
    to each of them; forms: of each cause; depth: most causes at once; polished: fits with free nominal parameters
    that get a full Jacobian of their own; freed: held fits of each number of causes whose law is freed; base:
    iterations for the nominal parameters alone; rivals: causes outside the catalogue fitted; exchanged: causes tried in
    place of the weaker one of the best pair; reformed: other forms of a cause tried in the place of its best one.
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
    exchanged: int = 2
    reformed: int = 4


#: A second cause, or causes beside free numbers, where no fit so far meets the noise.
NARROW = Limits(singles=3, beam=2, additions=3, forms=1, polished=1)
