"""What is drawn for an episode acts, and changes nothing else; what an environment cannot do is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from mrdamp.errors import InputError
from mrdamp.motions import read_motion

OWN = f"{Path(__file__).parents[1] / 'examples' / '08_structure_of_your_own.py'}:Isolated"
FRAME = "mrdamp:mrdamp/Frame-v0"


@pytest.mark.parametrize("tau", [0.05, 0.5])
def test_a_drawn_lag_acts_on_a_structure_of_ones_own(tau: float) -> None:
    """A step of the command: the mean of u (1 - exp(-t / tau)) over the episode."""
    env: Any = gymnasium.make(
        "mrdamp:mrdamp/Structure-v0", structure=OWN, engine="chain", randomise={"driver_lag_tau": (0.01, 1.0)}
    )
    info = env.reset(seed=3, options={"drawn": {"driver_lag_tau": tau}})[1]
    duration, over = info["duration"], False
    while not over:
        _, _, _, over, info = env.step(np.ones(env.action_space.shape, np.float32))
    largest = env.unwrapped.task.command_max[0]
    mean = largest * (1 - tau / duration * (1 - np.exp(-duration / tau)))
    assert info["mean_current"] == pytest.approx(mean, rel=5e-3)


@pytest.mark.parametrize(
    "given", [{"randomise": {"stiffness": (0.9, 1.1)}}, {"noise": {"force": 5.0}, "engine": "chain"}]
)
def test_a_seed_has_one_load(given: dict[str, Any]) -> None:
    plain, other = (gymnasium.make(FRAME, **some).reset(seed=1)[1] for some in ({}, given))
    assert (other["motion"], other["pga"]) == (plain["motion"], plain["pga"])


@pytest.mark.parametrize(
    ("given", "said"),
    [({"foo": 1}, "'foo' is no argument"), ({"command_max": 10.0}, "command_max is 10; allowed: up to 2.25")],
)
def test_what_cannot_be_is_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        gymnasium.make(FRAME, **given)


def test_a_state_belongs_to_its_environment() -> None:
    made: list[Any] = [gymnasium.make(FRAME, engine="chain", history=n).unwrapped for n in (1, 1, 3)]
    first, second, longer = made
    first.reset(seed=1)
    state = first.get_state()
    second.set_state(state)
    action = np.ones(first.action_space.shape, np.float32)
    np.testing.assert_array_equal(first.step(action)[0], second.step(action)[0])
    with pytest.raises(InputError, match="another environment"):
        longer.set_state(state)


def test_a_time_column_in_milliseconds_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "ms.csv"
    path.write_text("time_s,acceleration_m_s2\n" + "".join(f"{10 * k},{k % 3}\n" for k in range(20)))
    with pytest.raises(InputError, match=r"a sample every 10 s; allowed: up to 0.1 s"):
        read_motion(path)
