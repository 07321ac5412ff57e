"""Forms of the effects between fluid and load cell: mechanics and mount."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from studies.blindtest.scale import Form, Scale, Sized


def _spring_polytropic(r: np.random.Generator, c: Scale) -> Sized:
    length = c.stroke * r.uniform(4.0, 6.0)
    return lambda s: {"spring_form": 1, "spring_f0": 0.4 * c.force * s, "spring_length": length}


def _spring_power(r: np.random.Generator, c: Scale) -> Sized:
    k, end, power = (
        r.uniform(0.1, 0.3) * c.force / c.stroke,
        r.uniform(0.05, 0.12) * c.force,
        r.uniform(2.0, 4.0),
    )
    f0, fixed = (
        r.uniform(0.0, 0.3) * c.force,
        {"spring_form": 2, "spring_length": c.stroke, "spring_power": power},
    )
    return lambda s: {**fixed, "spring_f0": f0 * s, "spring_k": k * s, "spring_end": end * s}


def _spring_chambers(r: np.random.Generator, c: Scale) -> Sized:
    """Gas on both sides of the piston."""
    length, other = c.stroke * r.uniform(4.5, 6.5), r.uniform(0.3, 0.9)
    fixed = {"spring_form": 3, "spring_length": length, "spring_other": other}
    return lambda s: {**fixed, "spring_f0": 0.4 * c.force * s}


def _spring_progressive(r: np.random.Generator, c: Scale) -> Sized:
    """A coil spring whose coils close one after the other."""
    f0, k = r.uniform(0.0, 0.3) * c.force, r.uniform(0.1, 0.25) * c.force / c.stroke
    end, length = r.uniform(0.1, 0.25) * c.force, c.stroke * r.choice([-1.0, 1.0]) * r.uniform(1.0, 1.6)
    fixed = {"spring_form": 4, "spring_length": length}
    return lambda s: {**fixed, "spring_f0": f0 * s, "spring_k": k * s, "spring_end": end * s}


def _seal(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        fixed = {
            "seal_form": form,
            "seal_static": r.uniform(1.1, 1.7),
            "seal_v": r.uniform(0.002, 0.01),
            "seal_slide": r.uniform(15e-6, 60e-6) * {2: 2, 5: 2}.get(form, 1),
            "seal_time": r.uniform(5e-3, 2e-2),
        }
        return lambda s: {**fixed, "seal_coulomb": 0.4 * c.force * s}

    return draw


def _mass(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        spring = r.uniform(70.0, 140.0) if form == 2 else 0.0
        return lambda s: {"rod.mass": 0.5 * c.force / c.acceleration * s, "rod.mass_hz": spring}

    return draw


def _mass_coupled(r: np.random.Generator, c: Scale) -> Sized:
    """A viscously coupled mass: fast motion does not accelerate it."""
    time = r.uniform(2e-3, 6e-3)
    return lambda s: {"rod.mass_time": time, "rod.mass": 0.5 * c.force / c.acceleration * s}


def _mass_clamps(r: np.random.Generator, c: Scale) -> Sized:
    """Two masses, each with its own elastic clamp."""
    first, second = r.uniform(25.0, 45.0), r.uniform(60.0, 110.0)
    fixed = {"rod.mass_hz": first, "rod.mass_hz2": second, "rod.mass_share2": r.uniform(0.3, 0.7)}
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
    """A bush that reaches its stop."""
    knee, ratio = r.uniform(0.5, 1.2), r.uniform(2.5, 4.0)
    fixed = {"mount_form": 5, "mount_c": 0.2 * c.force, "mount_mass": c.piston, "mount_power": ratio}

    def sized(s: float) -> dict[str, float]:
        k = c.force / (0.5 * c.stroke * s)
        return {**fixed, "mount_k": k, "mount_scale": knee * c.force / k}

    return sized


def _mount_relaxes(r: np.random.Generator, c: Scale) -> Sized:
    """Rubber with a stiffness that increases with the rate (Zener)."""
    loss, time = r.uniform(0.8, 2.0), np.exp(r.uniform(np.log(0.01), np.log(0.1)))
    fixed = {"mount_form": 6, "mount_c": 0.1 * c.force, "mount_mass": c.piston}
    fixed |= {"mount_loss": loss, "mount_time": float(time)}
    return lambda s: {**fixed, "mount_k": c.force / (0.5 * c.stroke * s)}


def _play(form: int) -> Form:
    """A pin with clearance. Contact deflection at the RMS force: 10 um (form 3) or, by Hertz's law, 15 um
    (form 4)."""

    def draw(r: np.random.Generator, c: Scale) -> Sized:
        k = c.force / 1e-5 if form == 3 else c.force / 1.5e-5**1.5
        fixed = {"mount_form": form, "mount_k": k, "mount_c": 0.3 * c.force if form == 3 else 1.0}
        return lambda s: {**fixed, "mount_gap": 0.5 * c.stroke * s, "mount_mass": c.piston}

    return draw


#: Effect -> its stage and its forms.
EFFECTS: Mapping[str, tuple[str, tuple[Form, ...]]] = {
    "gas_spring": ("mechanics", (_spring_polytropic, _spring_power, _spring_chambers, _spring_progressive)),
    "seal_friction": ("mechanics", (_seal(1), _seal(2), _seal(3), _seal(4), _seal(5))),
    "moving_mass": ("mechanics", (_mass(1), _mass(2), _mass_coupled, _mass_clamps)),
    "mount_compliance": ("mount", (_mount(1), _mount(2), _mount_rates, _mount_relaxes)),
    "backlash": ("mount", (_play(3), _play(4))),
}
