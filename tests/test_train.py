"""Training: normalisation, actions, the evolution strategy, export, resume and sweeps, all in small."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mrdamp.cli import main
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.control.force_control import ForceController
from mrdamp.control.force_levels import LeastCommand
from mrdamp.control.policy import Policy
from mrdamp.envs import training_loads as loads
from mrdamp.envs.task import episodes
from mrdamp.model import Effect
from mrdamp.structures import dyke1996
from mrdamp.train.learn import train
from mrdamp.train.run import whitening
from mrdamp.train.search import EvolutionRun
from mrdamp.train.settings import Options, settings
from mrdamp.train.worlds import Judge, forces, imitated, world
from refusals import refuses

pytestmark = pytest.mark.usefixtures("few_validation_motions")
FRAME, CAR = "mrdamp/Frame-v0", "mrdamp/QuarterCar-v0"
#: An evolution strategy that takes a second or two.
SMALL = (
    "loads=2", "population=4", "n_timesteps=4000", "normalize=false", "teacher=", "sigma=0.1",
    "env_kwargs.period=0.004", "env_kwargs.duration=0.8",
)  # fmt: skip


def small(seed: int = 0, *overrides: str) -> Options:
    return Options(algorithm="es", seed=seed, overrides=(*SMALL, *overrides), evaluations=2)


def test_loads_are_shared_by_frames_that_fill_the_ranges() -> None:
    """A stiffness in each sixth of its range, times the frame's own; all seen by the observer of the frame as named."""
    ranges = {"stiffness": (0.7, 1.3), "mass": (0.9, 1.1)}
    given = world(FRAME, {"randomise": ranges})
    frame, observer = dyke1996(), given.task(1).observer
    found: list[Any] = [w.task(1) for w in given.drawn(np.random.default_rng(1), 84)]
    for name, (low, high) in ranges.items():
        factors = sorted(float(getattr(t.structure.frame, name)[0] / getattr(frame, name)[0]) for t in found)
        assert np.floor(6 * (np.array(factors) - low) / (high - low)).tolist() == [0, 1, 2, 3, 4, 5]
    assert all(t.observer.to_dict() == observer.to_dict() for t in found)
    assert len(given.drawn(np.random.default_rng(1), 2)) == 2
    assert world(FRAME, {}).drawn(np.random.default_rng(1), 84) == (world(FRAME, {}),)


def test_a_policy_is_judged_on_every_model(tmp_path: Path) -> None:
    arguments = settings(small()).env_kwargs
    frame = frame_model()
    softer = tmp_path / "softer.json"
    replace(frame, effects=(*frame.effects, Effect("storey_stiffness", {"e": -0.3}, 1))).write(softer)
    worlds = [world(FRAME, arguments), world(FRAME, arguments, softer)]
    rng = np.random.default_rng(0)
    given = [loads.training_motions().draw(rng) for _ in range(4)]
    both = Judge(worlds, given)(1.0)
    for k in (0, 1):
        alone = Judge(worlds[k], given[k::2])(1.0)
        for name, values in alone.items():
            np.testing.assert_allclose(both[name][2 * k : 2 * k + 2], values)
    assert (both["drift_ratio"][2:] != Judge(worlds[0], given[1::2])(1.0)["drift_ratio"]).all()
    refuses(lambda: Judge(worlds, given[:1]), "2 models for 1 loads")


def test_further_models_are_seen_as_the_exported_policy_sees(tmp_path: Path) -> None:
    """A policy has one scale of the force, of the first damper, whatever the largest force of the others."""
    frame, own, stronger = frame_model(), tmp_path / "own.json", tmp_path / "stronger.json"
    frame.write(own)
    grown = {name: 1.5 * v if name.startswith(("alpha", "c0")) else v for name, v in frame.parameters.items()}
    replace(frame, parameters=grown).write(stronger)
    assert world(FRAME, {}, own).task(1).observer.scales != world(FRAME, {}, stronger).task(1).observer.scales
    options = replace(small(0, "estimator=null"), model=own, others=(stronger,))
    run = EvolutionRun(options, settings(options), tmp_path)
    first, second = (w.task(1) for w in run.worlds)
    assert second.structure.models != first.structure.models
    assert second.observer.scales == first.observer.scales


