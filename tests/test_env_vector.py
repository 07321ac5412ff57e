"""Rows of a batch give the numbers of single environments, to the last bit."""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from scipy.signal import dlsim, lfilter

from env_arguments import TWO_DAMPERS
from mrdamp.control.observe import LinearFilter, Stack
from mrdamp.envs import (
    AmbientLoads,
    CableEnv,
    CableReward,
    CableTask,
    CarEnv,
    CarTask,
    FrameEnv,
    FrameTask,
    IsoRoads,
    Observer,
    SyntheticMotions,
    default_damper,
)
from mrdamp.envs.task import Task
from mrdamp.envs.vector import CableVectorEnv, CarVectorEnv, FrameVectorEnv, PlantVectorEnv
from mrdamp.errors import InputError
from mrdamp.model import Effect, Model
from mrdamp.structures import dyke1996
from refusals import refuses

N = 3
DAMPER = default_damper()


class Uneven:
    motions = SyntheticMotions(duration=1.5, rise=(0.2, 0.3), plateau=(0.2, 0.4))

    def draw(self, rng: np.random.Generator) -> Any:
        return self.motions.draw(rng).compressed(rng.uniform(1.0, 2.0))


ARGUMENTS: Mapping[str, Mapping[str, Any]] = {
    "frame": TWO_DAMPERS,
    "uneven": {"motions": Uneven()},
    "sensors": {
        "motions": SyntheticMotions(duration=1.5), "noise": {"stroke": 1e-4}, "action_in_observation": False,
        "signals": ["acceleration_2", "velocity_3", "stroke", "true_force", "current"],
        "model": Model(
            DAMPER.law, DAMPER.parameters,
            (*DAMPER.effects, Effect("channel_shift", {"d": 2e-3}), Effect("sensor_lag", {"tau": 2e-3}, 2)),
            "frame", dyke1996(),
        ),
        "randomise": {"stiffness": (0.9, 1.1), "alpha_b": (0.5, 1.5)},
    },
    "cable": {
        "loads": AmbientLoads(duration=0.3), "noise": {"force": 0.1}, "history": 2, "memory": [3.0],
        "peaks": {"force": 5.0}, "measured_at": [0.1, 0.5, 0.7], "bandwidth": 30.0,
        "randomise": {"tension": (0.9, 1.1)},
        "reward": CableReward(acceleration=0.3, power=0.2, energy=0.1, exponent=1.4),
    },
    "car": {
        "roads": IsoRoads(("C",), duration=1.0), "noise": {"acceleration": 0.05, "force": 2.0}, "history": 2,
        "full_state": True, "period": 0.02, "randomise": {"body": (0.8, 1.2)},
    },
}  # fmt: skip
SINGLE: Mapping[str, Callable[..., Any]] = {
    "frame": FrameEnv, "uneven": FrameEnv, "sensors": FrameEnv, "cable": CableEnv, "car": CarEnv
}  # fmt: skip
VECTOR: Mapping[str, Callable[..., PlantVectorEnv]] = {
    "frame": FrameVectorEnv, "uneven": FrameVectorEnv, "sensors": FrameVectorEnv, "cable": CableVectorEnv,
    "car": CarVectorEnv,
}  # fmt: skip
TASK: Mapping[str, Callable[..., Task]] = {"frame": FrameTask, "cable": CableTask, "car": CarTask}


def equal(a: Any, b: Any) -> None:
    """Infos of two vector environments: the same keys, values and types."""
    if isinstance(a, dict):
        assert set(a) == set(b)
        for key in a:
            equal(a[key], b[key])
    elif a.dtype == object:
        assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))
    else:
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


def both(
    kind: str, mode: AutoresetMode, engine: str = "mujoco"
) -> tuple[VectorEnv[Any, Any, Any], VectorEnv[Any, Any, Any]]:
    given = {**ARGUMENTS[kind], "engine": engine}
    loop = SyncVectorEnv([lambda: SINGLE[kind](**given)] * N, autoreset_mode=mode)
    return loop, VECTOR[kind](N, autoreset_mode=mode, threads=2, **given)


@pytest.mark.parametrize(
    ("kind", "engine", "mode"),
    [
        *((kind, engine, AutoresetMode.NEXT_STEP) for kind in ARGUMENTS for engine in ("mujoco", "chain")),
        ("frame", "mujoco", AutoresetMode.SAME_STEP),
    ],
)
def test_rows_are_single_environments(kind: str, engine: str, mode: AutoresetMode) -> None:
    """Plain numbers of one against arrays of many, over several ends of episodes, rewards, flags and infos included;
    with the spaces of the engine's environment."""
    loop, batch = both(kind, mode, engine)
    plain = SINGLE[kind](**ARGUMENTS[kind])
    assert plain.observation_space == batch.single_observation_space
    assert loop.observation_space == batch.observation_space
    assert loop.action_space == batch.action_space
    rng = np.random.default_rng(0)
    first, second = loop.reset(seed=3), batch.reset(seed=3)
    np.testing.assert_array_equal(first[0], second[0])
    equal(first[1], second[1])
    ends = 0
    for _ in range(150):
        action = rng.uniform(-1, 1, batch.action_space.shape or ()).astype(np.float32)
        a, b = loop.step(action), batch.step(action)
        for x, y in zip(a[:4], b[:4], strict=True):
            assert x.dtype == y.dtype
            np.testing.assert_array_equal(x, y)
        equal(a[4], b[4])
        ends += int(a[3].sum())
    assert ends >= 2 * N


