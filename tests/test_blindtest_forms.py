"""The reference rig's further forms and unknown causes: closed forms, work done, convergence of the step."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from mrdamp.blindtest import bench, causes, dampers, frame_causes, rig, unknown
from mrdamp.blindtest.bench import Truth
from mrdamp.blindtest.excitation import GRID_HZ, Excitation
from mrdamp.blindtest.rig import RATE_HZ, Array
from mrdamp.blindtest.scale import Form, Scale

DASHPOT = {"law": 0.0, "c0a": 1000.0, "v_ref": 1.0}
#: A yield force of 100 N per ampere.
YIELD = {"law": 0.0, "fyb": 100.0, "v_ref": 1e-3}
NOTHING = {"law": 0.0, "v_ref": 1.0}
PLAIN = {"mass": 100.0, "stiffness": 4e5, "damping": 50.0}


def clock(end: float, rate: int = RATE_HZ) -> Array:
    """Half steps."""
    return np.arange(round(end * 2 * rate) + 1) / (2 * rate)


def moved(numbers: Mapping[str, float], t: Array, x: Array, u: Array | float = 1.0) -> dict[str, Array]:
    """A rod on a path, with its velocity by differences."""
    return rig.run_damper(numbers, x, np.gradient(x, t), np.broadcast_to(u, t.shape))


def held(numbers: Mapping[str, float], t: Array, u: Array) -> dict[str, Array]:
    return rig.run_damper(numbers, 0 * t, 0 * t, u)


def steady(numbers: Mapping[str, float], speed: float, end: float = 0.2, u: float = 1.0) -> dict[str, Array]:
    t = clock(end)
    return rig.run_damper(numbers, speed * t, np.full(len(t), speed), np.full(len(t), u))


def at(seconds: float) -> int:
    return round(seconds * RATE_HZ)


# --- driver and magnetics ----------------------------------------------------------------------
def test_current_controller_overshoots() -> None:
    """exp(-pi z / sqrt(1 - z^2)) over the step; the area between command and current is the delay."""
    t = clock(1.0)
    lag = {"lag_form": 4.0, "lag_tau": 0.02, "lag_ratio": 0.5}
    current = held({**DASHPOT, **lag}, t, np.where(t > 0, 1.0, 0.0))["current"]
    assert current.max() - 1 == pytest.approx(np.exp(-np.pi * 0.5 / np.sqrt(0.75)), rel=1e-2)
    assert np.sum(1 - current[1:]) / RATE_HZ == pytest.approx(0.02, rel=1e-2)


def test_eddies_let_part_of_the_field_come_late() -> None:
    t = clock(0.2)
    lag = {"lag_form": 5.0, "lag_tau": 0.005, "lag_tau2": 0.04, "lag_ratio": 0.4}
    current = held({**DASHPOT, **lag}, t, np.where(t > 0, 1.0, 0.0))["current"]
    s = t[::2]
    assert np.abs(current - (1 - 0.6 * np.exp(-s / 0.005) - 0.4 * np.exp(-s / 0.04))).max() < 2e-3


def there_and_back(numbers: Mapping[str, float]) -> tuple[Array, Array]:
    """Current and field: up from 0 to 1 and down again, each in 1 s."""
    t = clock(2.0)
    out = held({**YIELD, **numbers}, t, 1 - np.abs(1 - t))
    return out["current"], out["field"]


def test_magnetisation_is_pinned() -> None:
    """Rising, m' = (i - m) / k with k falling from w to 0.4 w; after the turn it rests until the current meets it."""
    width, share = 0.2, 0.8
    i, b = there_and_back({"rem_form": 3.0, "rem_width": width, "rem_share": share, "rem_span": 1.0})
    magnet, step = 0.0, 1e-5
    for k in range(round(0.5 / step)):
        here = k * step
        magnet += step * (here - magnet) / (width * (1 - 0.6 * here))
    assert b[at(0.5)] == pytest.approx(0.5 - share * (0.5 - magnet), abs=2e-4)
    turned = b[at(1.0)] - b[at(1.02)]
    assert turned == pytest.approx((1 - share) * 0.02, rel=1e-2)  # the reversible part alone
    assert b[at(1.5)] - b[at(0.5)] > 0.5 * width * share
    assert i[at(1.5)] == pytest.approx(0.5)


def test_loop_widens_with_the_current() -> None:
    """On the way down a play of width w lags by w (1/2 + i); on the way up by w / 2."""
    w = 0.12
    _, b = there_and_back({"rem_form": 4.0, "rem_width": w, "rem_share": 1.0, "rem_span": 1.0})
    weights = np.exp(-0.2 * np.arange(6))
    mean = float(weights @ (w * np.arange(1, 7) / 6)) / float(weights.sum())
    assert b[at(0.5)] == pytest.approx(0.5 - 0.5 * mean, abs=1e-4)
    for level in (0.2, 0.6):
        assert b[at(2 - level)] == pytest.approx(level + (0.5 + level) * mean, abs=1e-3)


