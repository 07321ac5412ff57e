"""The written MJCF of a frame, stepped by MuJoCo, gives what the C entry predicts. Commands that a converter holds: the
truth is a frame that SciPy integrates, sample by sample."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

import bingham_rig
import frame_reference
from dampers import off
from excitation import Array
from frame_case import DT, NOISE, SECONDS, believed, ground
from mrdamp import sets
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.problem.command_hold import with_hold
from mrdamp.diagnosis.run import diagnose
from mrdamp.identify import error, identify
from mrdamp.model import Effect, Model, core
from mrdamp.records import Record
from mrdamp.records.log_filter import held
from mrdamp.simulation import stepping
from mrdamp.simulation.predict import free_run
from mrdamp.structures import ShearFrame, dyke1996

LIMIT = 0.006  # of the RMS; most of it is the command, straight in a record, that the engine holds over its steps

SPENCER = {k: v for k, v in sets.load("dyke1996_3kN").parameters.items() if not k.startswith("command")}

SERIES = Effect("trapped_gas", {"force": 200.0, "s_g": 5e-4, "shape": 1.2, "width": 5e-3, "series": 1.0})


FRAME_EFFECTS = {
    "none": (),
    "structure": (
        Effect("storey_stiffness", {"e": -0.2}, 2),
        Effect("joint_friction", {"coulomb": 80.0}, 2),
        Effect("floor_mass", {"dm": 15.0}, 3),
        Effect("storey_damping", {"e": 2.0}, 1),
        Effect("joint_friction", {"coulomb": 60.0, "width": 0.003}, 3),
    ),
    "gas in series": (SERIES,),
    "driver and sensors": (
        Effect("driver_lag", {"tau": 0.01}),
        Effect("sensor_gain", {"g": 1.3}, 3),
        Effect("sensor_lag", {"tau": 0.005, "tau2": 0.003}, 1),
        Effect("sensor_leakage", {"tau": 0.5}, 2),
        Effect("sensor_offset", {"f": 0.1}, 2),
        Effect("channel_shift", {"d": 0.002}),
    ),
    "other forms": (
        Effect("storey_damping", {"e": 0.5, "quadratic": 2000.0}, 1),
        Effect("sensor_lag", {"tau": 0.006, "ratio": 0.6, "tau2": 0.004}, 1),
        Effect("sensor_leakage", {"tau": 0.2, "share": 0.4, "tau2": 1.0}, 2),
        Effect("sensor_offset", {"settle": 0.5, "time": 0.6}, 3),
        Effect("sensor_leakage", {"tau": 0.2, "share": 0.4}, 3),
    ),
}


def smooth_inputs() -> dict[str, Array]:
    t = 0.002 * np.arange(2000)
    ground = sum(
        a * np.sin(2 * np.pi * f * t + p) for a, f, p in ((1.5, 2.3, 0), (1.2, 5.2, 1), (0.5, 12, 2))
    )
    return {"ground_acceleration_m_s2": np.asarray(ground), "command": 1 + 0.9 * np.sin(2 * np.pi * 1.7 * t)}


FRAMES: dict[tuple[str, Any], ShearFrame] = {
    **{(effects, between): replace(dyke1996(), damper_between=between)
       for effects in FRAME_EFFECTS for between in ((0, 1), (2, 1))},
    **{("none", between): replace(dyke1996(), damper_between=between) for between in ((1, 2), (0, 3))},
    **{("none", n): ShearFrame(np.full(n, 90.0), np.full(n, 4e5), np.full(n, 80.0)) for n in (1, 2, 7)},
}  # fmt: skip


@pytest.mark.parametrize("key", FRAMES, ids=str)
def test_the_frame_agrees_with_the_c_entry(key: tuple[str, Any]) -> None:
    """By effects, and the floors of the damper or the number of storeys."""
    model = Model("modified_bouc_wen", SPENCER, FRAME_EFFECTS[key[0]], "frame", FRAMES[key])
    inputs = smooth_inputs()
    predicted = model.simulate(0.002, inputs)
    stepped = stepping.drive_frame(model, 0.002, inputs)
    for name, values in predicted.items():
        assert off(stepped[name], values) < LIMIT, name


N = round(SECONDS / DT) + 1
LINES = 5  # constant pieces that stand for a line between two samples


def smooth(seed: int) -> Array:
    """Command (N,) of slow sines, as a controller puts it out: no jumps."""
    rng, t = np.random.default_rng(seed), DT * np.arange(N)
    sines = [
        rng.uniform(0.2, 1) * np.sin(2 * np.pi * rng.uniform(1, 12) * t + rng.uniform(0, 6)) for _ in range(6)
    ]
    return np.asarray(np.clip(0.9 + np.sum(sines, axis=0), 0, 1.8))


def jumping(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.choice([0.0, 0.7, 1.8], N // 50 + 1), 50)[:N]


@cache
def clean(kind: str, seed: int, between: str, late: int = 0) -> Record:
    """A record of the frame without noise. between: "held" or "lines"; late: samples by which the rig's command is
    behind its log."""
    t: Array = np.asarray(DT * np.arange(N), dtype=np.float64)
    a = ground(t, seed)
    u = smooth(seed) if kind == "smooth" else jumping(seed)
    acted = np.concatenate([np.full(late, u[0]), u[: N - late]])
    pieces, period = acted[:-1], DT
    if between == "lines":
        middle = (np.arange(LINES) + 0.5) / LINES
        pieces, period = (acted[:-1, None] + np.diff(acted)[:, None] * middle).ravel(), DT / LINES
    run = frame_reference.solve(lambda when: float(np.interp(when, t, a)), pieces, period, period)
    read = slice(None, None, round(DT / period))
    channels = {"time_s": t, "ground_acceleration_m_s2": a, "command": u, "force_N": run["force"][read]}
    for what, unit in (("acceleration", "_m_s2"), ("displacement", "_m")):
        for j in (1, 2, 3):
            channels[f"floor{j}_{what}{unit}"] = run[what][read, j - 1]
    return Record(f"{kind}_{seed}", None, DT, channels)


def noisy(r: Record, seed: int) -> Record:
    rng = np.random.default_rng(seed)
    size = {name: level for name in r.channels for what, level in NOISE.items() if what in name}
    size.pop("ground_acceleration_m_s2")
    return r.with_channels(
        {name: np.asarray(r.channel(name)) + rng.normal(0, x, N) for name, x in size.items()}
    )


def case(between: str, late: int = 0, model: Model | None = None) -> Case:
    one, two = (clean("smooth", seed, between, late) for seed in (1, 2))
    again = replace(noisy(one, 3), name="repeat")
    return Case("frame", Path(), model or believed(), (noisy(one, 1), noisy(two, 2)), ((again, 0),))


def apart(one: Array, other: Array) -> float:
    return float(np.sqrt(np.mean((one - other) ** 2)) / np.std(other))


def test_jumps_show_that_a_command_is_held() -> None:
    assert held(jumping(3))
    assert not held(smooth(3))
    assert not held(np.zeros(50))
    ramps = np.interp(np.arange(N), np.arange(0, N + 40, 40), np.arange(N // 40 + 2) % 2)
    assert not held(ramps)


@pytest.mark.parametrize("kind", ["jumping", "smooth"])
def test_a_prediction_of_a_held_command(kind: str) -> None:
    found, model = clean(kind, 1, "held"), believed()
    force = found.channel("force_N")
    assert apart(free_run(model.with_hold(True), found)["force_N"], force) < 0.005
    assert apart(free_run(model.with_hold(False), found)["force_N"], force) > 0.015
    # What the file does not say is found where the command jumps.
    if kind == "jumping":
        assert apart(free_run(model, found)["force_N"], force) < 0.005


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [False, True])
@pytest.mark.parametrize("between", ["held", "lines"])
def test_responses_show_whether_a_smooth_command_is_held(between: str, wrong: bool) -> None:
    stiffness = (5.16e5, 6.84e5 * (1.1 if wrong else 1.0), 6.84e5)
    found, notes = with_hold(case(between, model=believed(stiffness=stiffness)))
    assert bool(found.model.hold) == (between == "held"), notes
    assert found.model.hold is not None or "do not show whether" in notes[0]


@pytest.mark.parametrize(
    ("lines", "delay", "known"),
    [(False, 0.0, 0.0), (False, 4e-3, 0.0), (False, 0.0, 8e-3), (True, 4e-3, 0.0), (True, 0.0, 8e-3)],
)
def test_jumps_show_how_they_run_beside_a_lag_that_the_simulator_may_lack(
    lines: bool, delay: float, known: float
) -> None:
    """Bingham's force by hand, every 50 us, behind a lag of 8 ms and a delay; known: the lag that the simulator has."""
    fine, tau, found = 40, 8e-3, []
    t: Array = np.arange(1500.0 * fine) * DT / fine
    kept = np.exp(-DT / fine / tau)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        waves = zip(rng.uniform(0.5, 3, 3), rng.uniform(0, 6, 3), strict=True)
        x = np.sum([4e-3 * np.sin(2 * np.pi * f * t + p) for f, p in waves], axis=0)
        u = np.repeat(rng.choice([0.0, 0.5, 1.0, 1.5], 30), 50)
        at = np.interp(t, DT * np.arange(len(u)), u) if lines else np.repeat(u, fine)
        at = np.concatenate([np.full(round(delay * fine / DT), u[0]), at])[: len(t)]
        current = lfilter([1 - kept], [1, -kept], at, zi=[kept * u[0]])[0]
        force = bingham_rig.force(np.gradient(x, DT / fine), current)[::fine] + rng.normal(0, 3.0, len(u))
        channels = {"time_s": t[::fine], "displacement_m": x[::fine], "command": u, "force_N": force}
        found.append(Record(f"{seed}", None, DT, channels))
    lag = (Effect("driver_lag", {"tau": known}),) if known else ()
    model = replace(bingham_rig.model(), effects=lag)
    assert bool(with_hold(Case("rig", Path(), model, tuple(found), ()))[0].model.hold) != lines


