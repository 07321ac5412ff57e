"""The blind test: cases, which the diagnosis knows nothing of, and what the effects of its rig do by closed forms."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import jn_zeros

from modules import STUDIES, WITHOUT_PHYSICS, package_modules
from mrdamp.model import Model
from mrdamp.records import read_record
from record_tables import channels_by_test
from rig_paths import DASHPOT, YIELD, at, clock, held, on_the_way
from studies.blindtest import bench, causes, commissioning, dampers, misfit_case, rig, run, score, unknown
from studies.blindtest.bench import Truth
from studies.blindtest.make import make_one
from studies.blindtest.rig import RATE_HZ, Array
from studies.blindtest.scale import Form, Scale
from studies.blindtest.sizing import OWN, Task, relative

Made = tuple[Path, Path, dict[str, Any]]


def made(folder: Path, rig: str, label: str, seed: int, *, misfit: bool = False) -> Made:
    task = Task("case_001", rig, label, misfit=misfit)
    told = make_one(task, folder / "cases", folder / "tests", np.random.SeedSequence(seed))
    return folder / "cases" / "case_001", folder / "tests" / "case_001.npz", told


@pytest.mark.slow
def test_damper_case_without_a_gap(tmp_path: Path) -> None:
    case, tests, label = made(tmp_path, "damper", "none", 3)
    model, told = Model.read(case), json.loads((case / "case.json").read_text())
    assert label["gap"] == pytest.approx(0.0, abs=1e-6)
    for channels in channels_by_test(tests).values():  # the plugin agrees with the rig
        assert relative(model.simulate(0.002, channels)["force_N"], channels["nominal_N"]) < 0.01
        assert relative(channels["nominal_N"], channels["force_N"]) < 1e-6
    first, again = (
        read_record(case / next(name for name in reversed(told["records"]) if kind in name))
        for kind in ("sine_random", "repeat")
    )
    assert again.command == pytest.approx(first.command)
    difference = again.channel("force_N") - first.channel("force_N")
    size = float(np.sqrt(np.mean(first.channel("force_N") ** 2)))
    assert np.std(difference) / np.sqrt(2) / size == pytest.approx(label["noise"], rel=0.6)


@pytest.mark.slow
def test_frame_case(tmp_path: Path) -> None:
    case, tests, label = made(tmp_path, "frame", "storey_stiffness@2", 2)
    model = Model.read(case)
    assert label["stages"] == ["structure"]
    assert 0.02 < label["gap"] < 0.8
    for channels in channels_by_test(tests).values():
        inputs = {name: channels[name] for name in ("ground_acceleration_m_s2", "command")}
        simulated = model.simulate(0.002, inputs)
        for floor in (1, 2, 3):
            nominal = channels[f"nominal_floor{floor}_acceleration"]
            assert relative(simulated[f"floor{floor}_acceleration_m_s2"], nominal) < 0.05
            assert relative(nominal, channels[f"floor{floor}_acceleration_m_s2"]) > 0.01
    told = json.loads((case / "case.json").read_text())
    ground = [read_record(case / name).channel("ground_acceleration_m_s2") for name in told["records"][-2:]]
    assert np.array_equal(ground[0], ground[1])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rig", "cause", "seed"), [("damper", "sensor_gain", 1), ("damper", OWN, 2), ("frame", "floor_mass@2", 3)]
)
def test_simulator_leaves_three_to_fifteen_percent(rig: str, cause: str, seed: int, tmp_path: Path) -> None:
    """Without the cause; what the label calls its base is the same in the shared scorer's terms."""
    case, tests, label = made(tmp_path, rig, cause, seed, misfit=True)
    counted = len(channels_by_test(tests)) * (3 if label["rig"] == "frame" else 1)
    assert commissioning.MISFIT[0] <= label["misfit"] <= commissioning.MISFIT[1]
    assert label["base"] == pytest.approx(label["misfit"] * np.sqrt(counted), rel=1e-9)
    model = Model.read(case)
    before, after = score.gaps(tests, lambda inputs: run.predicted(model, inputs))
    assert [after, label["gap"]] == pytest.approx([before, before], rel=1e-3)  # the nominal simulator's
    assert label["gap"] == label["base"] if cause == OWN else label["gap"] > 1.05 * label["base"]


