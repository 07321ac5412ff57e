"""The damper's force over the command, turned round: which command brings the force near a wanted one; and a least one.

An MR damper that moves less than its yield displacement is a spring behind a dashpot, stiffer with the field on. A
wanted force below that without current commands nothing; the least command keeps the damper stiff there, and fades
out as the force grows, before it would add to it. At rest it costs current for nothing: `rise` takes it away there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mrdamp.control.base import Controller, sensor_name
from mrdamp.errors import InputError, refuse, require_positive
from mrdamp.model import Model, core
from mrdamp.model.core import Array

_COMMANDS = 17
_REACH = 10.0  # of a wanted force over the damper's, for on/off
_SOFT = 1e-4  # of the largest force and command, for on/off


def sine_forces(model: Model, stroke: float, w: float, command: float) -> Array:
    """(801,) N, the size of a damper's force over two periods of a sine of `stroke` (m) and w (rad/s), from rest."""
    t = np.linspace(0.0, 4 * math.pi / w, 801)
    x, v = stroke * np.sin(w * t), stroke * w * np.cos(w * t)
    out = core.run(model.law, model.attributes, float(t[1]), x, v, u=command, narx=model.narx)
    return np.abs(np.asarray(out["force"], dtype=np.float64))


@dataclass(frozen=True)
class ForceLevels:
    """A static inverse of an MR damper: the level of its force, N, at each of some commands, A or V.

    A damper only resists: where the wanted force has the other sign than the measured one, the command is zero.
    commands (k,) rise from 0, forces (k,) do not fall. release: the command is zero too where the measured force is
    larger than the wanted one, as under clipped-optimal control. damping: (k,) N s/m, the rise of the force with the
    size of the stroke's velocity at each command; () leaves that part out. speed: m/s, that `force_max` is at. Raises
    InputError.
    """

    commands: tuple[float, ...]
    forces: tuple[float, ...]
    release: bool = False
    damping: tuple[float, ...] = ()
    speed: float = 0.0

    def __post_init__(self) -> None:
        for name in ("commands", "forces", "damping"):
            object.__setattr__(self, name, tuple(float(v) for v in getattr(self, name)))
        c, f, d = np.array(self.commands), np.array(self.forces), np.array(self.damping)
        if len(c) < 2 or len(c) != len(f) or not np.isfinite(np.concatenate([c, f])).all():
            raise InputError(f"force levels: {len(c)} commands, {len(f)} forces; at least 2, finite, as many of each")
        refuse(
            "force levels",
            (c[0] != 0 or (np.diff(c) <= 0).any() or f[0] < 0 or (np.diff(f) < 0).any() or f[-1] <= f[0],
             "commands must rise from 0, forces must not fall and must differ"),
            (not 0 <= self.speed < math.inf, f"speed is {self.speed}; allowed: a number >= 0, m/s"),
            (len(d) and self.release, "damping and release; allowed: one of them"),
            (len(d) and (len(d) != len(c) or not np.isfinite(d).all() or d[0] < 0 or (np.diff(d) < 0).any()),
             f"damping is {self.damping}; allowed: none, or {len(c)} numbers >= 0 that do not fall"),
        )  # fmt: skip

    @property
    def force_max(self) -> float:
        """N, at the largest command and the speed."""
        return self.forces[-1] + (self.speed * self.damping[-1] if self.damping else 0.0)

    def command(self, wanted: ArrayLike, force: ArrayLike, velocity: ArrayLike = 0.0) -> Array:
        """Commands (...) for wanted forces (...) where the damper's forces (...) are measured; N, signs as there.

        velocity: (...) m/s, of the stroke, for levels with damping, which take the force's sign from it too.
        """
        w, f = np.asarray(wanted, dtype=np.float64), np.asarray(force, dtype=np.float64)
        if self.damping:
            f = np.asarray(velocity, dtype=np.float64)
            found = self._moving(np.abs(w), np.abs(f))
        else:
            found = np.interp(np.abs(w), self.forces, self.commands)
        resists = (w - f) * f > 0 if self.release else w * f > 0
        return np.asarray(np.where(resists, found, 0.0))

    def _moving(self, size: Array, speed: Array) -> Array:
        """Commands (...) whose forces at these speeds (...) have these sizes (...): linear between the levels."""
        size, speed = np.broadcast_arrays(size, speed)
        levels = np.array(self.forces) + speed[..., None] * np.array(self.damping)
        after = np.clip((levels < size[..., None]).sum(axis=-1), 1, len(self.commands) - 1)
        low, high = (np.take_along_axis(levels, (after - k)[..., None], axis=-1)[..., 0] for k in (1, 0))
        share = (size - low) / np.maximum(high - low, np.finfo(np.float64).tiny)
        ends = np.array(self.commands)
        return np.asarray(ends[after - 1] + np.clip(share, 0.0, 1.0) * (ends[after] - ends[after - 1]))

    def switching(self) -> ForceLevels:
        """On/off: nearly the largest command for any wanted force, up to ten times the damper's, and release."""
        high, largest = self.commands[-1], _REACH * self.force_max
        return ForceLevels((0.0, (1 - _SOFT) * high, high), (0.0, _SOFT * largest, largest), release=True)

    @classmethod
    def of(
        cls, model: Model, command_max: float, stroke: float, w: float, viscous: bool = False
    ) -> ForceLevels:
        """From sines of w (rad/s) at constant commands, of `stroke` (m) and of half of it.

        The largest forces of the two are extrapolated to no motion. viscous: with `damping`, from the forces at the
        largest velocity, which hold no spring's part. Raises InputError where the force does not rise with the command.
        """
        commands = np.linspace(0.0, command_max, _COMMANDS)

        def largest(size: float, u: float) -> float:
            found = sine_forces(model, size, w, u)[400:]
            return float(found[200] if viscous else found.max())

        half, whole = (np.array([largest(share * stroke, u) for u in commands]) for share in (0.5, 1.0))
        forces = np.maximum.accumulate(np.maximum(0.0, 2 * half - whole))
        rise = np.maximum.accumulate(np.maximum(0.0, (whole - half) / (0.5 * stroke * w)))
        found = cls(tuple(commands), tuple(forces))
        return replace(found, damping=tuple(rise), speed=stroke * w) if viscous else found

    def to_dict(self) -> dict[str, Any]:
        own = {"commands": list(self.commands), "forces": list(self.forces), "release": self.release}
        return own | ({"damping": list(self.damping), "speed": self.speed} if self.damping else {})

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ForceLevels:
        try:
            release, speed = bool(data.get("release", False)), float(data.get("speed", 0.0))
            return cls(data["commands"], data["forces"], release, data.get("damping", ()), speed)
        except (TypeError, KeyError, ValueError) as error:
            raise InputError(f"force levels: {error}") from None