@pytest.mark.slow
def test_a_held_command_is_no_delay() -> None:
    found = diagnose(case("held"))
    assert (found.verdict, found.effects) == ("none", ())
    assert found.corrected.hold
    assert any("held between samples" in note for note in found.notes)


@pytest.mark.slow
def test_a_delay_beside_a_held_command_is_right() -> None:
    found = diagnose(case("held", late=8, model=believed().with_hold(True)))
    assert [e.effect for e in found.effects] == ["command_delay"]
    assert found.effects[0].parameters["d"] == pytest.approx(8 * DT, abs=2e-4)


@pytest.mark.slow
def test_identify_keeps_how_a_command_runs_between_samples() -> None:
    taken = {"displacement_m": "floor1_displacement_m", "command": "command", "force_N": "force_N"}
    runs = [clean("jumping", seed, "held") for seed in (1, 2, 3)]
    train = [Record(r.name, None, DT, {n: r.channel(of) for n, of in taken.items()}) for r in runs]
    fit = identify("modified_bouc_wen", train, extras=("driver_lag",), starts=2)
    assert fit.model.hold
    assert fit.model.attributes["driver_lag_tau"] == pytest.approx(frame_reference.LAG, rel=0.03)
    along = identify("modified_bouc_wen", train, extras=("driver_lag",), starts=2, hold=False)
    assert error(along.model, train[0]).nrmse > error(fit.model, train[0]).nrmse


