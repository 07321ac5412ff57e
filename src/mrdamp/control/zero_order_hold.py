"""A controller called at a shorter period than its own: its command is held in between."""

from __future__ import annotations

from collections.abc import Mapping

from mrdamp.control.base import Controller
from mrdamp.errors import InputError


class ZeroOrderHold:
    """The controller at its own period, called `every` times as often, so that a run is sampled more finely.

    Attributes: inner; name; period, s. Raises InputError.
    """

    def __init__(self, inner: Controller, every: int) -> None:
        if every < 1:
            raise InputError(f"controller {inner.name}: held over {every} samples; allowed: 1 or more")
        self.inner, self._every = inner, every
        self.name = inner.name
        self.period = inner.period / every
        self.reset()

    def reset(self) -> None:
        self.inner.reset()
        self._calls, self._value = 0, 0.0

    def command(self, t: float, y: Mapping[str, float]) -> float:
        if self._calls % self._every == 0:
            self._value = self.inner.command(t, y)
        self._calls += 1
        return self._value
