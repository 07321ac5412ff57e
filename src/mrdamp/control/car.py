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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy import sparse
from scipy.linalg import expm, solve_discrete_are

from mrdamp.control import registry
from mrdamp.control.clipped_optimal import Lqg, estimator
from mrdamp.control.force_control import Aim, ForceController, Several, SkyhookForce, Tracking
from mrdamp.control.lqg import Linear, Plant, named_rows
from mrdamp.errors import InputError, require_positive
from mrdamp.model import Model
from mrdamp.structures import FloatArray
from mrdamp.structures.lumped import QuarterCar

if TYPE_CHECKING:
    from mrdamp.control.registry import AnySite

_MOST = 200  # forces in a horizon


class MpcForce:
    """Clipped model-predictive control: a quadratic program of the damper's forces over a horizon.

        min  sum over the horizon of y_r^T Q y_r + r f^2, and what an LQ regulator would cost behind it
        with |f_k| <= f_max, and f_0 of the sign of the stroke's velocity, as a damper only resists

    The first force is wanted, and followed through the damper's inverse. As in Canale, Milanese and Novara 2006 (doi
    10.1109/TCST.2006.880196), but with the program solved on line, by OSQP (Stellato et al. 2020, doi
    10.1007/s12532-020-00179-2), and states from the Kalman filter.

    o: options of the LQ force, and horizon, s. Raises InputError, also
    where OSQP is not installed."""

    def __init__(self, site: AnySite, o: Mapping[str, float]) -> None:
        try:
            import osqp
        except ImportError:
            raise InputError(
                "clipped-mpc needs osqp, which is not installed: pip install 'mrdamp[mpc]'"
            ) from None
        horizon = o["horizon"]
        steps = round(horizon / site.period)
        if not 1 <= steps <= _MOST:
            raise InputError(f"clipped-mpc: horizon is {horizon} s; allowed: 1 to {_MOST} control periods")
        whole, lqg = site.linear, site.lqg(o)
        linear, weights = whole.plant, dict(lqg["regulate"] or {})
        self._estimator = estimator(whole, lqg["noise_ratio"], site.period)
        n = len(linear.a)
        both = np.zeros((n + 1, n + 1))
        both[:n, :n], both[:n, n] = linear.a, linear.b
        moved = expm(both * site.period)
        a, b = moved[:n, :n], moved[:n, n:]
        c, d = whole.outputs(tuple(weights))
        cost = np.diag(list(weights.values()))
        q, s, rr = c.T @ cost @ c, c.T @ cost @ d[:, None], float(d @ cost @ d) + lqg["r"]
        # Forces in units of the largest, so that the program is well scaled.
        largest = site.force_max
        b, s, rr = b * largest, s * largest, rr * largest**2
        end = solve_discrete_are(a, b, q, np.array([[rr]]), s=s)
        # x_k = power x_0 + reach f, for k = 0 ... steps.
        power, reach = [np.eye(n)], [np.zeros((n, steps))]
        for k in range(steps):
            after = a @ reach[-1]
            after[:, k] += b[:, 0]
            power.append(a @ power[-1])
            reach.append(after)
        hessian = rr * np.eye(steps)
        slope = np.zeros((steps, n))
        for k in range(steps):
            hessian += reach[k].T @ q @ reach[k]
            mixed = np.zeros((steps, steps))
            mixed[k] = (s.T @ reach[k])[0]
            hessian += mixed + mixed.T
            slope += reach[k].T @ q @ power[k]
            slope[k] += (s.T @ power[k])[0]
        hessian += reach[-1].T @ end @ reach[-1]
        slope += reach[-1].T @ end @ power[-1]
        scale = 1 / float(np.abs(np.diag(hessian)).max())
        self._slope, self._largest = scale * slope, largest
        self._low, self._high = -np.ones(steps), np.ones(steps)
        self._solver: Any = osqp.OSQP()
        self._solver.setup(
            sparse.csc_matrix(np.triu(scale * (hessian + hessian.T) / 2)), np.zeros(steps),
            sparse.csc_matrix(np.eye(steps)), self._low, self._high, verbose=False, eps_abs=1e-4, eps_rel=1e-4,
            polishing=False,
        )  # fmt: skip
        self._steps = steps

    def reset(self) -> None:
        self._estimator.reset()
        rest = np.zeros(self._steps)
        self._solver.warm_start(x=rest, y=rest)
        self._before: list[tuple[Any, Any]] = []

    def __call__(self, t: float, y: Mapping[str, float]) -> Any:
        states, extends = self._estimator(y), np.asarray(y["stroke_velocity"]) > 0
        if states.ndim == 1:
            return self._solve(t, states, bool(extends))[0]
        rest = np.zeros(self._steps)
        found = []
        for (x, dual), state, way in zip(
            self._before or [(rest, rest)] * len(extends), states.T, extends.tolist(), strict=True
        ):
            self._solver.warm_start(x=x, y=dual)
            found.append(self._solve(t, state, way))
        self._before = [(solved.x, solved.y) for _, solved in found]
        return np.array([force for force, _ in found])

    def _solve(self, t: float, state: FloatArray, extends: bool) -> tuple[float, Any]:
        """The force, N, from the states (n,), and the solution."""
        self._low[0], self._high[0] = (0.0, 1.0) if extends else (-1.0, 0.0)
        self._solver.update(q=self._slope @ state, l=self._low, u=self._high)
        found = self._solver.solve(raise_error=False)
        if not np.isfinite(found.x[0]):
            raise InputError(f"clipped-mpc: no solution at {t:g} s: {found.info.status}")
        return float(np.clip(found.x[0], self._low[0], self._high[0])) * self._largest, found


