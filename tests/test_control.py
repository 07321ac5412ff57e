"""Controllers against the published table of Dyke et al. 1996 and against other solutions of LQG."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from mrdamp.control import Constant, Controller, ForceController, clipped_optimal, passive_off, passive_on
from mrdamp.control.clipped_optimal import OptimalForce, optimal_force
from mrdamp.control.force_control import clip
from mrdamp.control.lqg import first_order_hold, regulator_gain
from mrdamp.control.plant import outputs, plant
from mrdamp.errors import InputError
from mrdamp.simulation.criteria import evaluate
from mrdamp.structures import ShearFrame, dyke1996

Array = NDArray[np.float64]
RECORD = (
    Path(__file__).resolve().parents[2] / "shared" / "data" / "earthquakes" / "elcentro_1940_ns_iia001.csv"
)

# Dyke et al. 1996: peak floor displacements and drifts (cm), accelerations (cm/s2), force (N).
PUBLISHED = {
    "uncontrolled": [0.538, 0.820, 0.962, 0.538, 0.319, 0.201, 856, 1030, 1400],
    "passive-off": [0.211, 0.357, 0.455, 0.211, 0.153, 0.103, 420, 480, 717, 258],
    "passive-on": [0.076, 0.196, 0.306, 0.076, 0.158, 0.110, 281, 494, 767, 979],
    "clipped-optimal": [0.114, 0.185, 0.212, 0.114, 0.090, 0.101, 696, 739, 703, 941],
}
# Another program's run of the same equations (RK4 at 1e-4 s): base shear (N), energy into the
# damper (J), mean command (V). Not published.
OTHER = {
    "uncontrolled": (2793.0, 0.0, 0.0),
    "passive-off": (1191.5, 10.815, 0.0),
    "passive-on": (979.8, 7.626, 2.25),
    "clipped-optimal": (1242.4, 7.485, 0.686),
}


def frame_of(
    mass: list[float], stiffness: list[float], damping: list[float], floors: tuple[int, int]
) -> ShearFrame:
    return ShearFrame(np.array(mass), np.array(stiffness), np.array(damping), floors)


def simulate(ground: Array, dt: float, controller: Controller, damper: bool, h: float = 1.25e-4) -> Array:
    """Frame, Spencer's damper and driver by RK4; rows of x1..3, xa1..3, force, command, stroke."""
    m, (k1, k2, k3), (c1, c2, c3) = 98.3, (5.16e5, 6.84e5, 6.84e5), (125.0, 50.0, 50.0)
    n, every = round(10.0 / h), round(controller.period / h)
    half = np.interp(np.arange(2 * n + 1) * h / 2, np.arange(len(ground)) * dt, ground).tolist()

    def damper_force(s: tuple[float, ...]) -> tuple[float, float]:
        x1, v1, (y, z, u) = s[0], s[3], s[6:]
        c0, series = 2100 + 350 * u, 28300 + 295 * u
        rate = ((14000 + 69500 * u) * z + c0 * v1 + 4690 * (x1 - y)) / (c0 + series)
        return (series * rate + 500 * x1 if damper else 0.0), rate

    def floors(s: tuple[float, ...], force: float) -> tuple[float, float, float]:
        x1, x2, x3, v1, v2, v3 = s[:6]
        q1, q2, q3 = k1 * x1 + c1 * v1, k2 * (x2 - x1) + c2 * (v2 - v1), k3 * (x3 - x2) + c3 * (v3 - v2)
        return (q2 - q1 - force) / m, (q3 - q2) / m, -q3 / m

    def rate_of(s: tuple[float, ...], ground_now: float, command: float) -> tuple[float, ...]:
        force, rate = damper_force(s)
        z, w = s[7], s[3] - rate
        dz = -3.63e6 * abs(w) * z * abs(z) - 3.63e6 * w * z * z + 301 * w
        a1, a2, a3 = floors(s, force)
        return (*s[3:6], a1 - ground_now, a2 - ground_now, a3 - ground_now, rate, dz, 190 * (command - s[8]))

    def ahead(s: tuple[float, ...], step: float, rate: tuple[float, ...]) -> tuple[float, ...]:
        return tuple([a + step * b for a, b in zip(s, rate, strict=True)])

    state: tuple[float, ...] = (0.0,) * 9
    command, rows = 0.0, np.empty((n, 9))
    controller.reset()
    for i in range(n):
        force, _ = damper_force(state)
        acc = floors(state, force)
        if i % every == 0:
            y = {f"acceleration_{j + 1}": acc[j] for j in range(3)}
            command = controller.command(i * h, {**y, "displacement_1": state[0], "force": force})
        rows[i] = (*state[:3], *acc, force, command, state[0])
        r1 = rate_of(state, half[2 * i], command)
        r2 = rate_of(ahead(state, h / 2, r1), half[2 * i + 1], command)
        r3 = rate_of(ahead(state, h / 2, r2), half[2 * i + 1], command)
        r4 = rate_of(ahead(state, h, r3), half[2 * i + 2], command)
        state = tuple(
            [s + h / 6 * (a + 2 * b + 2 * c + d) for s, a, b, c, d in zip(state, r1, r2, r3, r4, strict=True)]
        )
    return rows


