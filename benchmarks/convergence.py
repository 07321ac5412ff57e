"""Does the chain converge? Laws, effects and pairs of effects over their legal ranges, at the default steps against a
fine one and against SciPy; work over closed cycles; the engine against the chain.

`benchmarks.convergence_page` writes the page.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp import sets
from mrdamp.errors import InputError
from mrdamp.model import core

Array = NDArray[np.float64]

DT, END = 1e-3, 0.5  # s, of a record
STEP = 5e-4  # s, the default inner step
FINE = 1.25e-5  # s, the reference's inner step

#: Laws with their largest command: on the motion below each yields at some 100 N, the foam damper at 10 N.
LAWS: Mapping[str, tuple[str, Mapping[str, float], float]] = {
    "bingham": ("bingham", {"c0a": 300.0, "c0b": 300.0, "fya": 50.0, "fyb": 400.0, "v_ref": 0.01}, 1.0),
    "bouc_wen": (
        "bouc_wen",
        {
            "c0a": 300.0, "c0b": 300.0, "alpha_a": 50.0, "alpha_b": 400.0, "gamma": 500.0, "beta": 300.0, "A": 800.0,
            "n": 2.0, "k0": 500.0, "x0": 0.01,
        },
        1.0,
    ),
    "bouc_wen, n = 1.4": (
        "bouc_wen",
        {
            "c0a": 300.0, "c0b": 300.0, "alpha_a": 50.0, "alpha_b": 400.0, "gamma": 500.0, "beta": 300.0, "A": 800.0,
            "n": 1.4, "k0": 500.0, "x0": 0.01,
        },
        1.0,
    ),
    "modified_bouc_wen": ("modified_bouc_wen", sets.load("spencer1997_3kN").parameters, 2.0),
    "hyperbolic_tangent": ("hyperbolic_tangent", sets.load("zapateiro_foam_tanh").parameters, 3.5),
}  # fmt: skip

_LAG = {"driver_lag_tau": 0.01}
_REMANENCE = {"remanence_b": 0.1, "remanence_d": 0.1}
_POCKET = {
    "trapped_gas_force": 50.0,
    "trapped_gas_s_g": 0.003,
    "trapped_gas_series": 1.0,
    "trapped_gas_shape": 1.3,
}
_LOSS = {"trapped_gas_d": 0.5, "trapped_gas_s_g": 0.003}
_SEAL = {"seal_friction_coulomb": 100.0}
_STRIBECK = {**_SEAL, "seal_friction_breakaway": 1.6}
_MASS = {"moving_mass_m": 5.0}
_MOUNT = {"mount_compliance_k": 2e5}
_LASH = {"backlash_gap": 0.001}
#: Forms of the effects with typical values, which a draw scales.
FORMS: Mapping[str, Mapping[str, float]] = {
    "lag": _LAG,
    "fast lag": {"driver_lag_tau": 1e-4},
    "two poles": {"driver_lag_tau": 0.006, "driver_lag_tau2": 0.004},
    "eddy currents": {"driver_lag_tau": 0.006, "driver_lag_tau2": 0.02, "driver_lag_share": 0.3},
    "lag of a fall": {**_LAG, "driver_lag_fall": 0.03},
    "limited rate": {"driver_lag_tau": 0.005, "driver_lag_rate": 50.0},
    "pair of poles": {"driver_lag_tau": 0.008, "driver_lag_ratio": 0.4},
    "current controller": {
        "driver_lag_tau": 0.02, "driver_lag_gain": 5.0, "driver_lag_integral": 0.02, "driver_lag_limit": 3.0,
    },
    "delay": {"command_delay_d": 0.0123},
    "spread delay": {"command_delay_d": 0.012, "command_delay_spread": 0.5},
    "clock": {"command_delay_d": 0.004, "command_delay_period": 0.0137, "command_delay_phase": 0.3},
    "saturation": {"saturation_i_s": 0.5},
    "Froehlich": {"saturation_i_s": 0.5, "saturation_shape": 1.0, "saturation_full": 1.0},
    "remanence": _REMANENCE,
    "remanence of stops": {**_REMANENCE, "remanence_stops": 1.0, **_LAG},
    "remanence with knee": {
        **_REMANENCE, "remanence_up": 0.5, "remanence_down": -0.3, "remanence_knee": 1.0, **_LAG,
    },
    "heating": {
        "heating_kappa": 0.02, "heating_kappa_yield": 0.01, "heating_capacity": 5.0, "heating_loss": 2.0,
    },
    "heating of two bodies": {
        "heating_kappa": 0.02, "heating_capacity": 5.0, "heating_loss": 2.0, "heating_link": 5.0, "heating_body": 10.0,
    },
    "asymmetry": {"asymmetry_a": 0.3},
    "asymmetry by force": {"asymmetry_a": 0.3, "asymmetry_force": 100.0},
    "asymmetry by travel": {"asymmetry_a": 0.3, "asymmetry_travel": 0.002},
    "asymmetry in time": {"asymmetry_a": 0.3, "asymmetry_time": 0.01},
    "asymmetry of parts": {"asymmetry_yield": 0.3, "asymmetry_viscous": -0.3},
    "thinning": {"shear_thinning_m": 0.6, "shear_thinning_v_s": 0.05},
    "thinning of both": {
        "shear_thinning_m": 0.6, "shear_thinning_v_s": 0.05, "shear_thinning_series": 1.0, "shear_thinning_shape": 1.0,
    },
    "gas": _LOSS,
    "gas pocket": {**_LOSS, "trapped_gas_reach": 0.006, "trapped_gas_width": 0.01},
    "gas in time": {**_LOSS, "trapped_gas_time": 0.05},
    "gas limit": {"trapped_gas_force": 50.0, "trapped_gas_s_g": 0.003},
    "gas in series": _POCKET,
    "gas in series, both sides": {**_POCKET, "trapped_gas_direction": 0.0},
    "gas spring": {
        "gas_spring_k": 3000.0, "gas_spring_k2": 5.0, "gas_spring_k3": 20.0, "gas_spring_f0": 50.0,
    },
    "seal": _SEAL,
    "seal, Stribeck": {**_STRIBECK, "seal_friction_v_s": 0.01},
    "seal, width": {**_SEAL, "seal_friction_width": 0.002},
    "mass": _MASS,
    "ringing mass": {**_MASS, "moving_mass_hz": 60.0},
    "two ringing masses": {
        **_MASS, "moving_mass_hz": 60.0, "moving_mass_hz2": 110.0, "moving_mass_share": 0.7,
    },
    "mount": _MOUNT,
    "hardening mount": {
        **_MOUNT, "mount_compliance_k3": 1e5, "mount_compliance_stop": 0.001, "mount_compliance_stiffer": 5.0,
    },
    "mount with friction": {**_MOUNT, "mount_compliance_friction": 50.0, "mount_compliance_slide": 1e-4},
    "mount with loss": {**_MOUNT, "mount_compliance_loss": 0.7},
    "mount and mass": {**_MOUNT, **_MASS},
    "mount and gas": {**_MOUNT, **_POCKET},
    "mount and seal": {**_MOUNT, **_STRIBECK},
    "backlash": _LASH,
    "backlash and mount": {**_LASH, **_MOUNT},
    "backlash and mass": {**_LASH, "moving_mass_m": 2.0},
    "backlash, mass, seal": {**_LASH, "moving_mass_m": 2.0, **_SEAL},
}  # fmt: skip

#: Attributes that choose a form; they are not scaled.
_CHOICES = {
    "trapped_gas_series", "trapped_gas_direction", "trapped_gas_end", "remanence_stops", "moving_mass_beyond",
    "shear_thinning_series", "command_delay_phase",
}  # fmt: skip
_SCALE = 1.3  # decades to either side of the typical value


@dataclass(frozen=True)
class Draw:
    """law: a key of `LAWS`; forms: keys of `FORMS`; settings: attributes of the effects."""

    law: str
    forms: tuple[str, ...]
    settings: Mapping[str, float]

    def force(self, step: float) -> Array:
        """(n,) N on the motion and the command of every draw, by inner steps of at most `step` (s)."""
        law, parameters, largest = LAWS[self.law]
        t: Array = np.arange(round(END / DT) + 1, dtype=np.float64) * DT
        x, v, a = motion(t)
        u = command(t, 0.2 * largest if law == "hyperbolic_tangent" else 0.0, largest)
        run = core.run(
            law, {**parameters, **self.settings}, DT, x, v, a, u, hold=True, substep=step, columns=("force",)
        )
        return run["force"]


def motion(t: Array) -> tuple[Array, Array, Array]:
    """Two sines from rest: displacement, velocity, acceleration at t (n,), 26 mm and .2 m/s at most."""
    x, v, a = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
    for size, hz in ((0.01, 2.0), (0.003, 5.3)):
        w = 2 * np.pi * hz
        x += size * (1 - np.cos(w * t))
        v += size * w * np.sin(w * t)
        a += size * w * w * np.cos(w * t)
    return x, v, a


def command(t: Array, low: float, high: float) -> Array:
    """(n,) a new level every 40 ms."""
    levels = np.random.default_rng(3).uniform(low, high, 100)
    return np.asarray(levels[np.floor(t / 0.04 + 1e-6).astype(int)])


def draw(rng: np.random.Generator) -> Draw:
    """One or two effects on a law; every parameter within its range, up to a factor of 20 from its typical value."""
    limits = {a.name: (a.minimum, a.maximum) for a in core.attributes()}
    law = str(rng.choice(list(LAWS)))
    forms = tuple(str(f) for f in rng.choice(list(FORMS), size=rng.integers(1, 3), replace=False))
    settings = {name: value for form in forms for name, value in FORMS[form].items()}
    for name, value in settings.items():
        low, high = limits[name]
        if name not in _CHOICES and high > 1.5:
            scaled = value * 10 ** rng.uniform(-_SCALE, _SCALE)
            settings[name] = float(np.clip(scaled, low, high))
    return Draw(law, forms, settings)


def rattles(one: Draw) -> bool:
    """True if a mass stands free between a damper and a mount or a clearance: it bounces, almost undamped.

    Then the force at a sample hangs on the phase of hundreds of impacts, which no step gives.
    """
    series = any(name in one.settings for name in ("backlash_gap", "mount_compliance_k"))
    return series and "moving_mass_m" in one.settings and "moving_mass_hz" not in one.settings


def rms(values: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values * values)))


def error(one: Draw, step: float = STEP) -> float:
    """RMS of the force at inner steps of `step` (s) less that at `FINE`, over the latter's RMS."""
    fine = one.force(FINE)
    return rms(one.force(step) - fine) / rms(fine)


