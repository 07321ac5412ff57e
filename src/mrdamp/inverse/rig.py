"""A rig to try inverses on: a damper with every effect of a real one, and records of it to identify from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mrdamp.inverse.baselines import Fixed
from mrdamp.inverse.tracking import STEP, RandomMotion, random_level, rms, track
from mrdamp.model import Effect, Model
from mrdamp.model.core import Array
from mrdamp.records import Record, RecordSet

_FORCE_NOISE = 0.005  # standard deviations, of the RMS force, displacement and velocity
_MOTION_NOISE = 0.0005
_VELOCITY_NOISE = 0.002


@dataclass(frozen=True)
class Sizes:
    """RMS force (N) under the largest command, displacement (m), velocity (m/s), acceleration (m/s2)."""

    force: float
    displacement: float
    velocity: float
    acceleration: float
    command: float

    @classmethod
    def of(cls, model: Model, motion: RandomMotion, command: float, seconds: float = 4.0) -> Sizes:
        """Of a model under a motion."""
        run = track(model, motion, np.zeros(round(seconds / STEP)), Fixed(command))
        _, _, a = motion.sample(run.time)
        return cls(rms(run.force), rms(run.displacement), rms(run.velocity), rms(a), command)

    @property
    def noise(self) -> tuple[float, float, float]:
        """Standard deviations of what is measured of stroke (m), velocity (m/s) and force (N)."""
        return (
            _MOTION_NOISE * self.displacement, _VELOCITY_NOISE * self.velocity, _FORCE_NOISE * self.force,
        )  # fmt: skip


def with_effects_of_a_rig(model: Model, s: Sizes) -> Model:
    """The model with what a real rig adds, each by a few percent of its size; effects that it has stay as they are."""
    stiffness = s.force / s.displacement
    added = {
        "driver_lag": {"tau": 6e-3, "tau2": 1.5e-3},
        "command_delay": {"d": 2e-3},
        "saturation": {"i_s": 1.5 * s.command},
        "remanence": {"b": 0.03 * s.command, "d": 0.2 * s.command},
        # A minute at this size warms the fluid by 20 K.
        "heating": {"kappa": 0.004, "kappa_yield": 0.004, "capacity": 3 * s.force * s.velocity},
        "asymmetry": {"a": 0.03, "width": 0.05 * s.velocity},
        "shear_thinning": {"m": 0.9, "v_s": s.velocity},
        "trapped_gas": {"d": 0.1, "s_g": 0.1 * s.displacement},
        "gas_spring": {"k": 0.05 * stiffness, "f0": 0.02 * s.force},
        "seal_friction": {"coulomb": 0.03 * s.force, "breakaway": 1.3, "v_s": 0.05 * s.velocity,
                          "presliding": 0.01 * s.displacement},
        "moving_mass": {"m": 0.01 * s.force / s.acceleration},
        "mount_compliance": {"k": 20 * stiffness},
        "backlash": {"gap": 0.01 * s.displacement},
        "sensor_gain": {"g": 1.02},
        "sensor_offset": {"f": 0.01 * s.force},
        "sensor_leakage": {"tau": 20.0},
        "sensor_lag": {"tau": 5e-4},
    }  # fmt: skip
    if model.law == "narx":  # has no viscosity of its own
        del added["shear_thinning"], added["heating"]
    own = {effect.name: dict(effect.parameters) for effect in model.effects}
    effects = tuple(Effect(name, added.get(name, {}) | own.get(name, {})) for name in {**added, **own})
    return replace(model, effects=effects, name=f"{model.name} with effects of a rig")


def records_of(
    plant: Model, motion: RandomMotion, s: Sizes, *, count: int = 6, seconds: float = 12.0, rate: float = 500.0,
    seed: int = 0,
) -> RecordSet:  # fmt: skip
    """Records of the damper with measurement noise: random motions of the same spectrum under random commands.

    Half of the commands are smooth with every level as likely, half are steps; every third record is held out.
    """
    seeds = np.random.SeedSequence(seed).spawn(count)
    made = []
    for k, child in enumerate(seeds):
        numbers = child.generate_state(4)
        t = np.arange(round(seconds * rate), dtype=np.float64) / rate
        x, v, a = replace(motion, seed=int(numbers[0])).sample(t)
        rng = np.random.default_rng(child)
        level = random_level(t, 8.0, int(numbers[1])) if k % 2 else _steps(t, rng)
        inputs = {
            "displacement_m": x,
            "velocity_m_s": v,
            "acceleration_m_s2": a,
            "command": s.command * level,
        }
        out = plant.simulate(1 / rate, inputs, hold=True)
        noise = rng.standard_normal((3, len(t))) * np.array(s.noise)[:, None]
        channels = {
            "displacement_m": x + noise[0], "velocity_m_s": v + noise[1], "command": inputs["command"],
            "force_N": out["force_N"] + noise[2],
        }  # fmt: skip
        made.append(Record(f"{'smooth' if k % 2 else 'steps'}_{k + 1}", None, 1 / rate, channels))
    validation = set(range(2, count, 3)) or {count - 1}
    return RecordSet(
        "made",
        tuple(r for k, r in enumerate(made) if k not in validation),
        tuple(r for k, r in enumerate(made) if k in validation),
    )


def _steps(t: Array, rng: np.random.Generator) -> Array:
    """Levels from 0 to 1 that hold for 20 to 300 ms."""
    ends = np.cumsum(rng.uniform(0.02, 0.3, round(t[-1] / 0.02) + 2))
    levels = np.clip(rng.uniform(-0.15, 1.15, len(ends)), 0.0, 1.0)
    return np.asarray(levels[np.searchsorted(ends, t)])
