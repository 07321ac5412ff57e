"""What every environment refuses before it steps, and that its copies go on as it does."""

from __future__ import annotations

import copy
import math
import pickle
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from env_arguments import OWN
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.envs import (
    AmbientLoads,
    CableEnv,
    CableLoad,
    CablePlant,
    CarEnv,
    CarPlant,
    CarTask,
    FrameEnv,
    FramePlant,
    FrameReward,
    FrameTask,
    IsoRoads,
    StructureEnv,
    SyntheticMotions,
    default_damper,
)
from mrdamp.envs.plant_env import PlantEnv
from mrdamp.envs.vector import CableVectorEnv, CarVectorEnv, FrameVectorEnv, StructureVectorEnv
from mrdamp.model import Effect, Model
from mrdamp.motions import GroundMotion
from mrdamp.simulation.roads import Road
from mrdamp.structures import dyke1996
from refusals import refuses

Make = Callable[..., Any]
FRAME: Mapping[str, Any] = {"motions": SyntheticMotions(duration=2.0), "noise": {"acceleration": 0.05}}
CABLE: Mapping[str, Any] = {
    "loads": AmbientLoads(duration=0.5), "noise": {"force": 0.1}, "bandwidth": 30.0,
    "randomise": {"tension": (0.9, 1.1), "driver_lag_tau": (0.0, 0.02)},
}  # fmt: skip
CAR: Mapping[str, Any] = {
    "roads": IsoRoads(duration=1.0), "randomise": {"body": (0.8, 1.2), "sensor_gain_g": (0.9, 1.1)}
}  # fmt: skip
OTHER: Mapping[str, Any] = {**FRAME, "noise": {"force": 2.0}, "structure": OWN}
#: Every kind of state that a sensor or a driver has.
_SENSING = (
    Effect("sensor_leakage", {"tau": 0.3, "share": 0.4, "tau2": 2.0}, 2), Effect("sensor_lag", {"tau": 0.004}, 1),
    Effect("sensor_lag", {"tau": 0.005, "ratio": 0.7}, 3), Effect("command_delay", {"d": 0.012}),
)  # fmt: skip
_DAMPER = default_damper()
SENSING: Mapping[str, Any] = {
    **FRAME, "history": 4,
    "randomise": {"stiffness": (0.9, 1.1), "mass": (0.9, 1.1), "alpha_b": (0.5, 1.5)},
    "reward": FrameReward(drift=1.0, acceleration=1.0, current=0.01, exponent=4.0),
    "model": Model(_DAMPER.law, _DAMPER.parameters, (*_DAMPER.effects, *_SENSING), "frame", dyke1996()),
}  # fmt: skip
KINDS: list[tuple[Any, Any, Mapping[str, Any]]] = [
    (FrameEnv, FrameVectorEnv, FRAME), (FrameEnv, FrameVectorEnv, SENSING), (CableEnv, CableVectorEnv, CABLE),
    (CarEnv, CarVectorEnv, CAR), (StructureEnv, StructureVectorEnv, OTHER),
]  # fmt: skip
every = pytest.mark.parametrize(
    ("single", "rows", "given"), KINDS, ids=["frame", "sensing frame", "cable", "car", "own"]
)
engines = pytest.mark.parametrize("engine", ["mujoco", "chain"])
NARX = (
    "mrdamp-narx 1 sample_time 0.002 inputs 3 x:0 v:0 i:0 offset 0 0 0 scale 100 5 1 force 0 600 "
    "hidden 1 2 weight 0.1 0.9 0.0 0.0 0.5 0.4 bias 0 0 weight 0.8 0.4 bias 0 end"
)
KINDS_OF_ONE = (FrameEnv, CableEnv, CarEnv)
#: What is no positive number.
NUMBERLESS = (math.nan, math.inf, 0.0, -1.0, "1", None)
DRAWN = partial(FrameEnv, randomise={"mass": (0.9, 1.1), "driver_lag_tau": (0.004, 0.007)})


def same(a: Any, b: Any) -> None:
    """Results of two steps: observation, reward, flags and info, to the last bit."""
    for x, y in zip(a, b, strict=True):
        np.testing.assert_equal(x, y)


@engines
@every
def test_actions_that_are_no_numbers_are_refused_without_a_step(
    single: Make, rows: Make, given: Mapping[str, Any], engine: str
) -> None:
    """The next step is that of an environment that was never asked."""
    cases: Sequence[tuple[Any, Any, list[Any]]] = (
        (partial(single), np.full(1, 0.3), [[math.nan], [math.inf], [None], [0.3 + 1j], ["0.3"], np.zeros(2)]),
        (partial(rows, 2), np.full((2, 1), 0.3), [[[0.1], [math.nan]], [[0.1], [1j]], np.zeros((3, 1)), np.zeros(2)]),
        (partial(rows, 1), np.full((1, 1), 0.3), [[[math.nan]], [0.3], [[0.3, 0.3]], [[[0.3]]]]),
    )
    for make, action, wrong in cases:
        asked, other = (make(engine=engine, **given) for _ in range(2))
        for env in (asked, other):
            env.reset(seed=3)
            env.step(action)
        for bad in wrong:
            refuses(partial(asked.step, bad), "action has shape|action holds NaN|action is ")
        same(asked.step(action), other.step(action))
    refuses(lambda: asked.step(None), "action is None|action has shape|action holds NaN")


