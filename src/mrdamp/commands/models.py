"""How commands name a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mrdamp.model import Model


def named_model(text: str) -> Model:
    """A model file, or a parameter set by its name. Raises InputError."""
    from mrdamp import sets
    from mrdamp.model import Model, effects_from

    if not Path(text).exists() and text in sets.names():
        found = sets.load(text)
        return Model(found.law, dict(found.parameters), effects_from(found.attributes()), name=text)
    return Model.read(text)


def named_unit(text: str) -> str:
    """Unit of the command: A, or V for a parameter set whose source is in volts."""
    from mrdamp import sets

    return sets.load(text).command.unit if not Path(text).exists() and text in sets.names() else "A"
