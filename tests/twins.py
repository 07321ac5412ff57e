"""Independent reference of the damper chain: the effects as ordinary differential equations, solved by SciPy.

command -> driver -> magnetics -> fluid -> mechanics -> mount -> sensor, with the attribute names of the
plugin. Nothing here is shared with the plugin. Reversals of the motion and jumps of the command are made
ends of integration intervals, so that no step runs over a kink that is known beforehand.

At t = 0 the driver rests at the command, the fluid and friction are free of force, the piston of a compliant
mount is where the springs balance, the high-pass of a sensor reads the force and its low-pass stands at that
reading.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from excitation import Array, Command, Motion, constant
from twin_laws import LAWS, Law, Softening

NEUTRAL: Mapping[str, float] = {
    "command_min": -math.inf, "command_max": math.inf,
    "driver_lag_tau": 0.0, "driver_lag_tau2": 0.0, "command_delay_d": 0.0,
    "saturation_i_s": 0.0, "saturation_shape": 0.0, "saturation_full": 0.0,
    "remanence_b": 0.0, "remanence_d": 0.1,
    "heating_kappa": 0.0, "heating_kappa_yield": 0.0, "heating_capacity": 100.0, "heating_loss": 0.0,
    "heating_start": 0.0, "asymmetry_a": 0.0, "asymmetry_width": 0.005,
    "shear_thinning_m": 1.0, "shear_thinning_v_s": 0.1, "shear_thinning_shape": 2.0, "shear_thinning_series": 0.0,
    "trapped_gas_d": 0.0, "trapped_gas_s_g": 0.001, "trapped_gas_direction": 1.0,
    "gas_spring_k": 0.0, "gas_spring_k2": 0.0, "gas_spring_f0": 0.0,
    "seal_friction_coulomb": 0.0, "seal_friction_breakaway": 1.0, "seal_friction_v_s": 0.005,
    "seal_friction_presliding": 2e-5, "moving_mass_m": 0.0,
    "mount_compliance_k": 0.0, "backlash_gap": 0.0, "backlash_k": 2e6,
    "sensor_gain_g": 1.0, "sensor_offset_f": 0.0, "sensor_leakage_tau": 0.0, "sensor_lag_tau": 0.0,
    "sensor_lag_tau2": 0.0, "channel_shift_d": 0.0,
}  # fmt: skip

COLUMNS = ("force", "reference", "true", "current", "field", "temperature", "piston", "state")


class Chain:
    """Right-hand side and outputs of one damper on one motion."""

    def __init__(self, law: str, attributes: Mapping[str, float], motion: Motion, command: Command) -> None:
        self.p = {**NEUTRAL, **attributes}
        self.law: Law = LAWS[law](self.p)
        self.motion = motion.shifted(self.p["channel_shift_d"]) if self.p["channel_shift_d"] else motion
        self.command = command
        self.piece = 0  # of the command
        self.stroke = (0.0, self.motion.x(0.0))  # direction, and where it began
        p, size = self.p, len(self.law.scales)
        self.rigid = p["mount_compliance_k"] == 0.0 and p["backlash_gap"] == 0.0
        self.spring = p["mount_compliance_k"] or p["backlash_k"]
        self.bristle = (
            p["seal_friction_coulomb"] * p["seal_friction_breakaway"] / p["seal_friction_presliding"]
        )
        # (name, absolute tolerance) of every state that is switched on
        parts: list[tuple[str, float]] = []
        parts += [(n, 1e-9) for n in ("driver_lag_tau", "driver_lag_tau2") if p[n] > 0.0]
        parts += [("remanence", 1e-9)] if p["remanence_b"] > 0.0 else []
        parts += [(f"law{k}", 1e-9 * scale) for k, scale in enumerate(self.law.scales)]
        heats = p["heating_kappa"] or p["heating_kappa_yield"] or p["heating_start"]
        parts += [("heat", 1e-8)] if heats else []
        parts += [("bristle", 1e-8 * p["seal_friction_presliding"])] if self.bristle else []
        parts += [] if self.rigid else [("piston", 1e-12)]
        self.inertial = not self.rigid and p["moving_mass_m"] > 0.0
        parts += [("speed", 1e-9)] if self.inertial else []
        parts += [
            (n, 1e-6) for n in ("sensor_leakage_tau", "sensor_lag_tau", "sensor_lag_tau2") if p[n] > 0.0
        ]
        self.index = {name: k for k, (name, _) in enumerate(parts)}
        self.atol = np.array([tolerance for _, tolerance in parts])
        self.laws = slice(self.index.get("law0", 0), self.index.get("law0", 0) + size)

    def start(self) -> Array:
        y = np.zeros(len(self.index))
        for name in ("driver_lag_tau", "driver_lag_tau2"):
            if name in self.index:
                y[self.index[name]] = self._command(0.0)[0]
        x = self._rest(y)
        y[self.laws] = self.law.start(x)
        for name, first in (("heat", self.p["heating_start"]), ("piston", x)):
            if name in self.index:
                y[self.index[name]] = first
        reading = self.p["sensor_gain_g"] * self.outputs(0.0, y)["reference"]
        for name in ("sensor_lag_tau", "sensor_lag_tau2"):
            if name in self.index:
                y[self.index[name]] = reading
        return y

    def _rest(self, y: Array) -> float:
        """Where the piston stands while the rod does: its springs may be preloaded."""
        rod = self.motion.x(0.0)
        if self.rigid:
            return rod

        def left(x: float) -> float:
            still = y.copy()
            still[self.laws] = self.law.start(x)
            still[self.index["piston"]] = x
            force = self._damper(still, x, 0.0, self._field(self._command(0.0)[0], y), self._softening(y))[1]
            return force - self._mount(0.0, still)

        if abs(left(rod)) < 1e-12:
            return rod
        reach = 1e-3
        while left(rod - reach) > 0.0 or left(rod + reach) < 0.0:
            reach *= 2.0
        return float(brentq(left, rod - reach, rod + reach, xtol=1e-15, rtol=1e-14))

    # --- driver and magnetics ----------------------------------------------------------
    def _command(self, t: float) -> tuple[float, float]:
        """Clamped, delayed command and its slope."""
        t = max(t - self.p["command_delay_d"], 0.0)
        u = self.command.pieces[self.piece](t)
        if self.p["command_min"] <= u <= self.p["command_max"]:
            return u, self.command.slopes[self.piece](t) if t > 0.0 else 0.0
        return min(max(u, self.p["command_min"]), self.p["command_max"]), 0.0

    def _current(self, t: float, y: Array, dy: Array | None) -> tuple[float, float]:
        """Coil current and its rate; writes the rates of the driver's states to dy."""
        i, rate = self._command(t)
        for name in ("driver_lag_tau", "driver_lag_tau2"):
            if name in self.index:
                k = self.index[name]
                rate = (i - float(y[k])) / self.p[name]
                i = float(y[k])
                if dy is not None:
                    dy[k] = rate
        return i, rate

    def _field(self, i: float, y: Array) -> float:
        if "remanence" in self.index:  # a coercive current: the loop closes where the circuit saturates
            i -= self.p["remanence_b"] * float(y[self.index["remanence"]])
        limit, shape = self.p["saturation_i_s"], self.p["saturation_shape"]
        if limit <= 0.0:
            return i

        def curve(current: float) -> float:
            if shape == 0.0:
                return limit * math.tanh(current / limit)
            return float(current / (1.0 + abs(current / limit) ** shape) ** (1.0 / shape))

        full = self.p["saturation_full"]
        return curve(i) * full / curve(full) if full > 0.0 else curve(i)

    # --- fluid and mechanics --------------------------------------------------------------
    def _softening(self, y: Array) -> Softening:
        rise = float(y[self.index["heat"]]) if "heat" in self.index else 0.0
        m, v_s, a = (self.p[f"shear_thinning_{name}"] for name in ("m", "v_s", "shape"))
        return Softening(
            math.exp(-self.p["heating_kappa"] * rise),
            math.exp(-self.p["heating_kappa_yield"] * rise),
            lambda v: float((1.0 + abs(v / v_s) ** a) ** ((m - 1.0) / a)),
            self.p["shear_thinning_series"],
        )

    def _bias(self, x: float, v: float) -> float:
        """Asymmetry and trapped gas: what the fluid's force is multiplied with."""
        p = self.p
        factor = 1.0 + p["asymmetry_a"] * math.tanh(v / p["asymmetry_width"])
        along, turn = self.stroke
        if p["trapped_gas_d"] > 0.0 and along != 0.0 and along * p["trapped_gas_direction"] >= 0.0:
            factor *= 1.0 - p["trapped_gas_d"] * math.exp(-(((x - turn) / p["trapped_gas_s_g"]) ** 2))
        return factor

    def _damper(self, y: Array, x: float, v: float, b: float, soft: Softening) -> tuple[float, float]:
        """Force of the fluid, and of fluid, springs and seal together."""
        p = self.p
        fluid, spring = self.law.forces([float(k) for k in y[self.laws]], x, v, b, soft)
        fluid *= self._bias(x, v)
        gas = p["gas_spring_k"] * x * (1.0 + p["gas_spring_k2"] * x) + p["gas_spring_f0"]
        seal = self.bristle * float(y[self.index["bristle"]]) if self.bristle else 0.0
        return fluid, fluid + spring + gas + seal

    # --- mount -------------------------------------------------------------------------------
    def _mount(self, t: float, y: Array) -> float:
        """Force in the spring of the mount, zero inside the clearance."""
        stretch = self.motion.x(t) - float(y[self.index["piston"]])
        return self.spring * math.copysign(max(abs(stretch) - self.p["backlash_gap"] / 2.0, 0.0), stretch)

    def _piston(self, t: float, y: Array, b: float, soft: Softening) -> tuple[float, float]:
        """Displacement and velocity of the piston."""
        if self.rigid:
            return self.motion.x(t), self.motion.v(t)
        x = float(y[self.index["piston"]])
        if self.inertial:
            return x, float(y[self.index["speed"]])
        pull = self._mount(t, y)

        def excess(v: float) -> float:
            return self._damper(y, x, v, b, soft)[1] - pull

        reach = 1e-3
        while excess(-reach) > 0.0 or excess(reach) < 0.0:
            reach *= 4.0
        return x, float(brentq(excess, -reach, reach, xtol=1e-15, rtol=1e-14))

    # --- together ----------------------------------------------------------------------------
    def outputs(self, t: float, y: Array, dy: Array | None = None) -> dict[str, float]:
        """Every column at one instant; fills the rates of all states where dy is given."""
        p, at = self.p, self.index
        i, i_rate = self._current(t, y, dy)
        b = self._field(i, y)
        soft = self._softening(y)
        x, v = self._piston(t, y, b, soft)
        fluid, damper = self._damper(y, x, v, b, soft)
        rod = damper + p["moving_mass_m"] * self.motion.a(t) if self.rigid else self._mount(t, y)
        true = damper if self.rigid or self.inertial else rod
        reading = charge = p["sensor_gain_g"] * rod
        if "sensor_leakage_tau" in at:
            reading = charge - float(y[at["sensor_leakage_tau"]])
            if dy is not None:
                dy[at["sensor_leakage_tau"]] = reading / p["sensor_leakage_tau"]
        for name in ("sensor_lag_tau", "sensor_lag_tau2"):
            if name in at:
                if dy is not None:
                    dy[at[name]] = (reading - float(y[at[name]])) / p[name]
                reading = float(y[at[name]])
        law_state = [float(k) for k in y[self.laws]]
        if dy is not None:
            dy[self.laws] = self.law.rates(law_state, x, v, b, soft)
            if "remanence" in at:
                h = float(y[at["remanence"]])
                dy[at["remanence"]] = i_rate / p["remanence_d"] * (1.0 - math.copysign(1.0, i_rate) * h)
            if "heat" in at:
                rise = float(y[at["heat"]])
                dy[at["heat"]] = (abs(fluid * v) - p["heating_loss"] * rise) / p["heating_capacity"]
            if self.bristle:
                dy[at["bristle"]] = v - self._slip(v) * float(y[at["bristle"]])
            if not self.rigid:
                dy[at["piston"]] = v
            if self.inertial:
                dy[at["speed"]] = (rod - damper) / p["moving_mass_m"]
        return {
            "force": reading + p["sensor_offset_f"], "reference": rod, "true": true, "current": i, "field": b,
            "temperature": float(y[at["heat"]]) if "heat" in at else 0.0, "piston": x,
            "state": law_state[0] if law_state else 0.0,
        }  # fmt: skip

    def _slip(self, v: float) -> float:
        """Rate at which the bristle of the seal gives way, 1/s."""
        p = self.p
        stribeck = math.exp(-((v / p["seal_friction_v_s"]) ** 2))
        g = p["seal_friction_coulomb"] * (1.0 + (p["seal_friction_breakaway"] - 1.0) * stribeck)
        return self.bristle * abs(v) / g

    def rates(self, t: float, y: Array) -> Array:
        dy = np.zeros_like(y)
        self.outputs(t, y, dy)
        return dy

    def enter(self, t: float, y: Array, stroke: tuple[float, float] | None) -> None:
        """Begin the interval that starts at t > 0: the next piece of the command, perhaps a new stroke."""
        before = self._command(t)[0]
        self.piece = self.command.piece(max(t - self.p["command_delay_d"], 0.0) + 1e-9)
        jump = self._command(t)[0] - before
        if "remanence" in self.index and "driver_lag_tau" not in self.index and jump:
            k = self.index["remanence"]  # h' = di/dt (...): a jump of i is a finite move along the branch
            end = math.copysign(1.0, jump)
            y[k] = end + (y[k] - end) * math.exp(-abs(jump) / self.p["remanence_d"])
        self.stroke = stroke or self.stroke


