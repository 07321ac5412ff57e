"""What a model file, a corrected.json or a case.json may hold; anything else is refused in a line that names it."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping
from typing import Any

from mrdamp.errors import LARGEST, InputError, nearest

#: Whether a value is of a kind, and how messages name the kind.
Kind = tuple[Callable[[Any], bool], str]
FORMAT = 1
RIGS = ("damper", "frame")


def is_number(value: Any) -> bool:
    """A finite number of a size that can be computed with; `true` is none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST


TEXT: Kind = (lambda value: isinstance(value, str)), "a text"
NUMBER: Kind = is_number, "a finite number"
NUMBERS: Kind = (
    (lambda value: isinstance(value, list) and bool(value) and all(map(is_number, value))),
    "a list of finite numbers, one a storey",
)
OBJECT: Kind = (lambda value: isinstance(value, Mapping)), "an object"
ANY: Kind = (lambda value: True), "anything"
#: Key -> what it holds. `channels`, `records` and `baseline` are a case's and are looked at where one is read.
FILE: Mapping[str, Kind] = {
    "name": TEXT,
    "format": ((lambda value: value is not True and value == FORMAT), str(FORMAT)),
    "rig": ((lambda value: value in RIGS), ", ".join(RIGS)),
    "sample_rate_hz": ((lambda value: is_number(value) and value > 0), "a positive number"),
    "hold": ((lambda value: isinstance(value, bool)), "true, false"),
    "nominal": OBJECT,
    "model": OBJECT,
    **dict.fromkeys(("channels", "records", "baseline", "notes", "identified_on", "network"), ANY),
    "command_log": ((lambda value: value == "as sent"), "as sent"),
    "logger": ((lambda value: value == "filtered"), "filtered"),
}
BODY: Mapping[str, Kind] = {
    "law": TEXT,
    "parameters": OBJECT,
    "effects": ((lambda value: isinstance(value, list)), "a list of objects with name, place and parameters"),
    "structure": ANY,
    "damper_between": ANY,
    "weights": TEXT,
}
EFFECT: Mapping[str, Kind] = {
    "name": TEXT,
    "place": (
        (lambda value: value is None or (isinstance(value, int) and not isinstance(value, bool))),
        "a whole number or null",
    ),
    "parameters": OBJECT,
}
STRUCTURE: Mapping[str, Kind] = dict.fromkeys(("mass_kg", "stiffness_n_m", "damping_n_s_m"), NUMBERS)


def check(data: Any, keys: Mapping[str, Kind] | None, where: str) -> None:
    """Raises InputError for an unknown key of an object or a value of another kind. keys None: numbers of any name."""
    if not isinstance(data, Mapping):
        raise InputError(f"{where} is {reprlib.repr(data)}; allowed: an object")
    for key, value in data.items():
        if keys is not None and key not in keys:
            allowed = f"allowed: {', '.join(keys)}{nearest(key, keys)}"
            raise InputError(f"{where}: {reprlib.repr(key)} is unknown; {allowed}")
        of_kind, kind = NUMBER if keys is None else keys[key]
        if not of_kind(value):
            raise InputError(f"{where}: {key} is {reprlib.repr(value)}; allowed: {kind}")
