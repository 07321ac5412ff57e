"""Controllers of the quarter car against their papers' rules and independent solutions, and a comparison."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_are, solve_discrete_are

from excitation import Array
from mrdamp import cli
from mrdamp.compare.car import CarBench
from mrdamp.compare.plant_run import run_plant
from mrdamp.control.car import HookForce, Switching, add_switch, sh_add_switch, skyhook_switch
from mrdamp.control.car_plant import car_plant, regulated
from mrdamp.control.registry import make
from mrdamp.errors import InputError
from mrdamp.simulation.roads import iso8608

BENCH = CarBench(engine="chain", timestep=1e-3)
SITE = BENCH.site
ROAD = replace(iso8608("C", 20.0, 4.0, 11), name="road")


def test_sh_add_is_the_papers_rule() -> None:
    """Savaresi and Spelta 2007: c_max where (a^2 - alpha^2 v^2 <= 0 and v r > 0) or (a^2 - alpha^2 v^2 > 0 and a r >
    0)."""
    alpha, switch = 7.0, sh_add_switch(7.0)
    rng = np.random.default_rng(1)
    for v, r, a in rng.normal(size=(200, 3)) * [0.2, 0.3, 1.0]:
        low = a * a - alpha**2 * v * v <= 0
        assert switch(0.0, v, r, a) == bool((low and v * r > 0) or (not low and a * r > 0))


def test_the_field_is_on_where_the_force_on_the_body_helps() -> None:
    """A damper that is being extended pulls the body down: on where that brakes it, or takes from its acceleration."""
    rng = np.random.default_rng(2)
    for wheel, body, acceleration in rng.normal(size=(100, 3)) * [1.0, 0.2, 1.0]:
        stroke = body - wheel
        on_body = -100.0 * np.sign(stroke)
        assert skyhook_switch(wheel, body, stroke, acceleration) == (on_body * body < 0)
        assert add_switch(wheel, body, stroke, acceleration) == (on_body * acceleration < 0)


def test_velocities_and_forces_of_a_sine() -> None:
    """With accelerations of wheel and body in quadrature; the integrator's leak is slow."""
    aim, w = HookForce(900.0, 0.25, 50.0, SITE.period), 2 * math.pi * 3.0
    for k in range(2000):
        t = k * SITE.period
        found = aim(t, {"acceleration_1": 4 * w * math.cos(w * t), "acceleration_2": -w * math.sin(w * t)})
    # The start's offset of the body's velocity has leaked away by exp(-t / 50 s).
    body = math.cos(w * t) - math.exp(-t / 50.0)
    assert found == pytest.approx(900.0 * (0.25 * body - 0.75 * 4 * math.sin(w * t)), abs=15.0)


def cost(holding: float, stroke: float, r: float) -> tuple[Array, Array, Array, Array, Array]:
    """a, b, and the weights of states, of states with the force and of the force, written out."""
    a = np.array(
        [[0, 0, 1, 0], [0, 0, -1, 1], [-210e3 / 40, 20e3 / 40, -120 / 40, 0], [0, -20e3 / 400, 0, 0]],
        dtype=float,
    )
    b = np.array([[0.0], [0.0], [1 / 40], [-1 / 400]])
    c = np.vstack([a[3], [1.0, 0, 0, 0], [0, 1.0, 0, 0]])
    d = np.array([b[3, 0], 0.0, 0.0])
    q = np.diag([1.0, holding * (210e3 / 400) ** 2, stroke * (20e3 / 400) ** 2])
    return a, b, c.T @ q @ c, (c.T @ q @ d)[:, None], np.array([[d @ q @ d + r / 400**2]])


def test_the_lq_force_is_that_of_riccatis_equation() -> None:
    a, b, q, s, r = cost(0.3, 0.03, 1e-3)
    p = solve_continuous_are(a, b, q, r, s=s)
    gain = np.linalg.solve(r, b.T @ p + s.T)[0]
    aim: Any = make("lq-tracking:holding=0.3,stroke=0.03,r=1e-3,roughness=1e-3", SITE)
    np.testing.assert_allclose(aim.aim.k, gain, rtol=1e-6)
    np.testing.assert_allclose(car_plant(SITE.car).a, a)
    assert regulated(SITE.car, 0.0, 0.0)["acceleration_2"] == 1.0


