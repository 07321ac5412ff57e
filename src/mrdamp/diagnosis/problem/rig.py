"""Interface of a rig: its records, its free nominal parameters, its catalogue and its simulator; and what the rigs of a
damper and of a frame have in common: all that follows from the nominal simulator alone."""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np

from mrdamp.diagnosis.hypotheses.damper_effects import nominal_coordinates
from mrdamp.diagnosis.hypotheses.nominal_effects import effect_coordinates, merged
from mrdamp.diagnosis.hypotheses.outside import inside_of
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Settings, Sizes, Term
from mrdamp.diagnosis.problem.command_memory import ALONG, MEMORY, log_entry
from mrdamp.diagnosis.problem.designs import Envelope, Signal
from mrdamp.errors import InputError
from mrdamp.model import Effect, Model, effects_from
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.log_filter import AS_SENT, LOG, without_waves
from mrdamp.records.smoothing import noise_level

#: Channels (sets, channels, m) of settings under a command (m,).
Run = Callable[[Sequence[Settings], Array], Array]
#: Commands that change by no more than this share of the largest one show nothing of what depends on them; measured
#: commands that are meant to be constant wobble by up to 1.4 %.
STEADY = 0.05
#: A negative command below this share of the largest is a filter's overshoot.
_OVERSHOOT = 0.05


@runtime_checkable
class Together(Protocol):
    """A rig whose simulator runs several records at once, which takes less time than one after the other."""

    def simulate_together(
        self, settings: Sequence[Settings], records: Sequence[int], *, coarse: bool = False
    ) -> list[Array]:
        """`Rig.simulate` of each record."""


def simulated_together(
    rig: Rig, settings: Sequence[Settings], records: Sequence[int], *, coarse: bool = False
) -> list[Array]:
    """`Rig.simulate` of each record, all at once or in parallel, so that a single fit uses all threads."""
    if isinstance(rig, Together):
        return rig.simulate_together(settings, records, coarse=coarse)
    if rig.threads == 1 or len(records) < 2:
        return [rig.simulate(settings, k, coarse=coarse) for k in records]
    with ThreadPoolExecutor(rig.threads) as pool:
        return list(pool.map(lambda k: rig.simulate(settings, k, coarse=coarse), records))


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

    @property
    def noise_shares(self) -> Array:
        """(records, channels): factors on the channels' noise levels."""

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


@dataclass(frozen=True, eq=False)
class Simulator(ABC):
    """The nominal simulator of a rig."""

    nominal_model: Model

    @cached_property
    @abstractmethod
    def sizes(self) -> Sizes:
        """Ranges of the records."""

    @property
    def hold(self) -> bool:
        """True if the command is held between samples."""
        return bool(self.nominal_model.hold)

    @cached_property
    def base(self) -> dict[str, float]:
        """The nominal settings, with the file's entry on the log."""
        along = {ALONG: 1.0} if self.nominal_model.extra.get(LOG) == AS_SENT else {}
        return dict(self.nominal_model.attributes) | along

    @cached_property
    def _ringing(self) -> dict[Hashable, tuple[Array, Array] | None]:
        """By key of `commands`: the command without its log's ringing, and what this adds to the channels."""
        return {}

    def commands(
        self, run: Run, settings: Sequence[Settings], logged: Array, fine: Array, key: Hashable
    ) -> list[tuple[list[int], Array, Array | float]]:
        """Which settings run under which command (m,), and what is added to their channels (channels, m): stages with
        memory see the command without the log's ringing.

        The command as logged (n,) and at the time steps of the run (m,). The channels contain the same filter's
        ringing: it is added as the simulator without memory gives it. key: of the record and the run's steps.
        """
        rows = [
            k
            for k, s in enumerate(settings)
            if s.get(MEMORY, self.base.get(MEMORY, 0.0)) and not (ALONG in self.base or ALONG in s)
        ]
        if rows and key not in self._ringing:
            without, off = without_waves(logged, fine), [{MEMORY: 0.0}]
            added = None if without is None else (run(off, fine) - run(off, without))[0]
            self._ringing[key] = None if without is None or added is None else (without, added)
        ringing = self._ringing[key] if rows else None
        if ringing is None:
            return [([*range(len(settings))], fine, 0.0)]
        others = [k for k in range(len(settings)) if k not in set(rows)]
        return [(rows, *ringing), *([(others, fine, 0.0)] if others else [])]

    def measured(self: Rig, record: int) -> Array:
        """(channels, n) of a record."""
        return np.vstack([self.records[record].channel(c) for c in self.channels])

    def numbers(
        self, catalogue: Sequence[Term], records: Sequence[Record], factor: float, which: Callable[[str], bool]
    ) -> tuple[Coordinate, ...]:
        """The nominal parameters of the law, those that `which` names in a range that is wider by a factor, and of
        the effects."""
        model, s = self.nominal_model, self.sizes
        one_command = float(np.ptp(np.concatenate([r.command for r in records]))) <= STEADY * s.command
        law = nominal_coordinates(dict(model.parameters), s.command, s.stroke, one_command=one_command)
        wider = (
            replace(c, low=c.low / factor, high=c.high * factor) if c.log and which(c.name) else c for c in law
        )
        return (*wider, *effect_coordinates(model.effects, catalogue))

    def limits(
        self,
        channel: str,
        largest: float,
        rate: float | None,
        band: tuple[float, float],
        records: Sequence[Record],
    ) -> Envelope:
        """Limits of a test: those of its motion (see `Envelope`), and the command from the least of the records to the
        simulator's largest. Any command can be switched off, few rigs reverse their current."""
        command = np.concatenate([r.command for r in records])
        low, most = float(command.min()), float(command.max())
        low = low if low < -_OVERSHOOT * most else 0.0
        high = self.nominal_model.parameters.get("command_max", most)
        return Envelope(channel, largest, rate, *band, low, high, self.sizes.sample_time)

    def with_settings(self, settings: Mapping[str, float], placed: Sequence[Effect] = (), **more: Any) -> Model:
        """The simulator with these settings and effects with a place. more: other fields of the model."""
        nominal = self.nominal_model
        parameters = {k: settings.get(k, value) for k, value in nominal.parameters.items()}
        own = {k: v for k, v in inside_of(settings).items() if k not in parameters and "@" not in k}
        effects = merged(nominal.effects, [*effects_from(own), *placed])
        extra = {**nominal.extra, **log_entry(settings)}
        return replace(nominal, parameters=parameters, effects=effects, extra=extra, **more)


def own_noise(records: Sequence[Record], channels: Sequence[str]) -> Array:
    """(records, channels): noise over its median, as a gauge's may grow with what it reads."""
    levels = np.array([[noise_level(r.channel(name)) for name in channels] for r in records])
    usual = np.median(levels, axis=0)
    return np.asarray(np.where(usual > 0, levels / np.where(usual > 0, usual, 1.0), 1.0))


def models_of(rig: Rig, settings: Iterable[Settings], most: int) -> tuple[Model, ...]:
    """The first `most` simulators that the law accepts: a hysteresis is bounded only for some parameters."""
    out: list[Model] = []
    for one in settings:
        if len(out) == most:
            break
        with contextlib.suppress(InputError):
            out.append(rig.model(one))
    return tuple(out)
