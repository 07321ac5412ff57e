"""Dampers of a Warp model: their forces by the callback `act_bias`, their sensors by `sensor`."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import mujoco_warp
import numpy as np
import warp as wp

from mrdamp.errors import InputError, require_kind
from mrdamp.model.attributes import attribute_index, attributes, check, law_options, law_parameters
from mrdamp.model.attributes import laws as law_names
from mrdamp.model.core import Array
from mrdamp.model.native import library
from mrdamp.warp.convert import Converted, Reading, Worlds, convert, sizes
from mrdamp.warp.kernels import add_damping, along, forces_on_joints, moment_of


@dataclass
class _State:
    """What dampers need of one `Data`: their stores, scratch arrays, and the structure that the chain takes."""

    owner: Dampers
    arrays: dict[str, wp.array]
    worlds: Worlds
    forces: wp.array
    solved: wp.array
    column: wp.array
    mass: wp.array | None
    params: Array = field(repr=False)
    kernels: Any = None  # on a GPU


@dataclass(eq=False)
class Dampers:
    """The dampers of a model in Warp.

    model: the MuJoCo model without plugins that was put on the device. threads: of the CPU that share the worlds.
    """

    converted: Converted
    device: Any
    threads: int = 1

    @property
    def model(self) -> mujoco.MjModel:
        return self.converted.model

    @property
    def names(self) -> tuple[str, ...]:
        """Of the dampers' actuators."""
        return tuple(self.model.actuator(d.actuator).name for d in self.converted.dampers)

    def make_data(self, nworld: int = 1, **sizes: int) -> mujoco_warp.Data:
        """`mujoco_warp.make_data` with room for the dampers' states."""
        require_kind("a whole number", int, nworld=nworld)
        with wp.ScopedDevice(self.device):
            data = mujoco_warp.make_data(self.model, nworld=nworld, **sizes)
            data.mrdamp = self._state(data)
        return data

    def set(
        self, data: mujoco_warp.Data, values: Mapping[str, float | Sequence[float] | Array], damper: int | str = 0
    ) -> None:
        """Attributes of a damper: a number, or one for each world (worlds,), as for randomised dampers.

        Raises InputError. A delay or a network that the model was not made with cannot be switched on.
        """
        require_kind("a mapping of attributes", Mapping, values=values)
        if damper not in (*self.names, *range(len(self.names))):
            raise InputError(f"damper is {damper!r}; allowed: {', '.join(self.names)}")
        k = self.names.index(damper) if isinstance(damper, str) else damper
        state, one = self._of(data), self.converted.dampers[k]
        law, index = law_names()[one.law], attribute_index()
        own = {*law_parameters(law), *law_options(law)}
        params = np.broadcast_to(state.params, (data.nworld, *state.params.shape[1:])).copy()
        for name, value in values.items():
            if name not in index or (attributes()[index[name]].group in ("law", "dependence") and name not in own):
                raise InputError(f"'{name}' is no attribute of law {law}")
            try:
                numbers = np.asarray(value, dtype=float)
            except (TypeError, ValueError):
                raise InputError(f"{name} is {value!r}; allowed: a number, or one for each world") from None
            if numbers.shape not in ((), (data.nworld,)):
                raise InputError(f"{name} has shape {numbers.shape}; allowed: a number, or ({data.nworld},)")
            params[:, k, index[name]] = numbers
        for row in np.unique(params[:, k], axis=0):
            check(one.law, row)
            delayed = row[index["command_delay_d"]] + row[index["command_delay_period"]] > 0
            if delayed and state.arrays["lines"] is None:
                raise InputError("command_delay: the model was made without one; give its damper a delay in the MJCF")
        self._params(state, params)

    def reset(self, data: mujoco_warp.Data) -> None:
        """All dampers at rest. A world whose time goes back is reset without it."""
        state = self._of(data)
        for name in ("store", "lines", "pasts", "reading_store"):
            array = state.arrays[name]
            if array is not None:
                array.zero_()

    def _of(self, data: mujoco_warp.Data) -> _State:
        state: _State | None = getattr(data, "mrdamp", None)
        if state is None or state.owner is not self:
            raise InputError("this Data has no room for these dampers: make it by their make_data")
        return state

    def _params(self, state: _State, params: Array) -> None:
        state.params, taken = params, params
        if self.device.is_cuda:
            from mrdamp.gpu import free_attributes, kernels

            free, dampers = free_attributes(params), self.converted.dampers
            state.kernels = kernels(self.device, "worlds", law_names()[dampers[0].law], free, len(dampers))
            taken = params[..., list(free)]
        kept = state.arrays.get("params")
        if kept is not None and kept.shape == taken.shape:
            kept.assign(taken)  # at the address that a captured graph has
            return
        state.arrays["params"] = wp.array(taken, dtype=wp.float64, device=self.device)
        state.worlds.params = state.arrays["params"].ptr
        state.worlds.sets = len(params)

    def _state(self, data: mujoco_warp.Data) -> _State:
        converted, model, size = self.converted, self.model, sizes()
        dampers, readings, worlds = converted.dampers, converted.readings, data.nworld
        if ctypes.sizeof(Worlds) != size["Worlds"] or ctypes.sizeof(Reading) != size["Reading"]:
            raise ImportError("mrdamp: library and package are of different versions; install again")
        n, index = len(dampers), attribute_index()
        delayed = any(d.params[index["command_delay_d"]] + d.params[index["command_delay_period"]] > 0 for d in dampers)
        networks = any(d.net is not None for d in dampers)

        def whole(values: Sequence[int]) -> wp.array:
            return wp.array(np.array(values, dtype=np.int32), dtype=wp.int32)

        def store(name: str, count: int, wanted: bool = True) -> wp.array | None:
            return wp.zeros(worlds * count * size[name], dtype=wp.uint8) if wanted and count else None

        def limits(ranges: Sequence[tuple[float, float]]) -> wp.array:
            return wp.array(np.array(ranges), dtype=wp.float64)

        nets = [library().mrdamp_worlds_net(d.net.handle) if d.net is not None else 0 for d in dampers]
        arrays: dict[str, wp.array | None] = {
            "law": whole([d.law for d in dampers]),
            "net": wp.array(np.array(nets, dtype=np.uint64), dtype=wp.uint64) if networks else None,
            "actuator": whole([d.actuator for d in dampers]),
            "control": whole([d.control for d in dampers]),
            "control_range": limits([d.command for d in dampers]),
            "force_range": limits([d.force for d in dampers]),
            "store": store("WorldDamper", n),
            "lines": store("WorldLine", n, delayed),
            "pasts": store("WorldPast", n, networks),
            "free": wp.zeros((worlds, n)),
            "weight": wp.zeros((worlds, n * n)),
            "bare": wp.zeros((worlds, n * n)),
            "acceleration": wp.zeros((worlds, n)),
            "reading_damper": whole([r.damper for r in readings]),
            "reading_column": whole([r.column for r in readings]),
            "reading": wp.array(np.frombuffer(b"".join(bytes(r.reading) for r in readings), np.uint8), dtype=wp.uint8),
            "effects": wp.array(np.array([r.effects for r in readings]), dtype=wp.float64),
            "cutoff": wp.array(np.array([r.cutoff for r in readings]), dtype=wp.float64),
            "reading_store": store("ReadingState", len(readings)),
        }
        engine = {
            "time": data.time, "length": data.actuator_length, "velocity": data.actuator_velocity, "ctrl": data.ctrl,
            "force": data.actuator_force, "sensordata": data.sensordata,
        }  # fmt: skip
        pointers = {name: a.ptr if a is not None else None for name, a in (*arrays.items(), *engine.items())}
        structure = Worlds(
            worlds, n, model.nactuator, model.nu, model.nsensordata, len(readings), 1, model.opt.timestep, **pointers
        )
        forces, solved, column = (wp.zeros((worlds, model.nv)) for _ in range(3))
        explicit = model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
        mass = wp.zeros_like(data.M) if np.any(model.dof_damping) and not explicit else None
        state = _State(self, arrays, structure, forces, solved, column, mass, np.empty(0))
        self._params(state, np.array([[d.params for d in dampers]]))
        return state

    def act(self, m: mujoco_warp.Model, d: mujoco_warp.Data) -> None:
        """Writes the dampers' forces of the step to come into `d.actuator_force`."""
        state = self._of(d)
        moment = (d.moment_rownnz, d.moment_rowadr, d.moment_colind, d.actuator_moment)
        joints = (d.qfrc_passive, d.qfrc_bias, d.qfrc_applied, d.qfrc_constraint)
        wp.launch(forces_on_joints, d.nworld, [*joints, *moment, d.actuator_force], [state.forces])
        mujoco_warp.xfrc_accumulate(m, d, state.forces)
        mujoco_warp.factor_m(m, d)
        self._weights(m, d, state, moment, state.arrays["bare"])
        if state.mass is not None:
            wp.copy(state.mass, d.M)
            inputs = [m.M_rownnz, m.M_rowadr, m.dof_damping, self.model.opt.timestep]
            wp.launch(add_damping, (d.nworld, m.nv), inputs, [state.mass])
            bare, d.M = d.M, state.mass
            mujoco_warp.factor_m(m, d)
            self._weights(m, d, state, moment, state.arrays["weight"])
            d.M = bare
        else:
            wp.copy(state.arrays["weight"], state.arrays["bare"])
        mujoco_warp.solve_m(m, d, state.solved, state.forces)
        self._project(d, state, moment, state.solved, 0, 1, state.arrays["free"])
        self._run("act", state)

    def read(self, m: mujoco_warp.Model, d: mujoco_warp.Data, stage: int) -> None:
        """Writes the force sensors into `d.sensordata`, once the accelerations are known."""
        if stage != int(mujoco.mjtStage.mjSTAGE_ACC) or not self.converted.readings:
            return
        state = self._of(d)
        moment = (d.moment_rownnz, d.moment_rowadr, d.moment_colind, d.actuator_moment)
        self._project(d, state, moment, d.qacc, 0, 1, state.arrays["acceleration"])
        self._run("read", state)

    def _weights(self, m: mujoco_warp.Model, d: mujoco_warp.Data, state: _State, moment: Any, out: wp.array) -> None:
        """Accelerations of all dampers for a unit force of each (worlds, dampers x dampers)."""
        n = len(self.converted.dampers)
        for k, damper in enumerate(self.converted.dampers):
            wp.launch(moment_of, d.nworld, [damper.actuator, *moment], [state.column])
            mujoco_warp.solve_m(m, d, state.solved, state.column)
            self._project(d, state, moment, state.solved, k, n, out)

    def _project(self, d: Any, state: _State, moment: Any, x: wp.array, first: int, step: int, out: wp.array) -> None:
        dim = (d.nworld, len(self.converted.dampers))
        wp.launch(along, dim, [state.arrays["actuator"], *moment, x, first, step], [out])

    def _run(self, what: str, state: _State) -> None:
        if state.kernels is not None:
            state.kernels.launch(what, state.worlds, state.worlds.worlds, wp.get_stream(self.device).cuda_stream)
            return
        entry: Callable[..., None] = getattr(library(), f"mrdamp_worlds_{what}")
        entry(ctypes.byref(state.worlds), self.threads)


