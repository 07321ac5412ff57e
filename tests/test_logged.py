"""What lies between the samples of a log whose filter rings or is none: against NumPy at 20 kHz."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, firwin, lsim, lti, sosfilt

from mrdamp.diagnosis.problem.command_memory import ALONG
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.report.handover import agreement
from mrdamp.model import Effect, Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.log_filter import (
    AS_SENT,
    FACTOR,
    FILTERED,
    LOG,
    LOGGER,
    finer,
    logged,
    rings_before_jumps,
)
from mrdamp.simulation.predict import free_run

RATE, EVERY = 500.0, 40
DT = 1 / RATE


def fine_steps(seconds: float = 4.0) -> Array:
    """A command that jumps at times off the log's grid, at EVERY times its rate."""
    t = np.arange(int(seconds * RATE) * EVERY) / (RATE * EVERY)
    return np.where((t * 1.37 + 0.2) % 1.0 < 0.5, 1.2, 0.0)


def decimated(x: Array) -> Array:
    """A converter's log: a linear-phase filter whose delay it takes off, then every sample of the slow clock."""
    taps = firwin(20 * EVERY + 1, 0.92 / EVERY, window=("kaiser", 6.0))
    padded = np.concatenate([np.full(10 * EVERY, x[0]), x, np.full(10 * EVERY, x[-1])])
    return np.convolve(padded, taps, mode="valid")[::EVERY]


def oscillator(force: Array, dt: float) -> Array:
    """Acceleration of 1 kg on a spring of 110 Hz with 3 % of critical damping; the force runs along lines."""
    w = 2 * np.pi * 110.0
    return np.asarray(lsim(lti([1, 0, 0], [1, 0.06 * w, w**2]), force, dt * np.arange(len(force)))[1])


def test_only_a_filter_without_delay_rings_before_a_jump() -> None:
    fine = fine_steps()
    assert rings_before_jumps(decimated(fine))
    assert not rings_before_jumps(fine[::EVERY])
    late = sosfilt(butter(4, 200.0, fs=RATE * EVERY, output="sos"), fine)[::EVERY]
    assert not rings_before_jumps(late)  # it rings after the jump alone
    t = DT * np.arange(2000)
    assert not rings_before_jumps(0.5 + 0.4 * np.sin(2 * np.pi * 3 * t))
    assert not rings_before_jumps(np.full(500, 0.7))
    assert not rings_before_jumps(np.array([0.0, 1.0]))
    noisy = decimated(fine) + 0.01 * np.random.default_rng(1).standard_normal(len(t))
    assert not rings_before_jumps(noisy)  # where noise hides it, lines stay


def test_a_filtered_jump_sets_off_what_the_real_one_did() -> None:
    """Against the oscillator under the real jumps, at 20 kHz, its acceleration through the same converter."""
    real = fine_steps()
    want = decimated(oscillator(real, 1 / (RATE * EVERY)))
    log = decimated(real)

    def error(got: Array) -> float:
        keep = slice(50, len(want) - 50)
        return float(np.sqrt(np.mean((got - want)[keep] ** 2) / np.mean(want[keep] ** 2)))

    _, command = finer(np.zeros(len(log)), log, True)
    assert len(command) == (len(log) - 1) * FACTOR + 1
    lines = error(oscillator(log, DT))
    curve = error(logged(oscillator(command, DT / FACTOR), True))
    assert curve < 0.3 * lines
    assert curve < 0.06


def test_an_unfiltered_log_keeps_its_lines_and_its_ground_runs_smoothly() -> None:
    t, jump = DT * np.arange(400), fine_steps(0.8)[::EVERY]
    fine_t = DT / FACTOR * np.arange(2 * 400 - 1)
    tone = np.sin(2 * np.pi * 12 * t)
    ground, command = finer(tone, jump, False)
    np.testing.assert_array_equal(command, np.interp(fine_t, t, jump))
    smooth, straight = (
        np.abs(g - np.sin(2 * np.pi * 12 * fine_t)).max() for g in (ground, np.interp(fine_t, t, tone))
    )
    assert smooth < 0.1 * straight
    np.testing.assert_array_equal(logged(np.vstack([ground, command]), False), np.vstack([tone, jump]))


#: Friction that turns within a sample or two.
LAW = {"c0a": 800.0, "c0b": 600.0, "fya": 80.0, "fyb": 600.0, "v_ref": 0.004}


def triangle(hz: float, amplitude: float) -> Array:
    """A displacement whose corners take some milliseconds, at EVERY times the log's rate."""
    t = np.arange(len(fine_steps())) / (RATE * EVERY)
    return np.asarray(gaussian_filter1d(amplitude * 2 / np.pi * np.arcsin(np.sin(2 * np.pi * hz * t)), 60))


def force(x: Array, u: Array) -> Array:
    v = np.gradient(x, 1 / (RATE * EVERY))
    return np.asarray(
        (LAW["c0a"] + LAW["c0b"] * u) * v + (LAW["fya"] + LAW["fyb"] * u) * np.tanh(v / LAW["v_ref"])
    )


