"""Catalogue of a damper's fluid effects: heat, asymmetry, shear thinning, trapped gas."""

from __future__ import annotations

from dataclasses import replace

from mrdamp.diagnosis.hypotheses.terms import (
    Coordinate,
    Form,
    Settings,
    Sizes,
    Term,
    declared,
    linear,
    positive,
)


def without_effect(settings: Settings) -> bool:
    """True for a heat that changes neither viscosity nor yield force by more than 1e-4 a kelvin."""
    return max(settings["heating_kappa"], settings["heating_kappa_yield"]) < 1e-4


def fluid_terms(s: Sizes) -> tuple[Term, ...]:
    """Effects on the fluid's part of the force."""
    f, v, heated = s.force, s.velocity, s.heat
    heat = (
        linear("heating_kappa", 0.02, 0.0, 1.0),
        linear("heating_kappa_yield", 0.02, 0.0, 1.0),
        positive("heating_loss", 0.01 * heated / 10, 1e-4 * heated / 10, 3.0 * heated / 10),
    )
    capacity = {"heating_capacity": heated / 10}  # gives a rise of about 10 K in the hottest record
    thinning = (
        linear("shear_thinning_m", 0.1, 0.0, 1.0, 1.0),
        positive("shear_thinning_v_s", v, 0.02 * v, 10 * v),
    )
    side = linear("asymmetry_a", 0.05, -0.8, 0.8)
    return (
        *declared(
            "heating",
            Form(
                "", heat, ((0.02, 0.02, 0.01 * heated / 10), (0.03, 0.0, 0.2 * heated / 10)), capacity,
                is_other=without_effect,
            ),
            Form(
                "two bodies",
                (
                    *heat,
                    positive("heating_link", 0.3 * heated / 10, 0.01 * heated / 10, 10 * heated / 10),
                    positive("heating_body", 2 * heated / 10, 0.1 * heated / 10, 100 * heated / 10),
                    positive("heating_shape", 3.0, 0.5, 30.0, 0.5),
                ),
                ((0.03, 0.02, 0.01 * heated / 10, 0.3 * heated / 10, 2 * heated / 10, 3.0),),
                capacity,
                is_other=without_effect,
            ),
        ),
        *declared(
            "asymmetry",
            Form(
                "",
                (linear("asymmetry_a", 0.05, -0.9, 0.9), positive("asymmetry_width", 0.1 * v, 1e-4, 3 * v)),
                ((0.1, 0.05 * v), (-0.1, 0.3 * v)),
            ),
            Form(
                "by the force",
                (
                    side,
                    positive("asymmetry_force", 0.1 * f, 3e-3 * f, 3 * f),
                    positive("asymmetry_time", 2e-3, 2e-4, 0.2),
                ),
                ((0.1, 0.05 * f, 5e-4), (-0.1, 0.1 * f, 0.015)),
            ),
            Form(
                "by the part",
                (
                    linear("asymmetry_yield", 0.05, -0.9, 0.9),
                    linear("asymmetry_viscous", 0.05, -0.9, 0.9),
                    positive("asymmetry_width", 0.02 * v, 1e-4, 3 * v),
                ),
                ((0.1, 0.0, 0.02 * v), (0.0, 0.1, 0.02 * v)),
            ),
            Form(
                "along the stroke",
                (side, positive("asymmetry_travel", 0.03 * s.stroke, 1e-3 * s.stroke, s.stroke)),
                ((0.1, 0.03 * s.stroke), (0.1, 0.2 * s.stroke)),
            ),
        ),
        *declared(
            "shear_thinning",
            Form("", thinning, ((0.6, 0.5 * v), (0.4, 1.5 * v))),
            Form(
                "both dashpots",
                (*thinning, positive("shear_thinning_shape", 2.0, 0.5, 8.0, 0.3)),
                ((0.6, 0.5 * v, 2.0), (0.4, 1.5 * v, 1.2)),
                {"shear_thinning_series": 1.0},
            ),
        ),
        *_gas_terms(s),
    )


def _gas_terms(s: Sizes) -> tuple[Term, ...]:
    turn = replace(positive("trapped_gas_turn", 1e-5, 2e-6, max(0.02 * s.stroke, 4e-6), 2.0), rugged=True)
    width = positive("trapped_gas_width", 0.02 * s.velocity, 1e-3 * s.velocity, s.velocity)
    loss = (  # of the force until the gas is compressed
        linear("trapped_gas_d", 0.1, 0.0, 1.0),
        positive("trapped_gas_s_g", 0.1 * s.stroke, 3e-3 * s.stroke, 2 * s.stroke),
    )
    pressed = (  # compression of gas in series with the fluid
        positive("trapped_gas_force", 0.2 * s.force, 0.01 * s.force, 5 * s.force),
        positive("trapped_gas_s_g", 0.1 * s.stroke, 1e-3 * s.stroke, 2 * s.stroke),
        positive("trapped_gas_shape", 1.2, 0.5, 10.0, 0.3),
    )
    return (
        *_on_either_side(
            "",
            (*loss, positive("trapped_gas_shape", 2.0, 0.5, 10.0, 0.3), turn),
            *((0.3, share * s.stroke, 2.0, back) for share in (0.1, 0.4) for back in (5e-6, 2e-5)),
        ),
        *_on_either_side(
            "a pocket",
            (
                *loss,
                positive("trapped_gas_reach", 0.2 * s.stroke, 0.01 * s.stroke, 2 * s.stroke),
                positive("trapped_gas_shape", 1.5, 0.5, 10.0, 0.3),
                width,
            ),
            (0.3, 0.1 * s.stroke, 0.2 * s.stroke, 1.5, 0.02 * s.velocity),
            (0.3, 0.3 * s.stroke, 0.5 * s.stroke, 1.5, 0.02 * s.velocity),
        ),
        *_on_either_side(
            "in its own time",
            (
                *loss,
                positive("trapped_gas_shape", 1.0, 0.5, 10.0, 0.3),
                positive("trapped_gas_time", 0.1, 5e-3, 20.0),
                width,
            ),
            *((0.3, share * s.stroke, 1.0, 0.2, 0.02 * s.velocity) for share in (0.15, 0.4)),
            trapped_gas_end=1.0,
        ),
        *_on_either_side(
            "in series",
            (*pressed, positive("trapped_gas_width", 0.05 * s.velocity, 2e-3 * s.velocity, s.velocity)),
            (0.2 * s.force, 0.07 * s.stroke, 1.2, 0.05 * s.velocity),
            trapped_gas_series=1.0,
        ),
    )


def _on_either_side(
    form: str, coordinates: tuple[Coordinate, ...], *starts: tuple[float, ...], **fixed: float
) -> tuple[Term, ...]:
    """Gas that is compressed in extension, and in compression."""
    sides = (("extension", 1.0), ("compression", -1.0))
    forms = [
        Form(f"{side}, {form}" if form else side, coordinates, starts, {"trapped_gas_direction": way, **fixed})
        for side, way in sides
    ]
    return declared("trapped_gas", *forms)
