"""Controllers of a quarter car: switching laws of its two accelerations and stroke, and wanted forces that are tracked.

z_b, z_w: heights of body and wheel; the damper's force f is positive where it is being extended, z_b' > z_w'. On/off,
the field is on where

    skyhook      z_b' (z_b' - z_w') > 0    Karnopp, Crosby and Harwood 1974, doi 10.1115/1.3438373
    ADD          z_b'' (z_b' - z_w') > 0   Savaresi, Silani and Bittanti 2005, doi 10.1115/1.1898241
    SH-ADD       ADD where z_b''^2 > (alpha z_b')^2, else skyhook   Savaresi and Spelta 2007, doi 10.1115/1.2745846

Continuous skyhook, groundhook (Valasek, Novak, Sika and Vaculin, Vehicle System Dynamics 27 (1997)) and their mix want
f = share c z_b' - (1 - share) c z_w' and follow it through the damper's inverse. Velocities come from the
accelerometers by leaky integrators; z_b' - z_w' is measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.car_mpc import MpcForce
from mrdamp.control.car_plant import MEASURED, CarSite, car_outputs, car_plant, regulated
from mrdamp.control.clipped_optimal import plant_force
from mrdamp.control.force_control import Aim, ForceController, OnOff, Tracking
from mrdamp.control.passive import Constant, passive_off, passive_on
from mrdamp.control.skyhook import SkyhookForce
from mrdamp.errors import InputError, require_positive
from mrdamp.inverse import LawInverse


class Velocities:
    """Absolute velocities of wheel and body from their accelerometers: v' = a - v / leak, m/s."""

    def __init__(self, leak: float, period: float) -> None:
        self._floors = tuple(SkyhookForce(floor, 1.0, 1.0, leak, period) for floor in (1, 2))

    def reset(self) -> None:
        for floor in self._floors:
            floor.reset()

    def __call__(self, t: float, y: Mapping[str, float]) -> tuple[float, float]:
        """Of wheel and body."""
        wheel, body = (floor(t, y) for floor in self._floors)
        return wheel, body


class _FromVelocities:
    """Base of what acts on `Velocities`. leak, period: s."""

    def __init__(self, leak: float, period: float) -> None:
        self._velocities = Velocities(leak, period)

    def reset(self) -> None:
        self._velocities.reset()


class HookForce(_FromVelocities):
    """Wanted force share c z_b' - (1 - share) c z_w'. damping: c, N s/m; share: 1 skyhook, 0 groundhook."""

    def __init__(self, damping: float, share: float, leak: float, period: float) -> None:
        if not 0 <= share <= 1:
            raise InputError(f"hybrid: share is {share}; allowed: 0 to 1")
        require_positive("hybrid", damping=damping)
        super().__init__(leak, period)
        self.damping, self.share = damping, share

    def __call__(self, t: float, y: Mapping[str, float]) -> float:
        wheel, body = self._velocities(t, y)
        return self.damping * (self.share * body - (1 - self.share) * wheel)


#: Whether the field is on, from velocities of wheel and body, the stroke's velocity and the body's acceleration.
Switch = Callable[[float, float, float, float], bool]


class Switching(_FromVelocities):
    """On/off control by a `Switch`. command_max: A or V; leak, period: s."""

    def __init__(self, name: str, switch: Switch, command_max: float, leak: float, period: float) -> None:
        super().__init__(leak, period)
        self.name, self.period = name, period
        self._switch, self._on = switch, command_max

    def command(self, t: float, y: Mapping[str, float]) -> float:
        wheel, body = self._velocities(t, y)
        return self._on * self._switch(wheel, body, y["stroke_velocity"], y["acceleration_2"])


def skyhook_switch(wheel: float, body: float, stroke: float, acceleration: float) -> bool:
    return body * stroke > 0


def add_switch(wheel: float, body: float, stroke: float, acceleration: float) -> bool:
    return acceleration * stroke > 0