def draws(seed: int, count: int) -> list[Draw]:
    """Legal ones: pairs that exclude each other are drawn again."""
    rng, found = np.random.default_rng(seed), list[Draw]()
    while len(found) < count:
        one = draw(rng)
        try:
            one.force(STEP)
        except InputError:
            continue
        found.append(one)
    return found


def work_made(law: str, settings: Mapping[str, float], amplitude: float, hz: float = 5.0) -> float:
    """Least work of a steady cycle at a constant command over the sum of its size, both over three cycles.

    Below 0 the damper supplies it. The motion rises to its amplitude (m) in 0.4 s.
    """
    name, parameters, largest = LAWS[law]
    dt, w = 5e-4, 2 * np.pi * hz
    n = round((0.4 + 12 / hz) / dt) + 1
    t: Array = np.arange(n, dtype=np.float64) * dt
    rise = np.clip(t / 0.4, 0, 1) ** 2 * (3 - 2 * np.clip(t / 0.4, 0, 1))
    x = amplitude * rise * np.sin(w * t)
    run = core.run(
        name, {**parameters, "x0": 0.0, **settings} if "x0" in parameters else {**parameters, **settings},
        dt, x, u=np.full(n, largest), hold=True, columns=("force",),
    )  # fmt: skip
    last = slice(n - 1 - round(3 / hz / dt), n)
    force, path = run["force"][last], np.diff(x[last])
    parts = 0.5 * (force[1:] + force[:-1]) * path
    size = np.abs(parts).sum()
    return float(parts.sum() / size) if size > 0 else 0.0


