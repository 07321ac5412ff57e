"""Middle parts of long records for a search; the last fit and every figure that is reported use the whole records.

Tests at constant command repeat the same cycle dozens of times: a search learns from the first few what all say.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrdamp.records import Record

#: s of records above which a search goes by excerpts: a commissioning programme of eight tests takes 66 s,
#: and such a case is searched whole.
WHOLE = 80.0
#: s of each record in a search, and of the one in which most heat is dissipated, since what warms up or leaks away
#: shows in a long record alone.
EACH, LONGEST = 3.5, 15.0
#: s between the samples of excerpts at least, and the chain's step there: with 2 ms the nominal gaps of utfsm and utfpr
#: are those of 1 ms within .1 % of the force.
STEP = 2e-3


def excerpts(records: Sequence[Record], heat: Sequence[float], *, thinned: bool = True) -> tuple[Record, ...]:
    """The records with their middle parts (a machine starts and stops at the ends) where they are long together.

    heat: J dissipated, by record. thinned: in samples STEP apart, where they are nearer.
    """
    if sum(r.n * r.sample_time for r in records) <= WHOLE:
        return tuple(records)
    hottest = int(np.argmax(heat))
    return tuple(_middle(r, LONGEST if k == hottest else EACH, thinned) for k, r in enumerate(records))


def _middle(record: Record, seconds: float, thinned: bool) -> Record:
    n = min(record.n, max(round(seconds / record.sample_time), 1))
    first, every = (record.n - n) // 2, max(1, round(STEP / record.sample_time)) if thinned else 1
    channels = {
        name: np.asarray(values)[first : first + n : every] for name, values in record.channels.items()
    }
    return Record(record.name, record.path, every * record.sample_time, channels, record.ignored)
