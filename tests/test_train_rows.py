"""What a search runs on against the engine, what it takes from a classical controller, and the search itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mrdamp.control.force_control import ForceController
from mrdamp.control.observe import Observer
from mrdamp.envs.loads import AmbientLoads
from mrdamp.envs.plants import Chained
from mrdamp.envs.task import Task, episodes
from mrdamp.envs.training_loads import TrainingRoads, some_motions
from mrdamp.errors import InputError
from mrdamp.train.imitation import estimated
from mrdamp.train.search import Cma, Shape, actions
from mrdamp.train.worlds import Act, forces, world
from refusals import refuses

Array = NDArray[np.float64]
FRAME, CABLE, CAR = "mrdamp/Frame-v0", "mrdamp/Cable-v0", "mrdamp/QuarterCar-v0"
def policyish(task: Task, largest: float) -> Act:
    """Half the command where the force resists the first measurement, else none."""

    def act(seen: NDArray[np.float32]) -> Array:
        return np.where(forces(task, seen) * seen[:, 0] > 0, 0.5 * largest, 0.0)

    return act


def some_loads(environment: str) -> Sequence[Any]:
    if environment == FRAME:
        return some_motions(np.random.default_rng(3), 3, 8.0)
    if environment == CABLE:
        return [AmbientLoads(duration=3.0).draw(np.random.default_rng(k), 12.65) for k in range(2)]
    return TrainingRoads(3.0).some(np.random.default_rng(3), 5)


@pytest.mark.parametrize(("environment", "tolerance"), [(FRAME, 0.01), (CABLE, 0.05), (CAR, 0.01)])
def test_episodes_of_a_search_are_those_of_the_engine(environment: str, tolerance: float) -> None:
    own = {"timestep": 2.5e-4, "action_in_observation": False}
    if environment == FRAME:
        own["period"] = 2e-3
    chosen = world(environment, own)
    loads = some_loads(environment)
    chain, engine = chosen.searching(len(loads)), chosen.judging(len(loads))
    assert isinstance(chain.rows, Chained)
    assert not isinstance(engine.rows, Chained)
    largest = float(engine.command_max[0])
    for make in (
        lambda task: lambda seen: np.full(len(seen), 0.3 * largest),
        lambda task: policyish(task, largest),
    ):
        found = episodes(chain, chosen.measures, loads, make(chain))
        wanted = episodes(engine, chosen.measures, loads, make(engine))
        assert chain.rows.steps.tolist() == engine.rows.steps.tolist()
        for name in chosen.measures:
            # A switching command's current depends on the step: 5 % on one of five roads at the search's 1 ms.
            wide = 0.06 if environment == CAR and name == "mean_current" else tolerance
            assert found[name] == pytest.approx(wanted[name], rel=wide), name


@pytest.mark.parametrize(
    ("environment", "spec"),
    [(FRAME, "clipped-optimal:balance=30,r=1e-6"), (CABLE, "clipped-optimal"), (CAR, "lq-tracking:r=1")],
)
def test_states_of_the_observer_are_shares_of_the_wanted_force(environment: str, spec: str) -> None:
    seen_alone: dict[str, Any] = {"action_in_observation": False}
    floors = [*(f"acceleration_{j}" for j in (1, 2, 3)), "displacement_1", "force"]
    chosen = world(environment, {**seen_alone, "signals": floors} if environment == FRAME else seen_alone)
    observer = estimated(chosen, spec)
    task = chosen.task(1)
    controller = chosen.stage(task, spec).controller
    assert isinstance(controller, ForceController)
    rng = np.random.default_rng(0)
    own = Observer.from_dict(observer.to_dict())
    for k in range(30):
        y = {name: scale * rng.standard_normal() for name, scale in zip(own.signals, own.scales, strict=True)}
        seen = own(y, 0.0)
        wanted = controller.aim(k * task.rows.period, y)
        states = seen[len(own.signals) :].astype(np.float64)
        size = np.abs(states).sum() * chosen.levels(task).force_max
        assert -states.sum() * chosen.levels(task).force_max == pytest.approx(wanted, abs=1e-5 * size + 1e-9)
    refuses(lambda: estimated(chosen, "passive-on"), "no Kalman filter")
    with pytest.raises(InputError, match="is not observed"):
        estimated(world(environment, {**seen_alone, "signals": ["stroke", "force"]}), spec)


def test_the_search_finds_the_minimum_of_an_ill_scaled_ellipsoid() -> None:
    scales = np.logspace(0, 3, 6)
    aim = np.linspace(-1, 1, 6)

    def cost(x: np.ndarray) -> np.ndarray:
        return np.asarray((scales * (x - aim) ** 2).sum(axis=-1))

    cma = Cma(np.zeros(6), 0.3, 10, np.random.default_rng(1))
    start = cost(cma.mean)
    for _ in range(150):
        cma.tell(cost(cma.ask()))
    assert cost(cma.mean) < 1e-7 * start
    assert cma.mean == pytest.approx(aim, abs=1e-3)


def test_candidates_at_once_act_as_their_networks() -> None:
    shape = Shape(5, [4])
    rng = np.random.default_rng(0)
    candidates, seen = rng.standard_normal((3, shape.size)), rng.standard_normal((3, 2, 5))
    each = [[shape.network(c)(seen[k, j])[0] for j in range(2)] for k, c in enumerate(candidates)]
    assert actions(shape.layers(candidates), seen) == pytest.approx(np.array(each))
    assert (actions(shape.layers(shape.start(rng)[None]), seen[:1]) == 0).all()


@pytest.mark.parametrize("hidden", [[], [3], [4, 2]])
def test_a_network_begins_at_given_weights(hidden: list[int]) -> None:
    shape, rng = Shape(5, hidden), np.random.default_rng(1)
    weights, seen = 0.1 * rng.standard_normal(5), rng.standard_normal((20, 5))
    numbers = shape.linear(shape.start(rng), weights)
    assert numbers.shape == (shape.size,)
    assert shape.network(numbers)(seen)[:, 0] == pytest.approx(np.clip(seen @ weights, -1, 1), abs=1e-3)