def test_mpc_is_the_discrete_regulator_where_nothing_binds(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("osqp", reason="needs the extra mpc")
    from mrdamp.control.car_mpc import MpcForce

    a, b, q, s, r = cost(0.3, 0.03, 1e-3)
    both = np.zeros((5, 5))
    both[:4, :4], both[:4, 4:] = a, b
    moved = expm(both * SITE.period)
    a, b = moved[:4, :4], moved[:4, 4:]
    p = solve_discrete_are(a, b, q, r, s=s)
    gain = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a + s.T)[0]
    aim = MpcForce(SITE, {"holding": 0.3, "stroke": 0.03, "r": 1e-3, "roughness": 1e-3, "horizon": 0.1})
    state = np.array([-1e-3, 4e-3, 0.05, 0.03])
    monkeypatch.setattr(aim, "_estimator", lambda y: state)
    wanted = -float(gain @ state)
    assert abs(wanted) > 20
    found = aim(0.0, {"stroke_velocity": math.copysign(0.1, wanted)})
    assert found == pytest.approx(wanted, rel=0.01)
    assert aim(0.0, {"stroke_velocity": -math.copysign(0.1, wanted)}) == pytest.approx(0.0, abs=1e-6)
    monkeypatch.setattr(aim, "_estimator", lambda y: 1e3 * state)
    assert abs(aim(0.0, {"stroke_velocity": math.copysign(0.1, wanted)})) == pytest.approx(
        SITE.force_max, rel=1e-3
    )


def test_what_mpc_needs_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "osqp", None)
    with pytest.raises(InputError, match=r"clipped-mpc needs osqp, .* pip install 'mrdamp\[mpc\]'"):
        make("clipped-mpc", SITE)
    with pytest.raises(InputError, match="option 'beta' is unknown; allowed: alpha, leak, level"):
        make("sh-add:beta=1", SITE)
    assert isinstance(make("sh-add", SITE), Switching)


@pytest.mark.parametrize("spec", ["constant:value=0.3", "lq-tracking"])
def test_both_engines_say_the_same(spec: str) -> None:
    found = []
    for engine in ("mujoco", "chain"):
        bench = CarBench(engine=engine)
        values = bench.values(bench.run(spec, ROAD, 1.0), bench.run("uncontrolled", ROAD, 1.0))
        found.append([values[key] for key in ("comfort", "load", "stroke", "mean_command")])
    np.testing.assert_allclose(found[0], found[1], rtol=0.02)


def test_the_command_compares_on_a_road_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A stronger damper strokes less; ratios are over the linear suspension, and the table says so."""
    file, out = tmp_path / "lane.csv", tmp_path / "out"
    rows = zip(np.arange(0, 60, 0.1), ROAD.at(np.arange(0, 60, 0.1) / 20.0), strict=True)
    file.write_text("position_m,height_m\n" + "".join(f"{x:.6g},{z:.6g}\n" for x, z in rows))
    given = ["--controllers", "passive-off", "passive-on", "sh-add", "--motions", str(file), "--speed", "15"]
    assert cli.main(["compare", "car", *given, "--engine", "chain", "--jobs", "1", "-o", str(out)]) == 0
    assert "over the linear suspension" in capsys.readouterr().out
    result = json.loads((out / "result.json").read_text())["controllers"]
    stroke = {name: row["measures"]["stroke"]["mean"] for name, row in result.items()}
    assert stroke["passive-on"] < stroke["sh-add"] < stroke["passive-off"]
    assert "linear suspension" in (out / "table.md").read_text()


def test_the_peak_stroke_of_a_run_is_in_metres() -> None:
    """That of the plant's strokes at the ends of the control periods, or a little more between them."""
    road = BENCH.unseen_loads()[-1]
    ends = run_plant(BENCH.plant, road, BENCH.controller("passive-off"), BENCH.measured).stroke
    kept = BENCH.run("passive-off", road, 1.0)
    assert np.abs(ends).max() <= kept["peak_stroke"] < 1.1 * np.abs(ends).max()
