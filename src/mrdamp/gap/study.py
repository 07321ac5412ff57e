"""One controller, one simulator, several real frames: how far apart they are, how much a diagnosis closes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp.blindtest.rig import Numbers
from mrdamp.compare.motions import unseen_motions
from mrdamp.compare.summary import ratio
from mrdamp.control import registry
from mrdamp.control.base import Controller
from mrdamp.diagnosis.case.folder import read_case
from mrdamp.diagnosis.run import diagnose
from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.gap.closed_loop import write_case
from mrdamp.gap.learned import Learning
from mrdamp.gap.other_law import other_law
from mrdamp.gap.real import EFFECTS, NONE, RealFrame
from mrdamp.gap.scenario import Scenario, is_tuned, nominal_frame
from mrdamp.model import Model
from mrdamp.simulation.criteria import Criteria

Progress = Callable[[str, float], None]

#: What a controller is evaluated by: the largest over storeys or floors.
CRITERIA = ("peak_drift", "peak_acceleration", "rms_drift", "rms_acceleration")
_VERSION = 5


@dataclass(frozen=True)
class Options:
    """controller: a kind that is tuned (`clipped-optimal`, `constant`, `force-tracking` ...); `learned`, with or
    without options, which is trained; or any other spec, which is left as it is (`policy:FILE`). effects: real frames,
    names of `EFFECTS`. loads: unseen motions. draws: simulators of a randomised tuning. misfit: the real damper has
    another law than the simulator's, which is identified on bench records of it; `NONE` is then a real frame too."""

    controller: str = "clipped-optimal"
    effects: tuple[str, ...] = tuple(EFFECTS)
    loads: int = 4
    draws: int = 3
    seed: int = 1
    misfit: bool = False

    def __post_init__(self) -> None:
        allowed = (*EFFECTS, NONE) if self.misfit else tuple(EFFECTS)
        for name in self.effects:
            if name not in allowed:
                raise InputError(f"gap: no effect '{name}'; allowed: {', '.join(allowed)}")
        for name, least, most in (("loads", 1, len(unseen_motions())), ("draws", 1, 20)):
            if not least <= getattr(self, name) <= most:
                raise InputError(f"gap: {name} is {getattr(self, name)}; allowed: {least} to {most}")
        if self.learning is None:
            registry.parse(self.controller)

    @property
    def learning(self) -> Learning | None:
        """How the controller is learned, None where it is not. Raises InputError."""
        return Learning.of(self.controller, self.seed, Path())

    @property
    def tuned(self) -> bool:
        """Is the controller tuned in the simulator, with draws of it in addition?"""
        return self.learning is None and is_tuned(self.controller)


@dataclass(frozen=True)
class Row:
    """One real frame.

    verdict, named: of the diagnosis. nominal, corrected: the simulators' mean relative error in the criteria, for the
    controller tuned on the nominal one; real: that controller's score on the real frame. retuned, randomised, blind,
    direct: scores on the real frame after tuning on the corrected simulator, on draws from its ranges, on draws of the
    nominal one, and on the real frame itself. None for a controller that is not tuned; for one that is learned the
    last, and all but the first where its algorithm learns in one simulator alone. A score is the mean of peak drift
    and peak acceleration over those without a damper in the nominal simulator.
    """

    cause: str
    verdict: str
    named: tuple[str, ...]
    nominal: float
    corrected: float
    real: float
    errors: Mapping[str, tuple[float, float]]  # criterion -> relative error, nominal and corrected
    interval: tuple[float, float] | None  # of `closed`, over the motions; None for one motion
    retuned: float | None = None
    randomised: float | None = None
    blind: float | None = None
    direct: float | None = None

    @property
    def closed(self) -> float:
        """Share of the performance gap that the correction closes."""
        return 1 - self.corrected / self.nominal


@dataclass(frozen=True)
class Study:
    """All real frames of one controller; promised: its score in the nominal simulator; alike: that simulator's error
    against the rig without an effect, what the two programs differ by, or the two laws. law, misfit: the simulator's
    law and its error on bench tests, if the real damper has another law."""

    controller: str
    promised: float
    alike: float
    rows: tuple[Row, ...] = field(default=())
    law: str = ""
    misfit: float = 0.0


def study(
    options: Options,
    out: Path,
    *,
    nominal: Model | None = None,
    jobs: int = 1,
    progress: Progress = lambda what, share: None,
) -> Study:
    """Runs it. Each finished real frame is kept in OUT/CAUSE.json, and the same options continue there.

    nominal: the simulator, a frame of three storeys without effects; None: that of Dyke et al. Raises InputError.
    """
    nominal = nominal_frame() if nominal is None else nominal
    RealFrame(nominal, NONE)
    out.mkdir(parents=True, exist_ok=True)
    other = None
    if options.misfit:
        progress("identifying a damper with another law", 0.0)
        other = other_law(nominal, options.seed)
    setup = Setup(nominal if other is None else other.nominal, None if other is None else other.numbers)
    scenario = Scenario(
        setup.nominal,
        options.controller,
        options.loads,
        options.draws,
        options.seed,
        jobs,
        trainings=out / "trainings",
    )
    progress("tuning on the nominal simulator", 0.0)
    first = scenario.tune([scenario.nominal], scenario.site(scenario.nominal), _within(progress, 0.0, 0.05))
    simulated = [scenario.criteria(scenario.nominal, first, load) for load in scenario.loads]
    matched = [scenario.criteria(setup.real(NONE), first, load) for load in scenario.loads]
    alike = float(np.mean([relative_error(simulated, matched, name) for name in CRITERIA]))
    blind = None
    if options.tuned or scenario.robust:
        progress("tuning on a blindly randomised simulator", 0.05)
        blind = scenario.tune(scenario.blind(), scenario.site(scenario.nominal))
    rows = []
    for k, cause in enumerate(options.effects):
        at = 0.1 + 0.9 * k / len(options.effects)
        step = 0.9 / len(options.effects)
        key = {"version": _VERSION, "nominal": nominal.to_dict(), **asdict(replace(options, effects=(cause,)))}
        kept = _kept(out / f"{cause}.json", key)
        if kept is None:
            kept = _row(scenario, setup, cause, first, blind, out, _within(progress, at, step))
            write_atomic(
                out / f"{cause}.json", json.dumps({"key": key, "row": asdict(kept)}, indent=1) + "\n"
            )
        rows.append(kept)
    law, misfit = ("", 0.0) if other is None else (other.nominal.law, other.misfit)
    return Study(options.controller, scenario.score(simulated), alike, tuple(rows), law, misfit)