def test_some_rows_are_reset_by_a_mask() -> None:
    loop, batch = both("frame", AutoresetMode.DISABLED)
    mask = np.array([False, True, False])
    for env in (loop, batch):
        env.reset(seed=5)
        for _ in range(10):
            env.step(np.full(env.action_space.shape, 0.3, np.float32))
    a = loop.reset(seed=8, options={"reset_mask": mask})
    b = batch.reset(seed=8, options={"reset_mask": mask})
    np.testing.assert_array_equal(a[0], b[0])
    equal(a[1], b[1])
    action = np.zeros((N, 2), np.float32)
    np.testing.assert_array_equal(loop.step(action)[0], batch.step(action)[0])


@pytest.mark.parametrize("kind", TASK)
def test_stable_baselines_rows_are_single_environments(kind: str) -> None:
    vec = pytest.importorskip("stable_baselines3.common.vec_env", reason="needs the extra train")
    from mrdamp.envs.sb3 import PlantVecEnv

    given = {**ARGUMENTS[kind], "engine": "chain"}
    loop = vec.DummyVecEnv([lambda: SINGLE[kind](**given)] * N)
    batch = PlantVecEnv(TASK[kind](N, threads=2, **given))
    for env in (loop, batch):
        env.seed(5)
    np.testing.assert_array_equal(loop.reset(), batch.reset())
    assert loop.reset_infos == batch.reset_infos
    rng = np.random.default_rng(0)
    for _ in range(130):
        action = rng.uniform(-1, 1, (N, *loop.action_space.shape)).astype(np.float32)
        a, b = loop.step(action), batch.step(action)
        for x, y in zip(a[:3], b[:3], strict=True):
            assert x.dtype == y.dtype
            np.testing.assert_array_equal(x, y)
        for x, y in zip(a[3], b[3], strict=True):
            assert set(x) == set(y)
            assert all(np.array_equal(x[key], y[key]) for key in x)
    for name in ("spec", "render_mode"):  # of environments that were made without an id
        assert loop.get_attr(name) == batch.get_attr(name)
    assert vec.VecNormalize(vec.VecMonitor(batch)).reset().shape == (N, *batch.observation_space.shape)


OBSERVER = Observer(("a", "b"), (2.0, 10.0), history=3, command_max=(4.0,), limit=5.0)


def test_an_observer_scales_cuts_and_stacks() -> None:
    assert OBSERVER.names[2:5] == ("command", "a[-1]", "b[-1]")
    first = OBSERVER({"a": 1.0, "b": 20.0, "c": 7.0}, 0.0)
    np.testing.assert_array_equal(first, [0.5, 2, 0] * 3)
    OBSERVER({"a": 2.0, "b": -1000.0}, 1.0)
    np.testing.assert_allclose(OBSERVER({"a": 3.0, "b": 5.0}, 4.0), [1.5, 0.5, 1, 1, -5, 0.25, 0.5, 2, 0])
    OBSERVER.reset()
    np.testing.assert_array_equal(OBSERVER({"a": 4.0, "b": 0.0}, 2.0), [2, 0, 0.5] * 3)
    OBSERVER.reset()
    assert OBSERVER.size == len(OBSERVER.names) == 9


REMEMBERING = replace(OBSERVER, history=2, memory=(2.0, 9.0))


def test_leaky_averages_are_a_filter_of_the_signals() -> None:
    observer = replace(REMEMBERING)
    assert observer.names[2:7] == ("command", "a~2", "b~2", "a~9", "b~9")
    assert observer.size == len(observer.names) == 14
    signal = np.random.default_rng(2).normal(size=(60, 2))
    seen = np.array([observer({"a": a, "b": b}, 1.0) for a, b in signal])
    scaled = signal / OBSERVER.scales
    for k, periods in enumerate(observer.memory):
        keep = math.exp(-1 / periods)
        # At rest with the first sample: lfilter's state is what one sample of it has left.
        wanted = lfilter([1 - keep], [1, -keep], scaled, axis=0, zi=keep * scaled[:1])[0]
        np.testing.assert_allclose(seen[:, 3 + 2 * k : 5 + 2 * k], wanted, atol=1e-6)
        np.testing.assert_array_equal(seen[1:, 10 + 2 * k : 12 + 2 * k], seen[:-1, 3 + 2 * k : 5 + 2 * k])
    assert Observer.from_dict(observer.to_dict()) == observer
    late = ("memory", "peaks", "filter")
    older = {key: value for key, value in OBSERVER.to_dict().items() if key not in late}
    assert Observer.from_dict(older) == OBSERVER  # a policy that was written before there was one


