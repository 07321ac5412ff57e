"""A model's free run over a record's inputs, as a file."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from mrdamp.errors import InputError, require_path
from mrdamp.files import write_atomic
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record, read_record
from mrdamp.records.csv_file import rendered
from mrdamp.records.log_filter import (
    AS_SENT,
    FACTOR,
    FILTERED,
    LOG,
    LOGGER,
    finer,
    held,
    logged,
    rings_before_jumps,
    without_waves,
)
from mrdamp.records.motion import noise
from mrdamp.records.smoothing import smoothed
from mrdamp.records.upsampling import FineInputs, repaired_ends, upsampled
from mrdamp.sets import named_model

#: s, the longest step between the samples of a damper's record, whose motion runs along a spline there.
_STEP = 5e-4
#: Share of the largest command by which it must go beyond a model's commands to be outside of them.
BEYOND = 0.02
#: Share of the predicted force's standard deviation from which the displacement's noise in it is told.
WORTH_NOISE = 0.05
#: The inputs of each rig: inputs that `predict` reads of a record; it reads nothing else.
INPUTS = {
    "damper": ("time_s", "displacement_m", "command"),
    "frame": ("time_s", "ground_acceleration_m_s2", "command"),
}


def predict(model: Model | Path | str, record: Record | Path | str) -> dict[str, Array]:
    """`time_s` and the simulated channels, (n,) each, of a model for the inputs of a record or its file.

    model: or its file, or the name of a parameter set. Raises InputError.
    """
    if not (isinstance(model, Model | Path | str) and isinstance(record, Record | Path | str)):
        kinds = f"{type(model).__name__} and {type(record).__name__}"
        raise InputError(f"predict takes a model and a record, or their files, not {kinds}")
    for name, given in (("model", model), ("record", record)):
        if not isinstance(given, Model | Record):
            require_path(**{name: given})
    model = named_model(model)
    read = record if isinstance(record, Record) else read_record(record, required=INPUTS[model.rig])
    return {"time_s": np.asarray(read.time), **free_run(model, read)}


def clamped(model: Model, record: Record) -> str:
    """How a record's command goes beyond those a model holds for, and is clamped; empty where it does not."""
    low, high = (model.attributes.get(f"command_{end}", np.nan) for end in ("min", "max"))
    u = record.command if np.isfinite(low) else np.abs(record.command)
    slack = BEYOND * max(float(np.abs(u).max()), 1e-12)
    share = float(np.mean((u < low - slack) | (u > high + slack)))
    if not share > 0:
        return ""
    holds = f"{low:g} to {high:g}" if np.isfinite(low) else f"up to {high:g}"
    if low == high:
        holds = f"{low:g} alone"
    return (
        f"its command runs from {record.command.min():.3g} to {record.command.max():.3g}, the model holds for {holds}:"
        f" {100 * share:.0f} % of the samples are clamped"
    )


def free_run(model: Model, record: Record) -> dict[str, Array]:
    """The simulated channels, (n,) each, for the inputs of a record.

    A command that the model says to be held, or whose jumps show it, is held between samples.
    A magnetic circuit with a memory is led along the command as it was before the log's filter; what the filter's waves
    do to the channels all the same is added as the model without that memory has it.
    """
    model = as_read(model, record)
    factor, sample_time, inputs = played(model, record)
    smooth = without_waves(np.asarray(record.command), inputs["command"])
    plain = replace(model, effects=tuple(e for e in model.effects if e.name != "remanence"))
    if smooth is None or plain.effects == model.effects or model.extra.get(LOG) == AS_SENT:
        return as_logged(model, record, factor, model.simulate(sample_time, inputs))
    given = inputs | {"command": smooth}
    led, waves, without = (
        m.simulate(sample_time, i) for m, i in ((model, given), (plain, inputs), (plain, given))
    )
    return as_logged(model, record, factor, {name: led[name] + waves[name] - without[name] for name in led})


def as_read(model: Model, record: Record) -> Model:
    """The model with whether the record's command is held, where it does not say."""
    return model if model.hold is not None or not held(record.command) else model.with_hold(True)


def as_logged(model: Model, record: Record, factor: int, channels: Mapping[str, Array]) -> dict[str, Array]:
    """Simulated channels on the clock of `played` at the record's own samples."""
    filtered = _filtered(model, np.asarray(record.command))
    return {name: logged(y, filtered, factor) for name, y in channels.items()}