def test_whitening_makes_the_second_moment_one_and_leaves_rest_at_zero() -> None:
    rng = np.random.default_rng(0)
    mixed = rng.standard_normal((5000, 3)) @ np.array([[1.0, 1.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 5.0]])
    w = whitening(mixed.astype(np.float32), floor=1e-6)
    assert (mixed @ w.T).T @ (mixed @ w.T) / 5000 == pytest.approx(np.eye(3), abs=1e-3)
    held = whitening(mixed.astype(np.float32), floor=0.1)
    assert np.linalg.svd(held)[1].max() == pytest.approx(
        1 / (0.1 * np.sqrt((mixed**2).mean(axis=0)).max()), rel=0.01
    )


def test_validation_is_drawn_apart_from_training() -> None:
    rng = np.random.default_rng(np.random.SeedSequence(0).spawn(3)[0])
    trained = {m.name for m in loads.some_motions(rng, 12)}
    known = {m.name for m in loads.validation_motions()}
    assert any(name.startswith("kanai") for name in known)
    assert not trained & {name for name in known if name.startswith("kanai")}
    assert not (trained | known) & {m.name for m in loads.reported_motions()}
    roads, judged = loads.TrainingRoads().some(rng, 40), loads.validation_roads()
    assert len({road.name[0] for road in judged}) == 5  # classes A to D and bumps
    assert not {road.height.tobytes() for road in roads} & {road.height.tobytes() for road in judged}


def test_a_pulse_keeps_the_peak_and_adds_its_own_period() -> None:
    plain = loads.training_motions((2.0, 2.0)).draw(np.random.default_rng(5))
    pulses = loads.Pulses(SimpleNamespace(draw=lambda rng: plain), share=1.0, period=(1.0, 1.0), size=(5.0, 5.0))
    motion = pulses.draw(np.random.default_rng(1))
    assert motion.pga == pytest.approx(plain.pga)
    spectrum = np.abs(np.fft.rfft(motion.acceleration))
    frequency = np.fft.rfftfreq(motion.n, motion.sample_time)[spectrum.argmax()]
    assert frequency == pytest.approx(5.0, rel=0.2)


class Wanting:
    """A wanted force of 300 N a unit of the third floor's acceleration, less 2000 N a metre of stroke."""

    def reset(self) -> None:
        pass

    def __call__(self, t: float, y: Mapping[str, float]) -> float:
        return 300 * y["acceleration_3"] - 2000 * y["stroke"]


def test_what_is_imitated_is_the_wanted_force_of_the_teacher() -> None:
    frame = world(FRAME, {"period": 0.004, "action_in_observation": False, "duration": 0.8})
    task = frame.task(1)
    plant, controller = frame.stage(task, "clipped-optimal:balance=30,r=1e-6")
    assert isinstance(controller, ForceController)
    controller.aim = Wanting()
    matrix = np.diag([2.0, 1.0, 1.0, 1.0, 4.0]).astype(np.float32)
    found = imitated(plant, controller, loads.validation_motions(1, (0.5, 1.5)), task.observer, matrix, 500.0)
    scales = dict(zip(task.observer.signals, task.observer.scales, strict=True))
    wanted = [0, 0, 300 * scales["acceleration_3"] / 500, -2000 * scales["stroke"] / 500, 0]
    assert found * np.diag(matrix) == pytest.approx(np.array(wanted), abs=1e-3)