def records(*, filtered: bool) -> tuple[Record, Record]:
    out = []
    for name, u, hz in (("steps", fine_steps(), 1.2), ("held", np.ones(len(fine_steps())), 0.9)):
        x = triangle(hz, 0.012)
        log = decimated if filtered else lambda y: np.asarray(y[::EVERY])
        channels = {"displacement_m": log(x), "command": log(u), "force_N": log(force(x, u))}
        out.append(Record(name, None, DT, channels))
    return out[0], out[1]


def errors(rig: DamperRig) -> list[float]:
    out = []
    for k, r in enumerate(rig.records):
        got, want = rig.simulate([{}], k)[0, 0], r.channel("force_N")
        keep = slice(60, -60)
        out.append(float(np.sqrt(np.mean((got - want)[keep] ** 2) / np.mean(want[keep] ** 2))))
    return out


def test_what_is_simulated_goes_through_the_logs_filter() -> None:
    rig = DamperRig(Model("bingham", LAW), records(filtered=True))
    assert rig.filtered
    through = errors(rig)
    assert max(through) < 0.012
    alone = replace(rig)
    alone.__dict__["filtered"] = False
    assert min(a / t for a, t in zip(errors(alone), through, strict=True)) > 2


def test_a_log_without_a_filter_is_taken_as_it_is() -> None:
    rig = DamperRig(Model("bingham", LAW), records(filtered=False))
    assert not rig.filtered
    assert max(errors(rig)) < 0.012
    assert LOGGER not in rig.model({}).extra


def test_a_model_tells_of_the_filter_where_a_records_own_command_cannot(tmp_path: Path) -> None:
    rig = DamperRig(Model("bingham", LAW), records(filtered=True))
    rig.model({}).write(tmp_path / "model.json")
    model = Model.read(tmp_path / "model.json")
    assert model.extra[LOGGER] == FILTERED
    for k, record in enumerate(rig.records):
        got = free_run(model, record)["force_N"]
        want = rig.simulate([{}], k)[0, 0]
        assert np.allclose(got, want, rtol=0, atol=1e-3 * np.abs(want).max())
    held = rig.records[1]
    untold = free_run(replace(model, extra={}), held)["force_N"]
    assert np.abs(untold - free_run(model, held)["force_N"]).max() > 0.02 * np.abs(untold).max()
    assert agreement(model, held).within


LINES = {"c0a": 700.0, "c0b": 800.0, "fya": 70.0, "fyb": 620.0, "v_ref": 0.03}
B, D = 0.25, 0.2


def steps(levels: int = 3) -> Array:
    """The jumps of the log's tests, between several levels."""
    t = np.arange(len(fine_steps())) / (RATE * EVERY)
    return np.asarray(fine_steps() * (0.6 + 0.2 * np.floor((t * 1.37 + 0.2) % levels)))


def field(current: Array) -> Array:
    """Prandtl and Ishlinskii's stops in a loop over samples, demagnetised at first."""
    stops, out = np.zeros(6), np.empty(len(current))
    widths = D * 2 * np.arange(1, 7) / 7
    for k, step in enumerate(np.diff(current, prepend=current[0])):
        stops = np.clip(stops + step, -widths, widths)
        out[k] = current[k] - B * np.mean(stops) / D
    return out


@pytest.fixture(scope="module")
def record() -> Record:
    real = steps()
    t = np.arange(len(real)) / (RATE * EVERY)
    x, v = 0.01 * np.sin(2 * np.pi * 2.3 * t), 0.01 * 2 * np.pi * 2.3 * np.cos(2 * np.pi * 2.3 * t)
    b = field(real)
    force = (LINES["c0a"] + LINES["c0b"] * b) * v + (LINES["fya"] + LINES["fyb"] * b) * np.tanh(v / LINES["v_ref"])
    channels = {"displacement_m": decimated(x), "command": decimated(real), "force_N": decimated(force)}
    return Record("steps", None, DT, channels)


def model() -> Model:
    return Model("bingham", LINES, (Effect("remanence", {"b": B, "d": D, "stops": 1.0}),))


def error(force: Array, record: Record) -> float:
    keep = slice(60, -60)
    want = record.channel("force_N")[keep]
    return float(np.sqrt(np.mean((force[keep] - want) ** 2) / np.mean(want**2)))


def test_a_memory_is_not_led_along_the_waves(record: Record) -> None:
    led = error(free_run(model(), record)["force_N"], record)
    along = error(free_run(replace(model(), extra={LOG: AS_SENT}), record)["force_N"], record)
    assert led < 0.5 * along
    assert led < 0.02


def test_a_diagnosis_simulates_as_predicted(record: Record) -> None:
    rig = DamperRig(Model("bingham", LINES), (record,))
    settings = {"remanence_b": B, "remanence_d": D, "remanence_stops": 1.0}
    together = rig.simulate([settings, {}, {**settings, ALONG: 1.0}], 0)
    for k, one in enumerate([settings, {}, {**settings, ALONG: 1.0}]):
        np.testing.assert_allclose(rig.simulate([one], 0)[0], together[k])
    led, plain, along = (error(channels[0], record) for channels in together)
    assert led < 0.5 * along < 0.5 * plain
    predicted = free_run(model(), record)["force_N"]
    np.testing.assert_allclose(together[0, 0, 60:-60], predicted[60:-60], atol=0.01 * np.abs(predicted).max())
