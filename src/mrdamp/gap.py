"""What the gap of a measured frame costs a controller at work in its simulators: ground motions, scores, tuning, and
trainings: `learned`, `learned:algorithm=ppo,timesteps=200000`.

The rig itself is not run: the corrected simulator of a diagnosis stands for it, with simulators drawn from the
diagnosis' intervals.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.control.told import told
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.run import diagnose
from mrdamp.envs.training_loads import tuning_motions, unseen_motions
from mrdamp.errors import InputError
from mrdamp.files import together, write_atomic
from mrdamp.model import Effect, Model
from mrdamp.motions import TIME_SCALE, GroundMotion
from mrdamp.parallel import mapped
from mrdamp.simulation.criteria import Criteria, evaluate
from mrdamp.simulation.stepping import FrameRun, run_frame

LEARNED = "learned"
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Learning:
    """How a policy is trained in a simulator. algorithm: of `mrdamp train`; timesteps: control periods in all, None: as
    its hyperparameters say; folder: where trainings are kept, a folder each, and go on."""

    algorithm: str
    timesteps: int | None
    seed: int
    folder: Path

    @classmethod
    def of(cls, spec: str, seed: int, folder: Path) -> Learning | None:
        """Of a controller's spec; None where it is none that is learned. Raises InputError."""
        kind, _, rest = spec.partition(":")
        if kind != LEARNED:
            return None
        given = dict.fromkeys(("algorithm", "timesteps"), "")
        for part in filter(None, rest.split(",")):
            key, _, value = part.partition("=")
            if key not in given:
                raise InputError(
                    f"controller {LEARNED}: option {key!r} is unknown; allowed: {', '.join(given)}"
                )
            given[key] = value
        steps = given["timesteps"]
        if steps and (not steps.isdecimal() or int(steps) < 1):
            raise InputError(f"controller {LEARNED}: timesteps is {steps!r}; allowed: a whole number > 0")
        return cls(given["algorithm"] or "es", int(steps) if steps else None, seed, folder)

    def train(
        self, models: Sequence[Model], site: registry.Site, progress: Progress | None = None
    ) -> Controller:
        """The policy of a training in a simulator, or over several, which continues where it was stopped.

        What a linear frame can hold of a model's effects goes into its structure. Raises InputError.
        """
        from mrdamp.train.learn import train
        from mrdamp.train.settings import Options

        simulators = [straightened(model) for model in models]
        key = "".join(json.dumps(simulator.to_dict(), sort_keys=True) for simulator in simulators)
        folder = self.folder / hashlib.sha256(key.encode()).hexdigest()[:12]
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / (f"model_{k + 1}.json" if k else "model.json") for k in range(len(simulators))]
        for simulator, file in zip(simulators, files, strict=True):
            simulator.write(file)
        others = tuple(files[1:])
        options = Options(
            algorithm=self.algorithm, seed=self.seed, timesteps=self.timesteps, model=files[0], others=others
        )
        found = train(options, folder / "training", progress)
        return told(partial(registry.make, f"{registry.POLICY}:{found.folder / 'policy.json'}"), site)


def straightened(model: Model) -> Model:
    """The same simulator with other masses, stiffnesses and damping in place of the effects that are just that."""
    linear = tuple(e for e in model.effects if _is_linear(e))
    structure = replace(model, effects=linear).built
    return replace(model, structure=structure, effects=tuple(e for e in model.effects if not _is_linear(e)))


def _is_linear(effect: Effect) -> bool:
    return effect.name in ("storey_stiffness", "floor_mass") or (
        effect.name == "storey_damping" and not effect.parameters.get("quadratic")
    )


#: What a controller is evaluated by: the largest over storeys or floors.
CRITERIA = ("peak_drift", "peak_acceleration", "rms_drift", "rms_acceleration")


@dataclass(frozen=True)
class Options:
    """controller: a kind that is tuned (`clipped-optimal`, `constant`, `force-tracking` ...); `learned`, with or
    without options, which is trained; or any other spec, which is left as it is (`policy:FILE`). loads: unseen motions.
    """

    controller: str = "clipped-optimal"
    loads: int = 4
    seed: int = 1

    def __post_init__(self) -> None:
        most = len(unseen_motions())
        if not 1 <= self.loads <= most:
            raise InputError(f"gap: loads is {self.loads}; allowed: 1 to {most}")
        if self.learning is None:
            registry.parse(self.controller)

    @property
    def learning(self) -> Learning | None:
        """How the controller is learned, None where it is not. Raises InputError."""
        return Learning.of(self.controller, self.seed, Path())

    @property
    def tuned(self) -> bool:
        """Is the controller tuned in a simulator?"""
        return self.learning is None and is_tuned(self.controller)


