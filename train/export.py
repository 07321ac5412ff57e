"""The deterministic actor of a model of stable-baselines3 as a `mrdamp.control.policy.Network`."""

from __future__ import annotations

from typing import Any

import numpy as np
from torch import nn

from mrdamp.control.policy import Network
from mrdamp.errors import InputError

_ACTIVATIONS = {"Tanh": "tanh", "ReLU": "relu", "ELU": "elu"}


def network(policy: Any) -> Network:
    """Of the policy of PPO, A2C, SAC, TD3 or DDPG. Raises InputError for one that is not layers of one activation."""
    if hasattr(policy, "mlp_extractor"):  # PPO, A2C: cut off at the ends of the action's range
        modules, squash = [*policy.mlp_extractor.policy_net, policy.action_net], False
    elif hasattr(policy.actor, "latent_pi"):  # SAC: tanh of a Gaussian's mean
        modules, squash = [*policy.actor.latent_pi, policy.actor.mu], True
    else:  # TD3, DDPG: the last of its modules is tanh
        modules, squash = list(policy.actor.mu)[:-1], True
    layers, found = [], set()
    for module in modules:
        if isinstance(module, nn.Linear):
            weight, bias = (p.detach().numpy().astype(np.float64) for p in (module.weight, module.bias))
            layers.append((weight, bias))
        else:  # SAC with use_sde ends in a part that cuts its mean off, which has no name here
            found.add(type(module).__name__)
    if len(found) > 1 or not found <= set(_ACTIVATIONS):
        raise InputError(f"this actor cannot be exported: it holds {', '.join(sorted(found))}")
    activation = _ACTIVATIONS[found.pop()] if found else "identity"
    return Network(tuple(layers), activation, squash)
