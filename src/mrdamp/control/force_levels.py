"""The damper's force over the command, turned round: which command brings the force near a wanted one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mrdamp.errors import InputError
from mrdamp.model import Model, core

Array = NDArray[np.float64]

_COMMANDS = 17
_REACH = 10.0  # of a wanted force over the damper's, for on/off
_SOFT = 1e-4  # of the largest force and command, for on/off


@dataclass(frozen=True)
class ForceLevels:
    """A static inverse of an MR damper: the level of its force, N, at each of some commands, A or V.

    A damper only resists: where the wanted force has the other sign than the measured one, the command is zero.
    commands (k,) rise from 0, forces (k,) do not fall. release: the command is zero too where the measured force is
    larger than the wanted one, as under clipped-optimal control. Raises InputError.
    """

    commands: tuple[float, ...]
    forces: tuple[float, ...]
    release: bool = False

    def __post_init__(self) -> None:
        for name in ("commands", "forces"):
            object.__setattr__(self, name, tuple(float(v) for v in getattr(self, name)))
        c, f = np.array(self.commands), np.array(self.forces)
        if len(c) < 2 or len(c) != len(f) or not np.isfinite(np.concatenate([c, f])).all():
            raise InputError(
                f"force levels: {len(c)} commands, {len(f)} forces; at least 2, finite, as many of each"
            )
        if c[0] != 0 or (np.diff(c) <= 0).any() or f[0] < 0 or (np.diff(f) < 0).any() or f[-1] <= f[0]:
            raise InputError("force levels: commands must rise from 0, forces must not fall and must differ")

    @property
    def force_max(self) -> float:
        """N, at the largest command."""
        return self.forces[-1]

    def command(self, wanted: ArrayLike, force: ArrayLike) -> Array:
        """Commands (...) for wanted forces (...) where the damper's forces (...) are measured; N, signs as there."""
        w, f = np.asarray(wanted, dtype=np.float64), np.asarray(force, dtype=np.float64)
        found = np.interp(np.abs(w), self.forces, self.commands)
        resists = (w - f) * f > 0 if self.release else w * f > 0
        return np.asarray(np.where(resists, found, 0.0))

    def switching(self) -> ForceLevels:
        """On/off: nearly the largest command for any wanted force, up to ten times the damper's, and release."""
        high, largest = self.commands[-1], _REACH * self.force_max
        return ForceLevels((0.0, (1 - _SOFT) * high, high), (0.0, _SOFT * largest, largest), release=True)

    @classmethod
    def of(cls, model: Model, command_max: float, stroke: float, w: float) -> ForceLevels:
        """From sines of w (rad/s) at constant commands, of `stroke` (m) and of half of it.

        The largest forces of the two are extrapolated to no motion: what is viscous is not the command's. Raises
        InputError where the force does not rise with the command.
        """
        t = np.linspace(0.0, 4 * math.pi / w, 801)
        commands = np.linspace(0.0, command_max, _COMMANDS)

        def largest(size: float, u: float) -> float:
            x, v = size * np.sin(w * t), size * w * np.cos(w * t)
            out = core.run(model.law, model.attributes, float(t[1]), x, v, u=u, narx=model.narx)
            return float(np.abs(out["force"][400:]).max())

        forces = [max(0.0, 2 * largest(0.5 * stroke, u) - largest(stroke, u)) for u in commands]
        return cls(tuple(commands), tuple(np.maximum.accumulate(forces)))

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"commands": list(self.commands), "forces": list(self.forces), "release": self.release}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ForceLevels:
        """From `to_dict`. Raises InputError."""
        try:
            return cls(tuple(data["commands"]), tuple(data["forces"]), bool(data.get("release", False)))
        except (TypeError, KeyError, ValueError) as error:
            raise InputError(f"force levels: {error}") from None
