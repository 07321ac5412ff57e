"""Forms of the effects between fluid and load cell: mechanics and mount."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mrdamp.blindtest.scale import Form, Scale, Sized


def _spring_polytropic(r: np.random.Generator, c: Scale) -> Sized:
    length = c.stroke * r.uniform(4.0, 6.0)
    return lambda s: {"spring_form": 1, "spring_f0": 0.4 * c.force * s, "spring_length": length}


def _spring_power(r: np.random.Generator, c: Scale) -> Sized:
    k, end, power = r.uniform(0.1, 0.3) * c.force / c.stroke, r.uniform(0.05, 0.12) * c.force, r.uniform(2.0, 4.0)
    f0, fixed = r.uniform(0.0, 0.3) * c.force, {"spring_form": 2, "spring_length": c.stroke, "spring_power": power}
    return lambda s: {**fixed, "spring_f0": f0 * s, "spring_k": k * s, "spring_end": end * s}


def _spring_thermal(r: np.random.Generator, c: Scale) -> Sized:
    """Gas that warms when it is pressed and cools down at the wall: between adiabatic and isothermal."""
    length, time = c.stroke * r.uniform(4.5, 6.5), r.uniform(0.2, 1.5)
    fixed = {"spring_form": 3, "spring_length": length, "spring_time": time}
    return lambda s: {**fixed, "spring_f0": 0.4 * c.force * s}


def _spring_rates(r: np.random.Generator, c: Scale) -> Sized:
    """Two rates, as of an accumulator that takes fluid above its charge pressure only."""
    rate = c.force / c.stroke
    f0, k = r.uniform(0.0, 0.3) * c.force, r.uniform(0.15, 0.35) * rate
    more = k * r.choice([r.uniform(-0.8, -0.5), r.uniform(1.0, 2.0)])
    fixed = {
        "spring_form": 4,
        "spring_knee": c.stroke * r.uniform(-0.6, 0.6),
        "spring_length": 0.15 * c.stroke,
    }
    return lambda s: {**fixed, "spring_f0": f0 * s, "spring_k": k * s, "spring_end": more * s}


def _seal(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        fixed = {
            "seal_form": form,
            "seal_static": r.uniform(1.1, 1.7),
            "seal_v": r.uniform(0.002, 0.01),
            "seal_slide": r.uniform(15e-6, 60e-6) * {2: 2, 5: 4}.get(form, 1),
        }
        return lambda s: {**fixed, "seal_coulomb": 0.4 * c.force * s}

    return draw


def _mass(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        spring = r.uniform(70.0, 140.0) if form == 2 else 0.0
        return lambda s: {"rod.mass": 0.5 * c.force / c.acceleration * s, "rod.mass_hz": spring}

    return draw


def _mass_bush(r: np.random.Generator, c: Scale) -> Sized:
    """Held by a rubber bush that loses much of what it takes up."""
    hz, loss = r.uniform(25.0, 60.0), r.uniform(1.5, 4.0)
    time = r.uniform(0.5, 1.5) / (2 * np.pi * hz)
    fixed = {"rod.mass_hz": hz, "rod.mass_loss": loss, "rod.mass_time": time}
    return lambda s: {**fixed, "rod.mass": 0.5 * c.force / c.acceleration * s}


def _mass_parts(r: np.random.Generator, c: Scale) -> Sized:
    """One part rigid, one on a spring."""
    fixed = {"rod.mass_hz": r.uniform(25.0, 60.0), "rod.mass_rigid": r.uniform(0.3, 0.6)}
    return lambda s: {**fixed, "rod.mass": 0.5 * c.force / c.acceleration * s}


def _mount(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        power = r.uniform(1.0, 2.5)
        fixed = {"mount_form": form, "mount_c": 0.2 * c.force, "mount_mass": c.piston, "mount_power": power}

        def sized(s: float) -> dict[str, float]:
            k = c.force / (0.5 * c.stroke * s)
            return {**fixed, "mount_k": k, "mount_scale": 1.5 * c.force / k}

        return sized

    return draw


def _mount_rates(r: np.random.Generator, c: Scale) -> Sized:
    """A bush that meets its stop."""
    knee, ratio = r.uniform(0.5, 1.2), r.uniform(2.5, 4.0)
    fixed = {"mount_form": 5, "mount_c": 0.2 * c.force, "mount_mass": c.piston, "mount_power": ratio}

    def sized(s: float) -> dict[str, float]:
        k = c.force / (0.5 * c.stroke * s)
        return {**fixed, "mount_k": k, "mount_scale": knee * c.force / k}

    return sized


def _mount_rubs(r: np.random.Generator, c: Scale) -> Sized:
    """Filled rubber: stiffer for small motions than for large ones, by friction within."""
    rub, reach = r.uniform(0.2, 0.4) * c.force, r.uniform(0.1, 0.3)
    fixed = {"mount_form": 6, "mount_c": 0.2 * c.force, "mount_mass": c.piston, "mount_rub": rub}

    def sized(s: float) -> dict[str, float]:
        k = c.force / (0.5 * c.stroke * s)
        return {**fixed, "mount_k": k, "mount_scale": reach * c.force / k}

    return sized


def _play(form: int) -> Form:
    """A pin with clearance: at the RMS force it is pressed in by 10 um (form 3) or, by Hertz's law, 15 um (form 4)."""

    def draw(r: np.random.Generator, c: Scale) -> Sized:
        k = c.force / 1e-5 if form == 3 else c.force / 1.5e-5**1.5
        fixed = {"mount_form": form, "mount_k": k, "mount_c": 0.3 * c.force if form == 3 else 1.0}
        return lambda s: {**fixed, "mount_gap": 0.5 * c.stroke * s, "mount_mass": c.piston}

    return draw


#: Effect -> its stage and its forms.
EFFECTS: Mapping[str, tuple[str, tuple[Form, ...]]] = {
    "gas_spring": ("mechanics", (_spring_polytropic, _spring_power, _spring_thermal, _spring_rates)),
    "seal_friction": ("mechanics", (_seal(1), _seal(2), _seal(3), _seal(4), _seal(5))),
    "moving_mass": ("mechanics", (_mass(1), _mass(2), _mass_bush, _mass_parts)),
    "mount_compliance": ("mount", (_mount(1), _mount(2), _mount_rates, _mount_rubs)),
    "backlash": ("mount", (_play(3), _play(4))),
}
