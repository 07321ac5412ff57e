"""A diagnosis beside a law that is not the rig's: own effects, channels compared, baselines, what the file leaves.

Records are written out in NumPy and SciPy, with noise, by forces that the nominal law cannot follow exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.channels.comparison import compared
from mrdamp.diagnosis.constants import UNSTEADY
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.run import diagnose
from mrdamp.model import Effect, Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.simulation.predict import write_prediction

DT = 0.002
#: Bingham with the least error on records of this rig with other noise (`identify`): only its form is wrong.
LAW = {"c0a": 450.0, "c0b": 63.0, "fya": 38.5, "fyb": 277.0, "v_ref": 0.022}
OWN = Effect("gas_spring", {"f0": 25.0})


def model(*effects: Effect) -> Model:
    return Model("bingham", LAW, effects, name="nominal")


def record(
    name: str, amplitude: float, hz: float, u: float, seed: int, *, gain: float = 1.0, spring: float = 0.0
) -> Record:
    """Six seconds; the rig's friction has a loop and its viscosity bends, which no Bingham law does."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(3000)
    x = amplitude * np.sin(2 * np.pi * hz * t) + 0.2 * amplitude * np.sin(2 * np.pi * 0.37 * hz * t + 1)
    v = np.gradient(x, DT)
    loop = lfilter([0.02], [1, -0.98], np.tanh(v / 0.01))
    force = (
        (380 + 320 * u) * v / (1 + np.abs(v)) + (45 + 290 * u) * (0.8 * np.tanh(v / 0.02) + 0.2 * loop) + 25
    )
    force = force + spring * x
    cell = force + rng.normal(0, 1.0, len(t))
    own = gain * force + rng.normal(0, 1.0, len(t))
    channels = {"displacement_m": x, "command": np.full(len(t), u), "force_N": own, "reference_force_N": cell}
    return Record(name, None, DT, channels)


def records(first_seed: int = 0, **changes: float) -> tuple[Record, ...]:
    tests = [(0.01, 1.0, 0.0), (0.01, 1.0, 1.0), (0.02, 0.7, 0.5), (0.005, 2.5, 0.0), (0.005, 2.5, 1.0)]
    return tuple(record(f"test_{k}", *test, seed=first_seed + k, **changes) for k, test in enumerate(tests))


def case(*, baseline: tuple[Record, ...] = (), **changes: float) -> Case:
    return Case("rig", Path(), model(OWN), records(0, **changes), (), baseline)


def test_nominal_effects_stay_free_and_in_what_is_handed_over() -> None:
    rig = DamperRig(model(OWN, Effect("driver_lag", {"tau": 0.01})), records())
    free = {c.name: c for c in rig.nominal}
    assert free["gas_spring_f0"].start == 25.0
    assert free["gas_spring_f0"].low < 0 < free["gas_spring_f0"].high
    assert free["driver_lag_tau"].start == 0.01
    own = {c.name: c for t in rig.terms if t.effect in ("gas_spring", "driver_lag") for c in t.coordinates}
    assert "gas_spring_k" in own
    assert own["gas_spring_f0"].start == 25.0  # a new spring may have another preload
    assert own["driver_lag_tau"].start == 0.01  # the lag itself may have grown
    made = rig.model({"gas_spring_k": 3000.0, "gas_spring_f0": 31.0, "sensor_lag_tau": 0.004})
    assert {e.name: dict(e.parameters) for e in made.effects} == {
        "gas_spring": {"f0": 31.0, "k": 3000.0}, "driver_lag": {"tau": 0.01}, "sensor_lag": {"tau": 0.004},
    }  # fmt: skip


def sensed(read: Callable[[Array], Array]) -> tuple[Record, ...]:
    """Records of a rig whose force sensor reads so, with noise, what the load cell beside it reads."""
    rng, made = np.random.default_rng(5), []
    for r in records():
        own = read(np.asarray(r.channel("reference_force_N")))
        made.append(r.with_channels({"force_N": own + rng.normal(0, 1.0, r.n)}))
    return tuple(made)


def lagging(cell: Array) -> Array:
    a = 2 * 0.01 / DT
    return np.asarray(lfilter([1 / (1 + a), 1 / (1 + a)], [1, (1 - a) / (1 + a)], cell))


@pytest.mark.parametrize(
    ("read", "cause", "setting", "value"),
    [
        (lambda cell: 1.15 * cell, "sensor_gain", "sensor_gain_g", pytest.approx(1.15, abs=0.005)),
        (lagging, "sensor_lag", "sensor_lag_tau", pytest.approx(0.01, rel=0.15)),
        (lambda cell: cell, None, "", None),
    ],
)
def test_the_force_sensor_is_compared_with_the_load_cell(
    read: Callable[[Array], Array], cause: str | None, setting: str, value: Any
) -> None:
    rig = DamperRig(model(), sensed(read))
    (found,) = compared(rig.records, rig.terms, rig.nominal_model.attributes)
    assert found.cause == cause
    if cause:
        assert found.settings is not None
        assert found.settings[setting] == value
        assert found.nats > 10