@pytest.mark.slow
def test_effect_is_in_the_records_and_not_in_the_baseline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A gain of one force channel: its ratio to the load cell of the same record."""
    monkeypatch.setattr(misfit_case, "BASELINE", 1.0)  # every case has records of the rig before the cause
    case, _, label = made(tmp_path, "damper", "sensor_gain", 1, misfit=True)
    told = json.loads((case / "case.json").read_text())
    assert {path.name for path in case.glob("*.csv.gz")} == {*told["baseline"], *told["records"]}
    wanted = label["size"]["sensor.gain"]
    assert abs(wanted) > 0.02
    for name in (*told["baseline"], *told["records"]):
        record = read_record(case / name)
        own, cell = (record.channel(c)[100:] for c in ("force_N", "reference_force_N"))
        gain = float(own @ cell / (cell @ cell)) - 1
        assert gain == pytest.approx(0.0 if name in told["baseline"] else wanted, rel=0.2, abs=0.01)


def test_rig_shares_no_code_with_the_plugin() -> None:
    names = sorted(path.stem for path in (STUDIES / "blindtest").glob("*_forms.py"))
    names += "rig bench causes unknown frame_causes damper_case frame_case dampers case_sampling recorder make".split()
    used = package_modules("; ".join(f"import studies.blindtest.{name}" for name in names))
    assert [name for name in used if not name.startswith(("sets", *WITHOUT_PHYSICS))] == []
    source = (STUDIES / "blindtest" / "rig.c").read_text()
    included = {line for line in source.splitlines() if line.startswith("#include")}
    assert included == {"#include <math.h>", "#include <string.h>"}


Numbers = Mapping[str, float]


def two_poles(s: Array, tau: float, tau2: float) -> Array:
    return (tau * np.exp(-s / tau) - tau2 * np.exp(-s / tau2)) / (tau - tau2)


def by_diffusion(s: Array) -> Array:
    """By the first four zeros of J0 behind the coil's own pole."""
    shares = jn_zeros(0, 4) ** -2 / np.sum(jn_zeros(0, 4) ** -2)
    taus = 0.05 * (jn_zeros(0, 4)[0] / jn_zeros(0, 4)) ** 2
    left = [share * two_poles(s, tau, 0.008) for share, tau in zip(shares, taus, strict=True)]
    return np.asarray(1 - np.sum(left, axis=0))


def controlled(s: Array) -> Array:
    """i'' tau + i' (1 + K) + i K / T = K / T: w0^2 = K / (T tau) = 1250, 2 z w0 = 2 / tau."""
    w, d = np.sqrt(1250 - 25**2), 25.0
    return np.asarray(1 - np.exp(-d * s) * (np.cos(w * s) + (d - 25.0) / w * np.sin(w * s)))


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        ({"lag_form": 1.0, "lag_tau": 0.02, "lag_tau2": 0.005}, lambda s: 1 - two_poles(s, 0.02, 0.005)),
        ({"lag_form": 2.0, "lag_tau": 1e-5, "lag_rate": 50.0}, lambda s: np.minimum(50 * s, 1)),
        ({"lag_form": 3.0, "lag_tau": 0.01, "lag_tau2": 0.03}, lambda s: 1 - np.exp(-s / 0.01)),
        ({"lag_form": 4.0, "lag_tau": 0.04, "lag_tau2": 0.02, "lag_gain": 1.0, "lag_span": 50.0}, controlled),
        ({"lag_form": 5.0, "lag_tau": 0.05, "lag_tau2": 0.008}, by_diffusion),
    ],
)
def test_current_after_a_step(numbers: Numbers, expected: Callable[[Array], Array]) -> None:
    t = clock(0.5)
    current = held({**DASHPOT, **numbers}, t, np.where(t > 0, 1.0, 0.0))["current"]
    assert np.abs(current - expected(t[::2])).max() < 4e-3


