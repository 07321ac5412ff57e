"""The bench of each structure by name, and a whole comparison on one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, Unpack

from mrdamp.compare.bench import Bench
from mrdamp.compare.bound import with_bounds
from mrdamp.compare.cable import CableBench
from mrdamp.compare.car import CarBench
from mrdamp.compare.comparison import Comparison, compare, distinct
from mrdamp.compare.contenders import contenders, shipped_policies
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import FrameBench
from mrdamp.compare.goals import GoalBench
from mrdamp.compare.runner import How
from mrdamp.compare.spread import with_spread
from mrdamp.compare.tuning import Setting, settings_for
from mrdamp.envs.linear import own_kind
from mrdamp.errors import InputError, require_positive
from mrdamp.model import Model
from mrdamp.motions import TIME_SCALE
from mrdamp.outside import NAMED
from mrdamp.structures import dyke1996

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

    model: of the damper, or its file; None: the published one. command_unit: A or V; None: V for the published model,
    else A. period: s; None: 1 ms of the frame, else 5 ms. compression: of the time of ground
    motions, None: five times. Of a frame alone: dampers: pairs of floors between which it
    has dampers; none: its model's. told: what controllers of a frame are told in place of the model.
    """
    if structure not in STRUCTURES and not NAMED.fullmatch(structure):
        raise InputError(f"environment {structure!r} is unknown; there are {', '.join(STRUCTURES)}, file.py:NAME")
    if command_unit not in (None, "A", "V"):
        raise InputError(f"command_unit is {command_unit!r}; allowed: A, V")
    kind = STRUCTURES.get(structure)
    unit = command_unit or ("V" if model is None else "A")
    read = model if model is None or isinstance(model, Model) else Model.read(model)
    fast = TIME_SCALE if compression is None else compression
    require_positive("compare", compression=fast)
    if kind == "frame":
        lied = None if told is None else _framed(told if isinstance(told, Model) else Model.read(told), dampers)
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
