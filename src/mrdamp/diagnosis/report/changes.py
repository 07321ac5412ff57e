"""What the corrected simulator has in place of the nominal one's numbers, with units."""

from __future__ import annotations

import math
from typing import NamedTuple

from mrdamp.diagnosis.hypotheses.nominal_effects import own_settings, setting_name
from mrdamp.diagnosis.report.result import Diagnosis
from mrdamp.model import STRUCTURE_EFFECTS, Model
from mrdamp.model.core import attributes


class Change(NamedTuple):
    """A parameter: its name, with `@place` where it has one; unit; old value (None: not there) and new one; 95 %."""

    name: str
    unit: str
    old: float | None
    new: float | None
    interval: tuple[float, float] | None


def changes(nominal: Model, found: Diagnosis) -> list[Change]:
    """Every parameter that differs between the nominal and the corrected simulator in the three digits that are shown,
    those of named effects first."""
    before, after = _settings(nominal), _settings(found.corrected)
    own = {
        setting_name(e.effect, key, e.place): e.intervals.get(key) for e in found.effects for key in e.parameters
    }
    differ = [name for name in {**before, **after} if not _same(before.get(name), after.get(name))]
    return [
        Change(name, unit_of(name), before.get(name), after.get(name), own.get(name) or found.intervals.get(name))
        for name in sorted(differ, key=lambda name: name not in own)
    ]


def unit_of(name: str) -> str:
    """Unit of a parameter under the name that `Change` has; empty for a plain number."""
    stem, _, place = name.partition("@")
    units = {a.name: a.unit for a in attributes()}
    for effect, keys in STRUCTURE_EFFECTS.items():
        # A relative change has no unit before its meaning.
        units |= {f"{effect}_{key}": text.partition(", ")[0] for key, text in keys.items() if ", " in text}
    unit = units.get(stem, "").replace("command", "A or V")
    if place and stem.startswith("sensor_") and unit == "N":
        unit = "m/s2"  # of a floor's accelerometer
    return "" if unit == "1" else unit


def _same(old: float | None, new: float | None) -> bool:
    return old is not None and new is not None and math.isclose(old, new, rel_tol=5e-4, abs_tol=1e-12)


def _settings(model: Model) -> dict[str, float]:
    return {**model.attributes, **own_settings([e for e in model.effects if e.place is not None])}
