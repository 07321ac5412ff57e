"""Published parameter sets: JSON files with their sources, one a damper; README.md has the table.

Values are SI (command in the unit of the source, V or A); names are the plugin's attributes. The sets are
data: which parameters a law needs and their ranges are checked where a model is made of them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from mrdamp.errors import InputError

if TYPE_CHECKING:
    from mrdamp.model import Model

__all__ = ["CommandRange", "ParameterSet", "load", "named_model", "names"]


@dataclass(frozen=True)
class CommandRange:
    """Commands that the numbers hold for; ``min == max`` where they were fitted at one command only."""

    min: float
    max: float
    unit: Literal["A", "V"]


@dataclass(frozen=True)
class ParameterSet:
    """A published damper.

    id: name of the set and of its file. device: what was measured, and its force scale. parameters: attribute -> value
    in SI units; the law's own first, in the contract's order, then the optional dependences on the field, then
    `command_min` and `command_max` where the force depends on the command. command: range the numbers hold for. status:
    A: two independent public copies, or one and reproduced results; B: one public copy. sources: papers and
    repositories, the first one is where the numbers were published. notes: conversions made, and what is doubtful.
    effects: effect -> parameter -> value, for what the source has beside the law (the coil's lag).
    """

    id: str
    device: str
    law: str
    parameters: Mapping[str, float]
    command: CommandRange
    status: Literal["A", "B"]
    sources: tuple[str, ...]
    notes: str
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def attributes(self) -> dict[str, float]:
        """Parameters and effects as one table of attributes (``driver_lag_tau`` ...)."""
        table = dict(self.parameters)
        for effect, values in self.effects.items():
            table |= {f"{effect}_{name}": value for name, value in values.items()}
        return table

    def model(self) -> Model:
        from mrdamp.model import Model, effects_from  # which read sets, for what papers to cite

        return Model(self.law, dict(self.parameters), effects_from(self.attributes()), name=self.id)


@cache
def names() -> tuple[str, ...]:
    files = resources.files(__name__).iterdir()
    return tuple(sorted(file.name.removesuffix(".json") for file in files if file.name.endswith(".json")))


@cache
def load(id: str) -> ParameterSet:
    """The set of that id. Raises InputError, which lists those there are."""
    if id not in names():
        raise InputError(f"parameter set {id!r}: no such set; there are {', '.join(names())}")
    data = json.loads(resources.files(__name__).joinpath(f"{id}.json").read_text(encoding="utf-8"))
    return ParameterSet(**data | {"command": CommandRange(**data["command"]), "sources": tuple(data["sources"])})


def named_model(given: Model | Path | str) -> Model:
    """A model as it is, from its file, or a parameter set by its name. Raises InputError."""
    from mrdamp.model import Model

    if isinstance(given, Model):
        return given
    if not Path(given).exists() and str(given) in names():
        return load(str(given)).model()
    return Model.read(given)
