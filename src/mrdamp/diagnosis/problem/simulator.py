"""What the rigs of a damper and of a frame have in common: all that follows from the nominal simulator alone."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from mrdamp.diagnosis.hypotheses.damper_effects import nominal_coordinates, widened
from mrdamp.diagnosis.hypotheses.nominal_effects import effect_coordinates, merged
from mrdamp.diagnosis.hypotheses.outside import inside_of
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Sizes, Term
from mrdamp.diagnosis.problem.command_memory import CommandMemory, base_settings, log_entry
from mrdamp.diagnosis.problem.designs import Envelope
from mrdamp.model import Effect, Model, effects_from
from mrdamp.records import Record

#: Commands that change by no more than this share of the largest one show nothing of what depends on them; measured
#: commands that are meant to be constant wobble by up to 1.4 %.
STEADY = 0.05
#: A negative command below this share of the largest is a filter's overshoot.
_OVERSHOOT = 0.05


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
        """The nominal settings."""
        return base_settings(self.nominal_model)

    @cached_property
    def command_memory(self) -> CommandMemory:
        """Of the stages with memory of the command."""
        return CommandMemory(self.base)

    def numbers(
        self, catalogue: Sequence[Term], records: Sequence[Record], factor: float, which: Callable[[str], bool]
    ) -> tuple[Coordinate, ...]:
        """The nominal parameters of the law, those that `which` names in a range that is wider by a factor, and of
        the effects."""
        model, s = self.nominal_model, self.sizes
        one_command = float(np.ptp(np.concatenate([r.command for r in records]))) <= STEADY * s.command
        law = nominal_coordinates(dict(model.parameters), s.command, s.stroke, one_command=one_command)
        return (*widened(law, factor, which), *effect_coordinates(model.effects, catalogue))

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
