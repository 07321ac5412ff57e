"""The commands as functions: `mrdamp.identify`, `diagnose`, `compare` and `train`. They write no files but `train`'s.

`mrdamp.predict` is `mrdamp.simulation.predict.predict`. Every function raises `mrdamp.InputError`, with one line that
says what is wrong and what is allowed. progress: called with what is being done and its share, 0 to 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mrdamp.compare import Comparison
    from mrdamp.diagnosis.case.folder import Case
    from mrdamp.diagnosis.report.result import Diagnosis
    from mrdamp.identify import Fit
    from mrdamp.model import Model
    from mrdamp.records import RecordSet
    from mrdamp.train.run import Result

Progress = Callable[[str, float], None]
Files = Path | str | Sequence[Path | str]


def identify(records: RecordSet | Files, law: str = "modified_bouc_wen", **options: Any) -> Fit:
    """Fits a force law to the training part of records and evaluates it in free run on the rest.

    records: a set, or files, a folder or a packaged set for `read_records`. law: a force law
    (`mrdamp.identify.laws.parametric()`). options: of `mrdamp.identify.fit.identify` (extras, dependence, follows,
    starts, seed, ...).
    """
    from mrdamp.errors import InputError, require_kind
    from mrdamp.identify.fit import identify as fitted
    from mrdamp.records import RecordSet, read_records

    require_kind("records or their files", (RecordSet, Path, str, Sequence), records=records)
    if records is None:
        raise InputError("records is None; allowed: records or their files")
    read = records if isinstance(records, RecordSet) else read_records(records)
    return fitted(law, read.train, read.held_out, **options)


def diagnose(case: Case | Path | str, **options: Any) -> Diagnosis:
    """The cause of the difference between a simulator and a rig, with the corrected simulator.

    case: read by `read_case`, or its folder. options: of `mrdamp.diagnosis.run.diagnose` (jobs, progress, ...).
    """
    from mrdamp.diagnosis.case.folder import Case, read_case
    from mrdamp.diagnosis.run import diagnose as answered

    return answered(case if isinstance(case, Case) else read_case(case), **options)


def compare(
    structure: str = "frame",
    controllers: Sequence[str] | None = None,
    loads: Sequence[Any] | None = None,
    amplitudes: Sequence[float] | None = None,
    *,
    model: Model | Path | str | None = None,
    tune: bool = False,
    bound: int | None = None,
    jobs: int = 1,
    keep: Path | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Comparison:
    """Controllers under loads that they were not tuned on.

    structure: frame, cable or car. controllers: as of `mrdamp compare`; None: all. loads: ground motions or roads;
    None: the structure's own. amplitudes: factors on them; None: 1 for given loads. model: of the damper, or its file.
    tune: tune anew. bound: add the best commands for loads known in advance, searched for from so many runs. keep: a
    file that a stopped comparison goes on from. options: command_unit (A or V), period (s), engine (mujoco or chain),
    dampers and told (as in the command), and compression: a frame's ground motions are played five times as fast
    without it, 1 plays them as they are.
    """
    from mrdamp.compare.benches import bench_of, compared
    from mrdamp.errors import InputError, require_kind

    require_kind("frame, cable, car or file.py:NAME", str, structure=structure)
    require_kind("a list of names", (list, tuple), controllers=controllers)
    require_kind("a list of loads", (list, tuple), loads=loads)
    require_kind("a list of numbers", (list, tuple), amplitudes=amplitudes)
    for name, given in (("controllers", controllers), ("loads", loads), ("amplitudes", amplitudes)):
        if given is not None and not given:
            raise InputError(f"{name} is empty; leave it out for all")
    if not all(isinstance(c, str) for c in controllers or ()):
        raise InputError(f"controllers are {controllers!r}; allowed: names")
    require_kind("True, False", bool, tune=tune)
    bench = bench_of(structure, model, **options)
    found = compared(
        bench, controllers, loads, amplitudes, tune=tune, bound=bound, jobs=jobs, keep=keep, progress=progress
    ).result
    speed = getattr(bench, "compression", 1.0)
    if loads is not None and speed != 1.0:
        found = replace(found, notes=(*found.notes, f"ground motions are played at {speed:g} times their speed"))
    return found


def train(
    environment: str,
    out: Path | str,
    *,
    algorithm: str = "es",
    seeds: Sequence[int] = (0,),
    jobs: int = 1,
    progress: Progress | None = None,
    **options: Any,
) -> tuple[Result, ...]:
    """Trains a controller, one training a seed; policies are in `out`/seed_N/policy.json.

    environment: mrdamp/Frame-v0, mrdamp/Cable-v0 or mrdamp/QuarterCar-v0. The same call goes on where one stopped.
    options: of `mrdamp.train.settings.Options` (timesteps, model, overrides, evaluations, ...).
    """
    from mrdamp.errors import InputError
    from mrdamp.train.learn import sweep
    from mrdamp.train.settings import Options

    if not seeds:
        raise InputError("train: seeds is empty; give at least one")
    chosen = Options(environment, algorithm, seeds[0], **options)
    return sweep(chosen, Path(out), seeds, jobs=jobs, progress=progress)[0].results