@dataclass(frozen=True)
class Setup:
    """What all real frames share: the nominal simulator, and the real damper's parameters if its law is another."""

    nominal: Model
    damper: Numbers | None

    def real(self, cause: str) -> RealFrame:
        return RealFrame(self.nominal, cause, self.damper)

    @property
    def before(self) -> RealFrame | None:
        """The real frame when a simulator with a wrong law was made; its records are the baseline."""
        return None if self.damper is None else self.real(NONE)


def _within(progress: Progress, at: float, width: float) -> Progress:
    return lambda what, share: progress(what, at + share * width)


def _row(
    scenario: Scenario,
    setup: Setup,
    cause: str,
    first: Controller,
    blind: Controller | None,
    out: Path,
    progress: Progress,
) -> Row:
    real = setup.real(cause)
    progress(f"{cause}: the real frame", 0.0)
    measured = [scenario.criteria(real, first, load) for load in scenario.loads]
    write_case(real, first, scenario.training, out / cause / "case", scenario.seed, setup.before)
    progress(f"{cause}: diagnosis", 0.15)
    found = diagnose(read_case(out / cause / "case"), jobs=scenario.jobs)
    write_atomic(out / cause / "diagnosis.json", json.dumps(found.to_dict(), indent=1) + "\n")
    corrected = with_range(found.corrected, scenario.nominal)
    corrected.write(out / cause / "corrected.json")
    progress(f"{cause}: the corrected simulator", 0.5)
    before = [scenario.criteria(scenario.nominal, first, load) for load in scenario.loads]
    after = [scenario.criteria(corrected, first, load) for load in scenario.loads]
    errors = {
        name: (relative_error(before, measured, name), relative_error(after, measured, name)) for name in CRITERIA
    }
    row = Row(
        cause,
        found.verdict,
        tuple(e.effect if e.place is None else f"{e.effect}@{e.place}" for e in found.effects),
        float(np.mean([e[0] for e in errors.values()])),
        float(np.mean([e[1] for e in errors.values()])),
        scenario.score(measured),
        errors,
        _interval(before, after, measured),
    )
    if blind is None and scenario.learning is None:
        return row
    progress(f"{cause}: tuning again", 0.6)
    site = scenario.site(corrected)
    retuned = scenario.tune([corrected], site, _within(progress, 0.6, 0.4))

    def on_real(controller: Controller) -> float:
        return scenario.score([scenario.criteria(real, controller, load) for load in scenario.loads])

    if blind is None:
        return replace(row, retuned=on_real(retuned))
    # Drawn together, as they go in the diagnosis' bootstrap: parameters that may trade off do so in every draw.
    drawn = [with_range(m, scenario.nominal) for m in found.drawn[: scenario.draws]]
    randomised = scenario.tune(drawn or [corrected], site)

    return replace(
        row,
        retuned=on_real(retuned),
        randomised=on_real(randomised),
        blind=on_real(blind),
        direct=None if scenario.learning else on_real(scenario.tune([real], site)),
    )


def with_range(model: Model, nominal: Model) -> Model:
    """A model with the command's range, which a corrected simulator need not carry."""
    ends = {k: v for k, v in nominal.parameters.items() if k.startswith("command_")}
    return replace(model, parameters={**ends, **model.parameters})


def _largest(c: Criteria, name: str) -> float:
    return float(np.max(getattr(c, name)))


def _relative(simulated: Criteria, measured: Criteria, name: str) -> float:
    return abs(_largest(simulated, name) / _largest(measured, name) - 1)


def relative_error(simulated: Sequence[Criteria], measured: Sequence[Criteria], name: str) -> float:
    """Mean relative error of a criterion over the motions."""
    return float(np.mean([_relative(s, m, name) for s, m in zip(simulated, measured, strict=True)]))


def _interval(
    before: Sequence[Criteria], after: Sequence[Criteria], measured: Sequence[Criteria]
) -> tuple[float, float] | None:
    """95 %, by drawing the motions again; None for one motion, of which nothing can be drawn."""
    if len(measured) < 2:
        return None
    table = np.array(
        [[[_relative(s, m, name) for name in CRITERIA] for s, m in zip(runs, measured, strict=True)]
         for runs in (before, after)]
    ).mean(axis=2)  # fmt: skip
    _, low, high = ratio(*(one[None, :, None] for one in table[::-1]))
    return 1 - high, 1 - low


def _kept(path: Path, key: Mapping[str, Any]) -> Row | None:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data["key"] != json.loads(json.dumps(key)):
            return None
        row = data["row"]
        pairs = {k: (v[0], v[1]) for k, v in row["errors"].items()}
        interval = row["interval"] and tuple(row["interval"])
        return Row(**{**row, "named": tuple(row["named"]), "errors": pairs, "interval": interval})
    except (OSError, ValueError, KeyError, TypeError):
        return None
