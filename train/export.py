"""The deterministic actor of a model of stable-baselines3 for `mrdamp.control.policy`."""

from __future__ import annotations

from typing import Any

import numpy as np
from torch import nn

from mrdamp.control.networks import Memory, Network
from mrdamp.errors import InputError

_ACTIVATIONS = {"Tanh": "tanh", "ReLU": "relu", "ELU": "elu"}


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
    if len(found) > 1 or not found <= set(_ACTIVATIONS):
        raise InputError(f"this actor cannot be exported: it holds {', '.join(sorted(found))}")
    activation = _ACTIVATIONS[found.pop()] if found else "identity"
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
