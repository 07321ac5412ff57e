"""Stages with memory of the command follow its path before the filter of the log
(`mrdamp.records.log_filter`).

The ringing in a log may also be part of the actual command (a band-limited command). That is a second form of
the same cause, and the fits decide between the two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mrdamp.diagnosis.hypotheses.outside import PREFIX
from mrdamp.diagnosis.hypotheses.terms import Term
from mrdamp.records import Record
from mrdamp.records.log_filter import AS_SENT, LOG, rings_before_jumps

#: The setting that is nonzero for a magnetic circuit with memory, and the one that makes it follow the log's
#: ringing.
MEMORY, ALONG = "remanence_b", f"{PREFIX}along_the_log"


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


def log_entry(settings: Mapping[str, float]) -> dict[str, str]:
    """Entry of a model's file on the log, for `mrdamp.simulation.predict`."""
    return {LOG: AS_SENT} if ALONG in settings else {}
