"""Force tracking in MuJoCo, the network inverse on a damper in closed form, and the command `inverse`."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from command_call import caller
from excitation import Array
from mrdamp import sets
from mrdamp.commands.inverse import add_to
from mrdamp.inverse import LawInverse
from mrdamp.inverse.baselines import Fixed, Switching
from mrdamp.inverse.network import LAGS, NetworkInverse, train_inverse
from mrdamp.inverse.rig import Sizes, records_of, wanted_force
from mrdamp.inverse.tracking import STEP, RandomMotion, Track, random_level, rms, track
from mrdamp.model import Effect, Model
from mrdamp.narx.data import Series
from refusals import refuses

BINGHAM = {"c0a": 400.0, "c0b": 150.0, "fya": 50.0, "fyb": 600.0, "v_ref": 0.01, "command_min": 0.0,
           "command_max": 2.0}  # fmt: skip
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


@pytest.mark.parametrize("kind", ["between", "unrelated"])
def test_wanted_forces_stay_within_reach(kind: str) -> None:
    t = grid(8000)
    _, v, _ = MOTION.sample(t)
    off, on = force_of(v, np.zeros(8000)), force_of(v, np.full(8000, 2.0))
    wanted = wanted_force(kind, off, on, 4)
    low, high = np.minimum(off, on), np.maximum(off, on)
    assert ((wanted >= low - 1e-9) & (wanted <= high + 1e-9)).all()
    assert rms(wanted - off) > 0.1 * rms(on - off)
    assert rms(wanted - on) > 0.1 * rms(on - off)


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
    call: list[str | Path] = [
        "inverse",
        tmp_path / "model.json",
        "--plant",
        tmp_path / "model.json",
        "--no-network",
    ]
    assert run(*call, "--seconds", "2", "--json", "-o", tmp_path / "out") == 0
    tables = json.loads(capsys.readouterr().out)["wanted"]
    rows = {row["inverse"]: row for row in tables["between"]}
    assert rows["law inverse"]["relative_error_percent"] < 10
    assert (
        rows["on/off switching"]["relative_error_percent"] > 2 * rows["law inverse"]["relative_error_percent"]
    )
    assert rows["constant, largest"]["mean_command"] == 2.0
    page = (tmp_path / "out" / "index.html").read_text()
    assert "law inverse" in page
    assert "://" not in page.replace("http://www.w3.org", "")
    _, *lines = (tmp_path / "out" / "unrelated.csv").read_text().splitlines()
    assert len(lines) == len(tables["unrelated"]) == 4


@pytest.mark.slow
def test_the_command_with_everything(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    MODEL.write(tmp_path / "model.json")
    call: list[str | Path] = ["inverse", tmp_path / "model.json", "--law", "bingham", "--seconds", "4"]
    assert run(*call, "--json", "-o", tmp_path / "out") == 0
    rows = {row["inverse"]: row for row in json.loads(capsys.readouterr().out)["wanted"]["between"]}
    for name in ("law inverse", "network inverse"):
        assert rows[name]["relative_error_percent"] < 0.6 * rows["on/off switching"]["relative_error_percent"]
    again: list[str | Path] = [*call[:2], "--network", tmp_path / "out" / "network.json", "--seconds", "2"]
    assert run(*again, "--stroke", "0.003", "-o", tmp_path / "again") == 0


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--seconds", "1"], "--seconds"),
        (["--commands", "1", "0"], "from 1 to 0"),
        (["--network", "missing.json"], "missing.json"),
        (["--stroke", "-1"], "random motion"),
        (["--plant", "nothing.json"], "nothing.json"),
    ],
)
def test_bad_input_of_the_command(arguments: list[str], named: str, tmp_path: Path) -> None:
    MODEL.write(tmp_path / "model.json")
    out = tmp_path / "out"
    refuses(lambda: run("inverse", tmp_path / "model.json", *arguments, "-o", out), named)
    assert not out.exists()
