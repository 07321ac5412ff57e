"""Coefficients that follow the command: straight, quadratic, saturating; the way back from attributes; far starts."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.errors import InputError
from mrdamp.identify import compare_dependences, identify
from mrdamp.identify.laws import DEPENDENCES, Scales, parametric, space
from mrdamp.model import core
from mrdamp.model.core import Array
from sine_records import grid, straight


def bent(u: Array) -> Array:
    return np.asarray(30.0 + 500.0 * u - 180.0 * u**2)


def saturated(u: Array) -> Array:
    return np.asarray(30.0 + 350.0 * (1 - np.exp(-2.5 * u)))


def test_a_quadratic_dependence_is_found() -> None:
    fit = identify("bingham", grid(bent), dependence="quadratic", starts=1)
    p = fit.model.parameters
    assert (p["fya"], p["fyb"], p["fyc"]) == pytest.approx((30.0, 500.0, -180.0), rel=0.04)
    assert p["c0a"] == pytest.approx(400.0, rel=0.05)


def test_a_saturating_dependence_is_found() -> None:
    p = identify("bingham", grid(saturated), dependence="saturating", starts=1).model.parameters
    assert (p["fya"], p["fye"], p["fyr"]) == pytest.approx((30.0, 350.0, 2.5), rel=0.06)
    assert p["fyb"] == 0.0


def test_a_curve_that_bends_both_ways_is_met_at_four_commands() -> None:
    """An S, slow at first and slow in the end, which neither a parabola nor a saturation follows."""

    def s_shaped(u: Array) -> Array:
        return np.asarray(30.0 + 400.0 * u**2 / (u**2 + 0.3))

    records = grid(s_shaped, (0.0, 0.25, 0.5, 1.0))
    errors = {
        d: identify("bingham", records, dependence=d, starts=1).train_nrmse for d in list(DEPENDENCES)[1:]
    }
    assert errors["quadratic_saturating"] < 0.5 * min(
        errors[d] for d in ("linear", "quadratic", "saturating")
    )
    p = identify("bingham", records, dependence="quadratic_saturating", starts=1).model.parameters
    for u in (0.0, 0.25, 0.5, 1.0):
        value = p["fya"] + p["fyb"] * u + p["fyc"] * u * u + p["fye"] * (1 - np.exp(-p["fyr"] * u))
        assert value == pytest.approx(float(s_shaped(np.array(u))), abs=8.0), u


def test_the_right_dependence_is_best_on_records_held_out() -> None:
    held = grid(saturated, (0.2, 0.6, 1.0), seed=100)
    fits = compare_dependences("bingham", grid(saturated), held, starts=1)
    errors = {name: fit.held_out_nrmse for name, fit in fits.items()}
    assert min(errors, key=lambda name: errors[name]) == "saturating"
    assert errors["linear"] > 2 * errors["quadratic"] > 2 * errors["saturating"]


@pytest.mark.parametrize("law", parametric())
@pytest.mark.parametrize("dependence", DEPENDENCES)
def test_attributes_lead_back_to_their_point(law: str, dependence: str) -> None:
    search = space(law, Scales(500.0, 0.1, 0.01, 1.2, 0.1), ("offset", "driver_lag"), dependence)
    point = np.linspace(0.2, 0.7, len(search.coordinates))
    back = search.point(search.attributes(point))
    assert back == pytest.approx(point, abs=1e-9)


@pytest.mark.parametrize("factor", [0.6, 1.4])
def test_a_start_forty_percent_off_arrives(factor: float) -> None:
    true = {"c0a": 400.0, "c0b": 250.0, "fya": 40.0, "fyb": 300.0, "v_ref": 0.01}
    start = {name: factor * value for name, value in true.items()} | {"gas_spring_f0": factor * 12.0}
    fit = identify("bingham", grid(straight), start=start, starts=1)
    for name, value in true.items():
        assert fit.model.parameters[name] == pytest.approx(value, rel=0.03, abs=1.0), name


def test_no_slope_from_a_command_that_never_varies() -> None:
    still = grid(straight, (0.8,))
    fit = identify("bingham", still, starts=1)
    assert fit.model.parameters["fya"] == pytest.approx(40.0 + 0.8 * 300.0, rel=0.02)
    assert fit.model.parameters["fyb"] == 0.0
    with pytest.raises(InputError, match="never varies"):
        identify("bingham", still, dependence="linear")
    with pytest.raises(InputError, match="2 different commands; a quadratic"):
        identify("bingham", grid(straight, (0.0, 0.8)), dependence="quadratic")
    with pytest.raises(InputError, match=r"3 different commands; a quadratic_saturating .* needs 4"):
        identify("bingham", grid(straight, (0.0, 0.4, 0.8)), dependence="quadratic_saturating")
    with pytest.raises(InputError, match="allowed: constant, linear"):
        identify("bingham", still, dependence="cubic")


@pytest.mark.parametrize("dependence", list(DEPENDENCES)[1:])
@pytest.mark.parametrize("law", parametric())
def test_records_that_hold_no_small_command_give_laws_that_the_chain_takes(law: str, dependence: str) -> None:
    """From 1 to 2 A, with coefficients that fall or rise by any factor of the search between them."""
    scales = Scales(force=500.0, velocity=0.05, stroke=0.005, command=2.0, low=1.0)
    search = space(law, scales, ("offset",), dependence)
    rng = np.random.default_rng(7)
    for point in rng.random((200, len(search.coordinates))):
        attributes = search.attributes(point)
        core.vector(law, attributes)  # raises where the chain refuses it
        back = search.attributes(search.point(attributes))
        assert back == pytest.approx(attributes, rel=1e-6, abs=1e-6)
