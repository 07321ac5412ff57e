"""Controllers of a frame by name, with options: `clipped-optimal:r=1e-10,balance=1`, `constant:value=0.75`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mrdamp.control.base import Controller
from mrdamp.control.clipped_optimal import (
    Lqg,
    clipped_optimal,
    force_tracking,
    ideal_active,
    modulated_optimal,
)
from mrdamp.control.least_command import AtLeast, LeastCommand
from mrdamp.control.lyapunov import lyapunov, max_dissipation
from mrdamp.control.passive import Constant, passive_off, passive_on
from mrdamp.control.skyhook import skyhook
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.structures import ShearFrame

POLICY, OWN = "policy", "own"
IDEAL = "ideal-active"
Options = dict[str, float]
_LEAK = 15.0  # periods of the first mode, of the peak that `weak` is compared with


@dataclass(frozen=True)
class Site:
    """What a controller is made for: the frame with the places of its dampers, the damper's model (rig `damper`), the
    largest command (A or V) and the control period, s."""

    frame: ShearFrame
    damper: Model
    command_max: float
    period: float = 1e-3

    @classmethod
    def of(cls, model: Model, period: float = 1e-3) -> Site:
        """From a model of the rig `frame`, its frame with what it can hold of the effects. Raises InputError."""
        if model.structure is None:
            raise InputError(f"{model.name}: rig damper has no frame")
        largest = model.attributes.get("command_max", math.nan)
        if not 0 < largest < math.inf:
            raise InputError(f"{model.name}: no command_max among its parameters; give the largest command")
        own = tuple(e for e in model.effects if e.place is None)
        damper = replace(model, rig="damper", structure=None, effects=own)
        held, s = model.frame, model.structure
        frame = ShearFrame(held.mass, held.stiffness, held.damping, s.damper_between, s.others)
        return cls(frame, damper, largest, period)

    @property
    def dampers(self) -> int:
        return len(self.frame.places)

    def force_max(self) -> float:
        """N at the largest command, of the damper moved at 0.1 m/s through 1 cm: the size of its forces."""
        dt, n = 1e-3, 200
        x = 1e-2 * np.sin(10 * dt * np.arange(n))
        u = np.full(n, self.command_max)
        return float(np.abs(self.damper.simulate(dt, {"displacement_m": x, "command": u})["force_N"]).max())


#: Makes a controller for a site; every option is given.
Builder = Callable[[Site, Mapping[str, float]], Controller]


@dataclass(frozen=True)
class Entry:
    """One kind of controller. options: name -> default; NaN: worked out from the site. about: one line."""

    build: Builder
    about: str
    options: Mapping[str, float]


def balanced(frame: ShearFrame, balance: float) -> dict[str, float]:
    """Weights of the regulated outputs: 1 on every floor's absolute acceleration, balance w1^4 on every drift.

    w1 (rad/s) is the frame's first frequency: with balance 1 a drift x and an acceleration w1^2 x cost the same.
    """
    floors = range(1, frame.storeys + 1)
    weight = balance * float(2 * np.pi * frame.frequencies[0]) ** 4
    return {f"acceleration_{j}": 1.0 for j in floors} | {f"drift_{j}": weight for j in floors}


def _lqg(site: Site, o: Mapping[str, float]) -> Lqg:
    """Dyke's own weights where no balance is given."""
    regulate = None if math.isnan(o["balance"]) else balanced(site.frame, o["balance"])
    return Lqg(regulate=regulate, r=o["r"], noise_ratio=o["noise_ratio"])


def _optimal(site: Site, o: Mapping[str, float]) -> Controller:
    return clipped_optimal(site.frame, o["level"] * site.command_max, site.period, **_lqg(site, o))


def _modulated(site: Site, o: Mapping[str, float]) -> Controller:
    largest = site.force_max() if math.isnan(o["force_max"]) else o["force_max"]
    return modulated_optimal(site.frame, site.command_max, largest, site.period, **_lqg(site, o))


def _tracking(site: Site, o: Mapping[str, float]) -> Controller:
    from mrdamp.inverse import LawInverse

    inverse = LawInverse(site.damper, site.period, commands=(0.0, site.command_max))
    return force_tracking(site.frame, inverse, **_lqg(site, o))


def _active(site: Site, o: Mapping[str, float]) -> Controller:
    return ideal_active(site.frame, site.period, **_lqg(site, o))


def _lyapunov(site: Site, o: Mapping[str, float]) -> Controller:
    weights = balanced(site.frame, o["balance"])
    return lyapunov(site.frame, o["level"] * site.command_max, weights, o["noise_ratio"], site.period)


