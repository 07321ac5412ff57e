"""Causes outside the catalogue on the reference rig, and every form: convergence of the step, work done."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from rig_paths import NOTHING, PLAIN, YIELD, at, clock, held, moved, on_the_way, sensed, steady
from studies.blindtest import bench, causes, dampers, frame_causes, rig, unknown
from studies.blindtest.bench import Truth
from studies.blindtest.excitation import GRID_HZ, Excitation
from studies.blindtest.rig import RATE_HZ, Array
from studies.blindtest.scale import Form, Scale


# --- outside the catalogue -----------------------------------------------------------------------------
def test_magnet_against_the_coil() -> None:
    t = clock(1.0)
    field = held({**YIELD, "bias_current": 0.3}, t, t)["field"]
    assert field[[at(0.1), at(0.3), at(0.8)]] == pytest.approx([0.5, 0.3, 0.8], abs=1e-4)


def test_pole_pulls_what_rests() -> None:
    numbers = {**YIELD, "pull_force": 80.0, "pull_x": 0.003, "pull_width": 0.002}
    t = clock(0.01)
    force = held(numbers, t, np.full(len(t), 0.5))["force"][-1]
    assert force == pytest.approx(80 * 0.25 * -1.5 * np.exp(-2.25))


def test_poppet_snaps_open_and_is_slow_to_shut() -> None:
    t = clock(1.0)
    u = np.select([t < 0.2, t < 0.4, t < 0.6], [0.6, 1.2, 0.6], 0.3)
    numbers = {**YIELD, "poppet_share": 0.5, "poppet_force": 100.0, "poppet_time": 0.1}
    force = rig.run_damper(numbers, 0.1 * t, np.full(len(t), 0.1), u)["force"]
    late = 30 * (1 - 0.5 * np.exp(-1.0))
    assert force[[at(0.19), at(0.39), at(0.59), at(0.7)]] == pytest.approx([60, 60, 30, late], rel=2e-3)


def test_yield_overshoots_after_a_turn() -> None:
    numbers = {**YIELD, "peak_gain": 0.5, "peak_path": 0.002}
    for place, path in ((0.001, 0.001), (0.006, 0.006)):
        share = (1 + 0.5 * np.exp(-path / 0.002)) / 1.15
        assert on_the_way(numbers, place)[0] == pytest.approx(100 * share, rel=0.02)


def test_accumulator_lets_go_through_an_orifice() -> None:
    """d' = -sqrt(d l) / T: the root of the force falls in a straight line."""
    t = clock(0.3)
    x = 0.004 * np.clip(t / 1e-3, 0, 1)
    numbers = {**NOTHING, "leak_k": 1e4, "leak_time": 0.5, "leak_length": 0.004}
    force = moved(numbers, t, x)["force"]
    root = np.sqrt(force[[at(0.05), at(0.25)]] / 40)
    assert root[0] - root[1] == pytest.approx(0.2 / (2 * 0.5), rel=0.03)


def test_fluid_goes_past_a_worn_seal() -> None:
    """Far below the speed at which the orifice holds the law's force it holds the square of the speed's share."""
    numbers = {**YIELD, "bypass_force": 100.0, "bypass_v": 0.05}
    assert steady(numbers, 0.01)["force"][-1] == pytest.approx(100 * 0.04 / np.hypot(1, 0.04), rel=1e-3)
    assert steady(numbers, -0.5)["force"][-1] == pytest.approx(-100.0, rel=1e-3)


def test_guide_holds_towards_one_end() -> None:
    numbers = {**NOTHING, "rub_force": 30.0, "rub_side": -1.0, "rub_x": 0.002, "rub_width": 0.004}
    force = steady(numbers, -0.05, end=0.2)["force"]  # from 0 to -10 mm
    assert force[[at(0.03), at(0.08), at(0.19)]] == pytest.approx([0, -15, -30], abs=0.05)
    assert np.abs(steady(numbers, 0.05)["force"]).max() == 0.0