@pytest.mark.slow
def test_a_sensor_fault_outside_the_catalogue_is_unknown_whatever_the_law_does() -> None:
    one = Case("rig", Path(), model(OWN), sensed(lambda cell: np.clip(cell, -200.0, 200.0)), (), ())
    (row,) = compared(one.records, DamperRig(one.model, one.records).terms, {})
    assert row.unexplained
    found = diagnose(one)
    assert found.verdict == "unknown"
    assert found.effects == ()
    assert found.probabilities["unknown"] > 0.95 * UNSTEADY
    assert max(found.where.stages, key=lambda name: found.where.stages[name]) == "sensor"
    assert sum(found.where.stages.values()) == pytest.approx(1.0)
    assert "reference_force_N and force_N differ by" in found.sentence
    assert found.corrected.parameters == one.model.parameters
    assert found.corrected.effects == one.model.effects


def test_the_measured_current_is_compared_with_the_command() -> None:
    made = []
    for k, r in enumerate(records()):
        u = np.where(np.floor(r.time / 0.4) % 2 == k % 2, 1.0, 0.2)
        a = np.exp(-DT / 0.03)
        late = np.asarray(lfilter([1 - a], [1, -a], u, zi=[a * u[0]])[0], dtype=np.float64)
        made.append(r.with_channels({"command": u.astype(float), "current_A": late}))
    rig = DamperRig(model(), tuple(made))
    found = [c for c in compared(rig.records, rig.terms, {}) if c.channels[1] == "current_A"]
    assert [c.cause for c in found] == ["driver_lag"]
    assert found[0].settings is not None
    assert found[0].settings["driver_lag_tau"] == pytest.approx(0.03, rel=0.05)


@pytest.mark.slow
def test_an_effect_of_the_simulator_that_has_grown_is_named() -> None:
    """A spring of 3,000 N/m that the simulator has is 9,000 N/m now: as stiff as by NumPy's least squares of this law's
    terms and a spring, whose loop is a part of it."""
    known = Effect("gas_spring", {"f0": 25.0, "k": 3000.0})
    baseline = tuple(replace(r, name=f"baseline_{r.name}") for r in records(50, spring=3000.0))
    found = diagnose(Case("rig", Path(), model(known), records(0, spring=9000.0), (), baseline))
    assert [e.effect for e in found.effects] == ["gas_spring"]
    columns, forces = [], []
    for r in records(0, spring=9000.0):
        v, f = r.velocity(), r.channel("force_N")
        rates, size = np.column_stack([v, np.tanh(v / LAW["v_ref"])]), np.sqrt(np.mean(f**2))
        terms = [rates, r.command[:, None] * rates, r.displacement[:, None], np.ones((r.n, 1))]
        columns.append(np.hstack(terms) / size)
        forces.append(f / size)
    spring = np.linalg.lstsq(np.vstack(columns), np.concatenate(forces))[0][4]
    assert 9000 < spring < 10000
    assert found.effects[0].parameters["k"] == pytest.approx(spring, rel=0.03)
    assert [e.name for e in found.corrected.effects] == ["gas_spring"]


@pytest.mark.slow
def test_a_gain_is_named_beside_a_law_that_is_not_the_rigs(tmp_path: Path) -> None:
    found = diagnose(case(gain=1.2))
    assert found.verdict == "effect"
    assert [e.effect for e in found.effects] == ["sensor_gain"]
    assert found.effects[0].parameters["g"] == pytest.approx(1.2, abs=0.03)
    assert found.remainder is not None
    assert "The remaining" in found.sentence
    left, nominal = (g**2 - found.gap.noise_floor**2 for g in (found.gap.left_out, found.gap.nominal))
    assert found.remainder.share == pytest.approx(left / nominal)
    assert any(e.name == "gas_spring" for e in found.corrected.effects)
    assert any("there are no baseline records" in note for note in found.notes)
    # The reported gap is the file's: by the command's own path, from the file that was written.
    found.corrected.write(tmp_path / "corrected.json")
    squares = []
    for r in records(gain=1.2):
        r.save(tmp_path / f"{r.name}.csv")
        own = write_prediction(
            Model.read(tmp_path / "corrected.json"), tmp_path / f"{r.name}.csv", tmp_path / "out.csv"
        )
        kept = slice(50, r.n - 8)
        for name in ("force_N", "reference_force_N"):
            true = np.asarray(r.channel(name))[kept]
            squares.append(float(np.mean((own[name][kept] - true) ** 2) / np.mean(true**2)))
    assert found.gap.corrected == pytest.approx(float(np.sqrt(np.mean(squares))), rel=0.01)


@pytest.mark.slow
def test_nothing_is_invented_where_only_the_law_is_wrong() -> None:
    found = diagnose(case())
    assert found.effects == ()
    bars = {s.name: s.gap for s in found.waterfall}
    assert bars["recalibrated"] == pytest.approx(found.gap.recalibrated)
    assert bars["nominal"] == found.gap.nominal
    again = diagnose(Case("again", Path(), found.corrected, records(), ()))
    assert again.effects == ()


@pytest.mark.slow
def test_a_rig_that_is_as_its_baseline_has_no_gap() -> None:
    found = diagnose(case(baseline=records(first_seed=10)))
    assert found.verdict == "none"
    assert "No change since the baseline shows" in found.sentence
    assert not any("there are no baseline records" in note for note in found.notes)