def test_a_held_delay_is_exact_between_steps() -> None:
    # tau i' = u(t - d) - i under steps every 50 ms, by its closed form.
    dt, tau, every = 1e-3, 5e-3, 50
    k = np.arange(400)
    u = (k // every % 2).astype(float)
    x = np.asarray(1e-4 * k, dtype=np.float64)
    for d in (0.1e-3, 0.4e-3, 0.8e-3, 2.3e-3):
        law = {"c0a": 300.0, "c0b": 0.0, "fya": 50.0, "fyb": 400.0, "v_ref": 0.01}
        attributes = {**law, "driver_lag_tau": tau, "command_delay_d": d}
        found = core.run("bingham", attributes, dt, x, u=u, hold=True, columns=("current",))["current"]
        expected, level, target, at = np.zeros(len(k)), 0.0, 0.0, 0.0
        arrivals = [(every * dt * j + d, float(j % 2)) for j in range(len(k) // every + 1)]
        for j, t in enumerate(dt * k):
            while arrivals and arrivals[0][0] <= t:
                when, to = arrivals.pop(0)
                level, target, at = target + (level - target) * np.exp(-(when - at) / tau), to, when
            expected[j] = target + (level - target) * np.exp(-(t - at) / tau)
        np.testing.assert_allclose(found, expected, atol=1e-9)
