"""The commands as functions: `mrdamp.identify`, `diagnose`, `compare` and `train`. They write no files but `train`'s.

`mrdamp.predict` is `mrdamp.simulation.predict.predict`. Every function raises `mrdamp.InputError`, with one line that
says what is wrong and what is allowed. progress: called with what is being done and its share, 0 to 1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrdamp.errors import InputError, require_kind, require_path

if TYPE_CHECKING:
    from mrdamp.compare import Comparison
    from mrdamp.diagnosis.case.folder import Case
    from mrdamp.diagnosis.report.result import Diagnosis
    from mrdamp.identify import Fit
    from mrdamp.identify.laws import Dependence
    from mrdamp.model import Model
    from mrdamp.records import RecordSet
    from mrdamp.train.run import Result

Progress = Callable[[str, float], None]
Files = Path | str | Sequence[Path | str]


def identify(
    records: RecordSet | Files,
    law: str = "modified_bouc_wen",
    *,
    extras: Sequence[str] = ("offset",),
    dependence: Dependence | None = None,
    follows: Sequence[str] | None = None,
    start: Mapping[str, float] | None = None,
    starts: int = 4,
    seed: int = 0,
    hold: bool | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fits a force law to the training part of records and evaluates it in free run on the rest.

    records: a set, or files, a folder or a packaged set for `read_records`. law: a force law
    (`mrdamp.identify.laws.parametric()`). extras: effects fitted along, any of a damper's, or `auto` for those that
    left-out records pay for. The others: see `mrdamp.identify.fit.identify`.
    """
    from mrdamp.diagnosis.form import form_with, sorted_extras
    from mrdamp.diagnosis.searched import silent
    from mrdamp.identify.fit import identify as fitted
    from mrdamp.records import Record, RecordSet, read_records

    require_kind("records or their files", (RecordSet, Path, str, list, tuple), records=records)
    if not records or (isinstance(records, list | tuple) and any(isinstance(r, Record) for r in records)):
        of = "a list of Records" if records else repr(records)
        raise InputError(f"records is {of}; allowed: a RecordSet, or files of records")
    require_kind("names in a list", (list, tuple), extras=extras, follows=follows)
    require_kind("parameters by name", Mapping, start=start)
    require_kind("a whole number", int, starts=starts, seed=seed, threads=threads)
    require_kind("True, False, None", bool, hold=hold)
    if extras is None or starts < 1 or seed < 0:
        raise InputError("identify: extras is a list, starts at least 1 and seed at least 0")
    read = records if isinstance(records, RecordSet) else read_records(records)
    plain, more = sorted_extras(extras)
    fit = fitted(
        law, read.train, read.held_out, extras=plain, dependence=dependence, follows=follows, start=start,
        starts=starts, seed=seed, hold=hold, threads=threads, progress=progress,
    )  # fmt: skip
    if not more:
        return fit
    form = form_with(fit, read.train, more, threads=threads or 1, progress=progress or silent)
    return form.applied(fit, read)


def diagnose(case: Case | Path | str, *, jobs: int = 1, progress: Progress | None = None) -> Diagnosis:
    """The cause of the difference between a simulator and a rig, with the corrected simulator.

    case: read by `read_case`, or its folder. The answer does not depend on the number of jobs.
    """
    from mrdamp.diagnosis.case.folder import Case, read_case
    from mrdamp.diagnosis.run import diagnose as answered
    from mrdamp.diagnosis.searched import silent

    _require_jobs(jobs)
    if case is None:
        raise InputError("case is None; allowed: a case, or its folder")
    if not isinstance(case, Case):
        require_path(case=case)
    return answered(case if isinstance(case, Case) else read_case(case), jobs=jobs, progress=progress or silent)


