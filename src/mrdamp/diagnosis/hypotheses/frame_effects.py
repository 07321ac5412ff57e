"""Catalogue of a frame: effects of storeys, floors and floor sensors, and the structure's nominal parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mrdamp.diagnosis.hypotheses.damper_effects import rms
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Form, Sizes, Term, declared, linear, positive
from mrdamp.model import FLOOR_SENSOR_EFFECTS, STRUCTURE_EFFECTS, Effect
from mrdamp.records import Record
from mrdamp.structures import ShearFrame


def structure_coordinates(s: ShearFrame) -> tuple[Coordinate, ...]:
    """Masses, stiffnesses and damping, free about their nominal values: range of a factor of 4, prior of a
    third."""
    out = []
    for kind in ("mass", "stiffness", "damping"):
        for j, value in enumerate(getattr(s, kind), start=1):
            size = float(value) or float(np.max(s.damping)) or 1.0
            out.append(Coordinate(f"{kind}@{j}", size, size / 4, 4 * size, 0.1, log=True, prior=3.0))
    return tuple(out)


def frame_terms(s: ShearFrame, records: Sequence[Record], sizes: Sizes) -> tuple[Term, ...]:
    """Effects of each storey, floor and accelerometer, from the ground up."""
    out: list[Term] = []
    for j in range(1, s.storeys + 1):
        shear, acceleration = _sizes(s, records, j)
        dashpot = float(s.damping[j - 1]) / (sizes.velocity or 1.0)
        out += _storey(j, float(s.mass[j - 1]), shear, dashpot)
        out += _accelerometer(j, acceleration, sizes.sample_time)
    # A relative change of zero damping has no effect.
    return tuple(t for t in out if t.effect != "storey_damping" or s.damping[(t.place or 1) - 1] > 0)


def _storey(j: int, mass: float, shear: float, dashpot: float) -> tuple[Term, ...]:
    """mass (kg) of floor j; shear (N): force in its storey; dashpot (N s2/m2): its damping over a velocity.
    """
    stiffness = (linear(f"storey_stiffness_e@{j}", 0.05, -0.8, 3.0),)
    damping = (linear(f"storey_damping_e@{j}", 0.3, -0.99, 60.0),)
    quadratic = (damping[0], linear(f"storey_damping_quadratic@{j}", 0.3 * dashpot, 0.0, 300 * dashpot))
    friction = (
        linear(f"joint_friction_coulomb@{j}", 0.02 * shear, 0.0, 2 * shear),
        positive(f"joint_friction_width@{j}", 2e-3, 5e-5, 0.1),
    )
    bristle = (friction[0], positive(f"joint_friction_presliding@{j}", 3e-5, 1e-6, 2e-3))
    e, up = 0.3 * dashpot, 3 * dashpot
    mu, more = 0.02 * shear, 0.1 * shear
    dm = (linear(f"floor_mass_dm@{j}", 0.03 * mass, -0.8 * mass, 3 * mass),)

    def at(effect: str, *forms: Form) -> tuple[Term, ...]:
        return declared(effect, *forms, stage="structure", place=j)

    return (
        *at("storey_stiffness", Form("", stiffness, ((0.05,), (-0.2,)))),
        *at(
            "storey_damping",
            Form("", damping, ((0.3,), (3.0,), (-0.4,))),
            Form("quadratic", quadratic, ((0.3, e), (1.0, up))),
        ),
        *at(
            "joint_friction",
            Form("", friction, ((mu, 2e-3), (more, 2e-3))),
            Form("building up", bristle, ((mu, 3e-5), (more, 1e-4))),
        ),
        *at("floor_mass", Form("", dm, ((0.03 * mass,), (0.2 * mass,)))),
    )


def _accelerometer(j: int, acceleration: float, dt: float) -> tuple[Term, ...]:
    """acceleration (m/s2) measured by the accelerometer of floor j; sample time dt (s)."""
    offset = linear(f"sensor_offset_f@{j}", 0.02 * acceleration, -5 * acceleration, 5 * acceleration)
    settling = (
        offset,
        linear(f"sensor_offset_settle@{j}", 0.02 * acceleration, -10 * acceleration, 10 * acceleration),
        positive(f"sensor_offset_time@{j}", 1.0, 0.02, 100.0),
    )
    leakage = positive(f"sensor_leakage_tau@{j}", 1.0, 0.01, 200.0)
    lag = (
        positive(f"sensor_lag_tau@{j}", 2 * dt, 0.1 * dt, 50 * dt),
        positive(f"sensor_lag_tau2@{j}", 0.3 * dt, 0.05 * dt, 25 * dt),
    )
    shares = (
        leakage,
        linear(f"sensor_leakage_share@{j}", 0.1, 0.0, 0.9),
        positive(f"sensor_leakage_tau2@{j}", 10.0, 0.05, 1000.0),
    )
    filtered = (lag[0], positive(f"sensor_lag_ratio@{j}", 0.8, 0.3, 0.98, 0.2))
    gain = (positive(f"sensor_gain_g@{j}", 1.0, 0.2, 5.0, 0.05),)
    f = 0.02 * acceleration

    def at(effect: str, *forms: Form) -> tuple[Term, ...]:
        return declared(effect, *forms, stage="sensor", place=j)

    return (
        *at("sensor_gain", Form("", gain, ((1.05,), (0.95,)))),
        *at(
            "sensor_offset",
            Form("", (offset,), ((f,), (-f,))),
            Form("settling", settling, ((f, f, 1.0),)),
        ),
        *at(
            "sensor_leakage",
            Form("", (leakage,), ((1.0,), (0.1,))),
            Form("two shares", shares, ((1.0, 0.2, 10.0), (0.2, 0.2, 2.0))),
        ),
        *at(
            "sensor_lag",
            Form("", lag, ((2 * dt, 0.2 * dt), (5 * dt, dt))),
            Form("second order", filtered, ((dt, 0.8), (4 * dt, 0.8))),
        ),
    )


def _sizes(s: ShearFrame, records: Sequence[Record], j: int) -> tuple[float, float]:
    """RMS force (N) in storey j, from the floors above, and RMS acceleration (m/s2) of floor j."""
    floors = range(j, s.storeys + 1)
    shear, acceleration = [], []
    for r in records:
        a = [
            r.channels.get(f"floor{k}_acceleration_m_s2", r.channel("ground_acceleration_m_s2"))
            for k in floors
        ]
        shear.append(rms(np.sum([s.mass[k - 1] * x for k, x in zip(floors, a, strict=True)], axis=0)))
        acceleration.append(rms(np.asarray(a[0])))
    return float(np.mean(shear)), float(np.mean(acceleration))


def placed_effects(settings: Mapping[str, float]) -> list[Effect]:
    """Effects with a place, from settings `EFFECT_PARAMETER@PLACE`."""
    found: dict[tuple[str, int], dict[str, float]] = {}
    for key, value in settings.items():
        head, _, place = key.partition("@")
        for name in (*STRUCTURE_EFFECTS, *FLOOR_SENSOR_EFFECTS):
            if place and head.startswith(f"{name}_"):
                found.setdefault((name, int(place)), {})[head.removeprefix(f"{name}_")] = value
    return [Effect(name, parameters, place) for (name, place), parameters in found.items()]