# --- fluid ---------------------------------------------------------------------------------------
def test_second_plateau_of_viscosity() -> None:
    numbers = {**DASHPOT, "thin_form": 3.0, "thin_v": 0.05, "thin_m": 0.2, "thin_rest": 0.1}
    assert steady(numbers, 0.002)["force"][-1] == pytest.approx(2.0, rel=1e-3)
    share = 0.1 + 0.9 * (1 + 4.0**4) ** (-0.8 / 4)
    assert steady(numbers, -0.2)["force"][-1] == pytest.approx(-200 * share)


def test_structure_takes_its_time() -> None:
    """From a speed v1 to v2 the structure goes from 1/(1 + v1/v_s) to 1/(1 + v2/v_s), the slower the slower v2 is."""
    numbers = {**DASHPOT, "thin_form": 4.0, "thin_v": 0.05, "thin_time": 0.04, "thin_rest": 0.1}
    t = clock(0.3)
    v = np.where(t < 0.2, 0.2, 0.05)
    out = rig.run_damper(numbers, np.cumsum(v) / (2 * RATE_HZ), v, np.ones(len(t)))["force"]
    assert out[at(0.19)] == pytest.approx(200 * (0.1 + 0.9 / 5), rel=1e-3)
    later = 0.5 + (0.2 - 0.5) * np.exp(-0.02 * 2 / 0.04)
    assert out[at(0.22)] == pytest.approx(50 * (0.1 + 0.9 * later), rel=2e-3)


def test_yield_and_viscosity_differ_each_by_its_share() -> None:
    shares = {"asym_form": 3.0, "asym_share": 0.2, "asym_visc": -0.1}
    assert steady({**DASHPOT, **shares}, 0.3)["force"][-1] == pytest.approx(270.0, rel=1e-3)
    assert steady({**YIELD, **shares}, 0.3)["force"][-1] == pytest.approx(120.0, rel=1e-3)
    assert steady({**YIELD, **shares}, -0.3)["force"][-1] == pytest.approx(-80.0, rel=1e-3)


def cycle(numbers: Mapping[str, float], hz: float = 1.0) -> tuple[Array, Array]:
    """Place (m) and force over the last of three cycles that begin with the stroke from 0 to 10 mm."""
    t = clock(3 / hz)
    x = 0.005 * (1 - np.cos(2 * np.pi * hz * t))
    last = slice(at(2 / hz), None)
    return x[::2][last], moved(numbers, t, x)["force"][last]


def on_the_way(numbers: Mapping[str, float], place: float, hz: float = 1.0) -> tuple[float, float]:
    """Force where the rod passes a place (m), out and back."""
    x, force = cycle(numbers, hz)
    half = len(x) // 2
    out = np.interp(place, x[:half], force[:half])
    return float(out), float(np.interp(place, x[half:][::-1], force[half:][::-1]))


def test_check_valve_opens_along_the_stroke() -> None:
    numbers = {**YIELD, "asym_form": 4.0, "asym_share": 0.2, "asym_width": 0.002}
    assert on_the_way(numbers, 0.001) == pytest.approx((100.0, -80.0), rel=0.02)  # half open out, open back
    assert on_the_way(numbers, 0.009) == pytest.approx((120.0, -100.0), rel=0.02)


def test_pocket_comes_back_in_its_own_time() -> None:
    """While the rod goes back for half a cycle the pressed length falls by exp(-t / tau)."""
    numbers = {**YIELD, "gas_form": 3.0, "gas_sign": 1.0, "gas_loss": 0.8, "gas_stroke": 0.004}
    for hz in (1.0, 4.0):
        pressed = np.exp(-0.5 / hz / 0.1) + 0.25  # 1 mm of 4 besides
        forces = on_the_way({**numbers, "gas_time": 0.1}, 0.001, hz)
        assert forces == pytest.approx((100 * (1 - 0.8 * (1 - pressed)), -100.0), rel=0.02)


def test_gas_in_the_chamber_limits_the_force() -> None:
    numbers = {**YIELD, "gas_form": 4.0, "gas_sign": -1.0, "gas_stroke": 0.004, "gas_force": 20.0}
    pressure = 20.0 * 0.5**-1.3
    expected = 100 / (1 + (100 / pressure) ** 4) ** 0.25
    assert on_the_way(numbers, 0.008)[1] == pytest.approx(-expected, rel=0.02)
    assert on_the_way(numbers, 0.002) == pytest.approx((100.0, -100.0), rel=0.02)


# --- mechanics and mount -----------------------------------------------------------------------------
def test_gas_is_adiabatic_when_fast_and_isothermal_when_slow() -> None:
    numbers = {**NOTHING, "spring_form": 3.0, "spring_f0": 50.0, "spring_length": 0.04, "spring_time": 0.3}
    assert steady(numbers, 5.0, end=0.004)["force"][-1] == pytest.approx(50 * 0.5**-1.4, rel=0.01)
    assert steady(numbers, 0.0025, end=8.0)["force"][-1] == pytest.approx(50 / 0.5, rel=0.03)


