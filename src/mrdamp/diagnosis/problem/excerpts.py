"""Excerpts of long records for a search; the last fit and all reported figures use the whole records.

Tests at constant command repeat the same cycle dozens of times, and the first cycles contain the information.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrdamp.diagnosis.hypotheses.terms import Settings
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.sampling import memory

#: s, total length of records above which a search uses excerpts. A commissioning programme of eight tests
#: takes 66 s and is searched whole.
WHOLE = 80.0
#: s, length of each excerpt, and of that of the record with the most dissipated energy: heating and leakage
#: show in long records only.
EACH, LONGEST = 3.5, 15.0
#: s, least sample time of excerpts and the chain's step for them. With 2 ms the nominal gaps of utfsm and
#: utfpr differ from those with 1 ms by less than .1 % of the force.
STEP = 2e-3


def excerpts(
    records: Sequence[Record], heat: Sequence[float], *, thinned: bool = True, slow: float = 1.0
) -> tuple[Record, ...]:
    """The middle parts of the records if their total length is large; a machine starts and stops at the ends.

    heat: J dissipated, by record. thinned: decimate to a sample time of STEP. slow: factor on all times.
    """
    if sum(r.n * r.sample_time for r in records) <= WHOLE * slow:
        return tuple(records)
    hottest, step = int(np.argmax(heat)), STEP * slow if thinned else 0.0
    return tuple(_middle(r, slow * (LONGEST if k == hottest else EACH), step) for k, r in enumerate(records))


def _middle(record: Record, seconds: float, step: float) -> Record:
    n = min(record.n, max(round(seconds / record.sample_time), 1))
    first, every = (record.n - n) // 2, max(1, round(step / record.sample_time))
    channels = {
        name: np.asarray(values)[first : first + n : every] for name, values in record.channels.items()
    }
    return Record(record.name, record.path, every * record.sample_time, channels, record.ignored)


@dataclass(frozen=True)
class Lead:
    """Simulation before an excerpt: force (n,) N from a record's start to the excerpt's, with step
    sample_time (s). A leaking charge amplifier depends on it for several time constants."""

    force: Array = field(repr=False)
    sample_time: float

    def leaked(self, settings: Settings, excerpt: Record) -> Array:
        """(n,) N, difference of a leaking sensor's reading in an excerpt from that of a sensor that starts
        with it.

        A high-pass is the force minus its low-pass, which is zero at the record's start. The value of the
        low-pass at the excerpt's start decays in the excerpt.
        """
        gain, share = settings.get("sensor_gain_g", 1.0), settings.get("sensor_leakage_share", 0.0)
        parts = ((1 - share, "sensor_leakage_tau"), (share, "sensor_leakage_tau2"))
        t = excerpt.sample_time * np.arange(excerpt.n)
        out = np.zeros(excerpt.n)
        for part, name in parts:
            tau = settings.get(name, 0.0)
            if part > 0 and tau > 0:
                end = np.exp(-self.sample_time * (len(self.force) - 1) / tau)
                at_start = float(memory(self.force, self.sample_time, tau)[-1] - end * self.force[0])
                out += gain * part * at_start * np.exp(-t / tau)
        return out
