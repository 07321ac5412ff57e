"""The law inverse against closed forms, and its force tracking on dampers integrated apart from the package."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest

from mrdamp.errors import InputError
from mrdamp.inverse import Inverse, LawInverse
from mrdamp.inverse.baselines import Extrapolation, command_range
from mrdamp.inverse.tracking import search
from mrdamp.model import Effect, Model
from refusals import refuses

PERIOD = 1e-3
BINGHAM = {"c0a": 400.0, "c0b": 150.0, "fya": 50.0, "fyb": 600.0, "v_ref": 0.01, "command_min": 0.0,
           "command_max": 2.0}  # fmt: skip


def bingham(v: float, u: float) -> float:
    return (400.0 + 150.0 * u) * v + (50.0 + 600.0 * u) * math.tanh(v / 0.01)


def damper(*effects: Effect) -> Model:
    return Model("bingham", BINGHAM, effects)


def steadily(inverse: Inverse, v: float, wanted: list[float]) -> list[float]:
    """Commands while the rod is drawn out at one velocity (m/s)."""
    inverse.reset()
    return [
        inverse.command(k * PERIOD, w, {"stroke": v * k * PERIOD, "stroke_velocity": v, "force": 0.0})
        for k, w in enumerate(wanted)
    ]


@pytest.mark.parametrize("v", [0.003, 0.05, -0.2])
def test_a_law_without_memory_is_inverted_in_closed_form(v: float) -> None:
    wanted = [bingham(v, u) for u in (0.0, 0.3, 1.1, 1.9, 2.0)]
    beyond = [-math.copysign(500.0, v), math.copysign(1e5, v)]  # out of reach: the nearer end
    got = steadily(LawInverse(damper(), PERIOD, feedback=False, preview=False), v, [wanted[0], *wanted, *beyond])
    assert got[1:] == pytest.approx([0.0, 0.3, 1.1, 1.9, 2.0, 0.0, 2.0], abs=0.01)


def test_a_lagging_driver_is_led() -> None:
    tau, v, horizon = 0.008, 0.1, 0.004
    model = damper(Effect("driver_lag", {"tau": tau}))
    inverse = LawInverse(model, PERIOD, horizon, feedback=False, preview=False)
    # Within reach, then a step that asks for more than the range: the range is what it gets.
    levels = (0.2, 0.3, 0.35, 0.3, 1.9, 1.9)
    current, expected = 0.0, []  # no current before the first command
    for level in levels:
        led = current + (level - current) / -math.expm1(-horizon / tau)
        expected.append(min(max(led, 0.0), 2.0))
        current += (expected[-1] - current) * -math.expm1(-PERIOD / tau)
    assert expected[0] == pytest.approx(0.2 / -math.expm1(-0.5))
    assert expected[-1] == 2.0
    assert steadily(inverse, v, [bingham(v, level) for level in levels]) == pytest.approx(expected, abs=0.01)


def test_what_is_on_its_way_through_a_delay_is_counted() -> None:
    tau, delay, v, horizon = 0.006, 0.003, 0.1, 0.005
    model = damper(Effect("driver_lag", {"tau": tau}), Effect("command_delay", {"d": delay}))
    rng = np.random.default_rng(2)
    levels = 0.8 + 0.05 * np.cumsum(rng.uniform(-1, 1, 40))
    inverse = LawInverse(model, PERIOD, horizon, feedback=False, preview=False)
    got = steadily(inverse, v, [bingham(v, u) for u in levels])
    # The coil, a millisecond at a time: what was commanded three before now, then what the horizon leaves.
    late, current = deque([0.0] * round(delay / PERIOD)), 0.0
    share = -math.expm1(-PERIOD / tau)
    reached = []
    for command in got:
        ahead = current
        for waiting in late:
            ahead += (waiting - ahead) * share
        reached.append(ahead + (command - ahead) * -math.expm1(-(horizon - delay) / tau))
        late.append(command)
        current += (late.popleft() - current) * share
    inside = (np.array(got) > 0.0) & (np.array(got) < 2.0)
    assert inside[5:].mean() > 0.6
    np.testing.assert_allclose(np.array(reached)[5:][inside[5:]], levels[5:][inside[5:]], atol=0.01)


@pytest.mark.parametrize(("feedback", "left"), [(False, 100.0), (True, 0.0)])
def test_the_measured_force_corrects_a_wrong_model(feedback: bool, left: float) -> None:
    """The real yield force is 100 N above the model's: with the measured force the right one comes."""
    v, wanted = 0.1, 500.0
    inverse = LawInverse(damper(), PERIOD, feedback=feedback)
    inverse.reset()
    force = 0.0
    for k in range(200):
        y = {"stroke": v * k * PERIOD, "stroke_velocity": v, "force": force}
        command = inverse.command(k * PERIOD, wanted, y)
        force = bingham(v, command) + 100.0
    assert abs(force - wanted) == pytest.approx(left, abs=5.0)
    assert inverse.bias == pytest.approx(100.0 if feedback else 0.0, abs=5.0)


