"""What of a record an identification takes: parts of long ones for the search, and what its start does not say.

A record that begins in motion is led into by motion of its own (`mrdamp.model.core.run_in`); a hysteresis forgets the
rest within a stroke. The modified Bouc-Wen law also has a slow state: x - y settles in (c0 + c1) / k0, seconds as a
rule, and depends on a history that no channel holds. A fit frees it at the start of such a record (`start_r`), and the
first `skipped` samples do not count.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrdamp.model import core
from mrdamp.records import Record

#: s, left out of every error at the start of a record, at most a quarter of it.
_START = 0.02


def skipped(record: Record) -> int:
    """Samples of the first 20 ms, where the unknown start state fades, or those that lead into the record."""
    return record.lead or min(record.n // 4, int(_START / record.sample_time))


def is_led(record: Record) -> bool:
    """True where a record begins in motion."""
    return core.run_in(record.sample_time, record.displacement, record.command) is not None


def excerpts(records: Sequence[Record], most: int) -> list[Record]:
    """The records, or of each its liveliest part where they are too long together; no record under 200 samples.

    For a search alone: a part begins in a state that is only nearly known.
    """
    total = sum(record.n for record in records)
    if total <= most:
        return list(records)
    out = []
    for record in records:
        keep = max(most / total * record.duration, 200 * record.sample_time)
        count = min(record.n, max(3, round(keep / record.sample_time)))
        energy = np.concatenate([[0.0], np.cumsum(record.velocity() ** 2)])
        inside = energy[count:] - energy[:-count]
        begin = int(np.argmax(inside >= 0.98 * inside.max()))
        out.append(record.part(record.time[begin], record.time[begin + count - 1]))
    return out
