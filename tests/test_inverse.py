"""The inverse of a law in closed form, force tracking in MuJoCo, the network inverse, and the command `inverse`."""

from __future__ import annotations

import json
import math
from collections import deque
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from command_call import caller
from excitation import Array
from mrdamp import sets
from mrdamp.commands.inverse import add_to
from mrdamp.inverse import Inverse, LawInverse
from mrdamp.inverse.baselines import Extrapolation, Fixed, Switching
from mrdamp.inverse.network import LAGS, NetworkInverse, train_inverse
from mrdamp.inverse.rig import Sizes, records_of, wanted_force
from mrdamp.inverse.tracking import STEP, RandomMotion, Track, random_level, rms, search, track
from mrdamp.model import Effect, Model
from mrdamp.narx.data import Series
from refusals import refuses

PERIOD = 1e-3
BINGHAM = {"c0a": 400.0, "c0b": 150.0, "fya": 50.0, "fyb": 600.0, "v_ref": 0.01, "command_min": 0.0,
           "command_max": 2.0}  # fmt: skip


def bingham(v: float, u: float) -> float:
    return (400.0 + 150.0 * u) * v + (50.0 + 600.0 * u) * math.tanh(v / 0.01)


def damper(*effects: Effect) -> Model:
    return Model("bingham", BINGHAM, effects)


class Told(Extrapolation):
    """So much of the value, in place of what is learnt."""

    def __init__(self, part: float) -> None:
        super().__init__(1.0, PERIOD)
        self.part = part

    def __call__(self, value: float, change: float) -> float:
        return self.part * value


def plain(model: Model) -> LawInverse:
    """The inverse without preview and feedback."""
    inverse = LawInverse(model, PERIOD)
    inverse._preview, inverse._feedback = Told(1.0), Told(0.0)
    return inverse


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
    got = steadily(plain(damper()), v, [wanted[0], *wanted, *beyond])
    assert got[1:] == pytest.approx([0.0, 0.3, 1.1, 1.9, 2.0, 0.0, 2.0], abs=0.01)


def test_a_lagging_driver_is_led() -> None:
    tau, v, horizon = 0.008, 0.1, 0.004
    model = damper(Effect("driver_lag", {"tau": tau}))
    inverse = plain(model)
    assert inverse.horizon == horizon
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
    tau, delay, v, horizon = 0.006, 0.003, 0.1, 0.006
    model = damper(Effect("driver_lag", {"tau": tau}), Effect("command_delay", {"d": delay}))
    rng = np.random.default_rng(2)
    levels = 0.8 + 0.05 * np.cumsum(rng.uniform(-1, 1, 40))
    inverse = plain(model)
    assert inverse.horizon == horizon
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
    inverse = LawInverse(damper(), PERIOD) if feedback else plain(damper())
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


LAG = Effect("driver_lag", {"tau": 0.005})
MODEL = Model("bingham", BINGHAM, (LAG,), name="bingham")
MOTION = RandomMotion(3e-3, 0.5, 4.0, 1)


def grid(n: int, step: float = STEP) -> Array:
    return np.arange(n, dtype=np.float64) * np.float64(step)


def force_of(v: Array, u: Array) -> Array:
    return np.asarray((400 + 150 * u) * v + (50 + 600 * u) * np.tanh(v / 0.01))


def made(seed: int, n: int = 3000, dt: float = 2e-3) -> Series:
    """A record of that damper in closed form behind a driver lag of 5 ms, with noise of 3 N."""
    t = grid(n, dt)
    x, v, _ = RandomMotion(3e-3, 0.5, 4.0, seed).steady(t)
    u = 2.0 * random_level(t, 8.0, seed + 50)
    current = np.empty(n)
    current[0] = u[0]
    for k in range(1, n):
        current[k] = u[k - 1] + (current[k - 1] - u[k - 1]) * np.exp(-dt / 0.005)
    noise = 3.0 * np.random.default_rng(seed).standard_normal(n)
    return Series(f"made_{seed}", dt, x, v, u, force_of(v, current) + noise)


@cache
def network() -> NetworkInverse:
    return train_inverse([made(0), made(1)], [made(2)], leads=(1, 2), lags=LAGS[:1], hidden=(10,))


def test_motion_is_exact_in_its_derivatives_and_of_its_size() -> None:
    t = grid(100_001, 1e-4)
    x, v, a = MOTION.sample(t)
    assert (x[0], v[0]) == (0.0, 0.0)
    np.testing.assert_allclose(np.gradient(x, 1e-4)[1:-1], v[1:-1], atol=1e-5)
    np.testing.assert_allclose(np.gradient(v, 1e-4)[1:-1], a[1:-1], atol=1e-3)
    long = RandomMotion(3e-3, 0.5, 4.0, 9).steady(grid(40_000, 5e-3))
    assert rms(long[0]) == pytest.approx(3e-3, rel=0.02)
    # A flat spectrum of displacement: RMS frequency sqrt((4^3 - .5^3) / (3 (4 - .5))) Hz.
    assert rms(long[1]) / rms(long[0]) / (2 * np.pi) == pytest.approx(2.466, rel=0.04)


