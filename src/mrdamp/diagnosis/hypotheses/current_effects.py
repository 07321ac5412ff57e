"""Catalogue of a damper's effects between command and field: driver and magnetics."""

from __future__ import annotations

from mrdamp.diagnosis.hypotheses.terms import Sizes, Term, linear, positive


def current_terms(s: Sizes) -> tuple[Term, ...]:
    """Effects of the stages `driver` and `magnetics`."""
    knee = (
        positive("saturation_i_s", s.command, 0.05 * s.command, 30 * s.command),
        positive("saturation_shape", 2.0, 0.7, 12.0),
    )
    loop = (
        linear("remanence_b", 0.05 * s.command, 0.0, 0.6 * s.command),
        positive("remanence_d", 0.2 * s.command, 0.005 * s.command, 3 * s.command),
    )
    by_current = (
        (
            linear("remanence_up", 0.3 / s.command, -2 / s.command, 4 / s.command),
            linear("remanence_down", 0.3 / s.command, -2 / s.command, 4 / s.command),
        ),
        (
            (0.08 * s.command, 0.1 * s.command, 0.0, 0.5 / s.command),
            (0.08 * s.command, 0.2 * s.command, -0.3 / s.command, -0.3 / s.command),
        ),
    )
    up_to = (
        (positive("remanence_knee", 0.7 * s.command, 0.2 * s.command, 5 * s.command),),
        (
            (0.1 * s.command, 0.1 * s.command, 0.8 * s.command),
            (0.1 * s.command, 0.3 * s.command, 0.6 * s.command),
        ),
    )
    return (
        Term(
            "driver_lag",
            "driver",
            (positive("driver_lag_tau", 0.01, 1e-4, 0.5), positive("driver_lag_tau2", 1e-3, 1e-4, 0.2)),
            ((0.001, 2e-4), (0.01, 5e-4), (0.03, 5e-3)),
        ),
        Term(
            "driver_lag",
            "driver",
            (positive("driver_lag_tau", 0.01, 1e-4, 0.5), positive("driver_lag_fall", 0.01, 1e-4, 0.5)),
            ((0.001, 0.002), (0.002, 0.001), (0.01, 0.02), (0.03, 0.015)),
            form="falling apart",
        ),
        Term(
            "driver_lag",
            "driver",
            (
                positive("driver_lag_tau", 0.005, 1e-4, 0.5),
                positive("driver_lag_rate", 50 * s.command, 0.5 * s.command, 5000 * s.command),
            ),
            (
                (5e-4, 300 * s.command),
                (0.005, 50 * s.command),
                (0.005, 10 * s.command),
                (0.02, 4 * s.command),
            ),
            form="slew",
        ),
        Term(
            "driver_lag",
            "driver",
            (positive("driver_lag_tau", 0.01, 3e-4, 0.5), positive("driver_lag_ratio", 0.6, 0.1, 0.98, 0.2)),
            ((0.006, 0.6), (0.02, 0.6)),
            form="overshooting",
        ),
        Term(
            "driver_lag",
            "driver",
            (
                positive("driver_lag_tau", 0.05, 1e-3, 2.0),
                positive("driver_lag_gain", 1.0, 0.1, 50.0),
                positive("driver_lag_integral", 0.05, 1e-3, 2.0),
                positive("driver_lag_limit", 2 * s.command, 1.02 * s.command, 30 * s.command),
            ),
            ((0.02, 1.0, 0.01, 2 * s.command), (0.1, 1.0, 0.05, 2 * s.command)),
            form="controlled",
        ),
        Term(
            "driver_lag",
            "driver",
            (
                positive("driver_lag_tau", 0.01, 3e-4, 0.5),
                positive("driver_lag_tau2", 0.1, 1e-3, 1.0),
                positive("driver_lag_share", 0.4, 0.02, 1.0),
            ),
            ((0.005, 0.05, 0.4), (0.02, 0.15, 0.4)),
            form="fast and slow",
        ),
        Term(
            "command_delay",
            "driver",
            (positive("command_delay_d", 0.01, 1e-4, 0.3),),
            ((0.001,), (0.006,), (0.02,)),
        ),
        Term(
            "command_delay",
            "driver",
            (
                positive("command_delay_d", 0.01, 1e-4, 0.3),
                positive("command_delay_spread", 0.3, 0.03, 0.6, 0.3),
            ),
            ((0.003, 0.3), (0.02, 0.3), (0.05, 0.3)),
            form="from packet to packet",
        ),
        Term(
            "saturation",
            "magnetics",
            knee,
            ((1.0 * s.command, 2.0), (0.4 * s.command, 2.0), (2.0 * s.command, 1.0)),
        ),
        Term(
            "saturation",
            "magnetics",
            knee,
            ((1.0 * s.command, 2.0), (0.4 * s.command, 2.0), (0.4 * s.command, 1.0)),
            form="at full scale",
            fixed={"saturation_full": s.command},  # the law is identified at the largest current
        ),
        Term(
            "remanence",
            "magnetics",
            (
                *loop,
                linear("remanence_start", 0.5, -1.0, 1.0),
            ),
            (
                (0.05 * s.command, 0.2 * s.command, 0.0),
                (0.1 * s.command, 0.05 * s.command, 0.0),
                (0.1 * s.command, 0.1 * s.command, 1.0),
            ),
        ),
        *(
            Term(
                "remanence",
                "magnetics",
                loop,
                ((0.05 * s.command, 0.2 * s.command), (0.1 * s.command, 0.05 * s.command)),
                form=form,
                fixed={"remanence_stops": stops, "remanence_rise": risen},
            )
            for form, stops, risen in (
                ("risen from zero", 0.0, 1.0),
                ("closing loops", 1.0, 0.0),
                ("closing loops, risen from zero", 1.0, 1.0),
            )
        ),
        *(
            Term(
                "remanence",
                "magnetics",
                (
                    *loop,
                    *bounds,
                ),
                starts,
                form=f"closing loops, {form}",
                fixed={"remanence_stops": 1.0, "remanence_rise": risen},
            )
            for form, risen, bounds, starts in (
                ("by the current", 0.0, *by_current),
                ("by the current, risen from zero", 1.0, *by_current),
                ("up to saturation", 0.0, *up_to),
                ("up to saturation, risen from zero", 1.0, *up_to),
            )
        ),
    )
