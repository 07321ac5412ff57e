"""From a model of stable-baselines3 to a `mrdamp.control.policy.Policy`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import nn

from mrdamp.control.force_levels import ForceLevels
from mrdamp.control.observe import Observer
from mrdamp.control.policy import Network, Policy
from mrdamp.errors import InputError

_ACTIVATIONS = {"Tanh": "tanh", "ReLU": "relu", "ELU": "elu"}


def export(
    model: Any,
    observer: Observer,
    matrix: NDArray[np.float32],
    period: float,
    command_max: float,
    levels: ForceLevels | None,
    about: dict[str, Any],
) -> Policy:
    """The deterministic actor of a PPO, A2C, SAC, TD3 or DDPG model, behind the observations' transform.

    Raises InputError for an actor that is not layers of one activation.
    """
    name = str(about.get("name", "policy"))
    fresh = Observer.from_dict(observer.to_dict())
    return Policy(name, period, fresh, matrix.astype(np.float64), network(model.policy), command_max, levels, about)


def network(policy: Any) -> Network:
    """The layers of an actor."""
    if hasattr(policy, "mlp_extractor"):  # PPO, A2C: cut off at the ends of the action's range
        modules, squash = [*policy.mlp_extractor.policy_net, policy.action_net], False
    elif hasattr(policy.actor, "latent_pi"):  # SAC: tanh of a Gaussian's mean
        modules, squash = [*policy.actor.latent_pi, _mean(policy.actor.mu)], True
    else:  # TD3, DDPG: the last of its modules is tanh
        modules, squash = list(policy.actor.mu)[:-1], True
    layers, found = [], set()
    for module in modules:
        if isinstance(module, nn.Linear):
            layers.append(tuple(p.detach().numpy().astype(np.float64) for p in (module.weight, module.bias)))
        else:
            found.add(type(module).__name__)
    if len(found) > 1 or not found <= set(_ACTIVATIONS):
        raise InputError(f"this actor cannot be exported: it holds {', '.join(sorted(found))}")
    activation = _ACTIVATIONS[found.pop()] if found else "identity"
    return Network(tuple((w, b) for w, b in layers), activation, squash)


def _mean(mu: Any) -> nn.Linear:
    """SAC's mean; with state-dependent exploration it is cut off at +-2 before tanh, which is not exported."""
    if not isinstance(mu, nn.Linear):
        raise InputError("this actor cannot be exported: SAC with use_sde; set use_sde: false")
    return mu
