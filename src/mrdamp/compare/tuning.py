"""Controllers tuned on loads of their own: differential evolution over every option of a kind, on rows of the chain."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from scipy.optimize import differential_evolution

from mrdamp.compare.bench import UNCONTROLLED, Bench, Load, score
from mrdamp.control import registry
from mrdamp.control.base import Controller, ZeroOrderHold
from mrdamp.control.observe import Observation
from mrdamp.envs.task import Task, episodes
from mrdamp.errors import Diverged, InputError
from mrdamp.files import digest, write_atomic
from mrdamp.model.core import Array
from mrdamp.parallel import How, Job, run_all

#: Of the options' range: members for each option in a generation. The search ends where the scores of a generation
#: are as near to each other as this, or after the budget.
_MEMBERS, _FLAT = 4, 1e-3
_CHOSEN = 5  # of the start and the best settings of a search, evaluated on all loads: what is best on few may not hold
_FAILED = 10.0  # score of a setting that no controller can be made of
_SEED = 47


def _ran(bench: Bench, spec: str, load: Load, amplitude: float) -> dict[str, Any]:
    try:
        return bench.run(spec, load, amplitude)
    except Diverged as error:
        raise InputError(f"controller {spec} under {load.name} at amplitude {amplitude:g}: {error}") from None


@dataclass(frozen=True)
class Setting:
    """A tuned controller. spec; score: on the tuning loads; periods: of control, simulated for it; curve: (periods,
    best score so far) after each generation, on the loads of the search."""

    spec: str
    score: float
    periods: int = 0
    curve: Sequence[tuple[int, float]] = ()


def run_grid(
    bench: Bench,
    specs: Sequence[str],
    cases: Sequence[tuple[Load, float]],
    what: str = "runs",
    **how: Unpack[How],
) -> dict[str, list[Mapping[str, float]]]:
    """Every measure of every spec on every case of load and amplitude."""
    rows = list(dict.fromkeys([UNCONTROLLED, *specs]))
    runs = [(spec, *case) for spec in rows for case in cases]
    tasks = [Job(bench.key(*run), partial(_ran, bench, *run)) for run in runs]
    found = run_all(tasks, what, **how)
    parts = [found[k : k + len(cases)] for k in range(0, len(found), len(cases))]
    return {
        spec: [bench.values(kept, without) for kept, without in zip(part, parts[0], strict=True)]
        for spec, part in zip(rows[1:], parts[1:], strict=True)
    }


class Loops:
    """Closed loops of several controllers, each under all loads, at once on the chain.

    Attributes: task; periods, of all loops so far.
    """

    def __init__(self, bench: Bench, loads: Sequence[Load], controllers: int) -> None:
        self.bench, self.loads, self.periods = bench, loads, 0
        self.task: Task = bench.task(len(loads) * controllers)

    def scores(self, controllers: Sequence[Controller]) -> list[float]:
        """What tuning makes small, of each: the mean over the loads, as `mrdamp.compare.bench.score`."""
        means = {key: values.mean(axis=1).tolist() for key, values in self.run(controllers).items()}
        each = zip(*means.values(), strict=True)
        return [score(self.bench, dict(zip(means, row, strict=True))) for row in each]

    def run(self, controllers: Sequence[Controller]) -> dict[str, Array]:
        """The measures that make the objective, (controllers, loads) each. Controllers act at their own periods."""
        task, many, used = self.task, len(self.loads), len(self.loads) * len(controllers)
        names, period = task.rows.names, task.rows.period
        acting = [_at_every(controller, period) for controller in controllers]
        for controller in acting:
            controller.reset()
        commands, time = np.zeros((len(task.command_max), task.n)), 0.0

        def act(_: Observation) -> Array:
            nonlocal time
            measured = task.measured.T.copy()  # which the next step writes over, and controllers remember
            for k, controller in enumerate(acting):
                own = slice(k * many, (k + 1) * many)
                commands[:, own] = controller.command(time, dict(zip(names, measured[:, own], strict=True)))
            time += period
            return commands.T

        infos = [info for info, _ in self.bench.objective.values()]
        try:
            found = episodes(task, infos, [self.loads[row % many] for row in range(task.n)], act)
        except Diverged as error:
            raise InputError(f"controller {controllers[error.row // many].name} under {error}") from None
        self.periods += int(task.rows.steps[:used].sum())
        return {key: found[info][:used].reshape(-1, many) for key, (info, _) in self.bench.objective.items()}


def _at_every(controller: Controller, period: float) -> Controller:
    """The controller asked every period, s. Raises InputError for one whose own is no multiple of it."""
    every = round(controller.period / period)
    if every < 1 or abs(every * period - controller.period) > 1e-9 * period:
        raise InputError(
            f"controller {controller.name}: period is {controller.period:g} s; allowed here: multiples of {period:g} s"
        )
    return ZeroOrderHold(controller, every)


class Search:
    """One search: from points of the unit cube to specs and their scores."""

    def __init__(self, bench: Bench, kind: str) -> None:
        self.bench, self.kind = bench, kind
        self.ranges, self.loads = bench.ranges(kind), list(bench.tuning_loads())
        self.stride, self.budget = bench.effort(kind)
        members = max(5, _MEMBERS * len(self.ranges))  # as SciPy has them
        self.loops = Loops(bench, self.loads[:: self.stride], members)
        self.found: dict[str, float] = {}
        self.curve: list[tuple[int, float]] = []

    def spec(self, point: Sequence[float]) -> str:
        """Options at a point of the unit cube; a range whose lower end is above 0 is divided in the logarithm."""
        options = {}
        for share, (name, (low, high)) in zip(point, self.ranges.items(), strict=True):
            options[name] = low * (high / low) ** share if low > 0 else low + share * (high - low)
        return registry.spec(self.kind, options)

    def scores(self, specs: Sequence[str], loops: Loops) -> dict[str, float]:
        """Of specs; a large number where no such controller can be made."""
        made, found = {}, dict.fromkeys(specs, _FAILED)
        for spec in specs:
            with suppress(InputError):
                made[spec] = self.bench.controller(spec)
        return found | dict(zip(made, loops.scores(list(made.values())), strict=True))

    def __call__(self, points: Array) -> Array:
        """(members,) scores of points (options, members)."""
        if self.loops.periods >= self.budget:
            raise _Spent
        specs = [self.spec(point) for point in points.T.tolist()]
        self.found |= self.scores([spec for spec in dict.fromkeys(specs) if spec not in self.found], self.loops)
        self.curve.append((self.loops.periods, min(self.found.values())))
        return np.array([self.found[spec] for spec in specs])

    def _start(self) -> Array | None:
        """Among the first points: what the package has for this kind, or for another one with all of these options."""
        specs = [setting.spec for setting in (shipped(self.bench) or {}).values()]
        known = [registry.parse(spec, self.bench.site.options) for spec in specs]
        known.sort(key=lambda found: found[0] != self.kind)
        for *_, options in known:
            if set(self.ranges) <= set(options):
                point = []
                for name, (low, high) in self.ranges.items():
                    value = min(max(options[name], low), high)
                    log = math.log(value / low) / math.log(high / low) if low > 0 else 0.0
                    point.append(log if low > 0 else (value - low) / (high - low))
                return np.array(point)
        return None

    def run(self, seed: int = _SEED) -> Setting:
        """The best setting. Raises InputError where there is none."""
        cube, start = [(0.0, 1.0)] * len(self.ranges), self._start()
        with suppress(_Spent):
            differential_evolution(
                self, cube, x0=start, popsize=_MEMBERS, tol=_FLAT, polish=False, vectorized=True,
                updating="deferred", rng=np.random.default_rng(seed), maxiter=10_000,
            )  # fmt: skip
        every = Loops(self.bench, self.loads[:: 1 if self.stride <= 8 else 4], _CHOSEN)
        begun = [] if start is None else [self.spec(start.tolist())]
        begun += [self.spec([end]) for end in (0.0, 1.0) if len(cube) == 1]  # which no member is
        chosen = dict.fromkeys([*begun, *sorted(self.found, key=self.found.__getitem__)])
        scores = self.scores(list(chosen)[:_CHOSEN], every)
        spec = min(scores, key=scores.__getitem__)
        if scores[spec] >= _FAILED:
            raise InputError(f"tuning: no setting of {self.kind} makes a controller")
        return Setting(spec, scores[spec], self.loops.periods + every.periods, self.curve)


class _Spent(Exception):
    """The budget is used up."""


def _searched(bench: Bench, kind: str) -> dict[str, Any]:
    return vars(Search(bench, kind).run())


def tune(bench: Bench, names: Sequence[str] | None = None, **how: Unpack[How]) -> dict[str, Setting]:
    """The best setting of each named controller, of all that are tuned by default."""
    kinds = {name: bench.tuned[name] for name in (bench.tuned if names is None else names)}
    jobs = []
    for kind in kinds.values():
        key = digest(["tuning", bench.identity(), kind, dict(bench.ranges(kind)), bench.effort(kind)])
        jobs.append(Job(key, partial(_searched, bench, kind)))
    found = run_all(jobs, "tuning", **how)
    return {name: Setting(**setting) for name, setting in zip(kinds, found, strict=True)}


def shipped(bench: Bench) -> dict[str, Setting] | None:
    """The settings that come with the package, None where they belong to another bench."""
    file = resources.files("mrdamp") / "data" / "controllers" / f"{bench.environment}.json"
    return _of(json.loads(file.read_text(encoding="utf-8")), bench) if file.is_file() else None


def read_settings(path: Path, bench: Bench) -> dict[str, Setting] | None:
    """Settings of an earlier run, None where there are none or they belong to another bench."""
    try:
        return _of(json.loads(path.read_text(encoding="utf-8")), bench)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def to_dict(settings: Mapping[str, Setting], bench: Bench) -> dict[str, Any]:
    return {
        "identity": bench.identity(),
        "loads": len(bench.tuning_loads()),
        "settings": {name: vars(setting) for name, setting in settings.items()},
    }


def _of(data: Mapping[str, Any], bench: Bench) -> dict[str, Setting] | None:
    if data["identity"] != bench.identity():
        return None
    return {name: Setting(**setting) for name, setting in data["settings"].items()}


def settings_for(
    bench: Bench,
    names: Sequence[str],
    *,
    anew: bool = False,
    needed: bool = True,
    file: Path | None = None,
    **how: Unpack[How],
) -> dict[str, Setting]:
    """Of the tuned controllers among names: as shipped, as they are in a file, or (anew) tuned now and written there,
    beside what the file has of others.

    needed: without any it is an error, else the answer is empty. Raises InputError.
    """
    named = (name.rpartition("=")[2] for name in names)
    wanted = [name for name in dict.fromkeys(named) if name in bench.tuned]
    if not wanted:
        return {}
    if anew:
        found = tune(bench, wanted, **how)
        if file is not None:
            found = (read_settings(file, bench) or {}) | found
            write_atomic(file, json.dumps(to_dict(found, bench), indent=1) + "\n")
        return found
    settings = shipped(bench)
    if settings is None and file is not None:
        settings = read_settings(file, bench)
    if settings is None and needed:
        raise InputError(
            f"{wanted[0]}: not tuned for this model with these settings yet; add --tune (some minutes, kept in -o OUT)"
        )
    return settings or {}