@pytest.mark.parametrize("turns", [0.1, 0.3, 0.7])
def test_the_share_of_a_ringing_is_the_least_squares_one(turns: float) -> None:
    """A sine whose slope is led by h: sin(w (t + h)) - sin(w t) over w h cos(w t) is sin(w h) / (w h) in the mean."""
    periods = 400
    w = 2 * math.pi * turns / periods
    extrapolated = Extrapolation(periods, 1e-6)
    for k in range(20_000):
        extrapolated(100.0 + math.sin(w * k), w * periods * math.cos(w * k))
    angle = 2 * math.pi * turns
    assert extrapolated.share == pytest.approx(max(math.sin(angle) / angle, 0.0), abs=0.01)



def test_what_is_left_of_an_error_is_its_correlation() -> None:
    """An error that forgets by a factor f each period leaves f^n after n."""
    forgets, periods = 0.9, 5
    rng = np.random.default_rng(3)
    extrapolated, error = Extrapolation(periods, 1e-5), 0.0
    for _ in range(50_000):
        error = forgets * error + float(rng.standard_normal())
        extrapolated(error, -error)
    assert extrapolated(1.0, -1.0) == pytest.approx(forgets**periods, abs=0.03)



def test_a_preview_neither_turns_the_force_round_nor_more_than_doubles_it() -> None:
    extrapolated = Extrapolation(1.0, PERIOD)
    for k in range(50):
        extrapolated(1000.0 + k, 1.0)
    assert extrapolated.share == 1.0
    assert extrapolated(1050.0, -5000.0) == pytest.approx(0.0)
    extrapolated.reset()
    for k in range(50):
        extrapolated(-1000.0 - k, -1.0)
    assert extrapolated(-1050.0, -5000.0) == pytest.approx(-2100.0)


def test_search_finds_a_bent_root_and_keeps_the_last_command_without_authority() -> None:
    assert search(lambda u: math.tanh(2 * u), 0.5, 0.0, 3.0, 0.0) == pytest.approx(0.2747, abs=0.01)
    assert search(lambda u: 7.0, 3.0, 0.0, 3.0, 1.3) == 1.3
    assert search(lambda u: -u, -2.0, 0.0, 3.0, 0.0) == pytest.approx(2.0)


def test_bad_input_is_told() -> None:
    open_range = Model("bingham", {k: v for k, v in BINGHAM.items() if not k.startswith("command")})
    refuses(lambda: command_range(open_range), "no command_max")
    assert command_range(open_range, (0.0, 1.5)) == (0.0, 1.5)
    refuses(lambda: command_range(open_range, (1.0, 0.0)), "from 1 to 0")
    with pytest.raises(InputError, match="longer than the command's delay"):
        LawInverse(damper(Effect("command_delay", {"d": 0.01})), PERIOD, 0.005)
    refuses(lambda: LawInverse(damper(), 0.0), "period")
