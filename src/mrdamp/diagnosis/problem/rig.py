"""What the diagnosis needs of a rig: its records, its free nominal parameters, its catalogue and its simulator."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

from mrdamp.diagnosis.hypotheses.terms import Coordinate, Settings, Term
from mrdamp.diagnosis.problem.signals import Envelope, Signal
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record


class Rig(Protocol):
    """A damper on a machine, or a frame; picklable, for workers.

    channels: names of the measured channels that the simulator answers for. nominal: coordinates of the nominal
    parameters, free in every hypothesis. terms: the catalogue.
    """

    @property
    def threads(self) -> int:
        """How many simulate side by side."""
        ...

    @property
    def records(self) -> tuple[Record, ...]: ...

    @property
    def channels(self) -> tuple[str, ...]: ...

    @property
    def nominal(self) -> tuple[Coordinate, ...]: ...

    @property
    def terms(self) -> tuple[Term, ...]: ...

    @property
    def rivals(self) -> tuple[Term, ...]:
        """Causes outside the catalogue that its effects are held against."""
        ...

    def measured(self, record: int) -> Array:
        """(channels, n) of a record."""
        ...

    def simulate(self, settings: Sequence[Settings], record: int, *, coarse: bool = False) -> Array:
        """(sets, channels, n): free runs with settings in place of (or beside) the nominal ones.

        coarse: a longer inner step will do, as in a search. May raise InputError; NaN where a run diverged.
        """
        ...

    def driven(self, record: int) -> Record:
        """The record as measured, which `mrdamp predict` is given."""
        ...

    def compared(self, simulated: Mapping[str, Array], record: int) -> Array:
        """(channels, n): simulated channels of a record as measured, at the rate of the comparison."""
        ...

    def rougher(self, terms: Sequence[Term]) -> Rig | None:
        """The same with longer steps yet in a search, where runs with these terms take long; None where they do not."""
        ...

    def input_noise(self, settings: Settings, record: int) -> Array:
        """(channels,): RMS change of the simulated channels by the noise that is on the measured inputs."""
        ...

    def noise_share(self, record: int) -> float:
        """What the levels of the channels' noise are multiplied by in a record."""
        ...

    @property
    def envelope(self) -> Envelope:
        """Limits that a test stays within."""
        ...

    def try_signal(self, settings: Sequence[Settings], signal: Signal) -> Array:
        """Simulated channels (sets, channels, n) of a test that has not been made."""
        ...

    def conditions(self, record: int) -> dict[str, Array]:
        """What the gap is mapped over: name with unit -> (n,)."""
        ...

    def model(self, settings: Mapping[str, float]) -> Model:
        """The simulator with these settings, as a file holds it."""
        ...


def models_of(rig: Rig, settings: Iterable[Settings], most: int) -> tuple[Model, ...]:
    """The first `most` simulators that the law takes: a hysteresis is bounded only where its numbers allow it."""
    out: list[Model] = []
    for one in settings:
        if len(out) == most:
            break
        with contextlib.suppress(InputError):
            out.append(rig.model(one))
    return tuple(out)
