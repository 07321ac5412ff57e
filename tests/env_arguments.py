"""Keyword arguments of environments that use much of what they have, for tests."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mrdamp.envs import FrameReward, SyntheticMotions
from mrdamp.model import Model

#: A frame with two dampers, noise, a history and a reward of peaks.
TWO_DAMPERS: Mapping[str, Any] = {
    "motions": SyntheticMotions(duration=1.5),
    "noise": {"acceleration": 0.05, "force": 2.0},
    "history": 3,
    "damper_between": [(0, 1), (1, 3)],
    "reward": FrameReward(drift=1.0, acceleration=1.0, current=0.01, exponent=4.0),
}

#: A structure that no module of the package knows.
OWN = f"{Path(__file__).parents[1] / 'examples' / '08_structure_of_your_own.py'}:Isolated"


def needed(identity: str) -> dict[str, Any]:
    return {"structure": OWN} if identity == "mrdamp/Structure-v0" else {}


def dashpot(c: float) -> Model:
    """A damper of c N s/m, whatever its command, which is from 0 to 4."""
    zero = dict.fromkeys(("c0b", "fya", "fyb"), 0.0)
    return Model("bingham", {"c0a": c, **zero, "v_ref": 0.01, "command_max": 4.0})
