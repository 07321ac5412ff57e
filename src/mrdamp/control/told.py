"""What a controller is told of the damper that it drives: one mechanism for all, learned or not.

| known | what is done with it |
|---|---|
| lag of the force sensor | the measured force is taken back to the one before a first-order lag, for every controller |
| delay and lag of the driver | inverse models lead it; a policy makes up for what its own training's driver had more |
| noise of the sensors | nothing: no controller is told |

A policy that was trained in another environment is refused.
"""

from __future__ import annotations

import reprlib
import traceback
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from mrdamp.control.base import Controller, Unlagged
from mrdamp.control.policy import Policy
from mrdamp.control.registry import AnySite
from mrdamp.control.registry import Site as FrameSite
from mrdamp.errors import InputError, MrdampError, first_line
from mrdamp.model import Model
from mrdamp.simulation.rows import finite

_LAG = "sensor_lag"


Site = TypeVar("Site", bound=AnySite)


class Told:
    """A controller whose measured force has no lag of its sensor, its command clamped to what the damper takes.

    Raises InputError for a command that is no number and for whatever else it raises. Attributes: inner; name; period,
    s; takes: the least and the largest command, A or V; dampers: how many commands it may give.
    """

    def __init__(
        self, inner: Controller, sensor_lag: float, takes: tuple[float, float], name: str = "", dampers: int = 1
    ) -> None:
        self.inner, self.name, self.takes, self.dampers = inner, name or inner.name, takes, dampers
        self.period = float(inner.period)  # NumPy's numbers as well: MJCF cannot hold them
        self._force = Unlagged(self.period, sensor_lag)

    def reset(self) -> None:
        ask(self.name, self.inner.reset)
        self._force.reset()

    def command(self, t: float, y: Mapping[str, float]) -> Any:
        rows, (least, largest) = np.shape(next(iter(y.values()))), self.takes  # before: it may empty what it is given
        found = ask(self.name, self.inner.command, t, self._force(y))
        try:
            values = finite("command", found, (self.dampers, *(rows or (1,))) if np.size(found) > 1 else (1, 1))
        except ValueError:  # InputError is one
            said = f"controller {self.name}: its command at {t:g} s is {reprlib.repr(found)}"
            many = f", or {self.dampers} of them" if self.dampers > 1 else ""
            raise InputError(f"{said}; allowed: a finite number{many}") from None
        if values.size == 1:  # of all dampers
            return min(max(float(values[0, 0]), least), largest)
        return np.clip(values, least, largest).reshape((self.dampers, *rows) if self.dampers > 1 else rows)


def ask(name: str, call: Callable[..., Any], *given: Any) -> Any:
    """What a controller's own code returns; whatever it raises is its author's to mend. Raises InputError."""
    try:
        return call(*given)
    except MrdampError:
        raise
    except (Exception, SystemExit) as error:
        raise InputError(f"controller {name}: {type(error).__name__}: {first_line(error)}{_place(error)}") from None


def _place(error: BaseException) -> str:
    """The deepest line of the called code's own file that an error went through."""
    own = traceback.extract_tb(error.__traceback__)[1:]
    lines = [f.lineno for f in own if f.filename == own[0].filename]
    return f" ({Path(own[0].filename).name}, line {lines[-1]})" if lines else ""


def told(build: Callable[[Site], Controller], site: Site, name: str = "") -> Told:
    """The controller that `build` makes for a site, told of its damper as above. name: for messages, else its own.

    Raises InputError.
    """
    damper, largest = site.damper, site.command_max
    own = tuple(e for e in damper.effects if e.name != _LAG)
    # Inverse models compare the force with what they expect at the sensor: without its lag, as it is given to them.
    made = build(replace(site, damper=replace(damper, effects=own)))  # type: ignore[type-var]
    if isinstance(made, Policy):
        made.require(site.environment)
        made.matched(damper.command_lag)
        if isinstance(site, FrameSite):
            made.facing(site.frame.places)
    # As the chain clamps: without command_min a command acts by its size. 0 is no command, also of a law above it.
    least = min(0.0, damper.attributes.get("command_min", -largest))
    return Told(made, damper.sensor_lag, (least, largest), name, site.dampers)


def knowledge(damper: Model) -> str:
    """What every controller is told of a damper, in words."""
    driver, sensor = 1e3 * damper.command_lag, 1e3 * damper.sensor_lag
    return f"every controller is told the lags of driver ({driver:.3g} ms) and force sensor ({sensor:.3g} ms), no noise"
