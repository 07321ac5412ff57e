"""What every training has, however it learns: its environment, its normalisation, its curve and its files."""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mrdamp.control.force_levels import ForceLevels, LeastCommand
from mrdamp.control.observe import Observer
from mrdamp.control.policy import VELOCITY, Memory, Network, Policy, velocities
from mrdamp.envs.task import Task
from mrdamp.envs.training_loads import VALIDATION_SEED
from mrdamp.errors import InputError
from mrdamp.files import together, write_atomic
from mrdamp.model.core import Array
from mrdamp.parallel import Progress
from mrdamp.shown import Shown
from mrdamp.train.settings import Options, Settings
from mrdamp.train.worlds import Judge, World, estimated, forces, imitated, with_ground, world

_EXPLORED = (8, 2500)  # rows and control periods, whole motions of them, that the whitening is taken from
_HELD = 50  # control periods that an action is held for there
_FLOOR = 1e-3
_LESSONS = 6  # loads that a teacher is watched under
_ANEW = "delete the folder, and the training begins again"
_LEAST = ("level", "fade", "full", "rise")


@dataclass(frozen=True)
class Result(Shown):
    """folder: policy.json (the best on the validation loads), training.json; curve: one row an evaluation, its
    `timesteps`, `score` and the means of the world's measures; seconds: of process time, whole."""

    picture: ClassVar[str] = "mrdamp.train.learn:curve"
    folder: Path
    curve: tuple[dict[str, float], ...]
    seconds: float

    @property
    def best(self) -> dict[str, float]:
        return min(self.curve, key=lambda row: row["score"])


@contextmanager
def reading(file: Path) -> Iterator[None]:
    """InputError for a file of a training's folder that is missing, or not as it was written."""
    require_file(file)
    try:
        yield
    except InputError:
        raise
    except Exception:  # of archives and pickles of any kind, and of what they lack
        raise InputError(f"{file}: damaged; {_ANEW}") from None


def require_file(file: Path) -> None:
    """InputError where a file of a training's folder is missing."""
    if not file.is_file():
        raise InputError(f"{file}: missing; {_ANEW}")


def require_policy(out: Path) -> None:
    """InputError where the policy in a training's folder is missing or damaged."""
    file = out / "policy.json"
    require_file(file)
    try:
        Policy.read(file)
    except InputError as error:
        raise InputError(f"{error}; {_ANEW}") from None


