"""Catalogue of a damper's fluid effects: heat, asymmetry, shear thinning, trapped gas."""

from __future__ import annotations

from dataclasses import replace

from mrdamp.diagnosis.hypotheses.terms import Coordinate, Sizes, Term, linear, positive


def fluid_terms(s: Sizes) -> tuple[Term, ...]:
    """Effects on the fluid's part of the force."""
    heat = (
        linear("heating_kappa", 0.02, 0.0, 1.0),
        linear("heating_kappa_yield", 0.02, 0.0, 1.0),
        positive("heating_loss", 0.01 * s.heat / 10, 1e-4 * s.heat / 10, 3.0 * s.heat / 10),
    )
    thinning = (
        linear("shear_thinning_m", 0.1, 0.0, 1.0, 1.0),
        positive("shear_thinning_v_s", s.velocity, 0.02 * s.velocity, 10 * s.velocity),
    )
    return (
        Term(
            "heating",
            "fluid",
            heat,
            ((0.02, 0.02, 0.01 * s.heat / 10), (0.03, 0.0, 0.2 * s.heat / 10)),
            fixed={"heating_capacity": s.heat / 10},  # gives a rise of about 10 K in the hottest record
        ),
        Term(
            "heating",
            "fluid",
            (
                *heat,
                positive("heating_link", 0.3 * s.heat / 10, 0.01 * s.heat / 10, 10 * s.heat / 10),
                positive("heating_body", 2 * s.heat / 10, 0.1 * s.heat / 10, 100 * s.heat / 10),
                positive("heating_shape", 3.0, 0.5, 30.0, 0.5),
            ),
            ((0.03, 0.02, 0.01 * s.heat / 10, 0.3 * s.heat / 10, 2 * s.heat / 10, 3.0),),
            form="two bodies",
            fixed={"heating_capacity": s.heat / 10},
        ),
        Term(
            "asymmetry",
            "fluid",
            (
                linear("asymmetry_a", 0.05, -0.9, 0.9),
                positive("asymmetry_width", 0.1 * s.velocity, 1e-4, 3 * s.velocity),
            ),
            ((0.1, 0.05 * s.velocity), (-0.1, 0.3 * s.velocity)),
        ),
        Term(
            "asymmetry",
            "fluid",
            (
                linear("asymmetry_a", 0.05, -0.8, 0.8),
                positive("asymmetry_force", 0.1 * s.force, 3e-3 * s.force, 3 * s.force),
                positive("asymmetry_time", 2e-3, 2e-4, 0.2),
            ),
            ((0.1, 0.05 * s.force, 5e-4), (-0.1, 0.1 * s.force, 0.015)),
            form="by the force",
        ),
        Term(
            "asymmetry",
            "fluid",
            (
                linear("asymmetry_yield", 0.05, -0.9, 0.9),
                linear("asymmetry_viscous", 0.05, -0.9, 0.9),
                positive("asymmetry_width", 0.02 * s.velocity, 1e-4, 3 * s.velocity),
            ),
            ((0.1, 0.0, 0.02 * s.velocity), (0.0, 0.1, 0.02 * s.velocity)),
            form="by the part",
        ),
        Term(
            "asymmetry",
            "fluid",
            (
                linear("asymmetry_a", 0.05, -0.8, 0.8),
                positive("asymmetry_travel", 0.03 * s.stroke, 1e-3 * s.stroke, s.stroke),
            ),
            ((0.1, 0.03 * s.stroke), (0.1, 0.2 * s.stroke)),
            form="along the stroke",
        ),
        Term(
            "shear_thinning",
            "fluid",
            thinning,
            ((0.6, 0.5 * s.velocity), (0.4, 1.5 * s.velocity)),
        ),
        Term(
            "shear_thinning",
            "fluid",
            (
                *thinning,
                positive("shear_thinning_shape", 2.0, 0.5, 8.0, 0.3),
            ),
            ((0.6, 0.5 * s.velocity, 2.0), (0.4, 1.5 * s.velocity, 1.2)),
            form="both dashpots",
            fixed={"shear_thinning_series": 1.0},
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
    return tuple(
        Term(
            "trapped_gas",
            "fluid",
            coordinates,
            starts,
            form=f"{side}, {form}" if form else side,
            fixed={"trapped_gas_direction": direction, **fixed},
        )
        for side, direction in (("extension", 1.0), ("compression", -1.0))
    )