def test_leaky_peaks_hold_the_size_of_a_signal_and_let_it_go() -> None:
    observer = replace(REMEMBERING, peaks={"b": 3.0})
    assert observer.names[6:9] == ("b~9", "b^3", "a[-1]")
    assert observer.without_peaks == (*range(7), *range(8, 15))
    keep, held = math.exp(-1 / 3), 0.0
    for b in (0.5, -2.0, 1.0, 0.0, 0.0, 1.0):
        seen = observer({"a": 1.0, "b": b}, 0.0)
        held = max(abs(b), keep * held)
        assert observer.peak(seen[None], "b")[0] == pytest.approx(held, rel=1e-6)
    assert Observer.from_dict(observer.to_dict()) == observer


def test_a_filter_of_the_observer_is_that_of_scipy() -> None:
    step, before, now = (
        np.array([[0.9, 0.1], [-0.2, 0.7]]),
        np.array([[0.3, 0.0], [1.0, 2.0]]),
        np.array([[0.0, 1.0], [0.5, 0.0]]),
    )
    held = LinearFilter(*(tuple(map(tuple, m.tolist())) for m in (step, before, now)))
    observer = replace(OBSERVER, history=1, peaks={"a": 4.0}, filter=held)
    assert observer.names[3:] == ("a^4", "state_1", "state_2")
    assert observer.without_peaks == (0, 1, 2, 4, 5)
    signal = np.random.default_rng(4).normal(size=(30, 2))
    seen = np.array([observer({"a": a, "b": b}, 1.0) for a, b in signal])
    scaled = signal / OBSERVER.scales
    pushed = np.concatenate([scaled[:-1], scaled[1:]], axis=1)  # from one sample to the next
    _, _, x = dlsim(
        (step, np.hstack([before, now]), np.eye(2), np.zeros((2, 4)), 1.0), np.vstack([pushed, pushed[:1]])
    )
    np.testing.assert_allclose(seen[:, 4:], x, atol=1e-5)
    assert Observer.from_dict(observer.to_dict()) == observer
    for wrong in ({"step": ((1.0,),)}, {"now": ((1.0, 2.0), (3.0,))}, {"before": "many"}):
        with pytest.raises(InputError, match="observer: filter"):
            LinearFilter(**{**held.to_dict(), **wrong})
    refuses(lambda: Observer(("a",), (1.0,), filter=held), "filter is not of 1 signals")


FULL = replace(
    REMEMBERING,
    peaks={"b": 3.0, "a": 8.0},
    filter=LinearFilter(((0.5, 0.2), (0.1, 0.3)), ((1.0, 0.0), (0.5, 3.0)), ((0.0, 2.0), (1.0, 1.0))),
)


@pytest.mark.parametrize("observer", [OBSERVER, REMEMBERING, FULL])
def test_stacked_rows_are_observers(observer: Observer) -> None:
    rng = np.random.default_rng(0)
    one, stack = Stack(observer, 1), Stack(observer, 2)
    each = [Observer.from_dict(observer.to_dict()) for _ in range(2)]
    for k in range(6):
        values, command = rng.normal(size=(2, 2)) * 10, rng.uniform(0, 4, (2, 1))
        if k in (0, 3):
            rows = [0, 1] if k == 0 else [1]
            for row in rows:
                each[row].reset()
            found = stack.restart(rows, values[rows], command[rows])
            if k == 0:
                one.restart([0], values[:1], command[:1])
        else:
            rows, found = [0, 1], stack.push(values, command)
            np.testing.assert_array_equal(one.push_one(values[0].tolist(), command[0].tolist()), found[0])
        for row, seen in zip(rows, found, strict=True):
            wanted = each[row]({"a": values[row, 0], "b": values[row, 1]}, command[row])
            np.testing.assert_array_equal(seen, wanted)


ROWS = 8


def measured(task: FrameTask) -> bytes:
    for _ in range(3):
        values = task.rows.advance(np.full((ROWS, 1), 0.5 * task.command_max))[1]
    return bytes(values.tobytes())


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_process_steps_rows_as_its_parent_does() -> None:
    task = FrameTask(ROWS, engine="chain", threads=2)
    task.reset(range(ROWS), [np.random.default_rng(k) for k in range(ROWS)])
    start = measured(task)
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        signal.alarm(20)  # ends a child that waits for threads that it has not
        os.write(write, measured(task))
        os._exit(0)
    os.close(write)
    _, status = os.waitpid(child, 0)
    found = os.read(read, 1 << 16)
    os.close(read)
    assert os.waitstatus_to_exitcode(status) == 0
    assert found != start
    assert found == measured(task)