def test_contact_opens_while_the_rod_moves_fast() -> None:
    t = np.arange(20 * GRID_HZ + 1) / GRID_HZ
    motion = np.where(t < 10, 0.02 * t, 0.2)
    test = Excitation("steps", motion, np.ones(len(t)), seed=3)
    opened = [
        bench.damper_channels(Truth(YIELD, {"command.contact": share}), test, test.rng)["current_A"] == 0
        for share in (0.3, 1.0)
    ]
    assert np.mean(opened[1][:5000]) == pytest.approx(1 - np.exp(-15 * 0.0225), rel=0.35)
    assert not opened[1][5010:].any()
    assert np.all(opened[1][opened[0]])  # those of the smaller share are among them
    assert 0 < np.mean(opened[0]) < 0.6 * np.mean(opened[1])


def test_coil_has_another_resistance_in_each_record() -> None:
    t = clock(0.1)
    drift = Truth({}, {"command.drift": 0.4})
    sizes = [bench.driven(drift, 1 + 0 * t, np.random.default_rng(k)) for k in range(30)]
    assert all(np.ptp(size) == 0 for size in sizes)
    assert 0.6 <= min(size[0] for size in sizes) < 0.75
    assert 1.25 < max(size[0] for size in sizes) <= 1.4


def test_dropouts_of_a_smaller_share_are_among_those_of_a_larger() -> None:
    t = clock(40.0)
    off = [
        bench.driven(Truth({}, {"command.dropouts": share}), 1 + 0 * t, np.random.default_rng(1)) == 0
        for share in (0.4, 1.0)
    ]
    assert np.all(off[1][off[0]])
    assert 0 < np.mean(off[0]) < np.mean(off[1])
    assert np.mean(off[1]) == pytest.approx(0.5 * 0.3, rel=0.5)


def test_command_of_few_levels() -> None:
    t = clock(1.0)
    coarse = bench.driven(Truth({}, {"command.step": 0.25}), t, np.random.default_rng(0))
    assert np.unique(coarse) == pytest.approx([0, 0.25, 0.5, 0.75, 1])
    assert np.abs(coarse - t).max() <= 0.125 + 1e-9


def test_slack_of_the_transducer() -> None:
    t = np.arange(2 * GRID_HZ + 1) / GRID_HZ
    test = Excitation("sine", 0.005 * np.sin(2 * np.pi * t), t)
    read = bench.as_read(Truth({}, {"reading.slack": 0.002}), test)
    assert read[-1] == pytest.approx(-0.001, abs=1e-5)
    assert np.abs(read - test.fine(test.motion)).max() == pytest.approx(0.001, rel=1e-3)


def test_range_is_held() -> None:
    force = np.where(np.arange(RATE_HZ) == at(0.2), 150.0, 50.0)
    truth = Truth({}, {"sensor.range": 100.0, "sensor.range_gain": 0.1, "sensor.range_hold": 0.3})
    read = bench.sensor(truth, "sensor", force, np.random.default_rng(0))
    assert read[[at(0.1), at(0.2), at(0.4), at(0.6)]] == pytest.approx([50, 165, 55, 50])


def test_ring_leaks_now_and_then() -> None:
    test = Excitation("triangle", 0.1 * np.arange(20 * GRID_HZ + 1) / GRID_HZ, np.ones(20 * GRID_HZ + 1))
    force = bench.damper_channels(Truth(YIELD, {"rod.leaks": 0.4}), test, np.random.default_rng(2))["force_N"]
    assert force.min() == pytest.approx(60.0)
    assert force.max() == pytest.approx(100.0)
    assert 0.1 < np.mean(force < 80) < 0.7


def test_load_cell_with_hysteresis_clips_and_drifts() -> None:
    t = np.arange(2 * RATE_HZ) / RATE_HZ
    wave = 100 * np.sin(2 * np.pi * 2 * t)
    bent = sensed(wave, hysteresis=0.5, hysteresis_width=20.0)
    crossing = [at(1.0), at(1.25)]  # upwards, downwards
    assert (wave - bent)[crossing] == pytest.approx([10, -10], abs=0.3)
    assert np.abs(sensed(wave, clip=60.0)).max() == 60.0
    assert sensed(wave, clip=120.0) == pytest.approx(wave)
    creeping = sensed(0 * wave, zero=10.0)
    assert creeping[0] == 0.0
    assert 5 < abs(creeping[-1]) / (1 - np.exp(-1 / 3)) < 15
    assert {float(np.sign(sensed(0 * wave, seed, zero=10.0)[-1])) for seed in range(8)} == {-1.0, 1.0}


