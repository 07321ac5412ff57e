"""Errors a user can correct: each is one line: what, where, and what is allowed."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from importlib import import_module
from numbers import Real
from pathlib import Path
from typing import Any

#: The largest number that an input may hold: its square and cube still are numbers.
LARGEST = 1e30
_PERIODS = 1e-5, 10.0  # s


class MrdampError(Exception):
    """Base of every error that mrdamp raises on purpose."""


class InputError(MrdampError, ValueError):
    """Bad input: a file, an attribute or a value. The command line prints it and exits with code 2.

    The text is one line: what is wrong, in which file or attribute, the value found, what is allowed.
    """


class Diverged(InputError):
    """A run whose numbers are none, or that the engine stopped: nothing of it may be scored. row: which."""

    row = 0


def diverged(of: str = "", row: int = 0) -> Diverged:
    """of: what ran, for the message."""
    said = "the simulation diverged; check the structure, the damper, and the load's unit and amplitude"
    found = Diverged(f"{of}: {said}" if of else said)
    found.row = row
    return found


class EngineError(MrdampError, ImportError):
    """The installed MuJoCo is not the release of the plugin; the line states how to install that one."""


def first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [""])[0]


def nearest(name: str, allowed: Iterable[str]) -> str:
    """The end of a message on an unknown name: the allowed one that is most like it, if one is."""
    found = difflib.get_close_matches(name, list(allowed), n=1)
    return f"; nearest: {found[0]}" if found else ""


def refuse(what: str, *faults: tuple[object, str]) -> None:
    """InputError of the first fault that there is: whether, and what is wrong and allowed. what: whose they are."""
    for there, said in faults:
        if there:
            raise InputError(f"{what}: {said}")


def require_positive(what: str, **values: float) -> None:
    """InputError unless every value is above 0, up to `LARGEST`. what: whose values they are, for the message."""
    for name, value in values.items():
        if not (isinstance(value, Real) and 0 < value <= LARGEST):
            raise InputError(f"{what}: {name} is {value!r}; allowed: a finite number > 0, up to {LARGEST:g}")


def require_one_of(what: str, allowed: Iterable[str], **values: Any) -> None:
    """InputError unless every value is among the allowed. what: whose values they are, for the message, or nothing."""
    for name, value in values.items():
        if value not in allowed:
            said = f"{what}: {name}" if what else name
            raise InputError(f"{said} is {value!r}; allowed: {', '.join(allowed)}")


def require_period(what: str, period: Any) -> None:
    """InputError unless a control period, s, is a number that a run can be made with. what: whose it is."""
    if not isinstance(period, Real) or not _PERIODS[0] <= float(period) <= _PERIODS[1]:
        raise InputError(f"{what}: period is {period!r}; allowed: {_PERIODS[0]:g} to {_PERIODS[1]:g} s")


def require_path(**values: Any) -> None:
    """InputError unless every value is None or the name of a file or folder; an empty one would be the present folder.
    """
    for name, value in values.items():
        if value is not None and (not isinstance(value, str | Path) or str(value) == ""):
            raise InputError(f"{name} is {value!r}; allowed: a path".splitlines()[0])


def require_kind(words: str, kind: type | tuple[type, ...], **values: Any) -> None:
    """InputError unless every value is None or of a kind. words: what is allowed, for the message."""
    for name, value in values.items():
        if value is not None and (not isinstance(value, kind) or (isinstance(value, bool) and kind is int)):
            raise InputError(f"{name} is {value!r}; allowed: {words}".splitlines()[0])


def optional(module: str, extra: str, needing: str) -> Any:
    """A module that comes with an extra. Raises InputError, which says what needs it, where it is not installed."""
    try:
        return import_module(module)
    except ImportError:
        raise InputError(f"{needing}, which is not installed: pip install 'mrdamp[{extra}]'") from None