class Scenario:
    """A controller's workplace. trainings: folder where what is learned is kept."""

    def __init__(self, nominal: Model, options: Options, jobs: int = 1, *, trainings: Path = Path("trainings")) -> None:
        self.nominal, self.controller, self.jobs = nominal, options.controller, jobs
        self.learning = Learning.of(options.controller, options.seed, trainings)
        self.loads = [m.compressed(TIME_SCALE) for m in unseen_motions()[: options.loads]]
        self.training = [m.compressed(TIME_SCALE) for m in tuning_motions()]
        # By name: a process that tunes has copies of the motions.
        self._reference = {m.name: self.criteria(nominal, None, m) for m in (*self.loads, *self.training)}

    def of(self, run: FrameRun) -> Criteria:
        assert self.nominal.structure is not None
        frame, largest = self.nominal.structure, self.nominal.attributes["command_max"]
        return evaluate(frame, run.time, run.drift, run.acceleration, run.force, run.stroke, run.command, largest)

    def criteria(self, plant: Model, controller: Controller | None, load: GroundMotion) -> Criteria:
        """Of a run in MuJoCo."""
        return self.of(run_frame(plant, load, controller))

    def score(self, criteria: Sequence[Criteria], loads: Sequence[GroundMotion] | None = None) -> float:
        values = []
        for c, load in zip(criteria, self.loads if loads is None else loads, strict=True):
            free = self._reference[load.name]
            drift = c.peak_drift.max() / free.peak_drift.max()
            values.append((drift + c.peak_acceleration.max() / free.peak_acceleration.max()) / 2)
        return float(np.mean(values))

    def tune(
        self, plants: Sequence[Model], site: registry.Site, progress: Progress | None = None
    ) -> Controller:
        """The controller made for a site that is best on average over simulators and tuning motions."""
        if self.learning:
            return self.learning.train(plants, site, progress)
        if not is_tuned(self.controller):
            return told(partial(registry.make, self.controller), site)
        specs = candidates(self.controller, site)
        tasks = [(self, p, spec, site) for spec in specs for p in plants]
        found = np.reshape(list(mapped(_tuning_score, tasks, self.jobs)), (len(specs), len(plants)))
        return told(partial(registry.make, specs[int(np.argmin(found.mean(axis=1)))]), site)


def candidates(kind: str, site: registry.Site) -> tuple[str, ...]:
    """Specs of a kind that a study tries: runs on a real frame are few. Raises InputError for one without options."""
    frame, largest = site.frame, site.command_max
    mass, first = float(frame.mass.sum()), 2 * math.pi * float(frame.frequencies[0])
    weights, noise = [k / mass**2 for k in (1e-3, 1e-1)], [50.0, 2000.0]
    balances = [30.0, 100.0, 300.0, 1000.0]
    optimal = {"balance": balances, "r": weights, "noise_ratio": noise}
    choices: Mapping[str, Mapping[str, Sequence[float]]] = {
        "constant": {"value": [largest * k / 20 for k in (0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 18, 20)]},
        "clipped-optimal": {**optimal, "balance": [1.0, 10.0, *balances, 3000.0], "level": [0.6, 1.0]},
        "modulated-optimal": {
            **optimal,
            "r": weights[1:],
            "force_max": [site.force_max * k for k in (0.1, 0.2, 0.5)],
        },
        "force-tracking": {**optimal, "balance": [10.0, *balances]},
        "lyapunov": {"balance": [0.0, 1.0, 10.0, 100.0, 1000.0], "noise_ratio": noise},
        "skyhook": {
            "damping": [first * mass * k for k in (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)],
            "leak": [2 * math.pi / first * k for k in (1.0, 2.0)],
        },
    }
    if kind not in choices:
        raise InputError(f"tuning: nothing to tune in {kind}; allowed: {', '.join(choices)}")
    chosen = choices[kind]
    points = [dict(zip(chosen, point, strict=True)) for point in itertools.product(*chosen.values())]
    return tuple(registry.spec(kind, point) for point in points)[:: 1 if kind == "constant" else 3]


def is_tuned(controller: str) -> bool:
    """A kind by its name alone is tuned; one with options, or a policy's file, is left as it is."""
    return ":" not in controller


def _tuning_score(scenario: Scenario, plant: Model, spec: str, site: registry.Site) -> float:
    controller = told(partial(registry.make, spec), site)
    return scenario.score(
        [scenario.criteria(plant, controller, load) for load in scenario.training], scenario.training
    )


def with_range(model: Model, nominal: Model) -> Model:
    """A model with the command's range, which a corrected simulator need not carry."""
    ends = {k: v for k, v in nominal.parameters.items() if k.startswith("command_")}
    return replace(model, parameters={**ends, **model.parameters})


def relative(simulated: Criteria, measured: Criteria, name: str) -> float:
    """Relative error of a criterion, the largest over storeys or floors."""
    return abs(float(np.max(getattr(simulated, name)) / np.max(getattr(measured, name))) - 1)


def relative_error(simulated: Sequence[Criteria], measured: Sequence[Criteria], name: str) -> float:
    """Mean relative error of a criterion over the motions."""
    return float(np.mean([relative(s, m, name) for s, m in zip(simulated, measured, strict=True)]))


