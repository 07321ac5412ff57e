"""Parts of long records for the search of an identification."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrdamp.model.core import Array
from mrdamp.records import Record


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
        velocity = record.velocity()
        part = _window(record, velocity, keep)
        out.append(record.part(record.time[part.start], record.time[part.stop - 1]))
    return out


def _window(record: Record, velocity: Array, duration: float) -> slice:
    """So many seconds of a record where the command and the motion vary most."""
    count = min(record.n, max(3, round(duration / record.sample_time)))
    if count >= record.n:
        return slice(0, record.n)
    energy = np.concatenate([[0.0], np.cumsum(velocity**2)])
    inside = energy[count:] - energy[:-count]
    begin = int(np.argmax(inside >= 0.98 * inside.max()))
    return slice(begin, begin + count)