def put_model(
    source: mujoco.MjSpec | Path | str, *, device: Any = None, threads: int = 1
) -> tuple[mujoco_warp.Model, Dampers]:
    """A model with damper plugins for MuJoCo Warp.

    source: MJCF file, its text, or a specification. device: as by Warp (None: its default). threads: of the CPU, on
    Warp's CPU device. Returns the model, whose dampers act in `mujoco_warp.step`, and its dampers, which make the data.
    Raises InputError for what Warp or a damper in it does not take.
    """
    converted = convert(source)
    if len(converted.dampers) > sizes()["most"]:
        raise InputError(f"{len(converted.dampers)} dampers; in Warp a model has at most {sizes()['most']}")
    require_kind("a whole number", int, threads=threads)
    if threads < 1:
        raise InputError(f"threads is {threads}; allowed: 1 or more")
    try:
        chosen = wp.get_device(device)
    except (RuntimeError, ValueError) as error:
        raise InputError(f"device {device!r}: {' '.join(str(error).split())}") from None
    if chosen.is_cuda and (len({d.law for d in converted.dampers}) > 1 or any(d.net for d in converted.dampers)):
        raise InputError("on a GPU the dampers of a model have one law, and no network")
    dampers = Dampers(converted, chosen, threads)
    with wp.ScopedDevice(chosen):
        try:
            model = mujoco_warp.put_model(converted.model)
        except NotImplementedError as error:
            raise InputError(f"MuJoCo Warp: {error}") from None
    model.callback.act_bias, model.callback.sensor = dampers.act, dampers.read
    return model, dampers
