"""Policies of moving dampers: force levels with the viscous part, the lead of the velocity, the score's parts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mrdamp.compare.bench import UNCONTROLLED
from mrdamp.compare.car import CarBench
from mrdamp.compare.contenders import contenders, shipped_policies
from mrdamp.control.force_levels import ForceLevels
from mrdamp.control.networks import Network
from mrdamp.control.observe import Observer
from mrdamp.control.policy import VELOCITY, Policy
from mrdamp.envs.car_task import car_damper
from mrdamp.errors import InputError
from mrdamp.model import core
from mrdamp.model.core import Array
from mrdamp.simulation.roads import iso8608
from mrdamp.train.worlds import world

LEVELS = ForceLevels((0.0, 1.0, 2.0), (100.0, 300.0, 400.0), damping=(500.0, 700.0, 1000.0), speed=0.2)
CAR = "mrdamp/QuarterCar-v0"


def policy(levels: ForceLevels | None = LEVELS) -> Policy:
    """A linear one of stroke, its velocity and force."""
    observer = Observer(("stroke", VELOCITY, "force"), (0.01, 0.5, 100.0), 1, False, (2.0,))
    network = Network(((np.array([[0.4, 0.1, 0.2]]), np.zeros(1)),), "tanh")
    return Policy("p", 5e-3, observer, np.eye(3), network, 2.0, levels)


@pytest.mark.parametrize("speed", [0.1, 0.3, 0.8])
@pytest.mark.parametrize("command", [0.0, 0.1, 0.4, 1.2])
def test_the_command_for_a_moving_dampers_own_force_is_the_one_it_has(speed: float, command: float) -> None:
    """The law itself, at the wheel's frequency, where the levels were taken at the body's."""
    damper, w = car_damper(), 70.0
    levels = ForceLevels.of(damper, 2.0, stroke=0.03, w=7.07, viscous=True)
    t = np.linspace(0.0, 4 * np.pi / w, 1601)
    x, v = speed / w * np.sin(w * t), speed * np.cos(w * t)
    out = core.run(damper.law, damper.attributes, float(t[1]), x, v, u=command, narx=damper.narx)
    force = float(out["force"][800:].max())
    assert float(levels.command(force, force, speed)) == pytest.approx(command, abs=0.03)
    still = ForceLevels.of(damper, 2.0, stroke=0.03, w=7.07)
    assert abs(float(still.command(force, force)) - command) > 0.25  # what it would be without


def test_levels_of_a_damper_at_rest_are_as_without_damping() -> None:
    wanted, force = np.array([50.0, 200.0, -350.0, 900.0, 200.0]), np.array([1.0, 1.0, -1.0, 1.0, -1.0])
    plain = ForceLevels(LEVELS.commands, LEVELS.forces)
    slow = 1e-9 * force
    assert LEVELS.command(wanted, force, slow) == pytest.approx(plain.command(wanted, force))
    assert LEVELS.command(wanted, force, 0.4) == pytest.approx([0.0, 0.0, 0.0, 2.0, 0.0])
    assert LEVELS.command(wanted, force, -0.4) == pytest.approx([0.0, 0.0, (350 - 300) / 280, 0.0, 0.0])
    assert LEVELS.force_max == 600.0
    assert plain.force_max == 400.0


def test_levels_that_cannot_be() -> None:
    for damping, speed, said in (
        ((1.0, 2.0), 0.0, "damping"),
        ((3.0, 2.0, 1.0), 0.0, "damping"),
        ((-1.0, 2.0, 3.0), 0.0, "damping"),
        ((1.0, 2.0, 3.0), -1.0, "speed"),
    ):
        with pytest.raises(InputError, match=said):
            ForceLevels(LEVELS.commands, LEVELS.forces, damping=damping, speed=speed)


def test_a_policy_takes_the_velocity_from_what_it_observes(tmp_path: Path) -> None:
    p = policy()
    y = {"stroke": 0.01, VELOCITY: 0.25, "force": 300.0}
    action = 0.4 * 1.0 + 0.1 * 0.5 + 0.2 * 3.0
    assert p.command(0.0, y) == pytest.approx(float(LEVELS.command(1.0 * 600, 300.0, 0.25)), rel=1e-6)
    assert action > 1  # cut off
    p.write(tmp_path / "p.json")
    again = Policy.read(tmp_path / "p.json")
    assert again.levels == LEVELS
    assert again.command(0.0, y) == p.command(0.0, y)
    data = p.to_dict()
    data["observer"]["signals"][1] = "velocity_1"
    with pytest.raises(InputError, match=VELOCITY):
        Policy.from_dict(data)


def test_the_velocity_is_led_by_signals_that_are_its_rate(tmp_path: Path) -> None:
    data = policy().to_dict()
    data["ahead"] = {"force": 1e-3}
    led = Policy.from_dict(data)
    y = {"stroke": 0.002, VELOCITY: -0.1, "force": 200.0}
    action = 0.4 * 0.2 - 0.1 * 0.2 + 0.2 * 2.0
    assert led.command(0.0, y) == pytest.approx(float(LEVELS.command(action * 600, 200.0, 0.1)), rel=1e-5)
    assert policy().command(0.0, y) == 0.0
    led.write(tmp_path / "p.json")
    assert Policy.read(tmp_path / "p.json").ahead == led.ahead
    data["ahead"] = {"acceleration_1": 1e-3}
    with pytest.raises(InputError, match="ahead"):
        Policy.from_dict(data)


def test_a_file_without_the_new_entries_is_a_policy_as_before() -> None:
    data = policy(ForceLevels(LEVELS.commands, LEVELS.forces)).to_dict()
    assert "damping" not in data["levels"]
    del data["ahead"]
    old = Policy.from_dict(data)
    y = {"stroke": 0.005, VELOCITY: 0.0, "force": 50.0}
    assert old.command(0.0, y) == pytest.approx(np.interp(0.3 * 400.0, [100, 300], [0, 1]), rel=1e-6)


def test_the_scores_share_of_road_holding_is_a_setting() -> None:
    means = {"comfort_ratio": 0.8, "load_ratio": 1.1}
    assert world(CAR, {}).score(means) == pytest.approx(0.95)
    assert world(CAR, {}, score={"holding": 0.6}).score(means) == pytest.approx(0.98)
    for score in ({"holding": 1.5}, {"weight": 0.5}, {"holding": "half"}):
        with pytest.raises(InputError, match=r"score\.\w+ is"):
            world(CAR, {}, score=score)  # type: ignore[arg-type]


@pytest.mark.slow
def test_shipped_policies_of_the_car_are_five_different_seeds_that_ride_better_than_clipped_lq() -> None:
    bench = CarBench(engine="chain")
    rows = contenders(bench, ["learned", "learned-comfort"], {}, shipped_policies("car"))
    assert all(row.learned and len(row.specs) == 5 for row in rows)
    roads = [iso8608("C", speed, 6.0, 77 + k) for k, speed in enumerate((12.0, 17.0, 22.0, 27.0))]
    linear = [bench.run(UNCONTROLLED, road, 1.0) for road in roads]

    def ratios(spec: str) -> Array:
        values = [bench.values(bench.run(spec, road, 1.0), free) for road, free in zip(roads, linear, strict=True)]
        return np.array([np.mean([v[name] for v in values]) for name in ("comfort", "load")])

    both, comfortable = (np.array([ratios(spec) for spec in row.specs]) for row in rows)
    assert len(set(np.concatenate([both, comfortable])[:, 0].tolist())) == 10
    comfort, load = ratios("clipped-lq:holding=0.3,r=1,level=0.2")
    assert (both.mean(axis=1) < (comfort + load) / 2).all()
    comfort, load = ratios("skyhook:damping=3394.11")
    assert (comfortable < [comfort, load]).all()
    assert comfortable[:, 0].max() < both[:, 0].min()