#: Effects that neither store a preload nor depend on the direction: a steady cycle cannot give work.
PASSIVE = (
    "lag", "saturation", "remanence", "heating", "thinning", "gas in series", "gas in series, both sides", "seal",
    "seal, Stribeck", "mount", "mount with friction", "mount with loss", "mount and gas", "backlash",
)  # fmt: skip
AMPLITUDES = (2e-5, 1e-4, 5e-4, 2e-3)  # m


@dataclass(frozen=True)
class Structure:
    """name; steps: default time step (s) by engine; run: on an engine at a time step (s) from rest, names of signals
    and (periods, signals) under commands that switch between none and the largest at every fifth period at most."""

    name: str
    steps: Mapping[str, float]
    run: Callable[[str, float], tuple[Sequence[str], Array]]

    @property
    def fine(self) -> float:
        """s, of the reference: a tenth of the shortest default."""
        return min(self.steps.values()) / 10


def structures() -> Iterator[Structure]:
    """The structures of the environments with their default dampers."""
    from mrdamp.envs import AmbientLoads, CableTask, FrameTask
    from mrdamp.envs.car import CarTask
    from mrdamp.motions import kanai_tajimi
    from mrdamp.simulation.roads import iso8608

    motion = kanai_tajimi(3, duration=5.0, pga=5.0).compressed(5.0)
    load = AmbientLoads(duration=2.0, rms=(2.0, 2.0)).draw(
        np.random.default_rng(3), CableTask(1).structure.cable.length
    )
    kinds = (
        ("frame", FrameTask, {"motion": motion}),
        ("cable", CableTask, {"load": load}),
        ("quarter car", CarTask, {"road": iso8608("C", 20.0, 2.0, 1)}),
    )
    for name, task, options in kinds:

        def run(
            engine: str, timestep: float, task: Any = task, options: dict[str, Any] = options
        ) -> tuple[Sequence[str], Array]:
            one = task(1, engine=engine, timestep=timestep)
            one.reset([0], [np.random.default_rng(0)], options)
            rng, found = np.random.default_rng(4), list[Array]()
            for k in range(10000):
                if k % 5 == 0:
                    action = rng.choice([-1.0, 1.0], (1, 1))
                step = one.step(action)
                if step.over[0]:
                    break
                found.append(one.measured[0].copy())
            return one.rows.names, np.array(found)

        yield Structure(name, {engine: step for engine, (_, step) in task.kind.engines.items()}, run)


def apart(found: Array, expected: Array) -> Array:
    """(signals,) RMS of the differences over the RMS."""
    return np.asarray(np.sqrt(np.mean((found - expected) ** 2, axis=0) / np.mean(expected**2, axis=0)))
