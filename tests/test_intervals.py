"""Bootstrap intervals, and coefficients that follow the command: straight, quadratic, saturating, as lines."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.errors import InputError
from mrdamp.identify import Fit, compare_dependences, identify
from mrdamp.identify.by_command import constant_groups, identify_by_command
from mrdamp.identify.intervals import channel_findings, intervals
from mrdamp.identify.laws import DEPENDENCES, Scales, parametric, space
from mrdamp.model import core
from mrdamp.model.core import Array
from mrdamp.pictures.identification import parameter_lines
from mrdamp.records import Record
from refusals import refuses
from sine_records import Curve, bingham_record, grid, straight, viscous


@pytest.fixture(scope="module")
def fitted() -> tuple[Fit, list[Record]]:
    train = grid(straight)
    return identify("bingham", train, starts=1), train


def test_intervals_hold_the_truth_and_shrink_with_the_noise(fitted: tuple[Fit, list[Record]]) -> None:
    rows = {row.name: row for row in intervals(*fitted, seed=1)}
    for name, true in {"c0a": 400.0, "c0b": 250.0, "fya": 40.0, "fyb": 300.0, "gas_spring_f0": 12.0}.items():
        row = rows[name]
        width = row.high - row.low
        assert row.low - 0.5 * width < true < row.high + 0.5 * width, row
        assert row.low <= row.value <= row.high
        assert not row.word
    assert rows["fya"].unit == "N"
    # 8000 samples with 2 N of noise: the mean is known to about 2 / sqrt(8000) N.
    offset = rows["gas_spring_f0"]
    assert 0.3 < (offset.high - offset.low) / (2 * 1.96 * 2 / np.sqrt(8000)) < 2.5


@pytest.mark.slow
def test_a_fit_of_each_resample_agrees_with_one_step_and_any_number_of_workers(
    fitted: tuple[Fit, list[Record]],
) -> None:
    one, two = (intervals(*fitted, resamples=24, refit=True, seed=3, block=0.5, workers=n) for n in (1, 2))
    assert one == two
    quick = intervals(*fitted, resamples=24, seed=3, block=0.5)
    for a, b in zip(one, quick, strict=True):
        assert a.name == b.name
        assert b.high - b.low == pytest.approx(a.high - a.low, rel=0.25)


def test_what_the_records_do_not_show_gets_a_word() -> None:
    # At one velocity amplitude far above v_ref and a square-like motion, viscous and dry friction are one number.
    t = 0.002 * np.arange(1000)
    v = 0.05 * np.tanh(40 * np.sin(2 * np.pi * 2 * t))
    x = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2) * 0.002])
    force = 400.0 * v + 100.0 * np.tanh(v / 0.01) + np.random.default_rng(0).normal(0, 2.0, len(t))
    channels = {"displacement_m": x, "velocity_m_s": v, "command": 0 * t, "force_N": force}
    train = [Record("square", None, 0.002, channels)]
    words = {row.name: row.word for row in intervals(identify("bingham", train, starts=1), train)}
    assert "only together with" in words["c0a"]
    assert "only together with" in words["fya"]


def test_offset_and_delay_left_in_a_record_are_found(fitted: tuple[Fit, list[Record]]) -> None:
    fit, _ = fitted
    shown = bingham_record("late", 0.004, 2.0, 0.4, viscous, straight, 77)
    force = np.roll(shown.channel("force_N"), 1) + 5.0  # one sample late, 5 N more
    late = shown.with_channels({"force_N": force}).part(0.1, 1.9)
    left = channel_findings(fit, [late, shown])
    assert left[0].delay == pytest.approx(0.002, rel=0.15)
    assert left[0].offset == pytest.approx(5.0, abs=0.6)
    assert abs(left[1].delay) < 0.0002
    assert abs(left[1].offset) < 0.6


def test_bad_requests_are_told(fitted: tuple[Fit, list[Record]]) -> None:
    fit, train = fitted
    with pytest.raises(InputError, match="too few"):
        intervals(fit, train[:3], block=100.0)
    with pytest.raises(InputError, match="no search space"):
        intervals(Fit(fit.model, (), (), 1, 1), train)


def bent(u: Array) -> Array:
    return np.asarray(30.0 + 500.0 * u - 180.0 * u**2)


def saturated(u: Array) -> Array:
    return np.asarray(30.0 + 350.0 * (1 - np.exp(-2.5 * u)))


@pytest.mark.parametrize(
    ("curve", "dependence", "true"),
    [
        (bent, "quadratic", {"fya": 30.0, "fyb": 500.0, "fyc": -180.0}),
        (saturated, "saturating", {"fya": 30.0, "fyb": 0.0, "fye": 350.0, "fyr": 2.5}),
    ],
)
def test_a_dependence_is_found(curve: Curve, dependence: str, true: dict[str, float]) -> None:
    p = identify("bingham", grid(curve), dependence=dependence, starts=1).model.parameters
    assert {name: p[name] for name in true} == pytest.approx(true, rel=0.06)
    assert p["c0a"] == pytest.approx(400.0, rel=0.05)


def test_a_curve_that_bends_both_ways_is_met_at_four_commands() -> None:
    """An S, slow at first and slow in the end, which neither a parabola nor a saturation follows."""

    def s_shaped(u: Array) -> Array:
        return np.asarray(30.0 + 400.0 * u**2 / (u**2 + 0.3))

    records = grid(s_shaped, (0.0, 0.25, 0.5, 1.0))
    fits = {d: identify("bingham", records, dependence=d, starts=1) for d in list(DEPENDENCES)[1:]}
    best = fits.pop("quadratic_saturating")
    assert best.train_nrmse < 0.5 * min(fit.train_nrmse for fit in fits.values())
    p = best.model.parameters
    for u in (0.0, 0.25, 0.5, 1.0):
        value = p["fya"] + p["fyb"] * u + p["fyc"] * u * u + p["fye"] * (1 - np.exp(-p["fyr"] * u))
        assert value == pytest.approx(float(s_shaped(np.array(u))), abs=8.0), u


def test_the_right_dependence_is_best_on_records_held_out() -> None:
    held = grid(saturated, (0.2, 0.6, 1.0), seed=100)
    fits = compare_dependences("bingham", grid(saturated), held, starts=1)
    errors = {name: fit.held_out_nrmse for name, fit in fits.items()}
    assert min(errors, key=lambda name: errors[name]) == "saturating"
    assert errors["linear"] > 2 * errors["quadratic"] > 2 * errors["saturating"]


def test_no_slope_from_a_command_that_never_varies() -> None:
    still = grid(straight, (0.8,))
    fit = identify("bingham", still, starts=1)
    assert fit.model.parameters["fya"] == pytest.approx(40.0 + 0.8 * 300.0, rel=0.02)
    assert fit.model.parameters["fyb"] == 0.0
    for commands, dependence, said in (
        ((0.8,), "linear", "never varies"),
        ((0.0, 0.8), "quadratic", "2 different commands; a quadratic"),
        ((0.0, 0.4, 0.8), "quadratic_saturating", "3 different commands; a quadratic_saturating .* needs 4"),
        ((0.8,), "cubic", "allowed: constant, linear"),
    ):
        train = grid(straight, commands)
        refuses(lambda t=train, d=dependence: identify("bingham", t, dependence=d), said)  # type: ignore[misc]


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


# --- one fit per constant command, and lines through the parameters ----------------------------------


def test_the_lines_are_those_of_the_damper() -> None:
    train = grid(straight, (0.0, 0.6, 1.2))
    held = [bingham_record("h", 0.006, 1.5, 0.9, viscous, straight, 99)]
    found = identify_by_command("bingham", train, held, starts=1)
    p = found.fit.model.parameters
    assert (p["fya"], p["fyb"]) == pytest.approx((40.0, 300.0), rel=0.03)
    assert (p["c0a"], p["c0b"]) == pytest.approx((400.0, 250.0), rel=0.06)
    assert found.fit.model.attributes["gas_spring_f0"] == pytest.approx(12.0, abs=0.5)
    assert found.fit.held_out_nrmse < 0.02
    lines = {line.parameter: line for line in found.lines}
    assert lines["fya"].commands == (0.0, 0.6, 1.2)
    assert lines["fya"].values == pytest.approx([40.0, 220.0, 400.0], rel=0.05)
    assert set(lines) == {"c0a", "fya"}
    assert [model.parameters["v_ref"] for _, model, _ in found.at] == [p["v_ref"]] * 3
    shown = [lines[name] for name in ("c0a", "fya")]
    fig = parameter_lines(
        [line.parameter for line in shown],
        ["N s/m", "N"],
        np.array(shown[0].commands),
        [np.array(line.values) for line in shown],
        [(line.zero, line.slope) for line in shown],
    )
    points = fig.axes[1].get_lines()[1]
    assert points.get_ydata() == pytest.approx(shown[1].values)


def test_records_with_a_varying_command_are_left_out() -> None:
    varying = bingham_record("v", 0.004, 2.0, np.repeat([0.0, 1.2], 500), viscous, straight, 5)
    groups = constant_groups([*grid(straight, (0.4, 0.8)), varying])
    assert [(u, len(records)) for u, records in groups] == [(0.4, 2), (0.8, 2)]
    said = "need 2 constant commands; the records have 1"
    refuses(lambda: identify_by_command("bingham", [*grid(straight, (0.4,)), varying]), said)
