"""Catalogue of a damper's effects between command and field: driver and magnetics."""

from __future__ import annotations

from mrdamp.diagnosis.hypotheses.terms import Form, Sizes, Term, declared, linear, positive


def current_terms(s: Sizes) -> tuple[Term, ...]:
    """Effects of the stages `driver` and `magnetics`."""
    c = s.command
    tau = positive("driver_lag_tau", 0.01, 1e-4, 0.5)
    slow = positive("driver_lag_tau", 0.01, 3e-4, 0.5)
    delay = positive("command_delay_d", 0.01, 1e-4, 0.3)
    knee = (positive("saturation_i_s", c, 0.05 * c, 30 * c), positive("saturation_shape", 2.0, 0.7, 12.0))
    return (
        *declared(
            "driver_lag",
            Form(
                "",
                (tau, positive("driver_lag_tau2", 1e-3, 1e-4, 0.2)),
                ((0.001, 2e-4), (0.01, 5e-4), (0.03, 5e-3)),
            ),
            Form(
                "falling apart",
                (tau, positive("driver_lag_fall", 0.01, 1e-4, 0.5)),
                ((0.001, 0.002), (0.002, 0.001), (0.01, 0.02), (0.03, 0.015)),
            ),
            Form(
                "slew",
                (
                    positive("driver_lag_tau", 0.005, 1e-4, 0.5),
                    positive("driver_lag_rate", 50 * c, 0.5 * c, 5000 * c),
                ),
                ((5e-4, 300 * c), (0.005, 50 * c), (0.005, 10 * c), (0.02, 4 * c)),
            ),
            Form(
                "overshooting",
                (slow, positive("driver_lag_ratio", 0.6, 0.1, 0.98, 0.2)),
                ((0.006, 0.6), (0.02, 0.6)),
            ),
            Form(
                "controlled",
                (
                    positive("driver_lag_tau", 0.05, 1e-3, 2.0),
                    positive("driver_lag_gain", 1.0, 0.1, 50.0),
                    positive("driver_lag_integral", 0.05, 1e-3, 2.0),
                    positive("driver_lag_limit", 2 * c, 1.02 * c, 30 * c),
                ),
                ((0.02, 1.0, 0.01, 2 * c), (0.1, 1.0, 0.05, 2 * c)),
            ),
            Form(
                "fast and slow",
                (
                    slow,
                    positive("driver_lag_tau2", 0.1, 1e-3, 1.0),
                    positive("driver_lag_share", 0.4, 0.02, 1.0),
                ),
                ((0.005, 0.05, 0.4), (0.02, 0.15, 0.4)),
            ),
        ),
        *declared(
            "command_delay",
            Form("", (delay,), ((0.001,), (0.006,), (0.02,))),
            Form(
                "from packet to packet",
                (delay, positive("command_delay_spread", 0.3, 0.03, 0.6, 0.3)),
                ((0.003, 0.3), (0.02, 0.3), (0.05, 0.3)),
            ),
        ),
        *declared(
            "saturation",
            Form("", knee, ((1.0 * c, 2.0), (0.4 * c, 2.0), (2.0 * c, 1.0))),
            # The law is identified at the largest current.
            Form(
                "at full scale",
                knee,
                ((1.0 * c, 2.0), (0.4 * c, 2.0), (0.4 * c, 1.0)),
                {"saturation_full": c},
            ),
        ),
        *_remanence(c),
    )


def _remanence(c: float) -> tuple[Term, ...]:
    loop = (
        linear("remanence_b", 0.05 * c, 0.0, 0.6 * c),
        positive("remanence_d", 0.2 * c, 0.005 * c, 3 * c),
    )
    plain = ((0.05 * c, 0.2 * c), (0.1 * c, 0.05 * c))
    by_current = (
        (
            *loop,
            linear("remanence_up", 0.3 / c, -2 / c, 4 / c),
            linear("remanence_down", 0.3 / c, -2 / c, 4 / c),
        ),
        ((0.08 * c, 0.1 * c, 0.0, 0.5 / c), (0.08 * c, 0.2 * c, -0.3 / c, -0.3 / c)),
    )
    up_to = (
        (*loop, positive("remanence_knee", 0.7 * c, 0.2 * c, 5 * c)),
        ((0.1 * c, 0.1 * c, 0.8 * c), (0.1 * c, 0.3 * c, 0.6 * c)),
    )
    closing = {"remanence_stops": 1.0, "remanence_rise": 0.0}
    risen = {"remanence_stops": 1.0, "remanence_rise": 1.0}
    return declared(
        "remanence",
        Form(
            "",
            (*loop, linear("remanence_start", 0.5, -1.0, 1.0)),
            (*((*start, 0.0) for start in plain), (0.1 * c, 0.1 * c, 1.0)),
        ),
        Form("risen from zero", loop, plain, {"remanence_stops": 0.0, "remanence_rise": 1.0}),
        Form("closing loops", loop, plain, closing),
        Form("closing loops, risen from zero", loop, plain, risen),
        Form("closing loops, by the current", *by_current, closing),
        Form("closing loops, by the current, risen from zero", *by_current, risen),
        Form("closing loops, up to saturation", *up_to, closing),
        Form("closing loops, up to saturation, risen from zero", *up_to, risen),
    )
