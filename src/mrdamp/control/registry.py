"""Controllers by name, with options: `clipped-optimal:r=1e-10,balance=1`, `constant:value=0.75`."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from mrdamp.control.base import Controller
from mrdamp.control.clipped_optimal import (
    Lqg,
    clipped_optimal,
    force_tracking,
    ideal_active,
    lyapunov,
    max_dissipation,
    modulated_optimal,
)
from mrdamp.control.force_control import skyhook
from mrdamp.control.force_levels import AtLeast, LeastCommand
from mrdamp.control.lqg import Linear, linear
from mrdamp.control.passive import Constant, passive_off, passive_on
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.structures import ShearFrame

if TYPE_CHECKING:
    from mrdamp.inverse import Inverse

POLICY, OWN = "policy", "own"
IDEAL = "ideal-active"
Options = dict[str, float]
_LEAK = 15.0  # periods of the first mode, of the peak that `weak` is compared with


_LEVEL = {"level": 1.0}  # of on/off switching, over the largest command
_WEAK = {"weak": 0.0}  # N, that the damper resists weak motion with, where its command is never small: `_at_least`
_BALANCED = {"balance": 100.0, "r": 1e-6, "noise_ratio": 50.0}
PASSIVE: Mapping[str, Mapping[str, float]] = {"passive-off": {}, "passive-on": {}, "constant": {"value": math.nan}}
#: Of a frame's controllers.
OPTIONS: Mapping[str, Mapping[str, float]] = {
    **PASSIVE,
    "clipped-optimal": {"balance": math.nan, "r": 1e-17, "noise_ratio": 50.0, **_LEVEL, **_WEAK},
    "modulated-optimal": {**_BALANCED, "force_max": math.nan, **_WEAK},
    "force-tracking": {**_BALANCED, **_WEAK},
    "lyapunov": {"balance": 1.0, "noise_ratio": 50.0, **_LEVEL, **_WEAK},
    "max-dissipation": {"noise_ratio": 50.0, **_LEVEL, **_WEAK},
    "skyhook": {"damping": math.nan, "leak": math.nan, **_LEVEL, **_WEAK},
    IDEAL: _BALANCED,
}


def regulators(lqg: Mapping[str, float], level: Mapping[str, float]) -> dict[str, Mapping[str, float]]:
    """Kinds of controller over the matrices and measurements of any structure, and a skyhook, with their options.

    lqg: options of an LQG force; level: of on/off switching.
    """
    noise = {"noise_ratio": lqg["noise_ratio"], **level}
    return {
        **PASSIVE,
        "clipped-optimal": {**lqg, **level},
        "modulated-optimal": {**lqg, "force_max": math.nan},
        "force-tracking": lqg,
        "lyapunov": noise,
        "max-dissipation": noise,
        "skyhook": {"damping": math.nan, "leak": math.nan, **level},
    }


class AnySite(ABC):
    """What a controller is made for.

    damper: its model (rig `damper`); command_max: the largest command, A or V; period: of control, s; force_max: N at
    the largest command. environment: id of that which policies for it are trained in, or the name of a structure of
    one's own. options: kind of controller -> its options with their defaults, NaN: worked out from the site.
    """

    damper: Model
    command_max: float
    period: float
    force_max: float
    environment: ClassVar[str]
    options: ClassVar[Mapping[str, Mapping[str, float]]]

    @property
    @abstractmethod
    def linear(self) -> Linear:
        """The structure."""

    @abstractmethod
    def lqg(self, options: Mapping[str, float]) -> Lqg:
        """Of an LQG force or a Lyapunov function, from options of a kind."""

    @abstractmethod
    def ranges(self) -> Mapping[str, tuple[float, float]]:
        """What tuning chooses from, the lower and the upper end, by option or `kind.option`."""

    @property
    def dampers(self) -> int:
        return self.linear.dampers

    def builders(self) -> Mapping[str, Builder]:
        """Of kinds of its own, or that mean something else here."""
        return {}

    def inverse(self) -> Inverse:
        from mrdamp.inverse import LawInverse

        return LawInverse(self.damper, self.period, commands=(0.0, self.command_max))


def largest_command(model: Model) -> float:
    """A or V. Raises InputError where the model has none."""
    largest = model.attributes.get("command_max", math.nan)
    if not 0 < largest < math.inf:
        raise InputError(
            f"{model.name}: no command_max among its parameters; add it to the model file (mrdamp sets NAME prints one)"
        )
    return largest


def largest_force(damper: Model, command: float, stroke: float = 1e-2, w: float = 10.0, n: int = 200) -> float:
    """N at a command, the size of a damper's forces: of one moved by a sine of `stroke` (m) and w (rad/s) for n ms."""
    dt = 1e-3
    x = stroke * np.sin(w * dt * np.arange(n))
    u = np.full(n, command)
    return float(np.abs(damper.simulate(dt, {"displacement_m": x, "command": u})["force_N"]).max())