def test_spring_of_two_rates() -> None:
    numbers = {**NOTHING, "spring_form": 4.0, "spring_f0": 5.0, "spring_k": 1000.0, "spring_end": 2000.0}
    numbers |= {"spring_knee": 0.002, "spring_length": 2e-4}
    force = steady(numbers, 0.01, end=1.0)["force"]
    assert force[0] == pytest.approx(5.0)
    assert np.diff(force[[at(0.02), at(0.05)]])[0] == pytest.approx(1000 * 3e-4, rel=0.01)
    assert np.diff(force[[at(0.8), at(0.9)]])[0] == pytest.approx(3000 * 1e-3, rel=0.01)


def test_seal_is_elastic_before_it_slides() -> None:
    """Over small cycles a bristle with a breakaway gives all work back; slipping elements keep some."""
    t = clock(1.0)
    x = 8e-6 * np.sin(2 * np.pi * 5 * t)
    seal = {"seal_coulomb": 40.0, "seal_static": 1.3, "seal_v": 1.0, "seal_slide": 2e-5}
    force = {k: moved({**NOTHING, **seal, "seal_form": k}, t, x)["force"] for k in (4.0, 5.0)}
    assert np.abs(force[4.0] - 40 / 2e-5 * x[::2]).max() < 0.02
    last = slice(at(0.8), None)
    work = float(np.trapezoid(force[5.0][last], x[::2][last]))
    # Elements that slip at 1/6, 2/6 of 20 um, each with a sixth of 52 N.
    assert work == pytest.approx(sum(4 * 52 / 6 * (8e-6 - k * 2e-5 / 6) for k in (1, 2)), rel=0.01)


def shaken(hz: float, **numbers: float) -> Array:
    """A mass's share of the force under 1 mm of sine."""
    t = np.arange(2 * GRID_HZ + 1) / GRID_HZ
    test = Excitation("sine", 1e-3 * np.sin(2 * np.pi * hz * t), np.ones(len(t)))
    rod = {f"rod.{name}": value for name, value in numbers.items()}
    heavy, plain = (
        bench.damper_channels(Truth(DASHPOT, more), test, np.random.default_rng(0))["force_N"]
        for more in (rod, {})
    )
    return np.asarray(heavy - plain)[len(heavy) // 2 :]


def test_mass_in_a_bush_and_in_two_parts() -> None:
    hz, w, k, time = 20.0, 2 * np.pi * 20.0, (2 * np.pi * 40.0) ** 2, 0.004
    spring = k * (1 + 2.5 * 1j * w * time / (1 + 1j * w * time))
    rigid = float(np.abs(shaken(hz, mass=2.0)).max())
    bush = shaken(hz, mass=2.0, mass_hz=40.0, mass_loss=2.5, mass_time=time)
    assert np.abs(bush).max() / rigid == pytest.approx(abs(spring / (spring - w**2)), rel=0.01)
    parts = shaken(hz, mass=2.0, mass_hz=40.0, mass_rigid=0.4)
    shared = abs(0.4 + 0.6 * k / (k - w**2 + 0.1j * w * np.sqrt(k)))
    assert np.abs(parts).max() / rigid == pytest.approx(shared, rel=0.01)


def test_mount_of_two_rates_and_one_that_rubs() -> None:
    mount = {**DASHPOT, "mount_k": 1e5, "mount_c": 100.0, "mount_mass": 0.1}
    stop = steady({**mount, "mount_form": 5.0, "mount_scale": 1e-3, "mount_power": 3.0}, 0.2)
    # 100 N of 200 beyond the stop
    assert 0.04 - stop["piston"][-1] == pytest.approx(1e-3 + 100 / 3e5, rel=1e-2)
    rubs = steady({**mount, "mount_form": 6.0, "mount_scale": 1e-4, "mount_rub": 60.0}, 0.2)
    assert 0.04 - rubs["piston"][-1] == pytest.approx((200 - 60) / 1e5, rel=1e-2)


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
        SCALE, (1e-3, 6e-4, 3e-4), (0.025, 0.016, 0.012), acc, (4e5,) * 3, (50.0,) * 3
    )
    sized = frame_causes.UNKNOWN[name][1](np.random.default_rng(2), scale, 2)(1.0)
    truth = Truth(DEVICE.numbers, {}, False, [PLAIN] * 3).having(sized)
    t = clock(2.0)
    out = rig.run_frame(truth.numbers, truth.storeys, (0, 1), 3 * np.sin(2 * np.pi * 3 * t), 0 * t)
    assert all(np.abs(out[f"acceleration{j}"]).max() < 80 for j in (1, 2, 3))