@pytest.fixture(scope="module")
def el_centro() -> Array:
    if not RECORD.exists():
        pytest.skip(f"needs {RECORD.name} in {RECORD.parent.name}/ of the shared data beside the repository")
    lines = [line for line in RECORD.read_text().splitlines() if line[:1] in "-0123456789"]
    return np.array(lines, dtype=np.float64)


@pytest.mark.parametrize(
    ("row", "controller"),
    [
        ("uncontrolled", passive_off()),
        ("passive-off", passive_off()),
        ("passive-on", passive_on(2.25)),
        ("clipped-optimal", clipped_optimal(dyke1996(), 2.25, period=1e-3)),
        ("clipped-optimal", clipped_optimal(dyke1996(), 2.25, period=5e-4)),
    ],
    ids=["uncontrolled", "off", "on", "clipped-1ms", "clipped-0.5ms"],
)
def test_published_table(row: str, controller: Controller, el_centro: Array) -> None:
    rows = simulate(el_centro, 0.02 / 5, controller, damper=row != "uncontrolled")
    frame = dyke1996()
    c = evaluate(
        frame,
        np.arange(len(rows)) * 1.25e-4,
        frame.drift(rows[:, :3]),
        rows[:, 3:6],
        force=rows[:, 6],
        stroke=rows[:, 8],
        command=rows[:, 7],
        command_max=2.25,
    )
    ours = [*100 * c.peak_displacement, *100 * c.peak_drift, *100 * c.peak_acceleration, c.peak_force]
    published = np.array(PUBLISHED[row])
    deviation = 100 * (np.array(ours[: len(published)]) / published - 1)
    report = f"{row} ({controller.name}, {controller.period * 1e3:g} ms): {np.round(ours, 4).tolist()}, "
    report += f"deviation {np.round(deviation, 1).tolist()} %, mean {np.abs(deviation).mean():.2f} %"
    print(report)
    assert np.abs(deviation).mean() <= 2.0, report
    # 6 % for the clipped row and for passive-on's first floor (0.0789 cm in every simulation seen).
    allowed = np.full(len(published), 6.0 if row == "clipped-optimal" else 2.0)
    if row == "passive-on":
        allowed[[0, 3]] = 6.0
    assert (np.abs(deviation) <= allowed).all(), report

    shear, energy, mean = OTHER[row]
    assert c.peak_base_shear == pytest.approx(shear, rel=0.015)
    assert c.dissipated_energy == pytest.approx(energy, rel=0.01)
    assert c.mean_command == pytest.approx(mean, rel=0.02)


def hand_made_plant() -> tuple[Array, Array, Array]:
    """a, b, c of Dyke's frame typed in: states x1..3, v1..3; outputs xa1..3, x1."""
    k = np.array([[12e5, -6.84e5, 0], [-6.84e5, 13.68e5, -6.84e5], [0, -6.84e5, 6.84e5]]) / 98.3
    d = np.array([[175.0, -50, 0], [-50, 100, -50], [0, -50, 50]]) / 98.3
    a = np.block([[np.zeros((3, 3)), np.eye(3)], [-k, -d]])
    b = np.array([0, 0, 0, -1 / 98.3, 0, 0])
    return a, b, np.vstack([a[3:], [1, 0, 0, 0, 0, 0]])


def test_plant_is_the_hand_made_one() -> None:
    a, b, c = hand_made_plant()
    linear = plant(dyke1996())
    rows, through = outputs(
        dyke1996(), ["acceleration_1", "acceleration_2", "acceleration_3", "displacement_1"]
    )
    np.testing.assert_allclose(linear.a, a, rtol=1e-12)
    np.testing.assert_allclose(linear.b, b, rtol=1e-12)
    np.testing.assert_array_equal(linear.e, [0, 0, 0, -1, -1, -1])
    np.testing.assert_allclose(rows, c, rtol=1e-12)
    np.testing.assert_allclose(through, [-1 / 98.3, 0, 0, 0], rtol=1e-12)