@dataclass(frozen=True)
class LeastCommand:
    """level up(peak) down(peak), peak being the leaky peak of the damper's |force| (`Observer.peaks`).

    up rises linearly from 0 without force to 1 at `rise`; down is 1 up to `full` and falls linearly to 0 at `fade`.
    level: A or V; fade, full, rise: N, 0 <= full < fade, 0 <= rise <= fade; rise 0: the whole level at rest. Raises
    InputError.
    """

    level: float
    fade: float
    full: float = 0.0
    rise: float = 0.0

    def __post_init__(self) -> None:
        require_positive("least command", level=self.level, fade=self.fade)
        if not 0 <= self.full < self.fade or not 0 <= self.rise <= self.fade:
            raise InputError(
                f"least command: full is {self.full}, rise is {self.rise}; allowed: 0 or more, full below fade "
                f"({self.fade:g}), rise not above it"
            )

    def __call__(self, peak: ArrayLike) -> NDArray[np.float64]:
        """Commands (...) for leaky peaks of the force (...), N."""
        size = np.asarray(peak, dtype=np.float64)
        down = np.clip((self.fade - size) / (self.fade - self.full), 0.0, 1.0)
        up = np.minimum(size / self.rise, 1.0) if self.rise else 1.0
        return np.asarray(self.level * up * down)

    def to_dict(self) -> dict[str, float]:
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> LeastCommand:
        try:
            rest = (float(data.get(name, 0.0)) for name in ("full", "rise"))
            return cls(float(data["level"]), float(data["fade"]), *rest)
        except (TypeError, KeyError, ValueError) as error:
            raise InputError(f"least command: {error}") from None


class AtLeast:
    """A controller whose command is never below the least one of each damper's leaky peak of |force|.

    leak: s, of the peaks; dampers: how many. Attributes: inner; name; period, s.
    """

    def __init__(self, inner: Controller, least: LeastCommand, leak: float, dampers: int = 1) -> None:
        self.inner, self.name, self.period = inner, inner.name, inner.period
        self._least, self._fall = least, math.exp(-inner.period / leak)
        self._forces = [sensor_name("force", k) for k in range(dampers)]
        self.reset()

    def reset(self) -> None:
        self.inner.reset()
        self._peaks: Any = 0.0

    def command(self, t: float, y: Mapping[str, float]) -> Any:
        forces = np.array([y[name] for name in self._forces])
        self._peaks = np.maximum(np.abs(forces), self._fall * self._peaks)
        least = self._least(self._peaks)
        return np.maximum(self.inner.command(t, y), least if len(least) > 1 else least[0])