def _skyhook(site: Site, o: Mapping[str, float]) -> Controller:
    given = {key: None if math.isnan(o[key]) else o[key] for key in ("damping", "leak")}
    return skyhook(site.frame, o["level"] * site.command_max, given["damping"], given["leak"], site.period)


_DYKE = {"balance": math.nan, "r": 1e-17, "noise_ratio": 50.0}
_LEVEL = {"level": 1.0}  # of on/off switching, over the largest command
_WEAK = {"weak": 0.0}  # N, that the damper resists weak motion with, where its command is never small: `_at_least`
_BALANCED = {"balance": 100.0, "r": 1e-6, "noise_ratio": 50.0}

ENTRIES: Mapping[str, Entry] = {
    "passive-off": Entry(lambda site, o: passive_off(site.period), "no command", {}),
    "passive-on": Entry(lambda site, o: passive_on(site.command_max, site.period), "the largest command", {}),
    "constant": Entry(
        lambda site, o: Constant(o["value"], f"constant {o['value']:g}", site.period),
        "the same command at all times",
        {"value": 0.0},
    ),
    "clipped-optimal": Entry(
        _optimal,
        "LQG force with on/off switching; by default as Dyke et al. 1996; level: command that is on, over the largest",
        {**_DYKE, **_LEVEL, **_WEAK},
    ),
    "modulated-optimal": Entry(
        _modulated,
        "LQG force with a command in proportion to it",
        {**_BALANCED, "force_max": math.nan, **_WEAK},
    ),
    "force-tracking": Entry(_tracking, "LQG force through the damper's inverse model", {**_BALANCED, **_WEAK}),
    "lyapunov": Entry(
        _lyapunov,
        "on where the force takes a Lyapunov function down",
        {"balance": 1.0, "noise_ratio": 50.0, **_LEVEL, **_WEAK},
    ),
    "max-dissipation": Entry(
        lambda site, o: max_dissipation(
            site.frame, o["level"] * site.command_max, o["noise_ratio"], site.period
        ),
        "on where the force resists the damper's motion",
        {"noise_ratio": 50.0, **_LEVEL, **_WEAK},
    ),
    "skyhook": Entry(
        _skyhook,
        "a dashpot to a fixed point in space, with on/off switching",
        {"damping": math.nan, "leak": math.nan, **_LEVEL, **_WEAK},
    ),
    IDEAL: Entry(_active, "the LQG force itself, from an ideal actuator that can push as well", _BALANCED),
}


def parse(spec: str, defaults: Mapping[str, Mapping[str, float]] | None = None) -> tuple[str, str, Options]:
    """Kind, a policy's path or "", and options of `kind`, `kind:key=value,...`, `policy:PATH` or `own:...`.

    defaults: kind -> options, those of a frame's controllers by default. Raises InputError.
    """
    if defaults is None:
        defaults = {kind: entry.options for kind, entry in ENTRIES.items()}
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
    return kind, "", options


def options_of(spec: str) -> tuple[str, Options]:
    """Kind and options of what `spec` wrote."""
    kind, _, rest = spec.partition(":")
    return kind, {key: float(value) for key, _, value in (part.partition("=") for part in rest.split(",") if part)}


def policy(path: str) -> Controller:
    """An exported policy. Raises InputError."""
    from mrdamp.control.policy import Policy

    return Policy.read(Path(path))


def make(spec: str, site: Site) -> Controller:
    """The controller of a spec for a site, as it is: see `mrdamp.control.told` for one that is compared.

    Raises InputError.
    """
    kind, path, options = parse(spec)
    if kind == POLICY:
        return policy(path)
    entry = ENTRIES[kind]
    o = {**entry.options, **options}
    return _at_least(entry.build(site, o), o.get("weak", 0.0), site)


def _at_least(controller: Controller, weak: float, site: Site) -> Controller:
    """With the least command of the learned policies, for a force `weak` of the damper without current, N."""
    if not weak:
        return controller
    least = LeastCommand(site.command_max, 1.4 * weak, 0.7 * weak, 0.5 * weak)
    return AtLeast(controller, least, _LEAK / float(site.frame.frequencies[0]), site.dampers)


def is_ideal(spec: str) -> bool:
    """Whether the command is the force of an ideal actuator, N."""
    return parse(spec)[0] == IDEAL


def spec(kind: str, options: Mapping[str, float]) -> str:
    """`kind:key=value,...`, what `parse` reads."""
    rest = ",".join(f"{key}={value:.6g}" for key, value in options.items())
    return f"{kind}:{rest}" if rest else kind