Interval = tuple[float, float]


@dataclass(frozen=True)
class CaseGap:
    """verdict, named: of the diagnosis; gap: of the corrected simulator. motions: unseen ones. error: of the nominal
    simulator in the controller's criteria, mean relative, against the corrected one. Scores (as in `Row`): promised, of
    the controller tuned on the nominal simulator, there; kept, of the same in the corrected one; retuned, of the one
    tuned on the corrected one, there; None if it is not tuned. Intervals: 2.5 and 97.5 % over the drawn simulators in
    place of the corrected one; None without any.
    """

    case: str
    controller: str
    verdict: str
    named: tuple[str, ...]
    gap: float
    motions: tuple[str, ...]
    error: float
    error_interval: Interval | None
    promised: float
    kept: float
    kept_interval: Interval | None
    retuned: float | None = None
    retuned_interval: Interval | None = None


def of_case(
    options: Options, case: Case, out: Path, *, jobs: int = 1, progress: Progress = lambda what, share: None
) -> CaseGap:
    """Diagnoses a frame's case, runs the controller in its simulators, and writes gap.json, diagnosis.txt and
    corrected.json. Raises InputError.
    """
    if case.model.rig != "frame":
        raise InputError(f"{case.name}: the case is of a damper; allowed: a case of rig 'frame'")
    nominal = case.model
    if "command_max" not in nominal.parameters:
        largest = max(float(np.max(np.abs(r.command))) for r in case.records)
        nominal = replace(nominal, parameters={**nominal.parameters, "command_max": largest})
    scenario = Scenario(nominal, options, jobs, trainings=out / "trainings")
    progress("tuning on the nominal simulator", 0.0)
    first = scenario.tune([nominal], registry.Site.of(nominal))
    progress("diagnosis", 0.2)
    found = diagnose(case, jobs=jobs)
    corrected, drawn = with_range(found.corrected, nominal), [with_range(m, nominal) for m in found.drawn]
    progress("the controller in the corrected simulator", 0.6)

    def ran(model: Model, controller: Controller) -> list[Criteria]:
        return [scenario.criteria(model, controller, load) for load in scenario.loads]

    before, after = ran(nominal, first), ran(corrected, first)
    others = [ran(m, first) for m in drawn]
    answer = CaseGap(
        case.name,
        options.controller,
        found.verdict,
        tuple(e.effect if e.place is None else f"{e.effect}@{e.place}" for e in found.effects),
        found.gap.corrected,
        tuple(load.name for load in scenario.loads),
        _error(before, after),
        _interval([_error(before, other) for other in others]),
        scenario.score(before),
        scenario.score(after),
        _interval([scenario.score(other) for other in others]),
    )
    if options.tuned or scenario.learning:
        progress("tuning again", 0.75)
        again = scenario.tune([corrected], registry.Site.of(corrected))
        answer = replace(
            answer,
            retuned=scenario.score(ran(corrected, again)),
            retuned_interval=_interval([scenario.score(ran(m, again)) for m in drawn]),
        )
    out.mkdir(parents=True, exist_ok=True)
    with together():
        write_atomic(out / "diagnosis.txt", f"{found.sentence}\n")
        corrected.write(out / "corrected.json")
        write_atomic(out / "gap.json", json.dumps(asdict(answer), indent=1) + "\n")
    return answer


def rows(found: CaseGap) -> list[tuple[str, str]]:
    """What is printed: name and value."""
    said = [
        ("diagnosis", " + ".join(found.named) or found.verdict),
        ("gap of the corrected simulator", f"{100 * found.gap:.1f} % of the records"),
        ("motions", f"{', '.join(found.motions)}, at five times their speed"),
        ("score", "mean of peak drift and peak acceleration over those without a damper; less is better"),
        ("error of the nominal simulator", _said(100 * found.error, found.error_interval, 100, " %")),
        ("score promised by the nominal simulator", f"{found.promised:.3f}"),
        ("score in the corrected one", _said(found.kept, found.kept_interval)),
    ]
    if found.verdict == "unknown":
        said.append(("check", "the cause is not known: the corrected simulator is not the rig, and no figure is its"))
    if found.retuned is not None:
        said.append(("tuned again on the corrected one", _said(found.retuned, found.retuned_interval)))
    return said


def _said(value: float, ends: Interval | None, scale: float = 1.0, unit: str = "") -> str:
    digits = 1 if unit else 3
    text = f"{value:.{digits}f}{unit}"
    return text if ends is None else f"{text} ({scale * ends[0]:.{digits}f} to {scale * ends[1]:.{digits}f})"


def _error(before: Sequence[Criteria], after: Sequence[Criteria]) -> float:
    return float(np.mean([relative_error(before, after, name) for name in CRITERIA]))


def _interval(values: Sequence[float]) -> Interval | None:
    if not values:
        return None
    low, high = np.percentile(values, [2.5, 97.5])
    return float(low), float(high)
