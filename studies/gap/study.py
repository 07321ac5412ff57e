"""One controller, one simulator, several real frames: how far apart they are, how much a diagnosis closes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp import gap as workplace
from mrdamp.compare.comparison import ratio
from mrdamp.control.base import Controller
from mrdamp.control.registry import Site
from mrdamp.diagnosis.case.folder import read_case
from mrdamp.diagnosis.run import diagnose
from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.gap import (
    CRITERIA,
    Progress,
    relative,
    relative_error,
    with_range,
)
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.simulation.criteria import Criteria
from mrdamp.structures import ShearFrame
from studies.blindtest.rig import Numbers
from studies.gap.closed_loop import write_case
from studies.gap.other_law import other_law
from studies.gap.real import EFFECTS, NONE, RealFrame, RigScenario, nominal_frame

_VERSION = 5
#: Half width of the ranges of who has no diagnosis.
_BLIND = 0.15


@dataclass(frozen=True)
class Options(workplace.Options):
    """effects: real frames, names of `EFFECTS`. draws: simulators of a randomised tuning. misfit: the real damper has
    another law than the simulator's, which is identified on bench records of it; `NONE` is then a real frame too."""

    effects: tuple[str, ...] = tuple(EFFECTS)
    draws: int = 3
    misfit: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        allowed = (*EFFECTS, NONE) if self.misfit else tuple(EFFECTS)
        for name in self.effects:
            if name not in allowed:
                raise InputError(f"gap: no effect '{name}'; allowed: {', '.join(allowed)}")
        if not 1 <= self.draws <= 20:
            raise InputError(f"gap: draws is {self.draws}; allowed: 1 to 20")


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
    scenario = RigScenario(setup.nominal, options, jobs, trainings=out / "trainings")
    progress("tuning on the nominal simulator", 0.0)
    first = scenario.tune([scenario.nominal], Site.of(scenario.nominal), _within(progress, 0.0, 0.05))
    simulated = [scenario.criteria(scenario.nominal, first, load) for load in scenario.loads]
    matched = [scenario.criteria(setup.real(NONE), first, load) for load in scenario.loads]
    alike = float(np.mean([relative_error(simulated, matched, name) for name in CRITERIA]))
    blind = None
    # A policy is learned over several simulators by the evolution strategy alone.
    if options.tuned or (scenario.learning and scenario.learning.algorithm == "es"):
        progress("tuning on a blindly randomised simulator", 0.05)
        blind = scenario.tune(_drawn_blindly(scenario.nominal, options), Site.of(scenario.nominal))
    rows = []
    for k, cause in enumerate(options.effects):
        at = 0.1 + 0.9 * k / len(options.effects)
        step = 0.9 / len(options.effects)
        key = {"version": _VERSION, "nominal": nominal.to_dict(), **asdict(replace(options, effects=(cause,)))}
        kept = _kept(out / f"{cause}.json", key)
        if kept is None:
            kept = _row(scenario, setup, options, cause, first, blind, out, _within(progress, at, step))
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
    scenario: RigScenario,
    setup: Setup,
    options: Options,
    cause: str,
    first: Controller,
    blind: Controller | None,
    out: Path,
    progress: Progress,
) -> Row:
    real = setup.real(cause)
    progress(f"{cause}: the real frame", 0.0)
    measured = [scenario.criteria(real, first, load) for load in scenario.loads]
    write_case(real, first, scenario.training, out / cause / "case", options.seed, setup.before)
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
    site = Site.of(corrected)
    retuned = scenario.tune([corrected], site, _within(progress, 0.6, 0.4))

    def on_real(controller: Controller) -> float:
        return scenario.score([scenario.criteria(real, controller, load) for load in scenario.loads])

    if blind is None:
        return replace(row, retuned=on_real(retuned))
    # Drawn together, as they go in the diagnosis' bootstrap: parameters that may trade off do so in every draw.
    drawn = [with_range(m, scenario.nominal) for m in found.drawn[: options.draws]]
    randomised = scenario.tune(drawn or [corrected], site)

    return replace(
        row,
        retuned=on_real(retuned),
        randomised=on_real(randomised),
        blind=on_real(blind),
        direct=None if scenario.learning else on_real(scenario.tune([real], site)),  # type: ignore[list-item]
    )


def _drawn_blindly(nominal: Model, options: Options) -> list[Model]:
    """The nominal simulator with masses, stiffnesses and size of the damper drawn about the nominal values."""
    rng = np.random.default_rng([options.seed, 1])
    s = nominal.structure
    assert s is not None

    def around(values: Array) -> Array:
        return values * rng.uniform(1 - _BLIND, 1 + _BLIND, np.shape(values))

    def scaled() -> Model:
        frame = ShearFrame(around(s.mass), around(s.stiffness), around(s.damping), s.damper_between)
        size = float(rng.uniform(1 - _BLIND, 1 + _BLIND))
        parameters = {
            k: v * size if k.startswith(("alpha_", "c0", "c1", "f0", "k1", "fy")) else v
            for k, v in nominal.parameters.items()
        }
        return replace(nominal, structure=frame, parameters=parameters)

    return [scaled() for _ in range(options.draws)]


def _interval(
    before: Sequence[Criteria], after: Sequence[Criteria], measured: Sequence[Criteria]
) -> tuple[float, float] | None:
    """95 %, by drawing the motions again; None for one motion, of which nothing can be drawn."""
    if len(measured) < 2:
        return None
    table = np.array(
        [[[relative(s, m, name) for name in CRITERIA] for s, m in zip(runs, measured, strict=True)]
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
