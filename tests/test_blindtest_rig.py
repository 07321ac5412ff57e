"""The reference rig: laws against SciPy, a table of steady forces, the frame against a linear system, its bench."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from scipy.linalg import expm

from dampers import rms
from excitation import Motion, constant, sine
from rig_paths import DASHPOT, NOTHING, PLAIN, YIELD, clock, sensed, steady
from studies.blindtest import bench, dampers, rig
from studies.blindtest.bench import Truth
from studies.blindtest.excitation import GRID_HZ, Excitation
from studies.blindtest.rig import RATE_HZ, Array
from twins import simulate

Numbers = Mapping[str, float]


def along(numbers: Numbers, motion: Motion, u: float, end: float) -> dict[str, Array]:
    t = clock(end)
    x, v, _ = motion.sample(t)
    return rig.run_damper(numbers, x, v, np.full(len(t), u))


@pytest.mark.parametrize("seed", [0, 1, 4, 5, 13])
def test_law_is_that_of_scipy(seed: int) -> None:
    device = dampers.draw(np.random.default_rng(seed))
    level = 0.6 * device.machine.command
    motion, end = sine(0.008, 1.7, phase=0.4), 0.9
    t = np.arange(0.0, end, 0.002)
    twin = simulate(device.law, device.parameters, motion, t, constant(level))["force"]
    force = along(device.numbers, motion, level, end)["force"][::50][: len(t)]
    assert rms((force - twin)[5:]) < 2e-3 * rms(twin), device.law


CROSS = {**DASHPOT, "thin_form": 1.0, "thin_v": 0.1, "thin_m": 1.0}
EYRING = {**DASHPOT, "thin_form": 2.0, "thin_v": 0.05}
CARREAU = {**DASHPOT, "thin_form": 3.0, "thin_v": 0.05, "thin_m": 0.2, "thin_rest": 0.1}
QUEMADA = {**DASHPOT, "thin_form": 4.0, "thin_v": 0.4, "thin_rest": 0.09}
SIDED = {**DASHPOT, "asym_share": 0.2, "asym_width": 1e-2, "asym_v": 0.1}
GAS = {**NOTHING, "spring_f0": 50.0, "spring_length": 0.04, "spring_other": 0.6}
SPRING = {**NOTHING, "spring_f0": 5.0, "spring_k": 1000.0, "spring_length": 0.01, "spring_power": 3.0}
SEAL = {
    **NOTHING,
    "seal_coulomb": 40.0,
    "seal_static": 1.5,
    "seal_v": 0.004,
    "seal_slide": 4e-5,
    "seal_time": 0.01,
}
STEADY: dict[str, tuple[Numbers, float, float]] = {  # numbers, speed (m/s) over 0.2 s, force (N) at the end by hand
    "Cross": (CROSS, 0.1, 50.0),
    "Eyring": (EYRING, -0.2, -50 * np.arcsinh(4.0)),
    "Eyring, slow": (EYRING, 1e-4, 0.1),
    "Carreau, slow": (CARREAU, 0.002, 2.0),
    "Carreau": (CARREAU, -0.2, -200 * (0.1 + 0.9 * (1 + 4.0**4) ** (-0.8 / 4))),
    "Quemada": (QUEMADA, 0.1, 100 * (0.3 * 1.5 / 0.8) ** 2),
    "Quemada, back": (QUEMADA, -0.4, -400 * (0.6 / 1.3) ** 2),
    "asymmetry 1": ({**SIDED, "asym_form": 1.0}, 0.3, 360.0),
    "asymmetry 1, back": ({**SIDED, "asym_form": 1.0}, -0.3, -240.0),
    "asymmetry 2": ({**SIDED, "asym_form": 2.0}, 0.3, 360.0),
    "asymmetry 2, back": ({**SIDED, "asym_form": 2.0}, -0.3, -240.0),
    "asymmetry with the speed": ({**SIDED, "asym_form": 3.0}, 0.3, 300 * (1 + 0.2 * 0.8125)),
    "asymmetry with the speed, back": ({**SIDED, "asym_form": 3.0}, -0.1, -100 * (1 - 0.2 * 0.625)),
    "polytropic gas": ({**GAS, "spring_form": 1.0}, 0.1, 50 * 0.5**-1.3),
    "gas on both sides": ({**GAS, "spring_form": 3.0}, 0.1, 50 * (0.5**-1.2 - 0.6 * 1.5**-1.2)),
    "gas on both sides, back": ({**GAS, "spring_form": 3.0}, -0.1, 50 * (1.5**-1.2 - 0.6 * 0.5**-1.2)),
    "power": ({**SPRING, "spring_form": 2.0, "spring_end": 30.0}, -0.1, 5 - 20 - 30 * 2.0**3),
    "progressive": ({**SPRING, "spring_form": 4.0, "spring_end": 20.0}, 0.1, 25 + 20 * (np.exp(2) - 3)),
    **{f"seal {form}": ({**SEAL, "seal_form": form}, -0.1, -40.0) for form in range(1, 6)},
    **{f"seal {form}, slow": ({**SEAL, "seal_form": form}, 4e-4, 60.0) for form in (1, 4, 5)},
    "Dahl has no peak": ({**SEAL, "seal_form": 2.0}, 4e-4, 40.0),
    # an arc tangent over a tenth of seal_v: 0.795 of its limit, which is 58.3 N there
    "arc tangent, slow": ({**SEAL, "seal_form": 3.0}, 1.2e-3, 58.3 * 0.795),
}


@pytest.mark.parametrize("name", STEADY)
def test_force_at_a_steady_speed(name: str) -> None:
    numbers, speed, expected = STEADY[name]
    slow = "seal_form" in numbers and abs(speed) < 0.01
    force = steady(numbers, speed, end=0.5 if slow else 0.2)["force"][-1]
    assert force == pytest.approx(expected, rel=0.05 if slow else 5e-3)


@pytest.mark.parametrize(("form", "at_level"), [(1, 0.5), (2, 0.7899), (3, 0.6392)])
def test_saturation_starts_with_slope_one_and_bends(form: int, at_level: float) -> None:
    """At i = level the field is 1/2 (Froehlich), erf(sqrt(pi)/2), or 2/pi atan(pi/2) of the level."""

    def field(i: float) -> float:
        return float(steady({**YIELD, "sat_form": form, "sat_level": 0.8}, 0.1, u=i)["field"][-1])

    assert [field(1e-4), field(0.8), -field(-0.8)] == pytest.approx(
        [1e-4, 0.8 * at_level, 0.8 * at_level], rel=1e-3
    )


MOUNT = {**DASHPOT, "mount_k": 1e5, "mount_c": 100.0, "mount_mass": 0.1}
PLAY = {**MOUNT, "mount_gap": 1e-3}


@pytest.mark.parametrize(
    ("numbers", "given"),
    [
        ({**MOUNT, "mount_form": 1.0}, 200 / 1e5),
        ({**MOUNT, "mount_form": 2.0, "mount_scale": 1e-3, "mount_power": 1.7}, 1e-3),  # k d (1 + 1) = F
        ({**PLAY, "mount_form": 3.0, "mount_k": 1e7}, 5e-4 + 2e-5),
        ({**PLAY, "mount_form": 4.0, "mount_k": 200 / 1.5e-5**1.5, "mount_c": 0.5}, 5e-4 + 1.5e-5),
        # 100 N of 200 beyond the stop
        ({**MOUNT, "mount_form": 5.0, "mount_scale": 1e-3, "mount_power": 3.0}, 1e-3 + 100 / 3e5),
        # the second spring has let go, or has not: 3 times as stiff
        ({**MOUNT, "mount_form": 6.0, "mount_loss": 2.0, "mount_c": 1.0, "mount_time": 0.02}, 200 / 1e5),
        ({**MOUNT, "mount_form": 6.0, "mount_loss": 2.0, "mount_c": 1.0, "mount_time": 1e3}, 200 / 3e5),
    ],
)
def test_mount_gives_way_by_force_over_stiffness(numbers: Numbers, given: float) -> None:
    out = steady(numbers, 0.2, end=0.4)
    assert out["force"][-1] == pytest.approx(200.0, rel=5e-3)
    assert 0.08 - out["piston"][-1] == pytest.approx(given, rel=0.02)
    if "mount_gap" in numbers:
        assert out["force"][: int(0.002 * RATE_HZ)] == pytest.approx(0.0)  # 0.4 mm of 0.5


def test_heat_is_the_work_done_and_thins_the_oil() -> None:
    """Nothing lost: the heat in fluid and body is the work; the fluid is warmer by what flows through the link."""
    heat = {"heat_form": 1.0, "heat_capacity": 10.0, "heat_body": 40.0, "heat_link": 20.0}
    rise = steady({**DASHPOT, **heat}, 0.2, end=4.0)["heat"]
    lag = 1 / (20.0 * (1 / 10.0 + 1 / 40.0))  # s
    over = 40.0 / 10.0 * lag * (1 - np.exp(-4.0 / lag))
    assert rise[-1] == pytest.approx(40.0 * 4.0 / 50.0 + over * 0.8, rel=0.01)
    base = {**DASHPOT, "heat_capacity": 5.0}
    warm = steady({**base, "heat_form": 2.0, "heat_visc": 0.02}, 0.2, end=3.0)
    assert warm["force"][-1] == pytest.approx(200.0 / (1 + 0.02 * warm["heat"][-1]))
    oil = steady({**base, "heat_form": 1.0, "heat_visc": 3000.0, "heat_body": 1e9}, 0.2, end=3.0)
    kelvin = oil["heat"][-1]
    assert kelvin > 10
    assert oil["force"][-1] == pytest.approx(200.0 * np.exp(3000 * (1 / (293 + kelvin) - 1 / 293)))


def test_gain_and_offset_and_charge_that_leaks_away() -> None:
    """Once, or through two high-passes: (e^(-t/a) / a - e^(-t/b) / b) / (1/a - 1/b)."""
    assert sensed(np.full(9, 100.0), gain=-0.2, offset=7.0) == pytest.approx(87.0)
    warming = sensed(np.full(2 * RATE_HZ + 1, 100.0), gain=0.3, offset=7.0, settle=0.2, settle_time=2.0)
    assert warming[[0, -1]] == pytest.approx([100 + 0.8 * 37, 100 + (1 - 0.2 * np.exp(-1)) * 37])
    step = np.where(np.arange(RATE_HZ) > 0, 100.0, 0.0)
    once, twice = (
        sensed(step, leakage=f, leakage_again=g)[RATE_HZ // 2] for f, g in ((0.5, 0.0), (0.2, 4.0))
    )
    assert once == pytest.approx(100 * np.exp(-1), rel=1e-3)
    a, b = 5.0, 1 / 0.8
    assert twice == pytest.approx(100 * (a * np.exp(-a * 0.5) - b * np.exp(-b * 0.5)) / (a - b), rel=1e-3)


@pytest.mark.parametrize("form", [1, 2, 3])
def test_sensor_is_late_by_its_lag(form: int) -> None:
    t = np.arange(RATE_HZ) / RATE_HZ
    late = sensed(1000.0 * t, lag=0.01, lag_form=form)
    assert late[-1] == pytest.approx(1000.0 * (t[-1] - 0.01), rel=2e-3)


def shaken(hz: float, size: float, **numbers: float) -> Array:
    t = np.arange(2 * GRID_HZ + 1) / GRID_HZ
    test = Excitation("sine", size * np.sin(2 * np.pi * hz * t), np.ones(len(t)))
    heavy, plain = (
        bench.damper_channels(Truth(DASHPOT, more), test, np.random.default_rng(0))["force_N"]
        for more in ({f"rod.{name}": value for name, value in numbers.items()}, {})
    )
    return np.asarray(heavy - plain)


def test_mass_between_damper_and_load_cell() -> None:
    own = shaken(3.0, 0.005, mass=2.0)
    w = 2 * np.pi * 3
    t = np.arange(len(own)) / bench.SAMPLE_RATE_HZ
    assert own == pytest.approx(-2.0 * 0.005 * w**2 * np.sin(w * t), abs=1e-3)
    w = 2 * np.pi * 20.0

    def sprung(hz: float) -> complex:
        k = (2 * np.pi * hz) ** 2
        return complex(k / (k - w**2 + 0.1j * w * np.sqrt(k)))

    rigid, viscous, clamps = (
        np.abs(shaken(20.0, 1e-3, mass=2.0, **more)[len(own) // 2 :]).max()
        for more in ({}, {"mass_time": 0.006}, {"mass_hz": 40.0, "mass_hz2": 80.0, "mass_share2": 0.4})
    )
    assert viscous / rigid == pytest.approx(1 / np.hypot(1, 0.006 * w), rel=0.01)
    assert clamps / rigid == pytest.approx(abs(0.6 * sprung(40) + 0.4 * sprung(80)), rel=0.01)


@pytest.mark.parametrize(
    ("numbers", "late", "share"),
    [
        ({"reading.shift": -0.006}, -0.006, 1.0),
        ({"reading.average": 0.01}, 0.01, np.sin(np.pi * 0.2) / (np.pi * 0.2)),  # 20 ms of 100
    ],
)
def test_displacement_is_read_late_or_early(numbers: dict[str, float], late: float, share: float) -> None:
    t = np.arange(2 * GRID_HZ + 1) / GRID_HZ
    test = Excitation("sine", 0.005 * np.sin(2 * np.pi * 10 * t), np.full(len(t), 1.0))
    read = bench.as_read(Truth(DASHPOT, numbers), test)
    expected = share * 0.005 * np.sin(2 * np.pi * 10 * (test.time - late))
    middle = slice(len(read) // 4, -len(read) // 4)
    assert rms((read - expected)[middle]) < 0.02 * 0.005


def test_frame_without_damper_is_a_linear_system() -> None:
    """Free of damper force the frame follows x' = A x + b a_g, stepped exactly for a constant ground acceleration."""
    storeys = [
        {"mass": 98.0, "stiffness": 5.2e5, "damping": 120.0},
        {"mass": 99.0, "stiffness": 6.8e5, "damping": 60.0},
        {"mass": 97.0, "stiffness": 7.0e5, "damping": 50.0},
    ]
    m, k, c = (np.array([s[name] for s in storeys]) for name in ("mass", "stiffness", "damping"))
    drift = np.eye(3) - np.eye(3, k=-1)
    stiff, damp = (drift.T @ np.diag(values) @ drift / m[:, None] for values in (k, c))
    a = np.block([[np.zeros((3, 3)), np.eye(3)], [-stiff, -damp]])
    t = clock(1.0)
    out = rig.run_frame(NOTHING, storeys, (0, 1), np.full(len(t), 2.0), 0 * t)
    force = np.concatenate([np.zeros(3), -np.full(3, 2.0)])
    for sample in (RATE_HZ // 7, RATE_HZ // 2, RATE_HZ):
        grown = expm(a * sample / RATE_HZ)
        state = np.linalg.solve(a, (grown - np.eye(6)) @ force)
        found = [out[f"displacement{j}"][sample] for j in (1, 2, 3)]
        assert found == pytest.approx(state[:3], rel=1e-6)
        absolute = (a @ state)[3:]
        assert [out[f"acceleration{j}"][sample] for j in (1, 2, 3)] == pytest.approx(absolute, rel=1e-5)


def test_damper_pulls_both_of_its_floors() -> None:
    """Between floors 1 and 2 the damper's force is internal: momentum changes by the ground's share alone."""
    t = clock(1.0)
    ground = 2 * np.sin(2 * np.pi * 4 * t)
    out = rig.run_frame({**DASHPOT, "c0a": 3000.0}, [PLAIN] * 3, (1, 2), ground, 0 * t)
    force = 100.0 * (out["acceleration1"] + out["acceleration2"] + out["acceleration3"])
    first, speed = out["displacement1"], np.gradient(out["displacement1"], 1 / RATE_HZ)
    assert rms((force + 4e5 * first + 50.0 * speed)[5:-5]) < 1e-3 * rms(force)
    stroke = out["displacement2"] - first
    assert rms((out["force"] - 3000 * np.gradient(stroke, 1 / RATE_HZ))[5:-5]) < 1e-3 * rms(out["force"])


@pytest.mark.parametrize("form", [1, 2, 3, 4])
def test_dry_friction_of_a_storey_takes_its_work(form: int) -> None:
    """Free vibration loses energy by friction force times path."""
    free = {**PLAIN, "damping": 0.0}
    joint = {"friction_travel": 2e-5, "friction_static": 1.0, "friction_v": 1e-3}
    t = clock(2.0)
    out = rig.run_frame(
        NOTHING,
        [{**free, "friction_form": form, "friction": 60.0, **joint}, free, free],
        (0, 1),
        np.where(t < 0.02, 20.0, 0.0),
        0 * t,
    )
    x = np.stack([out[f"displacement{j}"] for j in (1, 2, 3)])
    drift, speed = np.diff(x, axis=0, prepend=0.0), np.gradient(x, 1 / RATE_HZ, axis=1)
    total = 0.5 * 4e5 * (drift**2).sum(axis=0) + 50.0 * (speed**2).sum(axis=0)
    begin, end = round(0.05 * RATE_HZ), round(0.6 * RATE_HZ)
    path = np.abs(np.diff(x[0, begin:end])).sum()
    assert total[begin] - total[end] == pytest.approx(60.0 * path, rel=0.1)