@engines
@pytest.mark.parametrize("plant", [FramePlant, CablePlant, CarPlant])
def test_commands_that_are_no_numbers_are_refused(plant: Make, engine: str) -> None:
    made = plant(engine=engine)
    for bad, what in ((math.nan, "holds NaN"), (None, "holds NaN"), ([1.0, 1.0], "shape")):
        refuses(partial(made.step, bad), f"command .*{what}")
    assert made.time == 0.0


@engines
@every
def test_copies_go_on_to_the_last_bit(single: Make, rows: Make, given: Mapping[str, Any], engine: str) -> None:
    for env, shape in ((single(engine=engine, **given), (1,)), (rows(2, engine=engine, **given), (2, 1))):
        actions = np.random.default_rng(0).uniform(-1, 1, (80, *shape))
        env.reset(seed=4)
        for action in actions[:30]:
            env.step(action)
        copies = copy.deepcopy(env), pickle.loads(pickle.dumps(env))
        found = [*(env.step(action) for action in actions[30:]), env.reset()]
        for other in copies:
            for one, two in zip(found, [*(other.step(action) for action in actions[30:]), other.reset()], strict=True):
                same(one, two)


@engines
@every
def test_seeds_and_states_are_exact(single: Make, rows: Make, given: Mapping[str, Any], engine: str) -> None:
    env, other = (single(engine=engine, **given) for _ in range(2))
    actions = np.random.default_rng(0).uniform(-1, 1, (80, 1)).astype(np.float32)
    begin, again = (each.reset(seed=4) for each in (env, other))
    same(begin, again)
    before = [env.step(action) for action in actions[:40]]
    for found, action in zip(before, actions[:40], strict=True):
        same(found, other.step(action))
    state = env.get_state()
    after, following = [env.step(action) for action in actions[40:]], env.reset()
    assert not np.array_equal(other.reset(seed=77)[0], begin[0]) or other.reset()[1] != begin[1]
    for each in (env, other):
        each.set_state(state)
        for found, action in zip(after, actions[40:], strict=True):
            same(found, each.step(action))
        same(following, each.reset())


@engines
def test_copies_of_a_network_do_not_share_its_memory(engine: str) -> None:
    env: Any = FrameEnv(model=Model("narx", weights=NARX), command_max=1.0, engine=engine, **FRAME)
    env.reset(seed=1)
    other = copy.deepcopy(env)
    found = env.step(np.ones(1))
    del env
    same(found, other.step(np.ones(1)))


def test_the_limits_that_are_told_are_those_of_the_space() -> None:
    """In one place, for all environments."""
    told = re.search(r"`Box\((-\d+), (\d+), \(history", PlantEnv.__doc__ or "")
    assert told
    for kind in (FrameEnv, CableEnv, CarEnv):
        space: Any = kind().observation_space
        assert (space.low == float(told[1])).all()
        assert (space.high == float(told[2])).all()
        assert not re.search(r"\| *(Min|-?\d+) *\| *(Max|\d+) *\|", kind.__doc__ or "")


