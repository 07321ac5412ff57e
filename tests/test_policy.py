"""Learned controllers from a file: arithmetic, actions as forces of dampers at rest and in motion, what is refused."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrdamp.compare.bench import UNCONTROLLED
from mrdamp.compare.car import CarBench
from mrdamp.compare.contenders import contenders, shipped_policies
from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.force_levels import ForceLevels, LeastCommand
from mrdamp.control.observe import Observer
from mrdamp.control.policy import VELOCITY, Network, Policy
from mrdamp.control.told import told
from mrdamp.envs import FramePlant, default_damper
from mrdamp.envs.car import car_damper
from mrdamp.envs.loads import cut
from mrdamp.errors import InputError
from mrdamp.model import Model, core
from mrdamp.model.core import Array
from mrdamp.motions import embedded_motion
from mrdamp.simulation.roads import iso8608
from mrdamp.structures import dyke1996
from mrdamp.train.worlds import world
from refusals import refusal_of, refuses

LEVELS = ForceLevels((0.0, 1.0, 2.0), (100.0, 300.0, 400.0))
MOVING = ForceLevels((0.0, 1.0, 2.0), (100.0, 300.0, 400.0), damping=(500.0, 700.0, 1000.0), speed=0.2)


def policy(levels: ForceLevels | None = None, squash: bool = False) -> Policy:
    observer = Observer(("stroke", "force"), (0.01, 100.0), 2, True, (2.0,))
    rng = np.random.default_rng(3)
    layers = (
        (rng.standard_normal((4, 3)), rng.standard_normal(4)),
        (rng.standard_normal((1, 4)), np.array([0.1])),
    )
    transform = 0.3 * rng.standard_normal((3, observer.size))
    return Policy("p", 2e-3, observer, transform, Network(layers, "tanh", squash), 2.0, levels, {"seed": 3})


def by_hand(p: Policy, rows: list[list[float]]) -> float:
    h = p.transform @ np.concatenate(rows).astype(np.float32)
    (w1, b1), (w2, b2) = p.network.layers
    out = float((w2 @ np.tanh(w1 @ h + b1) + b2)[0])
    return float(np.tanh(out)) if p.network.squash else float(np.clip(out, -1, 1))


@pytest.mark.parametrize("squash", [False, True])
def test_command_is_the_layers_of_the_stacked_measurements(squash: bool) -> None:
    p = policy(squash=squash)
    assert isinstance(p, Controller)
    first = p.command(0.0, {"stroke": 0.002, "force": -30.0})
    assert first == pytest.approx(by_hand(p, [[0.2, -0.3, 0.0]] * 2) + 1, rel=1e-6)
    second = p.command(2e-3, {"stroke": 0.004, "force": 50.0})
    assert second == pytest.approx(by_hand(p, [[0.4, 0.5, first / 2], [0.2, -0.3, 0.0]]) + 1, rel=1e-6)
    p.reset()
    assert p.command(0.0, {"stroke": 0.002, "force": -30.0}) == first


def test_wanted_force_is_followed_only_where_the_damper_resists_that_way() -> None:
    wanted = np.array([200.0, -200.0, 200.0, 50.0, 1000.0, 0.0])
    force = np.array([30.0, -30.0, -30.0, 30.0, 30.0, 30.0])
    assert LEVELS.command(wanted, force) == pytest.approx([0.5, 0.5, 0.0, 0.0, 2.0, 0.0])
    p = policy(LEVELS)
    a = by_hand(p, [[0.2, -0.3, 0.0]] * 2)
    assert p.command(0.0, {"stroke": 0.002, "force": -30.0}) == pytest.approx(
        float(LEVELS.command(a * 400.0, -30.0)), rel=1e-6
    )


def test_a_second_output_adds_a_share_of_the_largest_command() -> None:
    """Also where the wanted force commands nothing; the sum stays between zero and the largest."""
    observer = Observer(("stroke", "force"), (1.0, 1.0), 1, False, (2.0,))
    weights = np.array([[0.0, 0.5], [1.0, 0.0]])  # half of the force is wanted; the stroke is the share
    p = Policy("p", 2e-3, observer, np.eye(2), Network(((weights, np.zeros(2)),)), 2.0, LEVELS)
    o = np.array([[0.25, 1.0], [-0.25, 1.0], [0.25, -1.0], [0.8, 1.0], [-0.9, 1.0]], dtype=np.float32)
    force = np.array([1.0, 1.0, 1.0, 1.0, 1.0])
    assert p.commands(o, force) == pytest.approx([1.0, 0.0, 0.5, 2.0, 0.0])
    assert p.commands(o * np.array([0, 1], dtype=np.float32), force) == pytest.approx([0.5, 0.5, 0.0, 0.5, 0.5])
    three = Network(((np.zeros((3, 2)), np.zeros(3)),))
    refuses(lambda: Policy("p", 2e-3, observer, np.eye(2), three, 2.0, LEVELS), "more than two outputs")


def test_force_levels_are_the_yield_forces_of_the_bouc_wen_element() -> None:
    """Well past yielding z rests at sqrt(A / (gamma + beta)), and alpha(u) z is what the command adds to the force."""
    damper = default_damper()
    levels = ForceLevels.of(damper, 2.25, stroke=4.3e-3, w=34.0)
    a = damper.attributes
    z = (a["A"] / (a["gamma"] + a["beta"])) ** 0.5
    rise = a["alpha_b"] * z * 2.25
    assert levels.forces[0] == pytest.approx(a["alpha_a"] * z, rel=0.15)
    assert levels.force_max - levels.forces[0] == pytest.approx(rise, rel=0.12)


@pytest.mark.parametrize("kind", ["forces", "cautious", "moving", "led"])
def test_written_and_read_it_gives_the_same_commands(kind: str, tmp_path: Path) -> None:
    p = {"forces": policy(LEVELS), "cautious": cautious(), "moving": moving(), "led": led()}[kind]
    p.write(tmp_path / "p.json")
    assert len((tmp_path / "p.json").read_text().splitlines()) < 200  # a row of numbers is one line
    again = Policy.read(tmp_path / "p.json")
    rng = np.random.default_rng(0)
    for k in range(20):
        y = dict(zip(p.observer.signals, p.observer.scales * rng.standard_normal(len(p.observer.scales)), strict=True))
        assert again.command(2e-3 * k, y) == pytest.approx(p.command(2e-3 * k, y), rel=1e-5, abs=1e-6)
    assert (again.name, again.period, again.about, again.levels) == (p.name, p.period, p.about, p.levels)


def test_a_released_damper_has_no_command_where_it_holds_more_than_is_wanted() -> None:
    released = replace(LEVELS, release=True)
    wanted, force = (
        np.array([200.0, 200.0, -200.0, -200.0, 200.0]),
        np.array([30.0, 230.0, -30.0, -230.0, -30.0]),
    )
    assert released.command(wanted, force) == pytest.approx([0.5, 0.0, 0.5, 0.0, 0.0])
    assert LEVELS.command(wanted, force) == pytest.approx([0.5, 0.5, 0.5, 0.5, 0.0])
    assert ForceLevels.from_dict(released.to_dict()) == released
    switched = LEVELS.switching()
    assert switched.force_max > 2 * LEVELS.force_max
    assert switched.command(wanted, force) == pytest.approx([2.0, 0.0, 2.0, 0.0, 0.0], rel=2e-3)


def cautious() -> Policy:
    observer = Observer(("stroke", "force"), (0.01, 100.0), 2, False, (2.0,), peaks={"force": 10.0})
    nothing = Network(((np.zeros((1, observer.size)), np.zeros(1)),))
    return Policy(
        "p", 2e-3, observer, np.eye(observer.size), nothing, 2.0, LEVELS, least=LeastCommand(0.8, 200.0)
    )


def test_the_least_command_fades_as_the_force_grows_and_comes_back_as_it_is_forgotten() -> None:
    p, peak = cautious(), 0.0
    for k, force in enumerate([0.0, 50.0, -100.0, 20.0, 500.0, 0.0, *[0.0] * 40]):
        peak = max(abs(force), math.exp(-1 / 10) * peak)
        wanted = 0.8 * max(0.0, 1 - peak / 200)
        assert p.command(2e-3 * k, {"stroke": 0.0, "force": force}) == pytest.approx(wanted, abs=1e-6)
    assert peak < 20
    older = {key: value for key, value in p.to_dict().items() if key != "least"}
    assert Policy.from_dict(older).least is None


def test_the_least_command_rises_from_rest_is_whole_and_fades() -> None:
    least = LeastCommand(2.0, fade=120.0, full=60.0, rise=40.0)
    forces = np.array([0.0, 10.0, 40.0, 60.0, 90.0, 120.0, 500.0])
    assert least(forces) == pytest.approx([0.0, 0.5, 2.0, 2.0, 1.0, 0.0, 0.0])
    assert LeastCommand.from_dict(least.to_dict()) == least
    assert LeastCommand(2.0, 120.0)(np.array([0.0, 60.0])) == pytest.approx([2.0, 1.0])


def test_a_policy_is_held_back_on_a_faster_driver_by_what_that_lacks_of_its_lag() -> None:
    """A policy without a network's part commands its least command: a step from 0.8 V at rest."""
    data = {**cautious().to_dict(), "command_lag": 0.006}
    rest = {"stroke": 0.0, "force": 0.0}
    for own, added in ((0.0, 0.006), (0.002, 0.004), (0.006, 0.0), (0.01, 0.0)):
        p = Policy.from_dict(data).matched(own)
        wanted = [0.8 * (1 - math.exp(-2e-3 * k / added)) if added else 0.8 for k in (1, 2, 3)]
        for _ in range(2):  # the same again after a reset
            assert [p.command(2e-3 * k, rest) for k in range(3)] == pytest.approx(wanted)
            p.reset()
    unknown = Policy.from_dict(cautious().to_dict()).matched(0.0)
    assert unknown.command(0.0, rest) == pytest.approx(0.8)
    assert Policy.from_dict(data).to_dict()["command_lag"] == 0.006


