"""What the rigs of a damper and of a frame have in common: all that follows from the nominal simulator alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from mrdamp.diagnosis.hypotheses.damper_effects import nominal_coordinates, widened
from mrdamp.diagnosis.hypotheses.nominal_effects import effect_coordinates, merged
from mrdamp.diagnosis.hypotheses.outside import inside_of
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Sizes, Term
from mrdamp.diagnosis.problem.command_memory import CommandMemory, base_settings, log_entry
from mrdamp.model import Effect, Model, effects_from


@dataclass(frozen=True, eq=False)
class Simulator:
    """The nominal simulator of a rig."""

    nominal_model: Model

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
        self, s: Sizes, catalogue: Sequence[Term], factor: float, which: Callable[[str], bool]
    ) -> tuple[Coordinate, ...]:
        """The nominal parameters of the law, those that `which` names in a range that is wider by a factor, and of
        the effects."""
        model = self.nominal_model
        law = nominal_coordinates(model.law, dict(model.parameters), s.command, s.stroke)
        return (*widened(law, factor, which), *effect_coordinates(model.effects, catalogue))

    def with_settings(self, settings: Mapping[str, float], placed: Sequence[Effect] = (), **more: Any) -> Model:
        """The simulator with these settings and effects with a place. more: other fields of the model."""
        nominal = self.nominal_model
        parameters = {k: settings.get(k, value) for k, value in nominal.parameters.items()}
        own = {k: v for k, v in inside_of(settings).items() if k not in parameters and "@" not in k}
        effects = merged(nominal.effects, [*effects_from(own), *placed])
        extra = {**nominal.extra, **log_entry(settings)}
        return replace(nominal, parameters=parameters, effects=effects, extra=extra, **more)