def test_command_is_delayed_and_packets_are_under_way_for_a_time_of_their_own() -> None:
    t = clock(20.0)
    network = {"command.delay": 0.05, "command.jitter": 0.3, "command.beat": 0.02}
    late = t - bench.driven(Truth({}, network), t, np.random.default_rng(0))
    later = late[len(t) // 10 :]
    assert later.mean() == pytest.approx(0.05, rel=0.1)
    assert 0.034 < later.min() < 0.037
    assert later.max() <= 0.065 + 1e-9
    assert np.all(np.diff(t - late) >= -1e-12)
    fixed = bench.driven(Truth({}, {"command.delay": 0.02}), t, np.random.default_rng(0))
    assert fixed[-1] == pytest.approx(19.98)


CLOSING = (
    2
    * 0.9
    * float(np.average(0.02 * np.arange(1, 7), weights=np.exp(-0.3 * np.arange(6))))
    / (1 + (5 / 7) ** 4)
)


@pytest.mark.parametrize(
    ("numbers", "width"),
    [
        ({"rem_form": 1.0, "rem_width": 0.12, "rem_share": 1.0}, 2 * 0.12 * 7 / 12),
        ({"rem_form": 2.0, "rem_width": 0.06, "rem_share": 0.8, "rem_span": 1.0}, 2 * 0.8 * 0.06),
        # less by 1 / (1 + (i / 0.7)^4) towards the tip, plays weighted by exp(-0.3 k)
        ({"rem_form": 3.0, "rem_width": 0.12, "rem_share": 0.9, "rem_span": 1.0}, CLOSING),
    ],
)
def test_field_is_higher_on_the_way_down(numbers: Numbers, width: float) -> None:
    """The loop is as wide as the mean of its plays (7/12 of the widest, both ways) or relays."""
    t = clock(2.0)
    field = held({**YIELD, **numbers}, t, 1 - np.abs(1 - t))["field"]
    assert field[at(1.5)] - field[at(0.5)] == pytest.approx(width, rel=0.05)


LOST = {**YIELD, "gas_sign": 1.0, "gas_loss": 0.8}


@pytest.mark.parametrize(
    ("numbers", "place", "out", "back"),
    [
        ({**LOST, "gas_form": 1.0, "gas_stroke": 0.002}, 0.0005, 100 * (1 - 0.8 * np.exp(-0.25)), -100),
        ({**LOST, "gas_form": 2.0, "gas_stroke": 0.002}, 0.0005, 100 * (1 - 0.8 * 0.75**2), -100),
        # empty for half of 4 mm, then softly: half of the loss is made up half way
        ({**LOST, "gas_form": 4.0, "gas_stroke": 0.004, "gas_free": 0.5}, 0.0015, 20, -100),
        ({**LOST, "gas_form": 4.0, "gas_stroke": 0.004, "gas_free": 0.5}, 0.0025, 20 + 80 * 5 / 32, -100),
        ({**LOST, "gas_form": 4.0, "gas_stroke": 0.004, "gas_free": 0.5, "gas_sign": -1.0}, 0.0085, 100, -20),
    ],
)
def test_gas_takes_force_at_the_start_of_one_stroke(
    numbers: Numbers, place: float, out: float, back: float
) -> None:
    assert on_the_way(numbers, place) == pytest.approx((out, back), rel=0.05)
    assert on_the_way(numbers, 0.005)[0] == pytest.approx(100.0, rel=0.07)


DEVICE = dampers.draw(np.random.default_rng(1), mounted=True)
SCALE = Scale(500.0, 40.0, 0.005, 1.0, DEVICE.machine.command, DEVICE.piston(500.0))
FORMS = {f"{name} {k}": form for name, (_, forms) in causes.EFFECTS.items() for k, form in enumerate(forms)}
FORMS |= {name: form for name, (_, form) in unknown.DAMPER.items()}


def run_at(rate: int, numbers: Numbers, monkeypatch: pytest.MonkeyPatch) -> tuple[Array, Array]:
    """Place (m) and force over two cycles of changing current, at a rate of steps."""
    monkeypatch.setattr(rig, "RATE_HZ", rate)
    t = clock(0.8, rate)
    w = 2 * np.pi * 2.5
    u = DEVICE.machine.command * (0.5 - 0.4 * np.cos(2 * w * t))
    out = rig.run_damper(numbers, 0.008 * np.sin(w * t), 0.008 * w * np.cos(w * t), u)
    return 0.008 * np.sin(w * t[::2]), out["force"]


@pytest.mark.parametrize("name", FORMS)
def test_half_the_step_changes_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """At a middling size the step is fine enough, and what loses energy does."""
    form: Form = FORMS[name]
    sized = form(np.random.default_rng(3), SCALE)(0.3)
    numbers = {**DEVICE.numbers, **{k: v for k, v in sized.items() if "." not in k}}
    x, force = run_at(RATE_HZ, numbers, monkeypatch)
    fine = run_at(2 * RATE_HZ, numbers, monkeypatch)[1][::2]
    assert np.sqrt(np.mean((force - fine) ** 2) / np.mean(fine**2)) < 2e-3
    last = slice(len(x) // 2, None)
    assert np.trapezoid(force[last], x[last]) > 0
