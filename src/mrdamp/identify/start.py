"""What a record does not say: the state of the damper at its first sample.

A record that begins in motion is led into by motion of its own (`mrdamp.model.core.run_in`); a hysteresis forgets the
rest within a stroke. The modified Bouc-Wen law also has a slow state: x - y settles in (c0 + c1) / k0, seconds as a
rule, and depends on a history that no channel holds. A fit frees it at the start of such a record (`start_r`), and the
first `skipped` samples do not count.
"""

from __future__ import annotations

from mrdamp.model import core
from mrdamp.records import Record

#: s, left out of every error at the start of a record, at most a quarter of it.
_START = 0.02


def skipped(record: Record) -> int:
    """Samples of the first 20 ms, where the unknown start state fades."""
    return min(record.n // 4, int(_START / record.sample_time))


def is_led(record: Record) -> bool:
    """True where a record begins in motion."""
    return core.run_in(record.sample_time, record.displacement, record.command) is not None
