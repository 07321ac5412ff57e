"""The two papers' printed dampers, integrated by SciPy from their equations, as truth for fits, norms and records."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from modules import TOOLS, loaded
from mrdamp.identify import identify
from mrdamp.identify.by_command import identify_by_command
from mrdamp.identify.comparison import judged_records, network_forces, paper_network, table_1
from mrdamp.identify.laws import PAPER_FOLLOWS
from mrdamp.identify.norms import CENTIMETRE, record_norms
from mrdamp.records import Record, embedded

Array = NDArray[np.float64]
VOLTAGES = (0.6, 1.2, 2.0)  # below the field's saturation
FOLLOWS = PAPER_FOLLOWS["hyperbolic_tangent"]


@pytest.fixture(scope="module")
def foam() -> ModuleType:
    return loaded(TOOLS / "make_foam.py")


def bouc_wen_force(frequency: float, amplitude: float, u: float) -> tuple[Array, Array]:
    """Eqs. (3), (4) and (7) of the foam-damper paper with its numbers: x in cm and F in N at 256 Hz, three cycles."""
    w = 2 * np.pi * frequency
    time = np.arange(round(3 * 256 / frequency)) / 256

    def rate(t: float, z: Array) -> Array:
        v, size = amplitude * w * np.cos(w * t), np.abs(z)
        return np.asarray(-84.0253 * abs(v) * z - 46.0 * v * size + 80.7337 * v)  # n = 1

    z = solve_ivp(rate, (0, time[-1]), [0.0], "RK45", time, rtol=1e-9, atol=1e-12, max_step=1e-3).y[0]
    c0, alpha = 0.0055 + 0.0055 * u, 1.8079 + 8.0802 * u
    return amplitude * np.sin(w * time), c0 * amplitude * w * np.cos(w * time) + alpha * z


def records_of(force: Callable[[float, float, float], tuple[Array, Array]]) -> list[Record]:
    """Two sines at each voltage in the package's units."""
    found = []
    for u in VOLTAGES:
        for hz, cm in ((1.0, 0.4), (3.0, 0.8)):
            x, f = force(hz, cm, u)
            channels = {"displacement_m": 0.01 * x, "command": np.full(len(x), u), "force_N": f}
            found.append(Record(f"{u}V_{hz}Hz", None, 1 / 256, channels))
    return found


@pytest.fixture(scope="module")
def tanh_records(foam: ModuleType) -> list[Record]:
    return records_of(lambda hz, cm, u: foam.simulate(hz, cm, u, friction=0.0))


@pytest.mark.parametrize("by_command", [False, True])
def test_eq_8_is_identified_with_the_papers_choice(tanh_records: list[Record], by_command: bool) -> None:
    """k0, k1, c1 and f0 as lines, c0, m0 and V_ref constant: every printed number comes back, in N, m and V."""
    if by_command:
        found = identify_by_command("hyperbolic_tangent", tanh_records, extras=(), follows=FOLLOWS, starts=1)
        assert [line.parameter for line in found.lines] == ["k0a", "k1a", "c1a", "f0a"]
        p = found.fit.model.parameters
    else:
        p = identify("hyperbolic_tangent", tanh_records, extras=(), follows=FOLLOWS, starts=1).model.parameters
        free = identify("hyperbolic_tangent", tanh_records, extras=(), starts=1)
        assert free.model.parameters["c0b"] != 0.0
    printed = {"k1a": -4744.74, "k1b": 14844.35, "c0a": 74.94, "c1b": 3.85, "f0a": -1.3704, "f0b": 4.9328}
    printed["v_ref"] = 0.0033
    assert {name: p[name] for name in printed} == pytest.approx(printed, rel=0.01)
    assert (p["k0a"], p["k0b"], p["m0"]) == pytest.approx((53.83, 1.93, 0.008), rel=0.06)
    assert p["c0b"] == 0.0