#: Of white noise on what the Kalman filter gets, per sample: wheel and body, m/s2, stroke, m.
MEASURED = {"acceleration_1": 0.5, "acceleration_2": 0.05, "stroke": 2e-4}


def car_plant(car: QuarterCar) -> Plant:
    """States z_w - w, z_b - z_w, z_w', z_b'; e (4,) per m/s of the road's velocity, which is white noise on a road of
    ISO 8608."""
    a, e, _, _ = car.passive(0.0)
    return Plant(a, np.array([0.0, 0.0, 1 / car.wheel, -1 / car.body]), e[:, 0])


def car_outputs(car: QuarterCar, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Rows c (p, 4) and feedthrough d (p,) of measurements by name. Raises InputError."""
    linear = car_plant(car)
    rows = {
        "acceleration_1": linear.a[2],
        "acceleration_2": linear.a[3],
        "drift_1": np.array([1.0, 0.0, 0.0, 0.0]),
        "stroke": np.array([0.0, 1.0, 0.0, 0.0]),
        "stroke_velocity": np.array([0.0, 0.0, -1.0, 1.0]),
    }
    direct = {"acceleration_1": linear.b[2], "acceleration_2": linear.b[3]}
    return named_rows(rows, direct, names)


def regulated(car: QuarterCar, holding: float, stroke: float) -> dict[str, float]:
    """Weights of body acceleration, tyre deflection and stroke.

    Each of the last two is weighed against an acceleration of 1 m/s2: holding, per (m_b 1 m/s2 / k_t)^2 of deflection;
    stroke, per (1 m/s2 over the square of the bounce's frequency)^2.
    """
    return {
        "acceleration_2": 1.0,
        "drift_1": holding * (car.tyre_stiffness / car.body) ** 2,
        "stroke": stroke * car.bounce**4,
    }


class Velocities(Several):
    """Base of what acts on the absolute velocities of wheel and body, from their accelerometers by v' = a - v / leak.

    leak, period: s.
    """

    def __init__(self, leak: float, period: float) -> None:
        super().__init__([SkyhookForce(floor, 1.0, 1.0, leak, period) for floor in (1, 2)])

    def velocities(self, t: float, y: Mapping[str, float]) -> tuple[float, float]:
        """Of wheel and body, m/s."""
        wheel, body = (floor(t, y) for floor in self.parts)
        return wheel, body


class HookForce(Velocities):
    """Wanted force share c z_b' - (1 - share) c z_w'. damping: c, N s/m; share: 1 skyhook, 0 groundhook."""

    def __init__(self, damping: float, share: float, leak: float, period: float) -> None:
        if not 0 <= share <= 1:
            raise InputError(f"hybrid: share is {share}; allowed: 0 to 1")
        require_positive("hybrid", damping=damping)
        super().__init__(leak, period)
        self.damping, self.share = damping, share

    def __call__(self, t: float, y: Mapping[str, float]) -> float:
        wheel, body = self.velocities(t, y)
        return self.damping * (self.share * body - (1 - self.share) * wheel)


#: Whether the field is on, from velocities of wheel and body, the stroke's velocity and the body's acceleration.
Switch = Callable[[float, float, float, float], bool]


class Switching(Velocities):
    """On/off control by a `Switch`. command_max: A or V; leak, period: s."""

    def __init__(self, name: str, switch: Switch, command_max: float, leak: float, period: float) -> None:
        super().__init__(leak, period)
        self.name, self.period = name, period
        self._switch, self._on = switch, command_max

    def command(self, t: float, y: Mapping[str, float]) -> float:
        wheel, body = self.velocities(t, y)
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


_LEAK = {"leak": 1.0}  # s, of the integrators, slow against the bounce
_SWITCH = {**_LEAK, "level": 1.0}  # level: of on/off switching, command over the largest
_LQ = {"holding": 0.3, "stroke": 0.03, "r": 1e-3, "roughness": 1e-3}  # roughness: class C at 20 m/s


@dataclass(frozen=True)
class CarSite(registry.AnySite):
    """Of a quarter car.

    command_max: the largest command, A or V; force_max: the force at that command, N; period: of control, s.
    """

    car: QuarterCar
    damper: Model
    command_max: float
    force_max: float
    period: float = 5e-3

    environment: ClassVar[str] = "mrdamp/QuarterCar-v0"
    options: ClassVar[Mapping[str, Mapping[str, float]]] = {
        **registry.PASSIVE,
        "skyhook": {"damping": math.nan, **_LEAK},
        "skyhook-switch": _SWITCH,
        "groundhook": {"damping": math.nan, **_LEAK},
        "hybrid": {"damping": math.nan, **_LEAK, "share": 0.5},
        "add": _SWITCH,
        "sh-add": {"alpha": 12.0, **_SWITCH},
        "clipped-lq": {**_LQ, "level": 1.0},
        "lq-tracking": _LQ,
        "clipped-mpc": {**_LQ, "horizon": 0.1},
    }

    @property
    def linear(self) -> Linear:
        """White noise is that per sample."""
        car, rows = self.car, partial(car_outputs, self.car)
        deviation = np.array(list(MEASURED.values())) * math.sqrt(self.period)
        return Linear(car_plant(car), rows, tuple(MEASURED), regulated(car, 0.3, 0.03), car.bounce, deviation=deviation)

    def lqg(self, options: Mapping[str, float]) -> Lqg:
        """r: of (f / m_b)^2; roughness: intensity of the road's velocity, m2/s."""
        weights = regulated(self.car, options["holding"], options["stroke"])
        return Lqg(regulate=weights, r=options["r"] / self.car.body**2, noise_ratio=options["roughness"])

    def ranges(self) -> Mapping[str, tuple[float, float]]:
        critical = self.car.critical_damping
        return {
            "leak": (0.05, 5.0), "level": (0.01, 1.0), "damping": (0.01 * critical, 2.0 * critical),
            "share": (0.0, 1.0), "alpha": (0.5, 100.0), "holding": (1e-2, 10.0), "stroke": (1e-3, 1.0),
            "r": (1e-4, 10.0), "roughness": (1e-5, 1e-1), "horizon": (0.02, 0.3),
        }  # fmt: skip

    def builders(self) -> Mapping[str, registry.Builder]:
        return {
            "skyhook": lambda site, o: site.hook(o, 1.0, "skyhook"),
            "skyhook-switch": lambda site, o: site.switching(o, skyhook_switch, "skyhook-switch"),
            "groundhook": lambda site, o: site.hook(o, 0.0, "groundhook"),
            "hybrid": lambda site, o: site.hook(o, o["share"], "hybrid"),
            "add": lambda site, o: site.switching(o, add_switch, "add"),
            "sh-add": lambda site, o: site.switching(o, sh_add_switch(o["alpha"]), "sh-add"),
            "clipped-lq": registry.BUILDERS["clipped-optimal"][0],
            "lq-tracking": registry.BUILDERS["force-tracking"][0],
            "clipped-mpc": lambda site, o: site.tracked(MpcForce(site, o), "clipped-mpc"),
        }

    def tracked(self, aim: Aim, name: str) -> ForceController:
        """The aim through the inverse of the site's damper."""
        return ForceController(aim, Tracking(self.inverse()), self.period, name)

    def hook(self, o: Mapping[str, float], share: float, name: str) -> ForceController:
        """By default as much as would damp the body critically."""
        damping = self.car.critical_damping if math.isnan(o["damping"]) else o["damping"]
        return self.tracked(HookForce(damping, share, o["leak"], self.period), name)

    def switching(self, o: Mapping[str, float], switch: Switch, name: str) -> Switching:
        return Switching(name, switch, o["level"] * self.command_max, o["leak"], self.period)