def strokes(motion: Motion, turns: list[float], end: float) -> dict[float, tuple[float, float]]:
    """When a stroke begins -> its direction and the position of the turn behind it. A turn counts from 10 um of way
    back: measured displacements are noisy, and so is the catalogue's "stroke since reversal" without such a width."""
    back, found = 1e-5, {}
    direction, turn = 0.0, motion.x(0.0)  # the furthest point of the stroke while it lasts
    for start, stop in itertools.pairwise([0.0, *turns, end]):
        x = motion.x(stop)
        heading = math.copysign(1.0, x - motion.x(start))
        if heading == direction:
            turn = max(turn * direction, x * direction) * direction
        elif (x - turn) * heading > back:
            level = turn + heading * back
            at = brentq(lambda t, level=level: motion.x(t) - level, start, stop, xtol=1e-14)
            found[float(at)] = (heading, turn)
            direction, turn = heading, x
    return found


def simulate(
    law: str,
    parameters: Mapping[str, float],
    motion: Motion,
    t_eval: Array,
    command: Command | None = None,
    *,
    rtol: float = 1e-8,
) -> dict[str, Array]:
    """The columns of a record at the times t_eval (n,), which start at 0, each (n,). At a jump of the command, and of
    a stroke that begins, a column has its value just after it."""
    chain = Chain(law, parameters, motion, command or constant(0.0))
    if not chain.rigid and chain.p["trapped_gas_d"] > 0.0:
        raise ValueError("the stroke of a piston behind a compliant mount is not known beforehand")
    end, delay = float(t_eval[-1]), chain.p["command_delay_d"]
    turns = chain.motion.turns(end)
    jumps = [t + delay for t in chain.command.breaks] + ([delay] if delay else [])
    begun = strokes(chain.motion, turns, end) if chain.p["trapped_gas_d"] else {}
    ends = sorted({*turns, *begun, *(t for t in jumps if t < end), end})
    y, now = chain.start(), 0.0
    rows: list[dict[str, float]] = []
    for until in ends:
        inside = t_eval[(t_eval > now - 1e-12) & (t_eval < until - 1e-12)]
        times = np.union1d(np.maximum(inside, now), [until])
        if len(y):
            solution = solve_ivp(
                chain.rates, (now, until), y, "LSODA", t_eval=times, rtol=rtol, atol=chain.atol, max_step=0.02
            )
            if not solution.success:
                raise RuntimeError(solution.message)
            states = solution.y.T
        else:
            states = np.zeros((len(times), 0))
        rows += [chain.outputs(float(t), s) for t, s in zip(times[:-1], states, strict=False)]
        y, now = states[-1].copy(), until
        chain.enter(now, y, begun.get(until))
    rows.append(chain.outputs(end, y))
    return {name: np.array([row[name] for row in rows]) for name in COLUMNS}
