"""The bench of each structure by name, and a whole comparison on one: also with bounds, and on other structures."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np

from mrdamp import sets
from mrdamp.compare import clairvoyant
from mrdamp.compare.beam import WIDTHS
from mrdamp.compare.bench import Bench, Load
from mrdamp.compare.car import CarBench
from mrdamp.compare.comparison import Comparison, compare, distinct
from mrdamp.compare.contenders import Contender, contenders, shipped_policies
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import FrameBench
from mrdamp.compare.linear import CableBench, GoalBench
from mrdamp.compare.tuning import Loops, Setting, settings_for
from mrdamp.control import registry
from mrdamp.envs.linear import own_kind
from mrdamp.errors import InputError, require_one_of, require_positive
from mrdamp.files import digest
from mrdamp.model import Model
from mrdamp.motions import TIME_SCALE, GroundMotion
from mrdamp.outside import NAMED
from mrdamp.parallel import How, Job, run_all
from mrdamp.structures import dyke1996

_VERSION = 2  # of the search


def _key(bench: Bench, load: Load, amplitude: float, starts: Mapping[str, Sequence[str]]) -> str:
    """Of the searches for one load at one amplitude."""
    specs = {name: [bench.key(spec, load, amplitude) for spec in some] for name, some in starts.items()}
    effort = {**vars(clairvoyant.Effort()), "widths": WIDTHS}
    return hashlib.sha256(json.dumps([_VERSION, effort, specs]).encode()).hexdigest()[:32]


def with_bounds(
    bench: Bench,
    result: Comparison,
    loads: Sequence[Load],
    *,
    starts: int = 1,
    **how: Unpack[How],
) -> Comparison:
    """A comparison with the bench's bounds as rows of their own, searched for from the best `starts` runs of each case.

    A bound is not worse than any controller of the comparison in any case. loads: those of the result. Raises
    InputError.
    """
    if not bench.bounds:
        raise InputError(
            f"compare: there is no clairvoyant command for the {bench.environment}; leave --bound out"
        )
    if starts < 1:
        raise InputError(f"compare: bound from {starts} controllers; allowed: 1 or more")
    result = replace(result, base=bench.base)
    result.start_of_way()
    jobs = []
    for (i, load), (j, amplitude) in itertools.product(enumerate(loads), enumerate(result.amplitudes)):
        best = {name: _best(result, weights, i, j)[:starts] for name, weights in bench.bounds.items()}
        jobs.append(Job(_key(bench, load, amplitude, best), partial(bench.clairvoyant, best, load, amplitude)))
    found = run_all(jobs, "bound", **how)
    shape = 1, len(loads), len(result.amplitudes)
    values = {
        name: {
            m.key: np.array([f[name]["values"][m.key] for f in found]).reshape(shape) for m in bench.measures
        }
        for name in bench.bounds
    }
    rows = tuple(Contender(name, (name,), bound=True) for name in bench.bounds)
    paths = {
        (load.name, amplitude): {name: f[name]["paths"] for name in bench.bounds}
        for (load, amplitude), f in zip(itertools.product(loads, result.amplitudes), found, strict=True)
    }
    return replace(
        result,
        contenders=(*result.contenders, *rows),
        values={**result.values, **values},
        bounds=dict(bench.bounds),
        paths=paths,
    )


def _best(result: Comparison, weights: Mapping[str, float], load: int, amplitude: int) -> tuple[str, ...]:
    """Specs of the controllers of a damper, the best in one case first."""
    rated = {
        spec: float(value)
        for c in result.contenders
        if not c.bound and not any(spec.partition(":")[0] == registry.IDEAL for spec in c.specs)
        for spec, value in zip(c.specs, result.score(c.name, weights)[:, load, amplitude], strict=True)
    }
    return tuple(sorted(rated, key=rated.__getitem__))


PARTS = ("stiffness", "mass")


def scaled(model: Model, part: str, factor: float) -> Model:
    """The model of a frame with the stiffness of every storey, or the mass of every floor, times a factor."""
    assert model.structure is not None
    return replace(model, structure=replace(model.structure, **{part: factor * getattr(model.structure, part)}))


def _on_rows(bench: FrameBench, specs: Sequence[str], loads: Sequence[GroundMotion]) -> dict[str, Any]:
    """Measures of a controller, all of its seeds, under loads as the frame feels them."""
    found = Loops(bench, loads, len(specs)).run([bench.controller(spec) for spec in specs])
    return {key: values.tolist() for key, values in found.items()}


def on_rows(
    benches: Mapping[str, FrameBench],
    rows: Sequence[Contender],
    loads: Sequence[GroundMotion],
    amplitudes: Sequence[float],
    **how: Unpack[How],
) -> dict[str, Comparison]:
    """Comparisons on several benches, whose measures are those that make the objective."""
    shape = len(loads), len(amplitudes)
    jobs = []
    for bench, row in itertools.product(benches.values(), rows):
        key = digest(["rows", *(bench.key(*case) for case in itertools.product(row.specs, loads, amplitudes))])
        played = [bench.played(load, a) for load in loads for a in amplitudes]
        jobs.append(Job(key, partial(_on_rows, bench, row.specs, played)))
    results = iter(run_all(jobs, "structures", **how))
    found = {}
    for name, bench in benches.items():
        values = {
            row.name: {key: np.array(each).reshape(-1, *shape) for key, each in next(results).items()} for row in rows
        }
        found[name] = Comparison(
            tuple(rows), tuple(m for m in bench.measures if m.key in bench.objective), tuple(m.name for m in loads),
            tuple(amplitudes), values, base=bench.base,
            objective={key: weight for key, (_, weight) in bench.objective.items()},
        )  # fmt: skip
    return found


def with_spread(
    bench: FrameBench,
    result: Comparison,
    loads: Sequence[GroundMotion],
    percent: Sequence[float],
    **how: Unpack[How],
) -> Comparison:
    """The comparison, with `others`: stiffness and mass less and more by each percentage, on rows of the chain.

    percent: above 0 and below 100.
    """
    # An ideal actuator is no damper, and rows have dampers.
    rows = [c for c in result.contenders if not c.bound and not registry.is_ideal(c.specs[0])]
    if result.base not in [c.name for c in rows]:
        rows.insert(0, Contender(result.base, (result.base,)))
    signed, told = sorted({sign * p for p in percent for sign in (-1, 1)}), bench.told or bench.model
    benches = {
        f"{part} {p:+g} %": replace(bench, model=scaled(bench.model, part, 1 + p / 100), told=told)
        for part in PARTS
        for p in signed
    }
    others = on_rows(benches, rows, loads, result.amplitudes, **how)
    return replace(result, others=others)


#: Name, or id of the environment with or without its namespace -> structure.
STRUCTURES = {
    name: kind
    for kind, identity in (("frame", "Frame-v0"), ("cable", "Cable-v0"), ("car", "QuarterCar-v0"))
    for name in (kind, identity, f"mrdamp/{identity}")
}


def bench_of(
    structure: str,
    model: Model | Path | str | None = None,
    *,
    command_unit: str | None = None,
    period: float | None = None,
    engine: str = "mujoco",
    compression: float | None = None,
    dampers: Sequence[tuple[int, int]] = (),
    told: Model | Path | str | None = None,
) -> Bench:
    """The bench of a structure. Raises InputError.

    model: of the damper, its file or its set's name; None: the published one. command_unit: A or V; None: V for the
    published model, that of a parameter set of the model's name, else A. period: s; None: 1 ms of the frame, else 5 ms.
    compression: of the time of ground motions, None: five times. Of a frame alone: dampers: pairs of floors between
    which it has dampers; none: its model's. told: what controllers of a frame are told in place of the model.
    """
    if structure not in STRUCTURES and not NAMED.fullmatch(structure):
        raise InputError(f"environment {structure!r} is unknown; there are {', '.join(STRUCTURES)}, file.py:NAME")
    if command_unit is not None:
        require_one_of("", ("A", "V"), command_unit=command_unit)
    kind = STRUCTURES.get(structure)
    read = None if model is None else sets.named_model(model)
    published = read is not None and read.name in sets.names()
    unit = command_unit or ("V" if read is None else sets.load(read.name).command.unit if published else "A")
    fast = TIME_SCALE if compression is None else compression
    require_positive("compare", compression=fast)
    if kind == "frame":
        lied = None if told is None else _framed(sets.named_model(told), dampers)
        shown = _framed(frame_model() if read is None else read, dampers)
        return FrameBench(shown, unit, fast, 1e-3 if period is None else period, engine=engine, told=lied)
    for option, own in (("dampers", dampers), ("told", told)):
        if own:
            raise InputError(f"--{option} is for a frame; leave it out")
    if compression is not None and kind is not None:
        raise InputError("--compression is for ground motions; leave it out")
    given: dict[str, Any] = {} if read is None else {"model": read}
    others: dict[str, Any] = {"command_unit": unit, "period": 5e-3 if period is None else period, "engine": engine}
    if kind is None:
        return GoalBench(own_kind(structure)(**given), compression=fast, **others)
    return CableBench(**given, **others) if kind == "cable" else CarBench(**given, **others)


class Compared(NamedTuple):
    """loads: those of the result; settings: of its tuned controllers."""

    result: Comparison
    loads: Sequence[Any]
    settings: Mapping[str, Setting]


def compared(
    bench: Bench,
    controllers: Sequence[str] | None = None,
    loads: Sequence[Any] | None = None,
    amplitudes: Sequence[float] | None = None,
    *,
    tune: bool = False,
    tuned: Path | None = None,
    percent: Sequence[float] | None = None,
    bound: int | None = None,
    **how: Unpack[How],
) -> Compared:
    """What `mrdamp compare` does. Raises InputError.

    controllers: names, None: all, the tuned ones where they have settings. loads: None: the bench's own. amplitudes:
    None: 1 for given loads. tune: anew; tuned: the file of their settings. percent: of `with_spread`. bound: as
    `starts` of `with_bounds`.
    """
    shipped = shipped_policies(bench.environment)
    names = list(controllers or (*bench.default, *shipped))
    # Tuning takes minutes: what is wrong with a file or a name is said before.
    contenders(bench, [name for name in names if name.rpartition("=")[2] not in bench.tuned], {}, shipped)
    settings = settings_for(bench, names, anew=tune, needed=bool(controllers), file=tuned, **how)
    if not settings and not controllers:
        names = [name for name in names if name not in bench.tuned]
    factors = amplitudes or (bench.unseen_amplitudes if loads is None else (1.0,))
    under = bench.unseen_loads() if loads is None else loads
    result = compare(bench, contenders(bench, names, settings, shipped), under, factors, **how)
    under = distinct(bench, under)
    if percent:
        assert isinstance(bench, FrameBench)
        result = with_spread(bench, result, under, percent, **how)
    if bound is not None:
        result = with_bounds(bench, result, under, starts=bound, **how)
    named = {name.rpartition("=")[2] for name in names}
    return Compared(result, under, {name: s for name, s in settings.items() if name in named})


def _framed(model: Model, dampers: Sequence[tuple[int, int]]) -> Model:
    """A model of a frame; of a damper in the published one."""
    frame = dyke1996() if model.structure is None else model.structure
    if dampers:
        frame = replace(frame, damper_between=dampers[0], others=tuple(dampers[1:]))
    return replace(model, rig="frame", structure=frame)
