"""Middle parts of long records for a search; the last fit and every figure that is reported use the whole records.

Tests at constant command repeat the same cycle dozens of times: a search learns from the first few what all say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrdamp.diagnosis.hypotheses.terms import Settings
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.sampling import memory

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


@dataclass(frozen=True)
class Lead:
    """force (n,) N: simulated from a record's start to the start of its excerpt, sample_time s apart. A charge that
    leaks remembers it for several of its time constants."""

    force: Array = field(repr=False)
    sample_time: float

    def leaked(self, settings: Settings, excerpt: Record) -> Array:
        """(n,) N that the own sensor of an excerpt reads less than one that starts with it, by what leaked before.

        A high-pass is the force less its low-pass, which starts from zero with the record; what that holds at the
        excerpt's start dies away in it.
        """
        gain, share = settings.get("sensor_gain_g", 1.0), settings.get("sensor_leakage_share", 0.0)
        parts = ((1 - share, "sensor_leakage_tau"), (share, "sensor_leakage_tau2"))
        t = excerpt.sample_time * np.arange(excerpt.n)
        out = np.zeros(excerpt.n)
        for part, name in parts:
            tau = settings.get(name, 0.0)
            if part > 0 and tau > 0:
                end = np.exp(-self.sample_time * (len(self.force) - 1) / tau)
                held = float(memory(self.force, self.sample_time, tau)[-1] - end * self.force[0])
                out += gain * part * held * np.exp(-t / tau)
        return out
