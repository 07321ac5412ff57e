"""What must be refused, and how: one line that names the fault."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrdamp.envs.task import Task
from mrdamp.errors import InputError


def refuses(call: Callable[[], Any], message: str) -> None:
    """The call raises InputError of one line in which the message is found."""
    with pytest.raises(InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


def refusal_of(path: Path, read: Callable[[], Any]) -> str:
    """What a file is refused with: one line that names it."""
    with pytest.raises(InputError) as caught:
        read()
    text = str(caught.value)
    assert "\n" not in text
    assert path.name in text
    return text


def says_that_it_diverged(task: Task) -> None:
    """A task of two rows on the chain, one of which gets a state that is no number."""
    task.reset([0, 1], [np.random.default_rng(k) for k in range(2)])
    task.step(np.zeros((2, 1)))
    task.rows.plants.state[1, 5] = math.nan
    with pytest.raises(InputError, match="diverged"):
        task.step(np.zeros((2, 1)))
