"""Stages with memory of the command follow its path before the filter of the log
(`mrdamp.records.log_filter`).

The ringing in a log may also be part of the actual command (a band-limited command). That is a second form of
the same cause, and the fits decide between the two.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mrdamp.diagnosis.hypotheses.outside import PREFIX
from mrdamp.diagnosis.hypotheses.terms import Settings, Term
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.log_filter import AS_SENT, LOG, rings_before_jumps, without_waves

#: The setting that is nonzero for a magnetic circuit with memory, and the one that makes it follow the log's
#: ringing.
MEMORY, ALONG = "remanence_b", f"{PREFIX}along_the_log"

#: Channels (sets, channels, m) of settings under a command (m,).
Run = Callable[[Sequence[Settings], Array], Array]


def with_waves(terms: Sequence[Term], records: Sequence[Record]) -> tuple[Term, ...]:
    """The terms, and forms whose memory follows the log if the command of a record has ringing."""
    if not any(rings_before_jumps(np.asarray(r.command)) for r in records):
        return tuple(terms)
    out = []
    for term in terms:
        out.append(term)
        if any(c.name == MEMORY for c in term.coordinates):
            form = f"{term.form}, along the log" if term.form else "along the log"
            out.append(replace(term, form=form, fixed={**term.fixed, ALONG: 1.0}, later=True))
    return tuple(out)


def base_settings(model: Model) -> dict[str, float]:
    """The nominal simulator's settings, including its file's entry on the log."""
    along = {ALONG: 1.0} if model.extra.get(LOG) == AS_SENT else {}
    return dict(model.attributes) | along


def log_entry(settings: Mapping[str, float]) -> dict[str, str]:
    """Entry of a model's file on the log, for `mrdamp.simulation.predict`."""
    return {LOG: AS_SENT} if ALONG in settings else {}


@dataclass
class CommandMemory:
    """Runs of a rig; stages with memory see the command without the log's ringing. base: the nominal
    settings."""

    base: Mapping[str, float]
    _without_ringing: dict[Hashable, Array | None] = field(default_factory=dict)
    _of_waves: dict[Hashable, Array] = field(default_factory=dict)

    def commands(
        self, run: Run, settings: Sequence[Settings], logged: Array, fine: Array, key: Hashable
    ) -> list[tuple[list[int], Array, Array | float]]:
        """Which settings run under which command (m,), and what is added to their channels (channels, m).

        The command as logged (n,) and at the time steps of the run (m,). The channels contain the same filter's
        ringing: it is added as the simulator without memory gives it. key: of the record and the run's steps.
        """
        as_logged = ALONG in self.base
        rows = [
            k
            for k, s in enumerate(settings)
            if s.get(MEMORY, self.base.get(MEMORY, 0.0)) and not (as_logged or ALONG in s)
        ]
        if rows and key not in self._without_ringing:
            self._without_ringing[key] = without_waves(logged, fine)
        without_ringing = self._without_ringing[key] if rows else None
        if without_ringing is None:
            return [([*range(len(settings))], fine, 0.0)]
        if key not in self._of_waves:
            off: list[Settings] = [{MEMORY: 0.0}]
            self._of_waves[key] = (run(off, fine) - run(off, without_ringing))[0]
        others = [k for k in range(len(settings)) if k not in set(rows)]
        return [(rows, without_ringing, self._of_waves[key]), *([(others, fine, 0.0)] if others else [])]
