"""Interface of a rig: its records, its free nominal parameters, its catalogue and its simulator."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol, runtime_checkable

from mrdamp.diagnosis.hypotheses.terms import Coordinate, Settings, Term
from mrdamp.diagnosis.problem.designs import Envelope, Signal
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record


@runtime_checkable
class Together(Protocol):
    """A rig whose simulator runs several records at once, which takes less time than one after the other."""

    def simulate_together(
        self, settings: Sequence[Settings], records: Sequence[int], *, coarse: bool = False
    ) -> list[Array]:
        """`Rig.simulate` of each record."""


class Rig(Protocol):
    """A damper on a testing machine, or a frame; picklable.

    channels: names of the measured channels that the simulator computes. nominal: coordinates of the nominal
    parameters, free in every hypothesis. terms: the catalogue.
    """

    @property
    def threads(self) -> int:
        """Number of simulations in parallel."""

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
        """Causes outside the catalogue, with which its effects are compared."""

    @property
    def still(self) -> bool:
        """True if the command hardly changes in any record, so that nothing is seen of what acts only while it does."""

    def measured(self, record: int) -> Array:
        """(channels, n) of a record."""

    def simulate(self, settings: Sequence[Settings], record: int, *, coarse: bool = False) -> Array:
        """(sets, channels, n): free runs with settings in place of, or in addition to, the nominal ones.

        coarse: a longer inner step suffices, as in a search. May raise InputError; NaN if a run diverged.
        """

    def driven(self, record: int) -> Record:
        """The record as measured: the input of `mrdamp predict`."""

    def compared(self, simulated: Mapping[str, Array], record: int) -> Array:
        """(channels, n): simulated channels of a measured record at the rate of the comparison."""

    def rougher(self, terms: Sequence[Term]) -> Rig | None:
        """The same rig with longer steps in a search if runs with these terms are slow; else None."""

    def input_noise(self, settings: Settings, record: int) -> Array:
        """(channels,): RMS change of the simulated channels due to noise of the measured inputs."""

    def noise_share(self, record: int) -> float:
        """Factor on the noise levels of the channels in a record."""

    @property
    def envelope(self) -> Envelope:
        """Limits of a test."""

    def admitted(self, signal: Signal, settings: Settings) -> Signal:
        """The test, scaled down so far that a simulator with these settings moves no more in it than the records do."""

    def try_signal(self, settings: Sequence[Settings], signal: Signal) -> Array:
        """Simulated channels (sets, channels, n) of a proposed test."""

    def conditions(self, record: int) -> dict[str, Array]:
        """Variables for the regimes of the gap: name with unit -> (n,)."""

    def model(self, settings: Mapping[str, float]) -> Model:
        """The simulator with these settings, as a file contains it."""


def models_of(rig: Rig, settings: Iterable[Settings], most: int) -> tuple[Model, ...]:
    """The first `most` simulators that the law accepts: a hysteresis is bounded only for some parameters."""
    out: list[Model] = []
    for one in settings:
        if len(out) == most:
            break
        with contextlib.suppress(InputError):
            out.append(rig.model(one))
    return tuple(out)
