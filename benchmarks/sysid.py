"""`mujoco.sysid` on a force law: MuJoCo's own identification, with the plugin's attributes as its parameters.

Its rollouts take controls and no prescribed motion, so the test rig's machine gets an actuator that is given the
acceleration of the record. It knows no laws, scales or starts: it is handed the search coordinates, bounds and start
of `mrdamp.identify.laws`, and so fits the same model. It fits from that one start. Importing this raises ImportError
where `mujoco[sysid]` is not installed.
"""

from __future__ import annotations

import io
from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.sysid import (
    ModelSequences,
    Parameter,
    ParameterDict,
    TimeSeries,
    build_residual_fn,
    create_initial_state,
    optimize,
    sysid_rollout,
)

from mrdamp.identify import model_of
from mrdamp.identify.laws import Scales, Space, space
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.simulation.mjcf import damper_config, mjcf

_MASS = 1e12  # kg, so heavy that the damper does not move the machine
_STEP = 1e-4  # of the unit cube, for its differences, as in `mrdamp.identify`
#: Steps in a sample: in a step the machine runs half a step ahead, and the command is held.
_SPLIT = 2


def fit(law: str, record: Record, extras: Sequence[str], most: int = 60) -> tuple[Model, float]:
    """The law fitted to a record, and the cost that it ended at.

    most: its iterations.
    """
    search = space(law, Scales.of([record]), extras)
    spec = rig(_model(search, search.start), record.sample_time / _SPLIT)
    parameters = ParameterDict()
    for k, value in enumerate(search.start):
        parameters.add(Parameter(f"p{k}", float(value), 0.0, 1.0))
    parameters.move_off_bounds()

    def build(p: ParameterDict, s: mujoco.MjSpec) -> mujoco.MjModel:
        _damper(s).config = damper_config(_model(search, p.as_vector()))
        return s.compile()

    residual = build_residual_fn(
        models_sequences=[_sequences(spec, record)], build_model=build, n_threads=1, resample_true=True
    )
    _, found = optimize(
        parameters,
        residual,
        optimizer="mujoco",
        verbose=False,
        max_iters=most,
        eps=_STEP,
        output=io.StringIO(),
    )
    end = np.clip(found.x, 0.0, 1.0)
    cost = float(np.sum(np.concatenate(residual(end, parameters)[0]) ** 2))
    return _model(search, end), cost


def rig(model: Model, timestep: float) -> mujoco.MjSpec:
    """The test rig with that damper, its force as the only sensor, and a machine that follows an acceleration."""
    spec = mujoco.MjSpec.from_string(mjcf(model, timestep=timestep))
    spec.body("machine").mass = _MASS
    machine = spec.add_actuator(name="machine", target="piston", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    machine.gainprm[0] = _MASS
    for sensor in list(spec.sensors):
        if sensor.name != "damper_force":
            spec.delete(sensor)
    return spec


def force(model: Model, record: Record) -> Array:
    """Force (n - 1,) N of a model on a record in that rig, rolled out as `mujoco.sysid` does."""
    compiled = rig(model, record.sample_time / _SPLIT).compile()
    control = _control(record)
    (run,) = sysid_rollout(compiled, mujoco.MjData(compiled), control, _state(compiled, record))
    return np.asarray(run.sensordata.data[::_SPLIT, 0])


def _model(search: Space, point: Array) -> Model:
    return model_of(search, np.asarray(point, dtype=float))


def _damper(spec: mujoco.MjSpec) -> mujoco.MjsPlugin:
    return next(p for p in spec.plugins if p.name == "damper")


def _control(record: Record) -> TimeSeries:
    times = np.arange(_SPLIT * (record.n - 1) + 1) * (record.sample_time / _SPLIT)
    velocity, command = (np.interp(times, _times(record), y) for y in (record.velocity(), record.command))
    acceleration = np.append(np.diff(velocity), 0.0) * (_SPLIT / record.sample_time)
    return TimeSeries(times, np.column_stack([command, acceleration]))


def _state(model: mujoco.MjModel, record: Record) -> Array:
    return np.asarray(
        create_initial_state(model, record.displacement[:1], record.velocity()[:1])
    )  # fmt: skip


def _sequences(spec: mujoco.MjSpec, record: Record) -> ModelSequences:
    model = spec.compile()
    # A rollout's sensors are of the state that a step began with, and have the time that it ended at.
    times = _times(record) + record.sample_time / _SPLIT
    data = TimeSeries.from_names(times, record.channel("force_N")[:, None], model, ["damper_force"])
    return ModelSequences("rig", spec, record.name, _state(model, record), _control(record), data)


def _times(record: Record) -> Array:
    return np.arange(record.n, dtype=np.float64) * record.sample_time