@pytest.mark.parametrize(
    ("make", "arguments", "options", "message"),
    [
        (FrameEnv, {"engine": "chain", "timestep": 0.0}, {}, "timestep is 0"),
        (FrameEnv, {"command_max": 10.0}, {}, "command_max is 10; allowed: up to 2.25"),
        (CarEnv, {"timestep": 1e-9}, {}, "timestep is 1e-09; allowed: 1e-06 s or more"),
        (CableEnv, {"model": frame_model()}, {}, "is of a frame; allowed here: a damper's"),
        (FrameEnv, {"damper_between": (0, 7)}, {}, "allowed: two different floor numbers"),
        (FrameEnv, {"period": 1e-9}, {}, "period is 1e-09; allowed: 1e-05 to 10 s"),
        (FrameEnv, {}, 5, "reset: options is 5; allowed: options by name"),
        (FrameEnv, {"signals": ("acceleration_9",)}, {}, "acceleration_9"),
        (FrameEnv, {"observer": {}}, {}, "observer: it has no signals; allowed: what "),
        (FrameEnv, {"reward": {"drifts": 1.0}}, {}, "'drifts' is unknown"),
        (FrameEnv, {"reward": {"reference": "passive-on"}, "damper_between": [(0, 1), (1, 2)]}, {}, "one damper"),
        (FrameEnv, {"randomise": {"stifness": (0.9, 1.1)}}, {}, "'stifness' is unknown.*nearest: stiffness"),
        (FrameEnv, {"randomise": {"mass": (1.1, 0.9)}}, {}, r"mass is \(1.1, 0.9\)"),
        (FrameEnv, {"randomise": {"sensor_gain_g_4": (0.9, 1.0)}}, {}, "place 4"),
        (FrameEnv, {}, {"drawn": {"mass": 1.0}}, "drawn is .*with randomise"),
        (DRAWN, {}, {"drawn": {"stiffness": 1.0}}, "'stiffness' is not randomised"),
        *((DRAWN, {}, {"drawn": {"mass": bad}}, "drawn: mass is .*; allowed: a factor > 0") for bad in NUMBERLESS),
        (DRAWN, {}, {"drawn": {"driver_lag_tau": math.nan}}, "drawn: driver_lag_tau is .*; allowed: a number"),
        (FrameEnv, {}, {"motion": GroundMotion("nothing", 0.01, np.zeros(50))}, "zero throughout"),
        *((make, {}, {"amplitude": bad}, "amplitude is") for make in KINDS_OF_ONE for bad in NUMBERLESS),
        (CableEnv, {"render_mode": "human"}, {}, "human needs a display"),
        (CableEnv, {}, {"load": CableLoad("none", 0.1, np.array([0.5]), np.zeros((9, 1)))}, "zero throughout"),
        (CarEnv, {}, {"road": Road("flat", 0.1, np.zeros(50), 5.0)}, "flat throughout"),
    ],
)
def test_arguments_are_checked_when_the_environment_is_made(
    make: Make, arguments: dict[str, Any], options: Any, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    if options:
        refuses(partial(make().reset, options=options), message)
    else:
        refuses(lambda: make(**arguments), message)


@every
def test_what_the_engine_warns_of_is_not_scored(
    single: Make, rows: Make, given: Mapping[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo begins anew, at rest, where numbers are huge: the episode would end as if nothing had been."""
    monkeypatch.chdir(tmp_path)  # the engine writes its log here
    for env in (single(**given), rows(2, **given)):
        many = getattr(env, "num_envs", 1)
        action = np.zeros((many, *env.unwrapped.task.action_space.shape), np.float32)

        def run(env: Any = env, action: Any = action, many: int = many) -> None:
            over = False
            while not over:
                over = bool(np.any(env.step(action if many > 1 else action[0])[3]))

        env.reset(seed=1, options={"amplitude": 1e13})
        refuses(run, r"at amplitude 1e\+13: the simulation diverged")
        env.reset(seed=1)
        run()


@pytest.mark.parametrize("kind", [FrameTask, CarTask])
def test_a_state_of_the_chain_that_is_no_number_is_said_to_have_diverged(kind: Make) -> None:
    task = kind(2, engine="chain")
    task.reset([0, 1], [np.random.default_rng(k) for k in range(2)])
    task.step(np.zeros((2, 1)))
    task.rows.plants.state[1, 5] = math.nan
    refuses(lambda: task.step(np.zeros((2, 1))), "diverged")


@pytest.mark.parametrize("other", [
    {"command_max": 0.5}, {"noise": {"force": 1.0}}, {"reward": {"drift": 2.0}},
    {"motions": SyntheticMotions(duration=9.0)}, {"history": 3},
])  # fmt: skip
def test_a_state_of_an_environment_with_other_arguments_is_refused(other: dict[str, Any]) -> None:
    env = FrameEnv(engine="chain")
    env.reset(seed=1)
    state = env.get_state()
    FrameEnv(engine="chain").set_state(state)
    refuses(lambda: FrameEnv(engine="chain", **other).set_state(state), "the state is of another environment")


@pytest.mark.parametrize("mask", [[True], [False] * 3, [True] * 5, [0, 2, 1]])
def test_a_mask_of_rows_that_is_none_is_refused(mask: list[int]) -> None:
    env = FrameVectorEnv(3, engine="chain")
    env.reset(seed=1)
    refuses(lambda: env.reset(options={"reset_mask": np.array(mask)}), "reset_mask is .*allowed: 3 flags")


@every
def test_a_step_without_an_episode_asks_for_a_reset(single: Make, rows: Make, given: Mapping[str, Any]) -> None:
    """Before the first one and after an episode's end, also of a copy and of a state that is put back."""
    env, batch = single(engine="chain", **given), rows(2, engine="chain", autoreset_mode="Disabled", **given)
    for each, action in ((env, np.zeros(1)), (batch, np.zeros((2, 1)))):
        with pytest.raises(ResetNeeded, match=r"^step: no episode has begun; call reset$"):
            each.step(action)
        each.reset(seed=1)
        while not np.any(each.step(action)[3]):
            pass
        for ended in (each, copy.deepcopy(each)):
            with pytest.raises(ResetNeeded, match=r"^step: the episode is over.*; call reset$"):
                ended.step(action)
    state = env.get_state()
    env.reset(seed=1)
    env.set_state(state)
    with pytest.raises(ResetNeeded, match="is over; call reset"):
        env.step(np.zeros(1))
