"""Trainings by stable-baselines3: wrappers, export against its own predictions, resume."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")

import stable_baselines3
from stable_baselines3.common.vec_env import VecEnv

from mrdamp.control.force_levels import ForceLevels
from mrdamp.control.policy import Policy
from mrdamp.envs.frame_task import FrameTask
from mrdamp.envs.sb3 import PlantVecEnv
from mrdamp.errors import InputError
from mrdamp.train import loads
from mrdamp.train.asymmetric import AsymmetricPolicy, Privileged
from mrdamp.train.export import network
from mrdamp.train.learn import train
from mrdamp.train.settings import Options
from mrdamp.train.worlds import FrameWorld
from mrdamp.train.wrappers import ForceAction, Whitened

PERIOD = 4e-3


@pytest.fixture(autouse=True)
def few_validation_motions(monkeypatch: pytest.MonkeyPatch) -> None:
    few = loads.validation_motions(1, (0.5, 1.5))
    monkeypatch.setattr("mrdamp.train.worlds.validation_motions", lambda: few)


def frames(n: int = 2) -> tuple[FrameTask, PlantVecEnv]:
    task = FrameTask(n, period=PERIOD, timestep=1e-3, duration=0.4)
    venv = PlantVecEnv(task)
    venv.seed(3)
    return task, venv


def test_force_actions_become_the_commands_of_the_levels() -> None:
    task, venv = frames()
    levels = ForceLevels((0.0, 2.25), (100.0, 1100.0))
    wrapped = ForceAction(venv, task.observer, levels, 2.25)
    seen = wrapped.reset()
    column = task.observer.signals.index("force")
    width = task.observer.width
    for action in (0.5, -0.5, 0.9, -0.05):
        force = seen[:, column] * task.observer.scales[column]
        seen, _, _, _ = wrapped.step(np.full((2, 1), action))
        wanted = action * 1100.0
        expected = [
            2.25 * (abs(wanted) - 100) / 1000 if wanted * f > 0 and abs(wanted) > 100 else 0.0 for f in force
        ]
        assert seen[:, width - 1] * 2.25 == pytest.approx(expected, abs=1e-5)


def test_whitened_and_privileged_observations_are_what_they_say() -> None:
    task, venv = frames()
    matrix = np.random.default_rng(0).standard_normal((3, task.observer.size)).astype(np.float32)
    wrapped = Privileged(Whitened(venv, matrix), FrameWorld({}), task)
    _, plain = frames()
    seen, raw = wrapped.reset(), plain.reset()
    actions = np.zeros((2, 1), np.float32)
    ended = 0
    while not ended:
        before = FrameWorld({}).sizes(task).copy()
        seen, _, done, infos = wrapped.step(actions)
        raw, _, _, raw_infos = plain.step(actions)
        for row in np.flatnonzero(done):
            last = raw_infos[row]["terminal_observation"] @ matrix.T
            both = np.concatenate([last, last / before[row]])
            assert infos[row]["terminal_observation"] == pytest.approx(both, rel=1e-4, abs=1e-6)
            ended += 1
        half = raw @ matrix.T
        sizes = FrameWorld({}).sizes(task)[:, None]
        assert seen == pytest.approx(np.concatenate([half, half / sizes], axis=1), rel=1e-4, abs=1e-6)


def test_the_actor_does_not_see_the_privileged_half() -> None:
    task, venv = frames()
    wrapped = Privileged(Whitened(venv, np.eye(task.observer.size, dtype=np.float32)), FrameWorld({}), task)
    arch = {"net_arch": {"pi": [8], "vf": [8]}}
    model = stable_baselines3.PPO(
        AsymmetricPolicy, wrapped, policy_kwargs=arch, n_steps=8, batch_size=8, device="cpu"
    )
    rng = np.random.default_rng(0)
    one = rng.standard_normal((1, 2 * task.observer.size)).astype(np.float32)
    other = one.copy()
    other[:, task.observer.size :] = 5.0
    assert model.predict(one, deterministic=True)[0] == model.predict(other, deterministic=True)[0]
    tensor = model.policy.obs_to_tensor(one)[0], model.policy.obs_to_tensor(other)[0]
    assert model.policy.predict_values(tensor[0]) != model.policy.predict_values(tensor[1])


@pytest.mark.parametrize(
    ("algorithm", "arguments"),
    [
        ("PPO", {"policy_kwargs": {"net_arch": {"pi": [7, 5], "vf": [4]}}, "n_steps": 8, "batch_size": 8}),
        (
            "PPO",
            {
                "policy_kwargs": {"net_arch": {"pi": [], "vf": [4]}},
                "use_sde": True,
                "n_steps": 8,
                "batch_size": 8,
            },
        ),
        ("A2C", {"policy_kwargs": {"net_arch": [6]}}),
        ("SAC", {"policy_kwargs": {"net_arch": [7, 5]}}),
        ("TD3", {"policy_kwargs": {"net_arch": [7, 5]}}),
        ("DDPG", {"policy_kwargs": {"net_arch": [6]}}),
    ],
)
def test_export_gives_the_deterministic_action_of_the_model(
    algorithm: str, arguments: dict[str, Any]
) -> None:
    task, venv = frames()
    maker: Any = getattr(stable_baselines3, algorithm)
    model = maker("MlpPolicy", venv, seed=1, device="cpu", **arguments)
    seen = 2.0 * np.random.default_rng(0).standard_normal((40, task.observer.size)).astype(np.float32)
    expected = model.predict(seen, deterministic=True)[0]
    assert np.ptp(expected) > 1e-3
    assert network(model.policy)(seen.astype(np.float64)) == pytest.approx(expected, abs=2e-6)


def test_an_actor_of_another_form_is_refused() -> None:
    _, venv = frames()
    model = stable_baselines3.SAC("MlpPolicy", venv, use_sde=True, device="cpu")
    with pytest.raises(InputError, match="cannot be exported"):
        network(model.policy)


def ppo(timesteps: int = 512) -> Options:
    small = (
        "n_envs=4",
        "n_steps=32",
        "batch_size=64",
        f"env_kwargs.period={PERIOD}",
        "env_kwargs.duration=0.4",
    )
    return Options(timesteps=timesteps, overrides=(*small, "normalize=false"), evaluations=2)


def test_ppo_trains_checkpoints_and_goes_on(tmp_path: Path) -> None:
    def stop(what: str, share: float) -> None:
        if share > 0.6:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(ppo(), tmp_path, stop)
    result = train(ppo(), tmp_path)
    assert [row["timesteps"] for row in result.curve] == [0, 256, 512]
    policy = Policy.read(tmp_path / "policy.json")
    assert policy.about["timesteps"] == result.best["timesteps"]
    assert policy.command(0.0, dict.fromkeys(policy.observer.signals, 0.1)) >= 0
    assert list((tmp_path / "tensorboard").rglob("events.*"))


def test_what_the_learner_does_not_know_is_refused(tmp_path: Path) -> None:
    options = Options(overrides=(*ppo().overrides, "learning_rte=1"))
    with pytest.raises(InputError, match="learning_rte"):
        train(options, tmp_path)
    assert not (tmp_path / "options.json").exists()
    with pytest.raises(InputError, match="privileged"):
        train(
            Options(algorithm="sac", overrides=("privileged=true", "n_envs=1", "normalize=false")), tmp_path
        )


def test_the_wrappers_are_vector_environments() -> None:
    task, venv = frames()
    assert isinstance(ForceAction(venv, task.observer, ForceLevels((0, 1), (0, 1)), 1.0), VecEnv)
    blind = FrameTask(1, signals=["acceleration_1"])
    with pytest.raises(InputError, match="force"):
        ForceAction(PlantVecEnv(blind), blind.observer, ForceLevels((0, 1), (0, 1)), 1.0)
