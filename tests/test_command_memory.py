"""A magnetic circuit's memory and a log whose filter rings: against NumPy at 20 kHz under the jumps themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mrdamp.diagnosis.problem.command_memory import ALONG, log_entry
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.model import Effect, Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.records.log_filter import AS_SENT, LOG, without_waves
from mrdamp.simulation.predict import free_run
from test_logged import DT, EVERY, RATE, decimated, fine_steps

LAW = {"c0a": 700.0, "c0b": 800.0, "fya": 70.0, "fyb": 620.0, "v_ref": 0.03}
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
    force = (LAW["c0a"] + LAW["c0b"] * b) * v + (LAW["fya"] + LAW["fyb"] * b) * np.tanh(v / LAW["v_ref"])
    channels = {"displacement_m": decimated(x), "command": decimated(real), "force_N": decimated(force)}
    return Record("steps", None, DT, channels)


def model() -> Model:
    return Model("bingham", LAW, (Effect("remanence", {"b": B, "d": D, "stops": 1.0}),))


def error(force: Array, record: Record) -> float:
    keep = slice(60, -60)
    want = record.channel("force_N")[keep]
    return float(np.sqrt(np.mean((force[keep] - want) ** 2) / np.mean(want**2)))


def test_only_waves_are_taken_off() -> None:
    real = steps()
    log = decimated(real)
    held = without_waves(log, log)
    assert held is not None
    keep = slice(30, -30)
    levels = np.unique(np.round(real, 9))
    off = np.abs(held[keep, None] - levels).min(axis=1)
    between = np.abs(np.diff(real[::EVERY], prepend=0.0)) > 0
    near = np.convolve(between, np.ones(7), mode="same")[keep] > 0
    assert off[~near].max() < 0.01 * levels.max()
    assert np.abs(log[keep, None] - levels).min(axis=1)[~near].max() > 0.01 * levels.max()
    assert held[keep].max() <= levels.max() * 1.002
    assert without_waves(real[::EVERY], real[::EVERY]) is None
    ramp = np.interp(np.arange(2000), [0, 700, 1400, 2000], [0.0, 1.0, 0.2, 0.9])
    assert without_waves(ramp, ramp) is None


def test_a_memory_is_not_led_along_the_waves(record: Record) -> None:
    led = error(free_run(model(), record)["force_N"], record)
    along = error(free_run(replace(model(), extra={LOG: AS_SENT}), record)["force_N"], record)
    assert led < 0.5 * along
    assert led < 0.02


def test_a_diagnosis_simulates_as_predicted(record: Record) -> None:
    rig = DamperRig(Model("bingham", LAW), (record,))
    settings = {"remanence_b": B, "remanence_d": D, "remanence_stops": 1.0}
    together = rig.simulate([settings, {}, {**settings, ALONG: 1.0}], 0)
    for k, one in enumerate([settings, {}, {**settings, ALONG: 1.0}]):
        np.testing.assert_allclose(rig.simulate([one], 0)[0], together[k])
    led, plain, along = (error(channels[0], record) for channels in together)
    assert led < 0.5 * along < 0.5 * plain
    predicted = free_run(model(), record)["force_N"]
    np.testing.assert_allclose(together[0, 0, 60:-60], predicted[60:-60], atol=0.01 * np.abs(predicted).max())


def test_a_file_tells_how_the_command_was_logged(record: Record) -> None:
    settings = {"remanence_b": B, "remanence_d": D, ALONG: 1.0}
    found = DamperRig(Model("bingham", LAW), (record,)).model(settings)
    again = Model.from_dict(found.to_dict())
    assert again.extra[LOG] == AS_SENT
    assert {e.name for e in again.effects} == {"remanence"}
    assert log_entry({}) == {}


def test_terms_along_the_log_are_there_where_a_log_rings(record: Record) -> None:
    ringing = DamperRig(Model("bingham", LAW), (record,)).terms
    flat = replace(record, channels={**record.channels, "command": np.full(record.n, 0.5)})
    still = DamperRig(Model("bingham", LAW), (flat,)).terms
    along = [t for t in ringing if ALONG in t.fixed]
    assert along
    assert {t.effect for t in along} == {"remanence"}
    assert not [t for t in still if ALONG in t.fixed]
    assert len({t.name for t in ringing}) == len(ringing) == len(still) + len(along)
