"""An actor that observes the sensors and a critic that observes more, for every learner of stable-baselines3; and the
deterministic actor of any of its policies for `mrdamp.control.policy`.

The first k numbers of an observation are the sensors'; what follows (`mrdamp.train.lessons`) no sensor shows, and it is
there while the critic is trained only: the actor, which alone is exported, is built on the first k.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, create_mlp
from stable_baselines3.sac.policies import SACPolicy
from stable_baselines3.td3.policies import TD3Policy
from torch import nn

from mrdamp.control.policy import Memory, Network
from mrdamp.errors import InputError

ACTIVATIONS = {"Tanh": "tanh", "ReLU": "relu", "ELU": "elu"}


class Front(BaseFeaturesExtractor):
    """The first `width` numbers of an observation."""

    def __init__(self, observation_space: Box, width: int) -> None:
        super().__init__(observation_space, width)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        return observations[..., : self.features_dim]


class _OnFront:
    """Mixin of policies whose actor is built on the first `front` features."""

    def __init__(self, *arguments: Any, front: int, **named: Any) -> None:
        self._front = front
        super().__init__(*arguments, **named)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {**super()._get_constructor_parameters(), "front": self._front}  # type: ignore[misc]


class SplitNetworks(nn.Module):
    """Hidden layers of an actor on the first `front` features and of a critic on all `width`."""

    def __init__(
        self, front: int, width: int, arch: dict[str, list[int]], activation: type[nn.Module]
    ) -> None:
        super().__init__()
        self.front = front
        self.policy_net = nn.Sequential(*create_mlp(front, 0, arch["pi"], activation)[: 2 * len(arch["pi"])])
        self.value_net = nn.Sequential(*create_mlp(width, 0, arch["vf"], activation)[: 2 * len(arch["vf"])])
        self.latent_dim_pi = arch["pi"][-1] if arch["pi"] else front
        self.latent_dim_vf = arch["vf"][-1] if arch["vf"] else width

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        found: torch.Tensor = self.policy_net(features[..., : self.front])
        return found

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        found: torch.Tensor = self.value_net(features)
        return found


class AsymmetricOnPolicy(_OnFront, ActorCriticPolicy):
    """For PPO and A2C. front: k; net_arch: {pi: [...], vf: [...]} or one list for both.

    averaged: the actor's mean over the last updates, which noise in the gradients moves less: what is exported.
    """

    def _build_mlp_extractor(self) -> None:
        arch = self.net_arch
        if not isinstance(arch, dict):
            arch = {"pi": arch, "vf": arch}
        self.mlp_extractor = SplitNetworks(self._front, self.features_dim, arch, self.activation_fn)

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.averaged = copy.deepcopy(self._actor).requires_grad_(False)

    @property
    def _actor(self) -> nn.Sequential:
        return nn.Sequential(*self.mlp_extractor.policy_net, self.action_net)

    def average(self, fresh: float) -> None:
        """Moves the mean by a share `fresh` to the actor."""
        with torch.no_grad():
            for held, now in zip(self.averaged.parameters(), self._actor.parameters(), strict=True):
                held.lerp_(now, fresh)


class AsymmetricRecurrent(_OnFront, RecurrentActorCriticPolicy):
    """For RecurrentPPO: the memory is the actor's alone; the critic observes the state and needs none."""

    def __init__(
        self, observation_space: Box, action_space: Any, lr_schedule: Any, front: int, **named: Any
    ) -> None:
        own = {**named, "share_features_extractor": False, "enable_critic_lstm": False}
        super().__init__(observation_space, action_space, lr_schedule, front=front, **own)
        self.pi_features_extractor = Front(observation_space, front)
        self.lstm_actor = nn.LSTM(front, self.lstm_output_dim, **self.lstm_kwargs)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)

class _FrontActor(_OnFront):
    """The same of a separate actor."""

    def make_actor(self, features_extractor: BaseFeaturesExtractor | None = None) -> Any:
        return super().make_actor(Front(self.observation_space, self._front))  # type: ignore[misc, attr-defined]


class AsymmetricSac(_FrontActor, SACPolicy):
    """For SAC."""


class AsymmetricTd3(_FrontActor, TD3Policy):
    """For TD3 and DDPG."""


POLICIES: dict[str, type[Any]] = {
    "a2c": AsymmetricOnPolicy,
    "ddpg": AsymmetricTd3,
    "ppo": AsymmetricOnPolicy,
    "recurrent": AsymmetricRecurrent,
    "sac": AsymmetricSac,
    "td3": AsymmetricTd3,
}


def network(policy: Any) -> Network:
    """Of the policy of PPO, A2C, RecurrentPPO, SAC, TD3 or DDPG, behind its memory.

    Raises InputError for one that is not layers of one activation.
    """
    if hasattr(policy, "averaged"):
        modules, squash = list(policy.averaged), False
    elif hasattr(policy, "mlp_extractor"):  # PPO, A2C: cut off at the ends of the action's range
        modules, squash = [*policy.mlp_extractor.policy_net, policy.action_net], False
    elif hasattr(policy.actor, "latent_pi"):  # SAC: tanh of a Gaussian's mean
        modules, squash = [*policy.actor.latent_pi, policy.actor.mu], True
    else:  # TD3, DDPG: the last of its modules is tanh
        modules, squash = list(policy.actor.mu)[:-1], True
    layers, found = [], set()
    for module in modules:
        if isinstance(module, nn.Linear):
            layers.append((_numbers(module.weight), _numbers(module.bias)))
        else:  # SAC with use_sde ends in a part that cuts its mean off, which has no name here
            found.add(type(module).__name__)
    if len(found) > 1 or not found <= set(ACTIVATIONS):
        raise InputError(f"this actor cannot be exported: it holds {', '.join(sorted(found))}")
    activation = ACTIVATIONS[found.pop()] if found else "identity"
    return Network(tuple(layers), activation, squash)


def memory(policy: Any) -> Memory | None:
    """Of RecurrentPPO's actor; None: there is none. Raises InputError for more than one layer of it."""
    held = getattr(policy, "lstm_actor", None)
    if held is None:
        return None
    if held.num_layers != 1:
        raise InputError(
            f"this actor cannot be exported: its memory has {held.num_layers} layers; allowed: 1"
        )
    weights = _numbers(held.weight_ih_l0), _numbers(held.weight_hh_l0)
    return Memory(*weights, _numbers(held.bias_ih_l0) + _numbers(held.bias_hh_l0))


def _numbers(parameter: Any) -> Any:
    return parameter.detach().numpy().astype(np.float64)