@dataclass(frozen=True)
class Site(AnySite):
    """Of a frame: the frame with the places of its dampers, the damper's model (rig `damper`), the
    largest command (A or V) and the control period, s."""

    frame: ShearFrame
    damper: Model
    command_max: float
    period: float = 1e-3

    environment: ClassVar[str] = "mrdamp/Frame-v0"
    options: ClassVar[Mapping[str, Mapping[str, float]]] = OPTIONS

    @classmethod
    def of(cls, model: Model, period: float = 1e-3) -> Site:
        """From a model of the rig `frame`, its frame with what it can hold of the effects. Raises InputError."""
        if model.structure is None:
            raise InputError(f"{model.name}: rig damper has no frame")
        own = tuple(e for e in model.effects if e.place is None)
        damper = replace(model, rig="damper", structure=None, effects=own)
        return cls(model.built, damper, largest_command(model), period)

    @cached_property
    def force_max(self) -> float:  # type: ignore[override]
        return largest_force(self.damper, self.command_max)

    @property
    def linear(self) -> Linear:
        return linear(self.frame)

    def lqg(self, options: Mapping[str, float]) -> Lqg:
        """Dyke's own weights where no balance is given."""
        balance = options.get("balance", math.nan)
        regulate = None if math.isnan(balance) else balanced(self.frame, balance)
        return Lqg(regulate=regulate, r=options.get("r", 1e-17), noise_ratio=options["noise_ratio"])

    def ranges(self) -> Mapping[str, tuple[float, float]]:
        """Forces are weighed in units of the structure's mass."""
        mass, first, force = float(self.frame.mass.sum()), self.linear.first, self.force_max
        return {
            "balance": (1.0, 1e4), "lyapunov.balance": (1e-2, 1e4), "r": (1e-5 / mass**2, 10.0 / mass**2),
            "noise_ratio": (10.0, 1e5), "level": (0.1, 1.0), "weak": (0.0, 0.3 * force),
            "force_max": (0.05 * force, 2.0 * force), "damping": (0.1 * first * mass, 50.0 * first * mass),
            "leak": (1.0 / first, 100.0 / first),
        }  # fmt: skip


def balanced(frame: ShearFrame, balance: float) -> dict[str, float]:
    """Weights of the regulated outputs: 1 on every floor's absolute acceleration, balance w1^4 on every drift.

    w1 (rad/s) is the frame's first frequency: with balance 1 a drift x and an acceleration w1^2 x cost the same.
    """
    floors = range(1, frame.storeys + 1)
    weight = balance * float(2 * np.pi * frame.frequencies[0]) ** 4
    return {f"acceleration_{j}": 1.0 for j in floors} | {f"drift_{j}": weight for j in floors}


#: Makes a controller for a site; every option is given.
Builder = Callable[[Any, Mapping[str, float]], Controller]


def _modulated(site: AnySite, o: Mapping[str, float]) -> Controller:
    largest = site.force_max if math.isnan(o["force_max"]) else o["force_max"]
    return modulated_optimal(site.linear, site.command_max, largest, site.period, **site.lqg(o))


def _lyapunov(site: AnySite, o: Mapping[str, float]) -> Controller:
    level, weights = o["level"] * site.command_max, site.lqg(o).get("regulate")
    return lyapunov(site.linear, level, weights, o["noise_ratio"], site.period)


def _constant(site: AnySite, o: Mapping[str, float]) -> Controller:
    if not 0 <= o["value"] <= site.command_max * (1 + 1e-9):
        given = "missing" if math.isnan(o["value"]) else f"{o['value']:g}"
        raise InputError(f"constant: value is {given}; allowed: 0 to {site.command_max:g}, the largest command")
    return Constant(o["value"], f"constant {o['value']:g}", site.period)


def _skyhook(site: AnySite, o: Mapping[str, float]) -> Controller:
    damping, leak = (None if math.isnan(o[key]) else o[key] for key in ("damping", "leak"))
    return skyhook(site.linear, o["level"] * site.command_max, damping, leak, site.period)


