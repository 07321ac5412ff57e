"""What remembers the command's path is led along it as it was before the log's filter (`mrdamp.records.log_filter`).

A log may as well tell of what was sent, waves and all (a command that was made band-limited): that is a form of the
same cause, between which the fits tell.
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

#: The setting that is not zero where a magnetic circuit remembers, and the one that leads it along the log's waves.
MEMORY, ALONG = "remanence_b", f"{PREFIX}along_the_log"

#: Channels (sets, channels, m) of settings under a command (m,).
Run = Callable[[Sequence[Settings], Array], Array]


def with_waves(terms: Sequence[Term], records: Sequence[Record]) -> tuple[Term, ...]:
    """The terms, and those with a memory along the log too where a record's command rings."""
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
    """The nominal simulator's settings, with what its file says of the log."""
    along = {ALONG: 1.0} if model.extra.get(LOG) == AS_SENT else {}
    return dict(model.attributes) | along


def told_by_the_log(settings: Mapping[str, float]) -> dict[str, str]:
    """What a model's file says of the log beside its settings, for `mrdamp.simulation.predict`."""
    return {LOG: AS_SENT} if ALONG in settings else {}


@dataclass
class CommandMemory:
    """Runs of a rig, those with a memory of the command without its log's waves. base: the nominal settings."""

    base: Mapping[str, float]
    _held: dict[Hashable, Array | None] = field(default_factory=dict)
    _of_waves: dict[Hashable, Array] = field(default_factory=dict)

    def channels(
        self, run: Run, settings: Sequence[Settings], logged: Array, fine: Array, clock: Hashable
    ) -> Array:
        """Simulated channels (sets, channels, m) under a command, as logged (n,) and on the clock of the run (m,).

        What the waves do to the channels all the same, since those went through the same filter, is added as the
        simulator without a memory has it. clock: names the record and the run's steps.
        """
        as_logged = ALONG in self.base
        rows = [
            k
            for k, s in enumerate(settings)
            if s.get(MEMORY, self.base.get(MEMORY, 0.0)) and not (as_logged or ALONG in s)
        ]
        if rows and clock not in self._held:
            self._held[clock] = without_waves(logged, fine)
        held = self._held[clock] if rows else None
        if held is None:
            return run(settings, fine)
        if clock not in self._of_waves:
            off: list[Settings] = [{MEMORY: 0.0}]
            self._of_waves[clock] = (run(off, fine) - run(off, held))[0]
        led = run([settings[k] for k in rows], held) + self._of_waves[clock]
        others = [k for k in range(len(settings)) if k not in set(rows)]
        out = np.empty((len(settings), *led.shape[1:]))
        out[rows] = led
        if others:
            out[others] = run([settings[k] for k in others], fine)
        return out