def test_figures_of_a_track() -> None:
    t = grid(4000)
    wanted, square = (
        100 * np.sin(20 * t),
        np.where(np.floor(2 * t) % 2 == 0, 0.0, 2.0),
    )  # on and off once a second
    run = Track("run", t, wanted, wanted + 5.0, square, 0 * t, 0 * t, start=0.0)
    assert run.error == pytest.approx(5.0)
    assert run.relative_error == pytest.approx(5.0 / rms(wanted))
    assert run.mean_command == pytest.approx(1.0)
    assert run.switching(2.0) == pytest.approx(1.5)  # three changes in two seconds, all of the range


def test_the_law_tracks_in_mujoco_and_noise_does_not_undo_it() -> None:
    t = grid(6000)
    _, v, _ = MOTION.sample(t)
    wanted = wanted_force("between", force_of(v, 0 * t), force_of(v, 2 + 0 * t), 4)
    run = track(MODEL, MOTION, wanted, LawInverse(MODEL))
    assert run.relative_error < 0.06
    noisy = track(MODEL, MOTION, wanted, LawInverse(MODEL), noise=(2e-6, 2e-4, 5.0), seed=1)
    assert run.relative_error < noisy.relative_error < 0.1


@pytest.mark.parametrize(("id", "stroke"), [("dyke1996_3kN", 4e-3), ("bw_50kN_amini", 0.02)])
def test_hysteretic_laws_track_three_times_as_well_as_switching(id: str, stroke: float) -> None:
    found = sets.load(id)
    model, motion = Model(found.law, found.parameters, (LAG,)), RandomMotion(stroke, 0.5, 4.0, 1)
    off, on = (track(model, motion, np.zeros(4000), Fixed(u)).force for u in (0.0, found.command.max))
    wanted = wanted_force("between", off, on, 4)
    inverse, switching = (
        track(model, motion, wanted, way).relative_error for way in (LawInverse(model), Switching(found.command.max))
    )
    assert inverse < 0.06
    assert switching > 3 * inverse


def test_a_ringing_of_the_wanted_force_is_not_led() -> None:
    """160 Hz and an eighth of the force, far above what a driver of 20 ms follows: nothing the command should chase."""
    slow = replace(MODEL, effects=(Effect("driver_lag", {"tau": 0.02}),))
    t = grid(6000)
    _, v, _ = MOTION.sample(t)
    smooth = force_of(v, 0.6 + 0.3 * np.sin(6 * t))
    ringing = smooth + 0.125 * rms(smooth) * np.sin(2 * np.pi * 160 * t)
    quiet, run = (track(slow, MOTION, w, LawInverse(slow)) for w in (smooth, ringing))
    error = rms((run.force - smooth)[1000:]) / rms(smooth[1000:])
    assert error < quiet.relative_error + 0.05 < 0.13


def test_a_network_tracks_as_the_law_does_and_reads_back(tmp_path: Path) -> None:
    t = grid(6000)
    _, v, _ = MOTION.sample(t)
    wanted = wanted_force("between", force_of(v, 0 * t), force_of(v, 2 + 0 * t), 4)
    network().write(tmp_path / "net.json")
    back = NetworkInverse.read(tmp_path / "net.json")
    runs = [track(MODEL, MOTION, wanted, net) for net in (network(), back)]
    assert runs[0].relative_error < 0.15
    np.testing.assert_array_equal(runs[0].command, runs[1].command)


def test_records_of_a_plant_are_its_law_in_closed_form_and_noise() -> None:
    sizes = Sizes.of(MODEL, MOTION, 2.0)
    records = records_of(MODEL, MOTION, sizes, count=3, seconds=4.0)
    assert (len(records.train), len(records.validation)) == (2, 1)
    for record in records.train:
        u, current = record.command, record.command.copy()
        assert u.min() >= 0.0
        assert u.max() <= 2.0
        assert np.ptp(u) > 1.0
        for k in range(1, record.n):
            current[k] = u[k - 1] + (current[k - 1] - u[k - 1]) * np.exp(-2e-3 / 0.005)
        v = record.velocity()
        noise = (record.channel("force_N") - force_of(v, current))[np.abs(v) > 0.04]
        assert rms(noise) == pytest.approx(sizes.noise[2], rel=0.2)


run = caller(add_to)


def test_the_command_without_a_network(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    MODEL.write(tmp_path / "model.json")
    call: list[str | Path] = ["inverse", tmp_path / "model.json", "--plant", tmp_path / "model.json", "--no-network"]
    assert run(*call, "--seconds", "2", "--json", "-o", tmp_path / "out") == 0
    tables = json.loads(capsys.readouterr().out)["wanted"]
    rows = {row["inverse"]: row for row in tables["between"]}
    assert rows["law inverse"]["relative_error_percent"] < 10
    assert (
        rows["on/off switching"]["relative_error_percent"] > 2 * rows["law inverse"]["relative_error_percent"]
    )
    assert rows["constant, largest"]["mean_command"] == 2.0
    _, *lines = (tmp_path / "out" / "unrelated.csv").read_text().splitlines()
    assert len(lines) == len(tables["unrelated"]) == 4


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--commands", "1", "0"], "from 1 to 0"),
        (["--network", "missing.json"], "missing.json"),
    ],
)
def test_bad_input_of_the_command(arguments: list[str], named: str, tmp_path: Path) -> None:
    MODEL.write(tmp_path / "model.json")
    out = tmp_path / "out"
    refuses(lambda: run("inverse", tmp_path / "model.json", *arguments, "-o", out), named)
    assert not out.exists()