def test_eqs_3_4_and_7_are_identified() -> None:
    """beta, gamma and delta up to the scale of z, which alpha takes; alpha and c0 as lines through three voltages."""
    found = identify_by_command("bouc_wen", records_of(bouc_wen_force), extras=(), starts=1)
    p, end = found.fit.model.parameters, 80.7337 / (84.0253 + 46.0)  # cm, z where it ends
    assert p["n"] == pytest.approx(1.0, rel=0.01)
    assert p["A"] == pytest.approx((84.0253 + 46.0) * 100, rel=0.01)  # 1/m with z scaled to end at 1
    assert p["beta"] / (p["beta"] + p["gamma"]) == pytest.approx(46.0 / (84.0253 + 46.0), abs=0.01)
    assert (p["alpha_a"], p["alpha_b"]) == pytest.approx((1.8079 * end, 8.0802 * end), rel=0.01)
    assert (p["c0a"], p["c0b"]) == pytest.approx((0.55, 0.55), rel=0.1)


def test_e_v_of_a_triangle_is_its_jumps_of_velocity() -> None:
    """A constant error e: 1/T int |dv/dt| dt is the sum of the jumps, 16 A f^2; the low-pass rings a little there.

    An error at the corners alone has the same norm at any rate: the corner is as wide as the low-pass makes it.
    """
    f, a, e = 2.5, 0.005, 3.0
    found = []
    for rate in (500, 2000):
        t = np.arange(4 * rate + 1) / rate
        wave = np.sin(2 * np.pi * f * t)
        channels = {"displacement_m": a * 2 / np.pi * np.arcsin(wave), "command": 0 * t, "force_N": 50.0 * wave}
        record = Record("t", None, 1 / rate, channels)
        jumps = e * np.sqrt(16 * a / CENTIMETRE * f**2) / np.std(50.0 * wave)
        assert 1.0 < record_norms(record, 50.0 * wave + e, CENTIMETRE).e_v / jumps < 1.08
        found.append(record_norms(record, 50.0 * wave + e * np.abs(wave) ** 400, CENTIMETRE).e_v)
    assert found[0] == pytest.approx(found[1], rel=0.05)


def test_the_package_holds_what_the_generators_make(foam: ModuleType) -> None:
    """The foam damper's 35 tests over the paper's ranges; the self-sensing paper's sets at .5 A and five currents."""
    made, kept = foam.record(4.0, 0.8, 3.0, 334), embedded("foam")["sine_4.0Hz_8.0mm_3.0V"]
    for name in ("displacement_m", "force_N"):
        np.testing.assert_allclose(kept.channel(name), made.channel(name), rtol=1e-5, atol=1e-9)
    assert {float(r.command[0]) for r in embedded("foam")} == {0.6, 1.0, 2.0, 3.0, 4.0}
    sensing = embedded("self_sensing")
    half = {name: {r.name for r in part if "0.50A" in r.name} for name, part in vars(sensing).items() if name != "name"}
    assert half["train"] == {"sine_1.0Hz_1.0mm_0.50A", "sine_5.0Hz_5.0mm_0.50A"}
    assert half["validation"] == {"sine_1.0Hz_5.0mm_0.50A", "sine_5.0Hz_1.0mm_0.50A"}
    assert half["test"] == {f"sine_2.5Hz_{mm}mm_0.50A" for mm in ("1.0", "5.0")} | {
        f"triangle_{hz}Hz_5.0mm_0.50A" for hz in ("1.0", "2.5", "5.0")
    }
    assert len([r for r in sensing.train if r.name.startswith("sine_5.0Hz_5.0mm")]) == 5


@pytest.mark.slow
def test_table_1_of_the_condition() -> None:
    """One cycle at 4 Hz and 3 V that no model has seen: the network has at most half of the best law's errors."""
    records = embedded("foam").smoothed(80.0, force=True, zero_mean=True)
    condition = "sine_4.0Hz_8.0mm_3.0V"
    network = paper_network(records, initialisations=1).model
    others = network_forces(network, judged_records(records, condition))
    table = table_1(records, others=others, condition=condition, paper_follows=True, starts=1)
    rows = {r.model: r.norms for r in table.rows}
    for norm in ("e_t", "e_x", "e_v"):
        best = min(getattr(rows[law], norm) for law in ("bingham", "bouc_wen", "hyperbolic_tangent"))
        assert getattr(rows["bingham"], norm) > 2 * best
        for name in ("network", "network, one step ahead"):
            assert getattr(rows[name], norm) < 0.5 * best
