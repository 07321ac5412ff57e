"""The attribute table of `mrdamp.damper`, the laws, and parameter vectors made of names."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from mrdamp.errors import InputError, nearest
from mrdamp.model.native import Array, checked, library, pointer, rows

#: Attributes with which a displacement channel reads something else than the motion.
MISREADING = ("channel_shift_d", "motion_lag_tau", "motion_lag_width")


@dataclass(frozen=True)
class Attribute:
    """One row of the attribute table: `group` is law, dependence, command, numerics or an effect's name."""

    name: str
    group: str
    unit: str
    default: float | None
    minimum: float
    maximum: float
    meaning: str


@functools.cache
def attributes() -> tuple[Attribute, ...]:
    """Every numeric attribute of `mrdamp.damper`, in the order of the parameter vector."""
    lib, out = library(), []
    columns = ("name", "group", "unit", "default", "min", "max", "meaning")
    for i in range(lib.mrdamp_attribute_count()):
        raw = [getattr(lib, f"mrdamp_attribute_{column}")(i) for column in columns]
        row: list[Any] = [value.decode() if isinstance(value, bytes) else value for value in raw]
        out.append(Attribute(*row))
    return tuple(replace(row, default=None) if math.isnan(row.default or 0.0) else row for row in out)


@functools.cache
def attribute_index() -> dict[str, int]:
    return {row.name: i for i, row in enumerate(attributes())}


class EffectRow(NamedTuple):
    """An effect of the chain: its name is the group of its attributes; words: what it does."""

    name: str
    stage: str
    words: str
    equations: str


@functools.cache
def effects() -> dict[str, EffectRow]:
    """The effects from driver to sensor, in the order of the chain."""
    return {row[0]: EffectRow(*row) for row in rows("effect")}


@functools.cache
def laws() -> tuple[str, ...]:
    lib = library()
    return tuple(lib.mrdamp_law_name(i).decode() for i in range(lib.mrdamp_law_count()))


def law_number(law: str) -> int:
    """Number of a law in the C interface; InputError lists the laws."""
    if law not in laws():
        raise InputError(f"law '{law}' is unknown; allowed: {', '.join(laws())}{nearest(law, laws())}")
    return laws().index(law)


def law_row(law: str, what: str) -> str:
    """What the law's row of the C table has as `equations`, `parameters`, `search` or `sources`."""
    return str(getattr(library(), f"mrdamp_law_{what}")(law_number(law)).decode())


@functools.cache
def law_parameters(law: str) -> tuple[str, ...]:
    """Names of the parameters that a law needs, in the contract's order."""
    return tuple(law_row(law, "parameters").partition("|")[0].split())


@functools.cache
def law_options(law: str) -> tuple[str, ...]:
    """Names of the parameters that a law may take besides: nonlinear dependences on the field."""
    may = law_row(law, "parameters").partition("|")[2].split()
    return tuple(sorted(may, key=list(attribute_index()).index))


def defaults() -> Array:
    """The neutral parameter vector (attributes,)."""
    out = np.empty(len(attributes()))
    library().mrdamp_defaults(pointer(out))
    return out


def vector(law: str, parameters: Mapping[str, float]) -> Array:
    """Parameter vector (attributes,) from names; effects' attributes may stand among a law's parameters.

    Raises InputError for an unknown name, a missing or surplus parameter of the law, or a value out of range.
    """
    number, index, out = law_number(law), attribute_index(), defaults()
    missing = [name for name in law_parameters(law) if name not in parameters]
    if missing:
        raise InputError(
            f"law {law} needs parameter {', '.join(map(repr, missing))}; it takes {' '.join(law_parameters(law))}"
        )
    allowed = set(law_parameters(law)) | set(law_options(law))
    for name, value in parameters.items():
        row = attributes()[index[name]] if name in index else None
        if row is None or (row.group in ("law", "dependence") and name not in allowed):
            raise InputError(
                f"parameter '{name}' is none of law {law}; it takes {' '.join(law_parameters(law)) or 'weights alone'}"
                f"{nearest(name, allowed)}"
            )
        out[index[name]] = value
    check(number, out)
    return out


def check(law: int, params: Array) -> None:
    """Checks ranges and what the law needs, as MJCF does; raises InputError."""
    checked(library().mrdamp_check, law, pointer(params))