@pytest.mark.parametrize("name", ["learned/seed_3", "ppo/seed_0", "adjoint/seed_0"])
def test_a_shipped_policy_of_the_frame_does_not_chatter_on_a_driver_without_lag(name: str) -> None:
    """As it is it is unstable there: its command moves half as much again from period to period, or more."""
    published, motion = default_damper(), cut(embedded_motion().compressed(5.0), 2.0)

    def moved(damper: Model, control: Controller) -> float:
        plant = FramePlant(damper, period=0.002, timestep=5e-4, engine="chain")
        y, commands = plant.reset(motion), []
        while not plant.finished:
            commands.append(control.command(plant.time, y))
            y = plant.step(commands[-1])
        return float(np.abs(np.diff(commands)).mean())

    file = resources.files("mrdamp") / "data" / "policies" / "frame" / f"{name}.json"
    alone = Policy.read(Path(str(file)))
    assert alone.command_lag == pytest.approx(published.command_lag)
    fast = replace(published, effects=())
    as_trained = moved(published, alone)
    alone.reset()
    assert moved(fast, alone) > 1.5 * as_trained
    site = registry.Site(dyke1996(), fast, 2.25, 0.002)
    assert moved(fast, told(partial(registry.make, f"policy:{file}"), site)) < 1.1 * as_trained


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"format": "other"}, "format"),
        ({"period": 0}, "period"),
        ({"transform": [[1.0, 2.0]]}, "fit"),
        ({"levels": {"commands": [0, 1], "forces": [3, 2]}}, "forces"),
        ({"levels": {**MOVING.to_dict(), "damping": [1.0, 2.0]}}, r"damping is \(1.0, 2.0\)"),
        ({"command_lag": -1.0}, "command_lag is -1"),
        ({"least": {"level": 1.0}}, "least command: 'fade'"),
        ({"least": {"level": 1.0, "fade": 2.0}}, "no peak of the force"),
    ],
)
def test_a_damaged_file_is_refused_in_a_line_with_its_name(
    tmp_path: Path, change: dict[str, Any], said: str
) -> None:
    file = tmp_path / "p.json"
    file.write_text(json.dumps({**policy(LEVELS).to_dict(), **change}))
    assert re.search(said, refusal_of(file, lambda: Policy.read(file)))