def test_stroke_and_drift_outputs() -> None:
    rows, through = outputs(
        dyke1996(damper_between=(1, 2)), ["stroke", "stroke_velocity", "drift_1", "drift_3"]
    )
    np.testing.assert_array_equal(rows[0], [-1, 1, 0, 0, 0, 0])
    np.testing.assert_array_equal(rows[1], [0, 0, 0, -1, 1, 0])
    np.testing.assert_array_equal(rows[2], [1, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(rows[3], [0, -1, 1, 0, 0, 0])
    assert not through.any()


def test_regulator_solves_its_riccati_equation() -> None:
    # The stable invariant subspace of the Hamiltonian matrix, by plain eigenvectors, with the force
    # in units of 1/sqrt(R) and time in units of the fast closed-loop pole.
    a, b, c = hand_made_plant()
    unit, q = 1e17**0.5, np.outer(c[2], c[2])
    bb = np.outer(b, b) * unit**2
    values, vectors = np.linalg.eig(np.block([[a, -bb], [-q, -a.T]]))
    stable = vectors[:, values.real < 0]
    p = np.real(stable[6:] @ np.linalg.inv(stable[:6]))
    residual = a.T @ p + p @ a - p @ bb @ p + q
    assert np.abs(residual).max() < 1e-4 * np.abs(q).max()
    k = optimal_force(dyke1996()).k
    np.testing.assert_allclose(k, b @ p * 1e17, rtol=2e-3)
    poles = np.linalg.eigvals(a - np.outer(b, k))
    assert poles.real.max() < 0
    found = np.sort_complex(poles)
    wanted = np.sort_complex(values[values.real < 0])
    np.testing.assert_allclose(found[:4], wanted[:4], rtol=1e-3)


def test_regulator_keeps_the_cross_terms() -> None:
    # Cost on an output that holds the force itself: with y = c s + d f and f = g + h s the cost
    # has no cross term, and the gain follows from the one without.
    a, b, c = hand_made_plant()
    q, r, d = 3.0, 2e-4, -1 / 98.3
    weight = r + q * d * d
    back = q * d * c[0] / weight
    plain = regulator_gain(
        a - np.outer(b, back),
        b,
        np.vstack([c[0], back]),
        np.zeros(2),
        np.array([q - (q * d) ** 2 / weight, 0.0]),
        weight,
    )
    both = regulator_gain(a, b, c[:1], np.array([d]), np.array([q]), r)
    np.testing.assert_allclose(both, plain + back, rtol=1e-6)
    assert np.linalg.norm(back) > 0.1 * np.linalg.norm(both)


def test_kalman_gain_is_the_steady_covariance() -> None:
    # The filter's covariance equation integrated in time until it stands still.
    a, _, c = hand_made_plant()
    e = np.array([0, 0, 0, 1.0, 1.0, 1.0])

    def rate(_: float, flat: Array) -> Array:
        p = flat.reshape(6, 6)
        return np.asarray((a @ p + p @ a.T - p @ c.T @ c @ p + 50 * np.outer(e, e)).ravel())

    run = solve_ivp(rate, (0, 1.5), np.zeros(36), method="LSODA", rtol=1e-9, atol=1e-14)
    gain = run.y[:, -1].reshape(6, 6) @ c.T
    found = optimal_force(dyke1996()).estimator.gain
    np.testing.assert_allclose(found, gain, rtol=1e-4, atol=1e-7 * np.abs(gain).max())
    assert np.linalg.eigvals(a - found @ c).real.max() < -10


@pytest.mark.parametrize("floors", [(0, 1), (1, 2), (3, 1)])
def test_filter_finds_the_state_of_a_frame_under_a_known_force(floors: tuple[int, int]) -> None:
    # No ground motion: with the force's sign or feedthrough wrong the estimate would not settle.
    frame = frame_of([80.0, 100.0, 120.0], [5e5, 6e5, 4e5], [90.0, 60.0, 30.0], floors)
    aim = optimal_force(frame, period=5e-4)
    inverse, gamma = np.linalg.inv(frame.mass_matrix), np.zeros(4)
    gamma[floors[1]], gamma[floors[0]] = -1, 1

    def acceleration(s: Array, t: float) -> Array:
        force = gamma[1:] * 200 * np.sin(40 * t)
        return np.asarray(inverse @ (force - frame.stiffness_matrix @ s[:3] - frame.damping_matrix @ s[3:]))

    times = np.arange(1001) * 5e-4
    run = solve_ivp(
        lambda t, s: np.concatenate([s[3:], acceleration(s, t)]),
        (0, 0.5),
        [2e-3, -1e-3, 3e-3, 0, 0, 0],
        t_eval=times,
        rtol=1e-9,
        atol=1e-12,
        method="DOP853",
    )
    for t, s in zip(times, run.y.T, strict=True):
        y = {f"acceleration_{i + 1}": float(a) for i, a in enumerate(acceleration(s, t))}
        wanted = aim(float(t), {**y, "displacement_1": float(s[0]), "force": 200 * float(np.sin(40 * t))})
    scale = np.abs(run.y[:, -200:]).max(axis=1)
    assert (np.abs(aim.estimator.estimate - run.y[:, -1]) < 0.01 * scale).all()
    assert wanted == pytest.approx(-float(aim.k @ run.y[:, -1]), rel=0.1)


def test_first_order_hold_is_exact_for_a_ramp() -> None:
    a, b = np.array([[0.0, 1.0], [-900.0, -3.0]]), np.array([[0.0, 2.0], [1.0, -4.0]])
    u0, u1, s0, h = np.array([3.0, -1.0]), np.array([-2.0, 5.0]), np.array([0.4, -0.7]), 0.02
    phi, g0, g1 = first_order_hold(a, b, h)
    run = solve_ivp(lambda t, s: a @ s + b @ (u0 + (u1 - u0) * t / h), (0, h), s0, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(phi @ s0 + g0 @ u0 + g1 @ u1, run.y[:, -1], rtol=1e-8)


@pytest.mark.parametrize(
    ("wanted", "force", "on"),
    [
        (900.0, 300.0, True),  # more of the same sign is wanted
        (300.0, 900.0, False),  # less is wanted
        (-900.0, -300.0, True),
        (-300.0, -900.0, False),
        (-900.0, 300.0, False),  # the other sign is wanted: a damper cannot push
        (900.0, -300.0, False),
        (900.0, 0.0, False),
        (300.0, 300.0, False),
    ],
)
def test_clipping_law(wanted: float, force: float, on: bool) -> None:
    assert clip(wanted, force, 2.25) == (2.25 if on else 0.0)


def test_controllers_start_over_after_reset() -> None:
    controller = clipped_optimal(dyke1996(), 2.25)
    y = {
        "acceleration_1": 1.0,
        "acceleration_2": -2.0,
        "acceleration_3": 0.5,
        "displacement_1": 1e-3,
        "force": 80.0,
    }
    first = [(controller.command(i * 1e-3, y), controller.wanted) for i in range(5)]
    assert first[-1][1] != 0
    controller.reset()
    assert [(controller.command(i * 1e-3, y), controller.wanted) for i in range(5)] == first


def test_every_controller_keeps_the_protocol() -> None:
    built = (
        passive_off(),
        passive_on(2.25),
        Constant(0.75, "constant 0.75 V"),
        clipped_optimal(dyke1996(), 2.25),
    )
    for controller in built:
        assert isinstance(controller, Controller)
        assert controller.period == 1e-3
    assert [c.command(0.0, {}) for c in built[:3]] == [0.0, 2.25, 0.75]
    assert len({c.name for c in built}) == 4


def test_defaults_follow_the_frame() -> None:
    frame = frame_of([10.0, 10.0], [1e4, 1e4], [5.0, 5.0], (1, 2))
    controller = clipped_optimal(frame, 1.0, r=1e-8)
    assert isinstance(controller, ForceController)
    assert isinstance(controller.aim, OptimalForce)
    assert controller.aim.estimator.measurements == ("acceleration_1", "acceleration_2", "displacement_1")
    # Less weight on the force: a larger wanted force.
    cheap, dear = (optimal_force(dyke1996(), regulate={"drift_1": 1.0}, r=r).k for r in (1e-14, 1e-10))
    assert np.linalg.norm(cheap) > 10 * np.linalg.norm(dear)


def test_a_design_without_a_solution_gets_one_line() -> None:
    # A damper between floors 1 and 2 that holds floor 2's acceleration at nothing lets it wander.
    frame = frame_of([10.0, 10.0], [1e4, 1e4], [5.0, 5.0], (1, 2))
    with pytest.raises(InputError, match="no stable regulator found for r = 1e-17; raise r"):
        clipped_optimal(frame, 1.0)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"command_max": 0.0}, "command_max is 0.0; allowed: a finite number > 0"),
        ({"r": -1.0}, "r is -1.0"),
        ({"noise_ratio": float("nan")}, "noise_ratio is nan"),
        ({"period": float("inf")}, "period is inf"),
        (
            {"regulate": {"acceleration_4": 1.0}},
            "measurement 'acceleration_4' is unknown; allowed: acceleration_i",
        ),
        ({"regulate": {"drift_1": 0.0}}, "regulate is {'drift_1': 0.0}"),
        ({"measurements": ["speed"]}, "measurement 'speed' is unknown"),
        ({"measurements": []}, "measurements is empty"),
    ],
)
def test_bad_designs_get_one_line(change: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError) as error:
        clipped_optimal(dyke1996(), **{"command_max": 2.25, **change})
    assert says in str(error.value)


def test_bad_constants_get_one_line() -> None:
    with pytest.raises(InputError, match="value is nan; allowed: a finite number"):
        Constant(float("nan"))
    with pytest.raises(InputError, match="period is 0; allowed: > 0 s"):
        Constant(1.0, period=0)