def test_a_training_writes_a_policy_and_goes_on_from_its_checkpoint(tmp_path: Path) -> None:
    whole = train(small(), tmp_path / "a")
    policy = Policy.read(tmp_path / "a" / "policy.json")
    assert policy.levels is not None
    assert policy.least is not None
    assert policy.transform[:, list(policy.observer.without_peaks)].shape == policy.transform.shape[:1] * 2
    assert policy.about["options"]["seed"] == 0
    assert whole.best["score"] == min(row["score"] for row in whole.curve)
    assert train(small(), tmp_path / "a").curve == whole.curve  # done already
    refuses(lambda: train(small(1), tmp_path / "a"), "other options")
    # Stopped after the second evaluation: what is later is taken away.
    half = tmp_path / "b"
    seen: list[float] = []

    def stop(what: str, share: float) -> None:
        seen.append(share)
        if share > 0.6:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(small(), half, stop)
    assert 0 < len(json.loads((half / "state.json").read_text())["curve"]) < len(whole.curve)
    again = train(small(), half)
    assert again.curve == whole.curve
    assert (half / "policy.json").read_text() == (tmp_path / "a" / "policy.json").read_text()


def test_a_least_command_is_in_shares_of_the_damper_and_the_same_for_every_candidate(tmp_path: Path) -> None:
    override = "least={level: 0.5, fade: 1.5, full: 0.7, rise: 0.4}"
    run = EvolutionRun(small(0, override), settings(small(0, override)), tmp_path)
    assert run.levels is not None
    assert run.levels.commands[-1] == 2.25
    unit = run.levels.forces[0]
    least = run.least()
    assert least == LeastCommand(0.5 * run.command_max, 1.5 * unit, 0.7 * unit, 0.4 * unit)
    assert run.policy().least == least
    assert run.policy().command_lag == pytest.approx(1 / 190)  # the damper of Dyke et al.
    given = small(0, "env_kwargs.peaks={}")
    refuses(lambda: EvolutionRun(given, settings(given), tmp_path), "needs env_kwargs.peaks")
    none = EvolutionRun(small(0, "least=null"), settings(small(0, "least=null")), tmp_path)
    assert none.least() is None
    assert len(none.cma.mean) == len(run.cma.mean)


@pytest.mark.parametrize(
    ("environment", "more"),
    [(FRAME, (*SMALL, "env_kwargs.randomise=null")), (CAR, ("normalize=false", "teacher="))],
)
def test_candidates_are_scored_as_the_policies_they_become(
    environment: str, more: tuple[str, ...], tmp_path: Path
) -> None:
    """Those of the car with the viscous part of its moving damper."""
    exact = ("loads=2", "population=4", "noise=0", "current=0", *more)
    options = Options(environment, "es", overrides=exact, evaluations=1)
    run = EvolutionRun(options, settings(options), tmp_path)
    candidates = run.cma.ask()
    scores = run._scores(candidates)
    drawn = np.random.SeedSequence(run.draws.entropy, spawn_key=(*run.draws.spawn_key, 0))
    judged = run.world.structure.some(np.random.default_rng(drawn), run.loads_count)
    task = run.world.searching(len(judged))
    for candidate, score in zip(candidates, scores, strict=True):
        run.cma.average = candidate
        policy = run.policy()
        found = episodes(task, run.world.measures, judged, lambda o, p=policy: p.commands(o, forces(task, o)))  # type: ignore[misc]
        assert run.world.score({k: float(v.mean()) for k, v in found.items()}) == pytest.approx(score, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["loky", "ray"])
def test_command_gives_the_same_numbers_in_two_workers(
    tmp_path: Path, backend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mrdamp.envs.frame.validation_motions", loads.validation_motions)  # as the workers have it
    command = ["train", FRAME, "--algo", "es", "--seeds", "2", "--evaluations", "1", "--set", *SMALL]
    assert main([*command, "-o", str(tmp_path / "one")]) == 0
    if backend == "ray":
        ray = pytest.importorskip("ray", reason="Ray is not installed")
        ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        monkeypatch.setenv("MRDAMP_BACKEND", "loky")  # put back afterwards
        assert main([*command, "-o", str(tmp_path / "two"), "--jobs", "2", "--backend", backend]) == 0
        if backend == "ray":
            assert ray.cluster_resources()["CPU"] == 2
    finally:
        if backend == "ray":
            ray.shutdown()
    for seed in ("seed_0", "seed_1"):
        texts = [(tmp_path / where / seed / "policy.json").read_text() for where in ("one", "two")]
        assert texts[0] == texts[1]
