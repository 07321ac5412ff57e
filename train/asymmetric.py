"""An actor that sees the sensors beside a critic that sees more, for on-policy learners.

The reward of a weak motion is as large as that of a strong one, for it is taken over what the motion does to the
structure without control. No sensor shows that, so a critic with the sensors alone cannot tell what is to come. While
it is trained the critic is given it; the actor, which alone is exported, is not.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from numpy.typing import NDArray
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import create_mlp
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from torch import nn

from mrdamp.train.worlds import World

Array = NDArray[np.float64]


class Privileged(VecEnvWrapper):
    """Observations (n, k) become (n, 2 k): as they are, and over the size of the motion without control."""

    def __init__(self, venv: VecEnv, world: World, task: Any) -> None:
        size = venv.observation_space.shape[0]
        limit = float(venv.observation_space.high.max())
        super().__init__(venv, observation_space=Box(-limit, limit, (2 * size,), np.float32))
        self._world, self._task = world, task
        self._size: NDArray[np.float32] = np.ones((venv.num_envs, 1), np.float32)

    def reset(self) -> Any:
        return self._with(self.venv.reset())

    def step_wait(self) -> Any:
        observation, reward, done, infos = self.venv.step_wait()
        for row in np.flatnonzero(done):
            last = infos[row]["terminal_observation"]
            infos[row]["terminal_observation"] = np.concatenate([last, last / self._size[row]])
        return self._with(observation), reward, done, infos

    def _with(self, observation: Any) -> Any:
        self._size = self._world.sizes(self._task).astype(np.float32)[:, None]
        return np.concatenate([observation, observation / self._size], axis=1)


class SplitNetworks(nn.Module):
    """Hidden layers of an actor on the first half of the features and of a critic on all of them."""

    def __init__(self, width: int, arch: dict[str, list[int]], activation: type[nn.Module]) -> None:
        super().__init__()
        self.half = width // 2
        self.policy_net = nn.Sequential(
            *create_mlp(self.half, 0, arch["pi"], activation)[: 2 * len(arch["pi"])]
        )
        self.value_net = nn.Sequential(*create_mlp(width, 0, arch["vf"], activation)[: 2 * len(arch["vf"])])
        self.latent_dim_pi = arch["pi"][-1] if arch["pi"] else self.half
        self.latent_dim_vf = arch["vf"][-1] if arch["vf"] else width

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        found: torch.Tensor = self.policy_net(features[..., : self.half])
        return found

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        found: torch.Tensor = self.value_net(features)
        return found


class AsymmetricPolicy(ActorCriticPolicy):
    """The policy of stable-baselines3 with `SplitNetworks`; net_arch: {pi: [...], vf: [...]}."""

    def _build_mlp_extractor(self) -> None:
        arch = (
            self.net_arch if isinstance(self.net_arch, dict) else {"pi": self.net_arch, "vf": self.net_arch}
        )
        self.mlp_extractor = SplitNetworks(self.features_dim, arch, self.activation_fn)
