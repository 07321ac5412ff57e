"""Forms of the effects of the fluid."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from studies.blindtest.scale import Form, Scale, Sized


def _heat_arrhenius(r: np.random.Generator, c: Scale) -> Sized:
    # a rise of about 30 K in half a minute, without losses to the housing
    fluid, body = c.power * r.uniform(0.2, 0.4), c.power * r.uniform(0.6, 1.2)
    return lambda s: {
        "heat_form": 1,
        "heat_capacity": fluid,
        "heat_body": body,
        "heat_link": c.power / 8,
        "heat_loss": body / 200,
        "heat_visc": 12_000 * s,
        "heat_yield": 0.015 * s,
    }


def _heat_rational(r: np.random.Generator, c: Scale) -> Sized:
    capacity = c.power * r.uniform(0.6, 1.1)
    return lambda s: {
        "heat_form": 2,
        "heat_capacity": capacity,
        "heat_loss": capacity / 90,
        "heat_visc": 0.2 * s,
        "heat_yield": 0.015 * s,
    }


def _asymmetry(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        side = r.choice([-1.0, 1.0])
        width = c.force * r.uniform(0.05, 0.3)
        return lambda s: {"asym_form": form, "asym_share": 0.35 * s * side, "asym_width": width}

    return draw


def _asymmetry_faster(r: np.random.Generator, c: Scale) -> Sized:
    """A bleed in one direction whose effect increases with the velocity."""
    side, speed = r.choice([-1.0, 1.0]), r.uniform(0.02, 0.08)
    return lambda s: {"asym_form": 3, "asym_share": 0.5 * s * side, "asym_v": speed}


def _asymmetry_check(r: np.random.Generator, c: Scale) -> Sized:
    """A pressure-driven check valve with the dynamics of its plate."""
    side, time, width = r.choice([-1.0, 1.0]), r.uniform(0.005, 0.025), c.force * r.uniform(0.05, 0.3)
    fixed = {"asym_form": 4, "asym_time": time, "asym_width": width}
    return lambda s: {**fixed, "asym_share": 0.35 * s * side}


def _thin_cross(r: np.random.Generator, c: Scale) -> Sized:
    m = r.uniform(0.8, 1.3)
    return lambda s: {"thin_form": 1, "thin_v": 0.02 / s, "thin_m": m}


def _thin_eyring(r: np.random.Generator, c: Scale) -> Sized:
    return lambda s: {"thin_form": 2, "thin_v": 0.008 / s}


def _thin_plateau(r: np.random.Generator, c: Scale) -> Sized:
    m, rest = r.uniform(0.1, 0.4), r.uniform(0.03, 0.15)
    return lambda s: {"thin_form": 3, "thin_v": 0.015 / s, "thin_m": m, "thin_rest": rest}


def _thin_crowded(r: np.random.Generator, c: Scale) -> Sized:
    """Crowding of particles (Quemada)."""
    rest = r.uniform(0.03, 0.15)
    return lambda s: {"thin_form": 4, "thin_v": 0.015 / (s**2 * rest), "thin_rest": rest}


def _gas(form: int) -> Form:
    def draw(r: np.random.Generator, c: Scale) -> Sized:
        side, stroke = r.choice([-1.0, 1.0]), c.stroke * r.uniform(0.15, 0.45) * form
        return lambda s: {"gas_form": form, "gas_sign": side, "gas_stroke": stroke, "gas_loss": s**0.5}

    return draw


def _gas_series(r: np.random.Generator, c: Scale) -> Sized:
    """A polytropic gas pocket between piston and fluid: the fluid flows once the gas is compressed."""
    side, stroke, force = r.choice([-1.0, 1.0]), c.stroke * r.uniform(0.8, 1.6), c.force * r.uniform(0.1, 0.4)
    return lambda s: {"gas_form": 3, "gas_sign": side, "gas_stroke": stroke * s, "gas_force": force}


def _gas_play(r: np.random.Generator, c: Scale) -> Sized:
    """A free length of the piston's path before the fluid carries force, with a smooth transition."""
    side, stroke, free = r.choice([-1.0, 1.0]), c.stroke * r.uniform(0.4, 1.0), r.uniform(0.2, 0.6)
    fixed = {"gas_form": 4, "gas_sign": side, "gas_free": free}
    return lambda s: {**fixed, "gas_stroke": stroke * s**0.5, "gas_loss": s**0.5}


#: Effect -> its stage and its forms.
EFFECTS: Mapping[str, tuple[str, tuple[Form, ...]]] = {
    "heating": ("fluid", (_heat_arrhenius, _heat_rational)),
    "asymmetry": ("fluid", (_asymmetry(1), _asymmetry(2), _asymmetry_faster, _asymmetry_check)),
    "shear_thinning": ("fluid", (_thin_cross, _thin_eyring, _thin_plateau, _thin_crowded)),
    "trapped_gas": ("fluid", (_gas(1), _gas(2), _gas_series, _gas_play)),
}