CAR = "mrdamp/QuarterCar-v0"
def moving(levels: ForceLevels | None = MOVING) -> Policy:
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
    plain = ForceLevels(MOVING.commands, MOVING.forces)
    slow = 1e-9 * force
    assert MOVING.command(wanted, force, slow) == pytest.approx(plain.command(wanted, force))
    assert MOVING.command(wanted, force, 0.4) == pytest.approx([0.0, 0.0, 0.0, 2.0, 0.0])
    assert MOVING.command(wanted, force, -0.4) == pytest.approx([0.0, 0.0, (350 - 300) / 280, 0.0, 0.0])
    assert MOVING.force_max == 600.0
    assert plain.force_max == 400.0


def test_a_policy_takes_the_velocity_from_what_it_observes() -> None:
    p = moving()
    y = {"stroke": 0.01, VELOCITY: 0.25, "force": 300.0}
    action = 0.4 * 1.0 + 0.1 * 0.5 + 0.2 * 3.0
    assert p.command(0.0, y) == pytest.approx(float(MOVING.command(1.0 * 600, 300.0, 0.25)), rel=1e-6)
    assert action > 1  # cut off
    data = p.to_dict()
    data["observer"]["signals"][1] = "velocity_1"
    refuses(lambda: Policy.from_dict(data), VELOCITY)


def led(signal: str = "force") -> Policy:
    return Policy.from_dict({**moving().to_dict(), "ahead": {signal: 1e-3}})


def test_the_velocity_is_led_by_signals_that_are_its_rate() -> None:
    y = {"stroke": 0.002, VELOCITY: -0.1, "force": 200.0}
    action = 0.4 * 0.2 - 0.1 * 0.2 + 0.2 * 2.0
    assert led().command(0.0, y) == pytest.approx(float(MOVING.command(action * 600, 200.0, 0.1)), rel=1e-5)
    assert moving().command(0.0, y) == 0.0
    refuses(lambda: led("acceleration_1"), "ahead")


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
        return np.array([np.mean([v[name] for v in values]) for name in ("comfort", "load_ratio")])

    both, comfortable = (np.array([ratios(spec) for spec in row.specs]) for row in rows)
    assert len(set(np.concatenate([both, comfortable])[:, 0].tolist())) == 10
    comfort, load = ratios("clipped-lq:holding=0.3,r=1,level=0.2")
    assert (both.mean(axis=1) < (comfort + load) / 2).all()
    comfort, load = ratios("skyhook:damping=3394.11")
    assert (comfortable < [comfort, load]).all()
    assert comfortable[:, 0].max() < both[:, 0].min()