def compare(
    environment: str = "frame",
    controllers: Sequence[str] | None = None,
    motions: Sequence[Any] | None = None,
    amplitudes: Sequence[float] | None = None,
    *,
    speed: float = 20.0,
    model: Model | Path | str | None = None,
    dampers: Sequence[tuple[int, int]] = (),
    told: Model | Path | str | None = None,
    command_unit: str | None = None,
    period: float | None = None,
    engine: str = "mujoco",
    compression: float | None = None,
    tune: bool = False,
    bound: int | None = None,
    jobs: int = 1,
    keep: Path | str | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Controllers under motions that they were not tuned on; arguments are named as options of `mrdamp compare`.

    environment: frame, cable, car, or file.py:NAME. controllers: None: all. motions: ground motions or roads, or their
    files; None: the structure's own. amplitudes: factors on them; None: 1 for given motions. speed: m/s, on road files.
    model: of the damper, its file or its set's name. dampers: pairs of floors of a frame. told: the frame that
    controllers know. command_unit: A or V. period: s. engine: mujoco or chain. compression: ground motions are played
    so many times as fast (5 without it). tune: tune anew. bound: add the best commands for motions known in advance,
    searched for from so many runs. keep: a file that a stopped comparison goes on from.
    """
    from mrdamp.compare.benches import bench_of, compared
    from mrdamp.model import Model

    if not isinstance(environment, str):
        raise InputError(f"environment is {environment!r}; allowed: frame, cable, car or file.py:NAME")
    files = {name: m for name, m in (("model", model), ("told", told)) if not isinstance(m, Model)}
    require_path(**files)
    require_path(keep=keep)
    require_kind("pairs of floors in a list", (list, tuple), dampers=dampers)
    require_kind("a whole number", int, bound=bound)
    _require_jobs(jobs)
    require_kind("a list of names", (list, tuple), controllers=controllers)
    require_kind("a list of motions", (list, tuple), motions=motions)
    require_kind("a list of numbers", (list, tuple), amplitudes=amplitudes)
    for name, given in (("controllers", controllers), ("motions", motions), ("amplitudes", amplitudes)):
        if given is not None and not given:
            raise InputError(f"{name} is empty; leave it out for all")
    if not all(isinstance(c, str) for c in controllers or ()):
        raise InputError(f"controllers are {controllers!r}; allowed: names")
    require_kind("True, False", bool, tune=tune)
    bench = bench_of(
        environment, model, command_unit=command_unit, period=period, engine=engine, compression=compression,
        dampers=dampers, told=told,
    )  # fmt: skip
    loads = None
    if motions is not None:
        parts = (bench.read([Path(m)], speed) if isinstance(m, Path | str) else [m] for m in motions)
        loads = [load for part in parts for load in part]
    found = compared(
        bench, controllers, loads, amplitudes, tune=tune, bound=bound, jobs=jobs, progress=progress,
        keep=None if keep is None else Path(keep),
    ).result
    speed = getattr(bench, "compression", 1.0)
    if motions is not None and speed != 1.0:
        found = replace(found, notes=(*found.notes, f"ground motions are played at {speed:g} times their speed"))
    return found


def train(
    environment: str,
    out: Path | str,
    *,
    algo: str = "es",
    seeds: Sequence[int] = (0,),
    timesteps: int | None = None,
    hyperparameters: Path | str | None = None,
    overrides: Sequence[str] = (),
    model: Path | str | None = None,
    others: Sequence[Path | str] = (),
    evaluations: int = 10,
    jobs: int = 1,
    progress: Progress | None = None,
) -> tuple[Result, ...]:
    """Trains a controller, one training a seed; policies are in `out`/seed_N/policy.json.

    environment: mrdamp/Frame-v0, mrdamp/Cable-v0, mrdamp/QuarterCar-v0, or file.py:NAME. algo: as of `mrdamp train`.
    The same call goes on where one stopped. The others: see `mrdamp.train.settings.Options`.
    """
    from mrdamp.train.learn import sweep
    from mrdamp.train.settings import Options

    if not isinstance(environment, str):
        raise InputError(f"environment is {environment!r}; allowed: the id of an environment")
    require_path(out=out or "", hyperparameters=hyperparameters, model=model)
    require_kind("a list", (list, tuple, range), seeds=seeds, overrides=overrides, others=others)
    _require_jobs(jobs)
    if not seeds or len(set(seeds)) < len(seeds):
        raise InputError(f"train: seeds is {seeds!r}; allowed: at least one, each once")
    if Path(out).is_file():
        raise InputError(f"{out}: a file; give a folder")
    yaml, damper = (None if file is None else Path(file) for file in (hyperparameters, model))
    chosen = Options(
        environment, algo, seeds[0], timesteps, yaml, tuple(overrides), damper, evaluations, tuple(map(Path, others))
    )
    (found,) = sweep(chosen, Path(out), seeds, jobs=jobs, progress=progress)
    return tuple(found.seeds[seed] for seed in seeds)


def _require_jobs(jobs: int) -> None:
    if not isinstance(jobs, int) or isinstance(jobs, bool) or jobs < 1:
        raise InputError(f"jobs is {jobs!r}; allowed: 1 or more")