class Run(ABC):
    """A training that is going on. n: rows of its task. Attributes: curve, as in `Result`; resumed, whether it goes on
    from a checkpoint, the file of `save`, and reached, the control periods of that."""

    kept_in: ClassVar[str] = "checkpoint.pt"

    def __init__(self, options: Options, chosen: Settings, out: Path, n: int) -> None:
        self.options, self.chosen, self.out = options, chosen, out
        self.state_file, self.matrix_file = out / "state.json", out / "normalization.npy"
        self.checkpoint = out / self.kept_in
        self.world: World = world(options.environment, chosen.env_kwargs, options.model, chosen.score)
        _require_trainable(options.algorithm, chosen, self.world.task(1).command_max)
        if chosen.estimator:
            self.world = self.world.observing(estimated(self.world, chosen.estimator))
        if chosen.ground is not None:
            self.world = with_ground(self.world, chosen.ground)
        self.worlds = (self.world, *(self._like(file) for file in options.others))
        self.task: Task = self.world.task(n, chosen.engine)
        self.command_max = float(self.task.command_max[0])
        levels = self.world.levels(self.task, chosen.viscous) if chosen.action == "force" else None
        self.levels = levels.switching() if levels is not None and chosen.switch else levels
        self.draws, explore, self.seed, self.lessons, self.pooled = np.random.SeedSequence(
            options.seed
        ).spawn(5)
        if chosen.viscous and VELOCITY not in self.task.observer.signals:
            raise InputError(f"hyperparameters: viscous needs {VELOCITY} in env_kwargs.signals")
        if chosen.teacher and self.levels is None:
            raise InputError("hyperparameters: teacher is for action: force")
        if self.least() and "force" not in self.task.observer.peaks:
            raise InputError("hyperparameters: least needs env_kwargs.peaks of the force")
        self.matrix = self._matrix(np.random.default_rng(explore))
        validation = self.world.structure.validation()
        self.judge = Judge(self.sharing(np.random.default_rng(VALIDATION_SEED), len(validation)), validation)
        self.curve: list[dict[str, float]] = []
        self._board: Any = None
        self._before, self._start = 0.0, time.process_time()
        self.resumed = self.state_file.is_file() or self.checkpoint.is_file()
        if self.resumed:
            require_file(self.checkpoint)
            with reading(self.state_file):
                kept = json.loads(self.state_file.read_text())
                self.curve, self._before = kept["curve"], float(kept["seconds"])
                self.reached = int(self.curve[-1]["timesteps"])
            require_policy(self.out)

    def _like(self, model: Path) -> World:
        other = world(self.options.environment, self.chosen.env_kwargs, model, self.chosen.score)
        return other.observing(self.world.task(1).observer)

    def sharing(self, rng: np.random.Generator, loads: int) -> list[World]:
        """The worlds that take so many loads in turn."""
        return [drawn for w in self.worlds for drawn in w.drawn(rng, loads // len(self.worlds))]

    @property
    def inputs(self) -> int:
        return len(self.matrix)

    @property
    @abstractmethod
    def timesteps(self) -> int:
        """Control periods so far."""

    @abstractmethod
    def learn(self, progress: Progress) -> None:
        """To the end, with evaluations."""

    @abstractmethod
    def network(self) -> Network:
        """What has been learned so far."""

    def least(self) -> LeastCommand | None:
        """The least command of the settings; none for a damper without a force when its command is zero, which has no
        such motion. Raises InputError."""
        given = self.chosen.least
        if given is None:
            return None
        fits = isinstance(given, Mapping) and {"level", "fade"} <= set(given) <= {*_LEAST}
        if not fits or not all(isinstance(value, int | float) for value in given.values()):
            raise InputError(
                f"hyperparameters: least is {given!r}; allowed: numbers level and fade, also full and rise, or none"
            )
        if self.levels is None:
            raise InputError("hyperparameters: least is for action: force")
        unit = self.levels.forces[0]
        if unit == 0:
            return None
        return LeastCommand.from_dict(
            {name: value * (self.command_max if name == "level" else unit) for name, value in given.items()}
        )

    def memory(self) -> Memory | None:
        """What has been learned of a memory before the network."""
        return None

    def transform(self) -> Array:
        """(k, size) from observations to what a `Policy` gives its network."""
        return self.matrix.astype(np.float64)

    def teacher(self) -> Array | None:
        """(inputs,) weights of the action that the network corrects, see `Policy`."""
        return None

    def taught(self) -> Array:
        """(inputs,) weights whose action is nearest to the teacher's wanted force. Raises InputError."""
        assert self.levels is not None
        loads = self.world.structure.some(np.random.default_rng(self.lessons), _LESSONS)
        plant, controller = self.world.stage(self.task, self.chosen.teacher)
        return imitated(plant, controller, loads, self.task.observer, self.matrix, self.levels.force_max)

    @abstractmethod
    def save(self) -> None:
        """A checkpoint, to continue from."""

    def seconds(self) -> float:
        """Of process time so far, those before a resume included."""
        return self._before + time.process_time() - self._start

    def tell(self, progress: Progress) -> None:
        done, whole = (1e-6 * n for n in (self.timesteps, self.chosen.n_timesteps))
        text = f"train: seed {self.options.seed}, {done:.3g} of {whole:.3g} million periods"
        progress(text, min(1.0, self.timesteps / self.chosen.n_timesteps))

    def due(self) -> bool:
        """Whether an evaluation is: they stand evenly over the training, and none is repeated after an interruption."""
        if self.curve and self.curve[-1]["timesteps"] >= self.timesteps:
            return False
        return self.timesteps >= self.chosen.n_timesteps / self.options.evaluations * len(self.curve)

    def evaluate(self) -> dict[str, float]:
        """A row of the curve, a checkpoint, and policy.json where it is the best yet."""
        policy = self.policy()
        means = {name: float(v.mean()) for name, v in self.judge(policy).items()}
        score = self.world.score(means)
        best = min((row["score"] for row in self.curve), default=np.inf)
        self.curve.append({"timesteps": float(self.timesteps), "score": score, **means})
        self.board({f"validation/{name}": v for name, v in self.curve[-1].items() if name != "timesteps"})
        with together():
            if score < best:
                policy.write(self.out / "policy.json")
            self.save()
            write_atomic(self.state_file, json.dumps({"curve": self.curve, "seconds": self.seconds()}) + "\n")
        return self.curve[-1]

    def board(self, values: Mapping[str, float]) -> None:
        """Numbers of now, for TensorBoard; nothing where it is not installed."""
        if self._board is None:
            try:
                from tensorboard.summary import Writer
            except ImportError:
                return
            self._board = Writer(str(self.out / "tensorboard"))
        for name, value in values.items():
            self._board.add_scalar(name, value, self.timesteps)
        self._board.flush()

    def policy(self) -> Policy:
        o = self.options
        about = {
            "options": o.to_dict(),
            "settings": json.loads(json.dumps(asdict(self.chosen))),
            "timesteps": self.timesteps,
        }
        if self.task.structure.identity:
            about["structure"] = self.task.structure.identity
        frame = self.worlds[0].task(1).structure.models[0].structure
        if frame is not None:
            about["upward"] = [upper > lower for lower, upper in frame.places]
        fresh = Observer.from_dict(self.task.observer.to_dict())
        name, matrix = f"{o.algorithm} seed {o.seed}", self.transform()
        return Policy(
            name, self.task.rows.period, fresh, matrix, self.network(), self.command_max, self.levels, about,
            self.least(), self.teacher(), self.chosen.reach, self.memory(), self.chosen.ahead,
            min(w.task(1).structure.models[0].command_lag for w in self.worlds),
        )  # fmt: skip

    def _matrix(self, rng: np.random.Generator) -> NDArray[np.float32]:
        if self.matrix_file.is_file():
            with reading(self.matrix_file):
                kept = np.load(self.matrix_file)
                if kept.ndim != 2 or kept.shape[1] != self.task.observer.size or not np.isfinite(kept).all():
                    raise ValueError
                return np.asarray(kept)
        columns = list(self.task.observer.without_peaks)
        matrix = np.eye(self.task.observer.size, dtype=np.float32)[columns]
        if self.chosen.normalize:
            observation = explored(
                self.world.task(_EXPLORED[0], self.chosen.engine), self.levels, self.command_max, rng
            )
            matrix[:, columns] = whitening(observation[:, columns])
        return matrix


class StepRun(Run):
    """A training by steps, each under loads that it draws anew."""

    _periods = 0

    @property
    def timesteps(self) -> int:
        return self._periods

    @abstractmethod
    def step(self) -> float:
        """One step; the score before it."""

    def learn(self, progress: Progress) -> None:
        while self.timesteps < self.chosen.n_timesteps:
            self.tell(progress)
            if self.due():
                self.evaluate()
            self.board({"train/score": self.step()})
        if self.curve[-1]["timesteps"] < self.timesteps:
            self.evaluate()

    def numbers(self, step: int) -> np.random.Generator:
        key = (*self.draws.spawn_key, step)
        return np.random.default_rng(np.random.SeedSequence(self.draws.entropy, spawn_key=key))


def _require_trainable(algorithm: str, chosen: Settings, command_max: Array) -> None:
    """InputError where several dampers, of these largest commands (m,), would be trained otherwise than can be."""
    several = f"training {len(command_max)} dampers"
    own = chosen.teacher or chosen.estimator or chosen.ground or chosen.least or chosen.pool
    if len(command_max) > 1 and (algorithm in ("es", "adjoint") or chosen.action != "command" or own):
        raise InputError(
            f"{several}: allowed: algorithms of stable-baselines3 with action: command, without teacher, estimator, "
            "ground, least and pool, as in examples/plain_ppo.yml"
        )
    if np.ptp(command_max):
        raise InputError(f"{several}: their largest commands are {command_max.tolist()}; allowed: one of all")


def explored(
    task: Task, levels: ForceLevels | None, command_max: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """(many, size) observations under random actions that are held for a while."""
    n = task.n
    rngs = list(rng.spawn(n))
    observation, found = task.reset(range(n), rngs)[0], []
    share = np.zeros(n)
    for k in range(_EXPLORED[1]):
        if k % _HELD == 0:
            share = rng.uniform(0, 1, n)
        command = share * command_max
        if levels is not None:
            force = forces(task, observation)
            velocity = velocities(task.observer, observation, {})
            sign = np.sign(velocity if levels.damping else force)
            command = levels.command(sign * share * levels.force_max, force, velocity)
        step = task.drive(command)
        observation = step.observation
        found.append(observation.copy())
        for row in np.flatnonzero(step.over).tolist():
            observation[row] = task.reset([row], rngs)[0][0]
    return np.concatenate(found)


def whitening(observations: NDArray[np.float32], floor: float = _FLOOR) -> NDArray[np.float32]:
    """(size, size) matrix W that makes the second moment of W o the identity, for observations (n, size).

    Stacked measurements are nearly the same number several times; their differences, small and telling, come out as
    large as the rest. Nothing is subtracted: rest stays zero. floor: directions whose RMS is below this share of the
    largest are held to it, so that noise is not blown up without bound.
    """
    o = observations.astype(np.float64)
    values, vectors = np.linalg.eigh(o.T @ o / len(o))
    least = max(floor**2 * float(values.max()), 1e-12)
    matrix: Any = vectors / np.sqrt(np.maximum(values, least)) @ vectors.T
    return np.asarray(matrix, dtype=np.float32)
