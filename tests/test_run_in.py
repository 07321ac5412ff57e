"""Records that begin in motion, a mass in a prediction, and coverage of intervals: against SciPy and by hand."""

from __future__ import annotations

import numpy as np
import pytest

from laboratory import TRUE, identifiable, rig_tests
from mrdamp.identify import identify, simulate
from mrdamp.identify.excerpts import skipped
from mrdamp.identify.findings import findings
from mrdamp.identify.intervals import intervals
from mrdamp.model import Effect, Model, core
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.simulation.predict import free_run
from mrdamp.simulation.stepping import drive_rig


def off(record: Record, force: np.ndarray) -> float:
    """RMS error over the force's deviation, beyond the first 20 ms."""
    measured = record.channel("force_N")[skipped(record) :]
    return float(np.sqrt(np.mean((force[skipped(record) :] - measured) ** 2)) / np.std(measured))


def late(law: str) -> list[Record]:
    """A test of each motion, at each command."""
    return rig_tests(law, noise=0.0, duration=2.5, late=1.37, chosen=(0, 4, 8))


@pytest.mark.parametrize("law", TRUE)
def test_a_record_cut_in_motion_is_what_the_whole_history_gives(law: str) -> None:
    for record in late(law):
        # x - y of modified_bouc_wen remembers 6.5 s: of the slow sine, a start that is not recorded.
        unknown = law == "modified_bouc_wen" and "_0.5_" in record.name
        led = off(record, simulate(Model(law, TRUE[law]), record))
        assert led < (0.04 if unknown else 0.005), record.name
        if law == "modified_bouc_wen":  # without it the start state is wrong
            plain = core.run(law, TRUE[law], record.sample_time, record.displacement, u=record.command)["force"]
            assert off(record, plain) > (1 if unknown else 3) * led


@pytest.mark.parametrize("law", ["bouc_wen", "modified_bouc_wen"])
def test_a_record_from_rest_is_not_led_into(law: str) -> None:
    for record in rig_tests(law, noise=0.0, duration=2.5, chosen=(0, 4, 8)):
        assert core.run_in(record.sample_time, record.displacement, record.command) is None
        assert off(record, simulate(Model(law, TRUE[law]), record)) < 0.005


@pytest.mark.slow
@pytest.mark.parametrize("law", ["hyperbolic_tangent", "modified_bouc_wen"])
def test_mujoco_is_led_into_it_too(law: str) -> None:
    model, record = Model(law, TRUE[law]), late(law)[1]
    inputs = {name: record.channel(name) for name in ("displacement_m", "command")}
    stepped = drive_rig(model, record.sample_time, inputs)["force_N"]
    whole = model.simulate(record.sample_time, inputs)["force_N"]
    assert np.sqrt(np.mean((stepped - whole) ** 2)) < 0.005 * np.std(whole)
    assert off(record, stepped) < 0.02


@pytest.mark.slow
def test_parameters_from_records_that_begin_in_motion() -> None:
    train = rig_tests("modified_bouc_wen", late=1.37, chosen=(0, 1, 3, 4, 5, 7, 8))
    fit = identify("modified_bouc_wen", train, starts=2)
    truth = identifiable("modified_bouc_wen")
    rows = {row.name: row for row in intervals(fit, train)}
    assert rows["k0"].value == pytest.approx(truth["k0"], rel=0.05)
    assert rows["k0"].high - rows["k0"].low < 0.1 * truth["k0"]
    for name in ("k0", "k1", "n", "c0a"):
        row = rows[name]
        reach = row.high - row.low
        assert row.low - reach < truth[name] < row.high + reach, name
    assert any("begin in motion" in line for line in findings(fit, train, []))


MASS, NOISE, VISCOSITY = 60.0, 2e-6, 800.0
LAW = {"c0a": VISCOSITY, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01}


def forces(dt: float, noise: float, *effects: Effect) -> tuple[Array, Array]:
    """Predicted force (n,) N of 15 mm at 2 Hz, and m a + c v of the motion without noise."""
    t = dt * np.arange(round(2 / dt))
    x = 0.015 * np.sin(4 * np.pi * t)
    noisy = x + noise * np.random.default_rng(1).standard_normal(len(t))
    record = Record("sine", None, dt, {"displacement_m": noisy, "command": np.zeros(len(t))})
    mass = sum(e.parameters["m"] for e in effects)
    exact = -mass * (4 * np.pi) ** 2 * x + VISCOSITY * 0.015 * 4 * np.pi * np.cos(4 * np.pi * t)
    keep = slice(round(0.1 / dt), -round(0.1 / dt))
    return free_run(Model("bingham", LAW, effects), record)["force_N"][keep], exact[keep]


@pytest.mark.parametrize("dt", [5e-4, 1e-3, 2e-3])
def test_a_mass_is_moved_without_the_displacements_noise(dt: float) -> None:
    """Differentiated as it is, the noise is a force of m sigma sqrt(6) / dt^2."""
    found, exact = forces(dt, NOISE, Effect("moving_mass", {"m": MASS}))
    assert np.std(found - exact) < 0.1 * MASS * NOISE * np.sqrt(6) / dt**2


def test_without_noise_or_mass_nothing_is_smoothed() -> None:
    plain, _ = forces(1e-3, NOISE)
    idle, _ = forces(1e-3, NOISE, Effect("moving_mass", {"m": 0.0}))
    assert idle == pytest.approx(plain, abs=1e-9)
    found, exact = forces(1e-3, 0.0, Effect("moving_mass", {"m": MASS}))
    assert np.std(found - exact) < 1e-3 * np.std(exact)


DRAWS = 20
#: Of 20 intervals that cover in 85 of 100 draws, fewer than 13 cover in 2 of 100.
LEAST = 13


@pytest.mark.slow
@pytest.mark.parametrize("law", TRUE)
def test_intervals_cover_the_truth(law: str) -> None:
    truth = identifiable(law)
    covered = {name: 0 for name, value in truth.items() if name not in ("x0", "k0b")}
    for seed in range(DRAWS):
        train = rig_tests(law, seed=seed)
        for row in intervals(identify(law, train, seed=seed, extras=(), starts=2), train, seed=seed):
            if row.name in covered:
                covered[row.name] += row.low <= truth[row.name] <= row.high
    share = sum(covered.values()) / (DRAWS * len(covered))
    print(f"{law}: {100 * share:.0f} %", covered)
    assert min(covered.values()) >= LEAST, covered
    assert share > 0.8