def sh_add_switch(alpha: float) -> Switch:
    """alpha: rad/s, above which acceleration decides. Raises InputError."""
    require_positive("sh-add", alpha=alpha)

    def switch(wheel: float, body: float, stroke: float, acceleration: float) -> Any:
        rules = acceleration**2 > (alpha * body) ** 2
        return np.where(rules, acceleration, body) * stroke > 0

    return switch


def lq_force(site: CarSite, holding: float, stroke: float, r: float, roughness: float) -> Aim:
    """LQG force for these weights. r: of (f / m_b)^2; roughness: intensity of the road's velocity, m2/s."""
    car = site.car
    deviation = np.array(list(MEASURED.values())) * math.sqrt(site.period)
    return plant_force(
        car_plant(car), lambda names: car_outputs(car, names), regulated(car, holding, stroke), r / car.body**2,
        roughness, site.period, tuple(MEASURED), deviation,
    )  # fmt: skip


def tracked(site: CarSite, aim: Aim, name: str) -> ForceController:
    """The aim through the inverse of the site's damper."""
    inverse = LawInverse(site.damper, site.period, commands=(0.0, site.command_max))
    return ForceController(aim, Tracking(inverse), site.period, name)


#: Leak: s, of the integrators, slow against the bounce; level: of on/off switching, command over the largest;
#: roughness: class C at 20 m/s.
_LEAK = {"leak": 1.0}
_SWITCH = {**_LEAK, "level": 1.0}
_LQ = {"holding": 0.3, "stroke": 0.03, "r": 1e-3, "roughness": 1e-3}
#: Kind -> options with their defaults; NaN: worked out from the site.
OPTIONS: Mapping[str, Mapping[str, float]] = {
    "passive-off": {},
    "passive-on": {},
    "constant": {"value": 0.0},
    "skyhook": {"damping": math.nan, **_LEAK},
    "skyhook-switch": _SWITCH,
    "groundhook": {"damping": math.nan, **_LEAK},
    "hybrid": {"damping": math.nan, "share": 0.5, **_LEAK},
    "add": _SWITCH,
    "sh-add": {"alpha": 12.0, **_SWITCH},
    "clipped-lq": {**_LQ, "level": 1.0},
    "lq-tracking": _LQ,
    "clipped-mpc": {**_LQ, "horizon": 0.1},
}


def make(spec: str, site: CarSite) -> Controller:
    """The controller of a spec (see `mrdamp.control.registry`) for a car. Raises InputError."""
    kind, path, options = registry.parse(spec, OPTIONS)
    if kind == registry.POLICY:
        return registry.policy(path)
    o = {**OPTIONS[kind], **options}
    # By default as much as would damp the body critically.
    damping = o.get("damping", math.nan)
    c = site.car.critical_damping if math.isnan(damping) else damping

    def hook(share: float) -> ForceController:
        return tracked(site, HookForce(c, share, o["leak"], site.period), kind)

    def switching(switch: Switch) -> Switching:
        return Switching(kind, switch, o["level"] * site.command_max, o["leak"], site.period)

    def force() -> Aim:
        return lq_force(site, o["holding"], o["stroke"], o["r"], o["roughness"])

    def mpc() -> ForceController:
        return tracked(
            site, MpcForce(site, o["holding"], o["stroke"], o["r"], o["roughness"], o["horizon"]), kind
        )

    builders: Mapping[str, Callable[[], Controller]] = {
        "passive-off": lambda: passive_off(site.period),
        "passive-on": lambda: passive_on(site.command_max, site.period),
        "constant": lambda: Constant(o["value"], f"constant {o['value']:g}", site.period),
        "skyhook": lambda: hook(1.0),
        "skyhook-switch": lambda: switching(skyhook_switch),
        "groundhook": lambda: hook(0.0),
        "hybrid": lambda: hook(o["share"]),
        "add": lambda: switching(add_switch),
        "sh-add": lambda: switching(sh_add_switch(o["alpha"])),
        "clipped-lq": lambda: ForceController(
            force(), OnOff(o["level"] * site.command_max), site.period, kind
        ),
        "lq-tracking": lambda: tracked(site, force(), kind),
        "clipped-mpc": mpc,
    }
    return builders[kind]()
