"""Catalogue of a damper's effects between command and field: driver and magnetics."""

from __future__ import annotations

from collections.abc import Iterator

from mrdamp.diagnosis.hypotheses.terms import Sizes, Term, linear, positive, term


def current_terms(s: Sizes) -> Iterator[Term]:
    """Effects of the stages `driver` and `magnetics`."""
    c = s.command
    tau = positive("tau", 0.01, 1e-4, 0.5)
    second = positive("tau2", 1e-3, 1e-4, 0.2)
    yield term("driver_lag", (tau,), (0.001,), (0.01,), (0.03,))
    yield term("driver_lag:two poles", (tau, second), (0.001, 2e-4), (0.01, 5e-4), (0.03, 5e-3))
    fall = positive("fall", 0.01, 1e-4, 0.5)
    falls = (0.001, 0.002), (0.002, 0.001), (0.01, 0.02), (0.03, 0.015)
    yield term("driver_lag:falling apart", (tau, fall), *falls)
    slew = positive("tau", 0.005, 1e-4, 0.5), positive("rate", 50 * c, 0.5 * c, 5000 * c)
    yield term("driver_lag:slew", slew, (5e-4, 300 * c), (0.005, 50 * c), (0.005, 10 * c), (0.02, 4 * c))
    slow = positive("tau", 0.01, 3e-4, 0.5)
    ratio = positive("ratio", 0.6, 0.1, 0.98, 0.2)
    yield term("driver_lag:overshooting", (slow, ratio), (0.006, 0.6), (0.02, 0.6))
    controlled = (
        positive("tau", 0.05, 1e-3, 2.0),
        positive("gain", 1.0, 0.1, 50.0),
        positive("integral", 0.05, 1e-3, 2.0),
        positive("limit", 2 * c, 1.02 * c, 30 * c),
    )
    yield term("driver_lag:controlled", controlled, (0.02, 1.0, 0.01, 2 * c), (0.1, 1.0, 0.05, 2 * c))
    two = slow, positive("tau2", 0.1, 1e-3, 1.0), positive("share", 0.4, 0.02, 1.0)
    yield term("driver_lag:fast and slow", two, (0.005, 0.05, 0.4), (0.02, 0.15, 0.4))

    delay = positive("d", 0.01, 1e-4, 0.3)
    spread = positive("spread", 0.3, 0.03, 0.6, 0.3)
    yield term("command_delay", (delay,), (0.001,), (0.006,), (0.02,))
    packets = (0.003, 0.3), (0.02, 0.3), (0.05, 0.3)
    yield term("command_delay:from packet to packet", (delay, spread), *packets)

    knee = positive("i_s", c, 0.05 * c, 30 * c), positive("shape", 2.0, 0.7, 12.0)
    yield term("saturation", knee, (1.0 * c, 2.0), (0.4 * c, 2.0), (2.0 * c, 1.0))
    # The law is identified at the largest current.
    yield term("saturation:at full scale", knee, (1.0 * c, 2.0), (0.4 * c, 2.0), (0.4 * c, 1.0), fixed={"full": c})
    yield from _remanence(c)


def _remanence(c: float) -> Iterator[Term]:
    loop = linear("b", 0.05 * c, 0.0, 0.6 * c), positive("d", 0.2 * c, 0.005 * c, 3 * c)
    plain = (0.05 * c, 0.2 * c), (0.1 * c, 0.05 * c)
    initial = linear("start", 0.5, -1.0, 1.0)
    yield term("remanence", (*loop, initial), *((*start, 0.0) for start in plain), (0.1 * c, 0.1 * c, 1.0))
    yield term("remanence:risen from zero", loop, *plain, fixed={"stops": 0.0, "rise": 1.0})
    by_current = *loop, linear("up", 0.3 / c, -2 / c, 4 / c), linear("down", 0.3 / c, -2 / c, 4 / c)
    up_to = *loop, positive("knee", 0.7 * c, 0.2 * c, 5 * c)
    for form, coordinates, starts in (
        ("", loop, plain),
        (
            ", by the current",
            by_current,
            ((0.08 * c, 0.1 * c, 0.0, 0.5 / c), (0.08 * c, 0.2 * c, -0.3 / c, -0.3 / c)),
        ),
        (", up to saturation", up_to, ((0.1 * c, 0.1 * c, 0.8 * c), (0.1 * c, 0.3 * c, 0.6 * c))),
    ):
        name = f"remanence:closing loops{form}"
        yield term(name, coordinates, *starts, fixed={"stops": 1.0, "rise": 0.0})
        yield term(f"{name}, risen from zero", coordinates, *starts, fixed={"stops": 1.0, "rise": 1.0})
