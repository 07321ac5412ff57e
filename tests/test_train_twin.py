"""Twins of the plants in NumPy against the engine and SciPy, and what a search takes from a classical controller."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from mrdamp import sets
from mrdamp.control.force_control import ForceController
from mrdamp.control.observe import Observer
from mrdamp.control.plant import Plant
from mrdamp.envs.cable_loads import AmbientLoads
from mrdamp.envs.cable_task import CableTask, cable_damper
from mrdamp.envs.frame_task import FrameTask
from mrdamp.envs.plant import default_damper
from mrdamp.envs.task import Task
from mrdamp.errors import InputError
from mrdamp.model import Model, effects_from
from mrdamp.train.evaluate import Act, episodes, forces
from mrdamp.train.imitation import estimated
from mrdamp.train.loads import some_motions
from mrdamp.train.twin import TwinPlants, has_twin
from mrdamp.train.twin_tasks import CableTwinTask, FrameTwinTask
from mrdamp.train.worlds import world
from twin_laws import LAWS, Softening

Array = NDArray[np.float64]
FRAME, CABLE = "mrdamp/Frame-v0", "mrdamp/Cable-v0"
SEEN = {"action_in_observation": False}


@pytest.mark.parametrize("make", [default_damper, cable_damper])
def test_an_oscillator_with_a_damper_is_that_of_scipy(make: Callable[[], Model]) -> None:
    """A mass on a spring under a push, with the law's equations of the SciPy twin; the command steps once."""
    model = make()
    heavy = model.law == "modified_bouc_wen"
    m, k, push = (98.3, 5.16e5, 900.0) if heavy else (2.0, 400.0, 25.0)
    w, h, n = np.sqrt(k / m), 2.5e-4 if heavy else 1e-3, 800
    commands = np.where(np.arange(n) < n // 2, 0.6, 2.0)
    linear = Plant(np.array([[0, 1], [-(w**2), -0.1]]), np.array([0, -1 / m]), np.array([0, 1 / m]))
    plants = TwinPlants(linear, np.ones(1), model, 1, h, 2)
    times = h * np.arange(n + 1)
    load = push * np.sin(0.7 * w * times)
    for row in range(2):
        plants.start(row, (1 - row / 2) * load[:, None])
    found = np.zeros((n, 2))
    for at, u in enumerate(commands):
        found[at] = plants.measure()[0][:2, 0]
        plants.advance(np.full(2, u))
    law, tau = LAWS[model.law](model.attributes), model.attributes.get("driver_lag_tau", 0.0)

    def rate(t: float, s: Array, u: float) -> Array:
        b = s[2] if tau else u
        f = sum(law.forces(list(s[3:]), s[0], s[1], b, Softening()))
        a = (np.interp(t, times, load) - f) / m - w**2 * s[0] - 0.1 * s[1]
        return np.array(
            [s[1], a, (u - b) / tau if tau else 0.0, *law.rates(list(s[3:]), s[0], s[1], b, Softening())]
        )

    start, wanted = np.array([0.0, 0.0, 0.0, *law.start(0.0)]), []
    for part in (range(n // 2 + 1), range(n // 2, n + 1)):
        span = times[part.start : part.stop]
        u = float(commands[part.start])
        run = solve_ivp(
            rate, (span[0], span[-1]), start, "LSODA", span, rtol=1e-7, atol=1e-10, args=(u,), max_step=h
        )
        wanted.append(run.y[:2, :-1])
        start = run.y[:, -1]
    exact = np.concatenate(wanted, axis=1)
    for column, true in zip(found.T, exact, strict=True):
        assert np.abs(column - true).max() < 0.01 * np.abs(true).max()


def policyish(task: Task, largest: float) -> Act:
    """Half the command where the force resists the first measurement, else none."""

    def act(seen: NDArray[np.float32]) -> Array:
        return np.where(forces(task, seen) * seen[:, 0] > 0, 0.5 * largest, 0.0)

    return act


@pytest.mark.parametrize(("environment", "tolerance"), [(FRAME, 0.01), (CABLE, 0.05)])
def test_episodes_on_twins_are_those_of_the_engine(environment: str, tolerance: float) -> None:
    own = {"timestep": 2.5e-4, "action_in_observation": False}
    if environment == FRAME:
        own["period"] = 2e-3
    chosen = world(environment, own)
    loads = (
        some_motions(np.random.default_rng(3), 3, 8.0)
        if environment == FRAME
        else [AmbientLoads(duration=3.0).draw(np.random.default_rng(k), 12.65) for k in range(2)]
    )
    twin, engine = chosen.searching(len(loads)), chosen.judging(len(loads))
    assert isinstance(twin, FrameTwinTask | CableTwinTask)
    assert type(engine) in (FrameTask, CableTask)
    largest = float(engine.command_max[0])
    for make in (
        lambda task: lambda seen: np.full(len(seen), 0.3 * largest),
        lambda task: policyish(task, largest),
    ):
        found, periods = episodes(twin, chosen, loads, make(twin))
        wanted, same = episodes(engine, chosen, loads, make(engine))
        assert periods == same
        for name in chosen.measures:
            assert found[name] == pytest.approx(wanted[name], rel=tolerance), name


def test_a_search_stays_on_the_engine_for_what_has_no_twin() -> None:
    damper = default_damper()
    assert has_twin(damper, ("acceleration_1", "stroke", "force"))
    assert not has_twin(damper, ("velocity_1",))
    other = sets.load(next(name for name in sets.names() if sets.load(name).law == "hyperbolic_tangent"))
    assert not has_twin(Model(other.law, dict(other.parameters)), ("force",))
    hot = effects_from({"shear_thinning_m": 0.8})
    assert not has_twin(replace(damper, effects=(*damper.effects, *hot)), ("force",))
    full = world(FRAME, {"full_state": True})
    assert type(full.searching(1)) is FrameTask


@pytest.mark.parametrize(
    ("environment", "spec"), [(FRAME, "clipped-optimal:balance=30,r=1e-6"), (CABLE, "clipped-optimal")]
)
def test_states_of_the_observer_are_shares_of_the_wanted_force(environment: str, spec: str) -> None:
    floors = [*(f"acceleration_{j}" for j in (1, 2, 3)), "displacement_1", "force"]
    chosen = world(environment, {**SEEN, "signals": floors} if environment == FRAME else SEEN)
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
    with pytest.raises(InputError, match="no Kalman filter"):
        estimated(chosen, "passive-on")
    with pytest.raises(InputError, match="is not observed"):
        estimated(world(environment, {**SEEN, "signals": ["stroke", "force"]}), spec)