def test_transmitter_hangs() -> None:
    t = np.arange(20 * RATE_HZ) / RATE_HZ
    stands = [float(np.mean(np.diff(sensed(t, hang=share)) == 0)) for share in (0.2, 1.0)]
    assert stands[0] < 0.6 * stands[1]
    assert stands[1] == pytest.approx(1.5 * 0.09, rel=0.4)
    assert np.abs(sensed(t, hang=1.0) - t).max() <= 0.3


# --- frame ------------------------------------------------------------------------------------------------
def at_rest(*storeys: Mapping[str, float], ground: float = 1.0) -> tuple[float, ...]:
    """Displacements under a ground acceleration (m/s2) that grows slowly and stays."""
    t = clock(3.0)
    damped = [{**s, "damping": 4000.0} for s in storeys]
    out = rig.run_frame(NOTHING, damped, (0, 1), ground * np.clip(t, 0, 1), 0 * t)
    return tuple(float(out[f"displacement{j}"][-1]) for j in (1, 2, 3))


def test_foundation_tilts() -> None:
    """Under one acceleration the storeys carry 3, 2, 1 floors; the tilt carries the sum of their forces."""
    rock = {"rock_mass": 30.0, "rock_k": 2e6, "rock_ratio": 5.0}
    tilt = -100 * (3 + 2 + 1) / 2e6
    plain, rocking = at_rest(PLAIN, PLAIN, PLAIN), at_rest({**PLAIN, **rock}, PLAIN, PLAIN)
    assert plain == pytest.approx(np.cumsum([-3, -2, -1]) * 100 / 4e5, rel=1e-3)
    assert np.subtract(rocking, plain) == pytest.approx(tilt * np.array([1, 2, 3]), rel=2e-3)


def test_brace_with_clearance() -> None:
    loose = {**PLAIN, "slack": 1e-4, "slack_share": 0.5}
    inside, outside = (at_rest(loose, PLAIN, PLAIN, ground=g)[0] for g in (0.05, 1.0))
    assert inside == pytest.approx(-15 / 2e5, rel=1e-3)
    assert outside == pytest.approx(-(300 + 0.5 * 4e5 * 1e-4) / 4e5, rel=1e-3)


def test_bolts_slip_in_their_holes_and_stay() -> None:
    """Strained by more than they hold they slip to the edges of their holes, and are there when the ground rests."""
    t = clock(6.0)
    ground = np.clip(t, 0, 1) - np.clip(t - 3, 0, 1)
    plain = -300 / 4e5
    for hold, gap in ((5e-4, 1e-4), (5e-4, 1e-3), (1e-3, 1e-4)):
        floors = [
            {**s, "damping": 4000.0} for s in ({**PLAIN, "bolt_hold": hold, "bolt_gap": gap}, PLAIN, PLAIN)
        ]
        slipped = gap if hold < abs(plain) else 0.0
        for side in (-1, 1):
            x = side * rig.run_frame(NOTHING, floors, (0, 1), side * ground, 0 * t)["displacement1"]
            assert x[[at(2.9), -1]] == pytest.approx([plain - slipped, -slipped], abs=2e-6)


def test_slab_that_bends_has_the_floor_s_mass() -> None:
    scale = frame_causes.FrameScale(
        SCALE, (1e-3,) * 3, (0.02,) * 3, (2.0,) * 3, (4e5,) * 3, (50.0,) * 3, (100.0,) * 3
    )
    sized = frame_causes.UNKNOWN["floppy_floor"][1](np.random.default_rng(0), scale, 2)(0.5)
    second = Truth(NOTHING, {}, False, [PLAIN] * 3).having(sized).storeys[1]
    assert second["mass"] + second["hung_mass"] == pytest.approx(100.0)
    assert 10 < second["hung_mass"] < 40