#: Kinds of controllers of any structure: how they are made, and what they do.
BUILDERS: Mapping[str, tuple[Builder, str]] = {
    "passive-off": (lambda site, o: passive_off(site.period), "no command"),
    "passive-on": (lambda site, o: passive_on(site.command_max, site.period), "the largest command"),
    "constant": (_constant, "the same command at all times"),
    "clipped-optimal": (
        lambda site, o: clipped_optimal(site.linear, o["level"] * site.command_max, site.period, **site.lqg(o)),
        "LQG force with on/off switching; by default as Dyke et al. 1996; level: command that is on, over the largest",
    ),
    "modulated-optimal": (_modulated, "LQG force with a command in proportion to it"),
    "force-tracking": (
        lambda site, o: force_tracking(site.linear, site.inverse(), **site.lqg(o)),
        "LQG force through the damper's inverse model",
    ),
    "lyapunov": (_lyapunov, "on where the force takes a Lyapunov function down"),
    "max-dissipation": (
        lambda site, o: max_dissipation(site.linear, o["level"] * site.command_max, o["noise_ratio"], site.period),
        "on where the force resists the damper's motion",
    ),
    "skyhook": (_skyhook, "a dashpot to a fixed point in space, with on/off switching"),
    IDEAL: (
        lambda site, o: ideal_active(site.linear, site.period, **site.lqg(o)),
        "the LQG force itself, from an ideal actuator that can push as well",
    ),
}


#: Least and largest value of options that are not any number.
_ALLOWED = {"level": (0.0, 1.0), "balance": (0.0, math.inf), "weak": (0.0, math.inf)}


def parse(spec: str, defaults: Mapping[str, Mapping[str, float]] | None = None) -> tuple[str, str, Options]:
    """Kind, a policy's path or "", and options of `kind`, `kind:key=value,...`, `policy:PATH` or `own:...`.

    defaults: kind -> options, those of a frame's controllers by default. Raises InputError.
    """
    defaults = OPTIONS if defaults is None else defaults
    kind, _, rest = spec.partition(":")
    if kind in (POLICY, OWN):
        if not rest:
            raise InputError(f"controller {kind}: give its file, as in {kind}:PATH")
        return kind, rest, {}
    if kind not in defaults:
        raise InputError(f"controller {kind!r} is unknown; there are {', '.join(defaults)}, {POLICY}:PATH")
    options: Options = {}
    allowed = defaults[kind]
    for part in filter(None, rest.split(",")):
        key, _, value = part.partition("=")
        if key not in allowed:
            raise InputError(
                f"controller {kind}: option {key!r} is unknown; allowed: {', '.join(allowed) or 'none'}"
            )
        try:
            options[key] = float(value)
        except ValueError:
            raise InputError(f"controller {kind}: {key} is {value!r}; allowed: a number") from None
        if not math.isfinite(options[key]):
            raise InputError(f"controller {kind}: {key} is {value}; allowed: a finite number")
        low, high = _ALLOWED.get(key, (-math.inf, math.inf))
        if not low <= options[key] <= high:
            ends = f"{low:g} to {high:g}" if math.isfinite(high) else f"{low:g} or more"
            raise InputError(f"controller {kind}: {key} is {value}; allowed: {ends}")
    return kind, "", options


def make(spec: str, site: AnySite) -> Controller:
    """The controller of a spec for a site, as it is: see `mrdamp.control.told` for one that is compared.

    Raises InputError.
    """
    kind, path, options = parse(spec, site.options)
    if kind == POLICY:
        from mrdamp.control.policy import Policy

        return Policy.read(path)
    o = {**site.options[kind], **options}
    build = site.builders().get(kind) or BUILDERS[kind][0]
    try:
        made = build(site, o)
    except InputError as error:  # of what a controller is made of
        said = str(error)
        raise InputError(said if said.startswith(kind) else f"controller {kind}: {said}") from None
    return _at_least(made, o.get("weak", 0.0), site)


def _at_least(controller: Controller, weak: float, site: AnySite) -> Controller:
    """With the least command of the learned policies, for a force `weak` of the damper without current, N."""
    if not weak:
        return controller
    least = LeastCommand(site.command_max, 1.4 * weak, 0.7 * weak, 0.5 * weak)
    return AtLeast(controller, least, _LEAK / (site.linear.first / (2 * math.pi)), site.dampers)


def is_ideal(spec: str) -> bool:
    return parse(spec)[0] == IDEAL


def spec(kind: str, options: Mapping[str, float]) -> str:
    """`kind:key=value,...`, what `parse` reads."""
    rest = ",".join(f"{key}={value:.6g}" for key, value in options.items())
    return f"{kind}:{rest}" if rest else kind