def _filtered(model: Model, command: Array) -> bool:
    return not model.hold and (model.extra.get(LOGGER) == FILTERED or rings_before_jumps(command))


def played(model: Model, record: Record) -> tuple[int, float, dict[str, Array]]:
    """What the simulator is driven with: inputs on a clock so many times as fine, its sample time (s), the inputs."""
    inputs = {name: np.asarray(record.channel(name)) for name in INPUTS[model.rig][1:]}
    if model.rig == "damper":
        inputs["displacement_m"] = displacement(record, model.attributes)
    if model.rig == "frame" and model.law != "narx":
        ground, command = (inputs[name] for name in INPUTS["frame"][1:])
        between_samples = finer(ground, command, _filtered(model, command), bool(model.hold))
        driven = dict(zip(INPUTS["frame"][1:], between_samples, strict=True))
        return FACTOR, record.sample_time / FACTOR, driven
    factor = max(1, math.ceil(record.sample_time / _STEP - 1e-9))
    if model.rig == "frame" or model.law == "narx":
        return 1, record.sample_time, inputs
    command = inputs["command"]

    def fine(x: Array) -> FineInputs:
        return upsampled(
            x, command, record.sample_time, factor, filtered=_filtered(model, command), hold=bool(model.hold)
        )

    x = repaired_ends(inputs["displacement_m"])
    # The displacement's noise, differentiated twice, would be the force of a mass.
    quiet = fine(smoothed(x)).a if any(e.name == "moving_mass" for e in model.effects) else None
    if factor == 1:
        return 1, record.sample_time, inputs if quiet is None else inputs | {"acceleration_m_s2": quiet}
    found = fine(x)
    moved = {"displacement_m": found.x, "velocity_m_s": found.v, "command": found.u}
    return factor, found.sample_time, moved | {"acceleration_m_s2": found.a if quiet is None else quiet}


def displacement(record: Record, attributes: Collection[str]) -> Array:
    """Displacement (n,) m for a model with these attributes: without its noise where the inverse of a filter
    (`motion_lag`) would differentiate it."""
    x = np.asarray(record.displacement)
    return smoothed(repaired_ends(x)) if any(name.startswith("motion_lag") for name in attributes) else x


def motion(record: Record, attributes: Collection[str] = ()) -> tuple[Array, Array, Array]:
    """Displacement (n,) m, velocity (n,) m/s and acceleration (n,) m/s2 that drive a damper with these attributes, at
    the samples of its record."""
    x, u = repaired_ends(displacement(record, attributes)), np.asarray(record.command)
    own = upsampled(x, u, record.sample_time, 1)
    quiet = "moving_mass_m" in attributes
    return x, own.v, upsampled(smoothed(x), u, record.sample_time, 1).a if quiet else own.a


def carried_noise(model: Model, record: Record, force: Array) -> tuple[float, float]:
    """White noise of a record's displacement (standard deviation, m) and what more of it, as large, does to the
    predicted force (n,) N (RMS, N)."""
    level = noise(np.asarray(record.displacement))
    if not level > 0:
        return 0.0, 0.0
    drawn = level * np.random.default_rng(0).standard_normal(record.n)
    disturbed = record.with_channels({"displacement_m": record.displacement + drawn})
    return level, float(np.sqrt(np.mean((free_run(model, disturbed)["force_N"] - force) ** 2)))


def noisy_motion(model: Model, record: Record, force: Array) -> str:
    """How far noise of a record's displacement is in the predicted force (n,) N; empty below WORTH_NOISE of it."""
    level, carried = carried_noise(model, record, force)
    if not carried > WORTH_NOISE * float(np.std(force)):
        return ""
    return (
        f"noise or steps of its displacement, {1e6 * level:.2g} um, are {carried:.3g} N of the predicted force: give a"
        " smoother displacement or fewer samples a second"
    )


def write_prediction(model: Model, record: Record | Path | str, path: Path | str) -> dict[str, Array]:
    """Predicts and writes the CSV in one go; returns its columns. Raises InputError, also where one is not finite."""
    columns = predict(model, record)
    try:
        parts = rendered(columns)
    except InputError as error:
        raise InputError(f"{model.name}: {error}; its parameters are beyond what can be computed") from None
    write_atomic(Path(path), parts)
    return columns