def test_panel_hits_its_edges() -> None:
    """Until it does the floor does not feel it; then momentum goes from the one to the other and none is made."""
    panel = {"hung_mass": 20.0, "hung_hz": 30.0, "hung_ratio": 0.2, "hung_gap": 2e-3, "hung_rub": 0.0}
    t = clock(1.5)
    ground = 3 * np.sin(2 * np.pi * 3 * t)
    free, hit = (
        rig.run_frame(NOTHING, [s, PLAIN, PLAIN], (0, 1), ground, 0 * t) for s in (PLAIN, {**PLAIN, **panel})
    )
    apart = np.abs(hit["acceleration1"] - free["acceleration1"])
    assert apart[: at(0.03)].max() < 1e-9
    assert 0.5 < apart.max() < 60
    push = 100 * sum(hit[f"acceleration{j}"] for j in (1, 2, 3))
    shear = 4e5 * hit["displacement1"] + 50 * np.gradient(hit["displacement1"], 1 / RATE_HZ)
    # What the frame's own forces do not account for moves the panel, which stays between its edges.
    panel_at = np.cumsum(np.cumsum(-(push + shear) / 20)) / RATE_HZ**2
    floor_at = hit["displacement1"] + np.cumsum(np.cumsum(ground[::2])) / RATE_HZ**2
    assert np.ptp(floor_at) > 1e-2
    assert 2e-3 < np.abs(panel_at - floor_at).max() < 4e-3


def test_ground_accelerometer_askew() -> None:
    """Far below the sway's frequency it reads cos + sin of the angle, at that frequency ten times the sine besides."""
    t = np.arange(4 * GRID_HZ + 1) / GRID_HZ
    truth = Truth({}, {"ground.angle": 0.1, "ground.hz": 10.0})
    slow, tuned = (
        bench.felt_ground(truth, Excitation("quake", np.sin(2 * np.pi * hz * t), t)) for hz in (0.5, 10)
    )
    slow, tuned = slow[len(slow) // 2 :], tuned[len(tuned) // 2 :]
    assert slow.max() == pytest.approx(np.cos(0.1) + np.sin(0.1), rel=5e-3)
    assert tuned.max() == pytest.approx(np.hypot(np.cos(0.1), 10 * np.sin(0.1)), rel=5e-3)
    assert np.array_equal(bench.felt_ground(Truth({}), Excitation("quake", t, t))[::25], t)


# --- all of them -----------------------------------------------------------------------------------------
DEVICE = dampers.draw(np.random.default_rng(1), mounted=True)
SCALE = Scale(500.0, 40.0, 0.005, 1.0, DEVICE.machine.command, DEVICE.piston(500.0))
FORMS = {f"{name} {k}": form for name, (_, forms) in causes.EFFECTS.items() for k, form in enumerate(forms)}
FORMS |= {name: form for name, (_, form) in unknown.DAMPER.items()}


def run_at(rate: int, numbers: Mapping[str, float], monkeypatch: pytest.MonkeyPatch) -> tuple[Array, Array]:
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


@pytest.mark.parametrize("name", [n for n in frame_causes.UNKNOWN if n not in unknown.DAMPER])
def test_frames_stay_whole(name: str) -> None:
    """The strongest of each kind leaves a frame's accelerations finite and of an earthquake's order."""
    acc = (1.7, 2.0, 2.3)
    scale = frame_causes.FrameScale(
        SCALE, (1e-3, 6e-4, 3e-4), (0.025, 0.016, 0.012), acc, (4e5,) * 3, (50.0,) * 3, (100.0,) * 3
    )
    sized = frame_causes.UNKNOWN[name][1](np.random.default_rng(2), scale, 2)(1.0)
    truth = Truth(DEVICE.numbers, {}, False, [PLAIN] * 3).having(sized)
    t = clock(2.0)
    out = rig.run_frame(truth.numbers, truth.storeys, (0, 1), 3 * np.sin(2 * np.pi * 3 * t), 0 * t)
    assert all(np.abs(out[f"acceleration{j}"]).max() < 80 for j in (1, 2, 3))
