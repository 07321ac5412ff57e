"""Middle parts of long records for a search; the last fit and every figure that is reported use the whole records.

Tests at constant command repeat the same cycle dozens of times: a search learns from the first few what all of them say.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrdamp.core import Array
from mrdamp.records import Record

#: s of records that a search simulates at most; 66 s are what a commissioning programme of eight tests takes
#: (`mrdamp blindtest`), so that such a case is searched whole.
SEARCHED = 80.0
#: s of each record at least, whatever their number: two cycles of a sine of .5 Hz.
LEAST = 4.0


def excerpts(records: Sequence[Record], heat: Sequence[float]) -> tuple[Record, ...]:
    """The records with their middle parts (a machine starts and stops at the ends), so that all together last about SEARCHED; the one in which most heat is
    dissipated (J, by record) stays whole, since what warms up or leaks away shows in a long record alone."""
    lengths = np.array([r.n * r.sample_time for r in records])
    if lengths.sum() <= SEARCHED:
        return tuple(records)
    whole = int(np.argmax(heat))
    others = np.delete(lengths, whole)
    each = max(_equal_share(others, max(SEARCHED - lengths[whole], 0.0)), LEAST)
    return tuple(r if k == whole else _middle(r, each) for k, r in enumerate(records))


def _equal_share(lengths: Array, total: float) -> float:
    """s, the length that every longer record is cut to, so that all add up to a total."""
    order = np.sort(lengths)
    for k, value in enumerate(order):
        share = (total - order[:k].sum()) / (len(order) - k)
        if value >= share:
            return float(share)
    return float(order[-1]) if len(order) else 0.0


def _middle(record: Record, seconds: float) -> Record:
    n = min(record.n, max(round(seconds / record.sample_time), 1))
    first = (record.n - n) // 2
    channels = {name: np.asarray(values)[first : first + n] for name, values in record.channels.items()}
    return Record(record.name, record.path, record.sample_time, channels, record.ignored)
