"""Rows of closed loops through the C++ chain: many copies of one structure with dampers, a control period at a time."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.errors import InputError, diverged, require_kind, require_positive
from mrdamp.model import Model
from mrdamp.model.attributes import law_number, vector
from mrdamp.model.core import FrameInput, Narx, fill_frame
from mrdamp.model.native import (
    ERROR_SIZE,
    Array,
    Car,
    Dampers,
    Frame,
    LinearStructure,
    Load,
    checked,
    library,
    pointer,
    whole_pointer,
)  # fmt: skip
from mrdamp.simulation.criteria import STATES, wk_sections
from mrdamp.structures.lumped import QuarterCar

HEADER = 3  # doubles of a row's state before its coordinates
_CAR = 5  # of a car's between the rates and the filter: force and rise of damper and tyre, friction of the tyre

#: s, engine step: below it time steps vanish beside the time of a run.
_LEAST_STEP = 1e-6
#: Kinds of NumPy's types that would be taken for numbers: truth values, complex numbers and text.
_NO_NUMBERS = "bcSU"


def finite(what: str, values: Any, shape: tuple[int, ...], *, exact: bool = False) -> Array:
    """values as float64 of a shape; unless it is exact, an axis of length 1 may be left out. Raises InputError, NaN and
    None included.

    The engine takes a control that is no number for none, and the load with it: nothing may be stepped with one.
    """
    try:
        found = np.asarray(values)
        if found.dtype.kind in _NO_NUMBERS:
            raise TypeError
        found = found.astype(np.float64, copy=False)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what} is {values!r}; allowed: finite numbers".replace("\n", "")) from None
    if found.shape != shape:
        if exact or 1 not in shape or found.size != shape[0] * shape[1]:
            allowed = shape if exact or shape[0] > 1 else shape[1:]
            raise InputError(f"{what} has shape {found.shape}; allowed: {allowed}")
        found = found.reshape(shape)
    if not math.isfinite(np.add.reduce(found, axis=None)):
        raise InputError(f"{what} holds NaN, None or infinity; allowed: finite numbers")
    return found


def require_finite(found: tuple[Array, Array]) -> tuple[Array, Array]:
    """Criteria and measurements of a period as they are. Raises Diverged where a criterion is no number."""
    if not math.isfinite(np.add.reduce(found[0], axis=None)):
        raise diverged(row=int(np.argmin(np.isfinite(found[0]).all(axis=1))))
    return found


@dataclass(frozen=True)
class Stepping:
    """How n rows are stepped. period: of control, s; timestep: the largest within it, s; command_max: (m,) A or V;
    threads: that share the rows."""

    period: float
    timestep: float
    command_max: Array
    n: int = 1
    threads: int = 1

    def __post_init__(self) -> None:
        require_positive("steps (s)", period=self.period, timestep=self.timestep)
        if self.timestep < _LEAST_STEP:
            raise InputError(f"timestep is {self.timestep:g}; allowed: {_LEAST_STEP:g} s or more")
        require_kind("a whole number", int, threads=self.threads)
        require_positive("rows", threads=self.threads)

    @property
    def inner(self) -> int:
        """Steps in a control period, none longer than timestep."""
        return max(1, math.ceil(self.period / self.timestep - 1e-9))


@dataclass(frozen=True)
class RowMoment:
    """Everything that the future of one row depends on: its state, load (samples, loads) every sample_time (s), its
    steps, and the step it is at."""

    state: Array
    load: Array
    sample_time: float
    steps: int
    step: int


class ChainRows:
    """n rows; see `mrdamp.h` for what is measured and what the criteria are.

    Attributes: state (n, doubles), all that a row's future depends on but for its load and commands; criteria (n, 6),
    of a car (n, 9), and measured (n, measurements) of the last period, used again by the next; period s, inner: steps
    in it; within (n, inner, measurements), after `follow`: those at the start of every step of the last period.
    """

    def __init__(
        self, kind: str, made: tuple[Any, ...], given: Any, arguments: tuple[Any, ...], models: Sequence[Model],
        stepping: Stepping, loads: int, coordinates: int,
    ) -> None:  # fmt: skip
        """kind, made: the constructor and its arguments. given, arguments: of the C entry, before and after dampers."""
        n, period = stepping.n, stepping.period
        self._made = kind, made
        self._lib = library()
        self._nets: list[Narx | None] = [m.narx for m in models]
        laws = np.array([law_number(m.law) for m in models], dtype=np.intc)
        params = np.ascontiguousarray([vector(m.law, m.attributes) for m in models])
        largest = np.ascontiguousarray(stepping.command_max, dtype=np.float64)
        handles = (ctypes.c_void_p * len(models))(*(net.handle if net else None for net in self._nets))
        dampers = Dampers(len(models), whole_pointer(laws), handles, pointer(params), pointer(largest))
        error = ctypes.create_string_buffer(ERROR_SIZE)
        make = getattr(self._lib, f"mrdamp_rows_{kind}")
        self._handle = make(given, dampers, *arguments, error, ERROR_SIZE) or 0
        if not self._handle:
            raise InputError(error.value.decode())
        self.n, self.inner, self.period = n, stepping.inner, period
        self.threads = stepping.threads
        self._loads, self._coordinates, self._dampers = loads, coordinates, len(models)
        self.state = np.zeros((n, self._lib.mrdamp_rows_size(self._handle)))
        self.criteria = np.zeros((n, self._lib.mrdamp_rows_criteria(self._handle)))
        self.measured = np.zeros((n, self._lib.mrdamp_rows_measurements(self._handle)))
        self._given: list[Array] = [np.zeros((1, loads))] * n
        self._load = (Load * n)(*(Load(pointer(each), period, 1, 0) for each in self._given))
        self._point()
        self.step = np.zeros(n, dtype=np.int64)
        self._noise: Array | None = None

    def _point(self) -> None:
        self._rows = (
            self.state.ctypes.data, ctypes.addressof(self._load), self.criteria.ctypes.data, self.measured.ctypes.data,
        )  # fmt: skip

    @classmethod
    def frame(
        cls, frame: FrameInput, models: Sequence[Model], damper_floors: Sequence[tuple[int, int]], stepping: Stepping,
        instants: int = 1,
    ) -> ChainRows:  # fmt: skip
        """Shear frames with dampers between pairs of floors (0 the ground), under ground accelerations (m/s2).

        instants: of every step, at which the criteria are taken.
        """
        keep: list[Array] = []
        given = Frame()
        fill_frame(given, frame, keep)
        pairs = np.array(damper_floors, dtype=np.intc)
        arguments = whole_pointer(pairs), stepping.period, stepping.inner, instants
        made = frame, models, damper_floors, stepping, instants
        return cls("frame", made, given, arguments, models, stepping, 1, len(frame.mass))

    @classmethod
    def linear(
        cls, rate: Array, load: Array, stroke: Array, push: Array, at: Array, models: Sequence[Model],
        stepping: Stepping, mass: float = 0.0, grounds: int = 0,
    ) -> ChainRows:  # fmt: skip
        """Linear structures q'' = rate [q; q'] + load w + push f with m dampers, f (N) their tension, under loads w.

        rate (n, 2n), load (n, k), stroke (m, n) of the dampers per unit of the coordinates, push (n, m), at (p, n) of
        the places of measurement. mass: kg, reference of the criteria; 0: those of each place, see `mrdamp.h`.
        grounds: loads, from the first on, that are accelerations of the ground that the coordinates are relative to.
        """
        arrays = [np.ascontiguousarray(a, dtype=np.float64) for a in (rate, load, stroke, push, at)]
        n, loads, places = len(rate), arrays[1].shape[1], len(at)
        given = LinearStructure(n, loads, *map(pointer, arrays[:4]), places, pointer(arrays[4]), grounds, mass)
        made = rate, load, stroke, push, at, models, stepping, mass, grounds
        return cls("linear", made, given, (stepping.period, stepping.inner), models, stepping, loads, n)

    @classmethod
    def car(cls, car: QuarterCar, model: Model, stepping: Stepping) -> ChainRows:
        """Quarter cars on roads whose vertical acceleration (m/s2) is the load; measured as frames of two floors."""
        period, inner = stepping.period, stepping.inner
        sections = wk_sections(period / inner)
        weighting = np.ascontiguousarray(sections[:, [0, 1, 2, 4, 5]])
        given = Car(
            car.body, car.wheel, car.stiffness, car.damping, car.tyre_stiffness, car.tyre_damping, car.weight,
            len(weighting), pointer(weighting),
        )  # fmt: skip
        return cls("car", (car, model, stepping), given, (period, inner, 1), [model], stepping, 1, 2)

    def __reduce__(self) -> Any:
        """Copies are made again as this was, at the same present."""
        moments = [self.save(row) for row in range(self.n)]
        return _again, (self._made, self._noise, moments, self.criteria, self.measured)

    def __del__(self) -> None:
        if getattr(self, "_handle", None):
            self._lib.mrdamp_rows_free(self._handle)
            self._handle = 0

    @property
    def timestep(self) -> float:
        """s."""
        return self.period / self.inner

    def noise(self, deviation: Array) -> None:
        """White noise on every measurement from now on: standard deviations (measurements,), SI."""
        values = np.ascontiguousarray(deviation, dtype=np.float64)
        if values.shape != self.measured.shape[1:]:
            raise InputError(f"noise has shape {values.shape}; expected {self.measured.shape[1:]}")
        checked(self._lib.mrdamp_rows_noise, self._handle, pointer(values))
        self._noise = values

    def follow(self) -> None:
        """From now on `within` holds what is measured at the start of every step, without noise."""
        self.within = np.zeros((self.n, self.inner, self.measured.shape[1]))
        self._lib.mrdamp_rows_within(self._handle, pointer(self.within))

    def start(self, row: int, load: Array, sample_time: float, steps: int, seed: int = 0) -> None:
        """Row at rest under a load (samples, loads) every sample_time (s), straight between samples.

        Behind its end it stays as it is, and is none from step `steps` on. seed: of the row's noise, below 2^53. The
        row's `measured` is that of the start.
        """
        row = int(row)  # of NumPy's integers ctypes makes no address
        self._give(row, load, sample_time, steps)
        size = self.measured.itemsize
        self._lib.mrdamp_rows_start(
            self._handle, float(seed), self._load[row],
            self.state.ctypes.data + row * self.state.shape[1] * size,
            self.measured.ctypes.data + row * self.measured.shape[1] * size,
        )  # fmt: skip
        self.step[row] = 0

    def advance(self, commands: Array) -> tuple[Array, Array]:
        """One control period with commands (n, dampers) held: `criteria` and `measured`."""
        given = np.ascontiguousarray(finite("command", commands, (self.n, self._dampers)))
        state, load, criteria, measured = self._rows
        self._lib.mrdamp_rows_step(
            self._handle, self.n, state, load, given.ctypes.data, criteria, measured, self.threads, 0
        )
        self.step += self.inner
        return self.criteria, self.measured

    def position(self, row: int) -> Array:
        """(coordinates,) of a row: floors' displacements to the ground (m), or those of the modes."""
        return np.array(self.coordinates()[row])

    def coordinates(self) -> Array:
        """(n, coordinates), `position` of every row, a view."""
        return self.state[:, HEADER : HEADER + self._coordinates]

    def velocities(self) -> Array:
        """(n, coordinates), the rates of `coordinates`, a view."""
        begin = HEADER + self._coordinates
        return self.state[:, begin : begin + self._coordinates]

    def weighting(self) -> Array:
        """(n, 8), the states of the filter Wk of every car, two a section, a view."""
        begin = HEADER + 2 * self._coordinates + _CAR
        return self.state[:, begin : begin + STATES]

    def save(self, row: int) -> RowMoment:
        load = self._load[row]
        state = self.state[row].copy()
        return RowMoment(state, self._given[row], load.sample_time, load.steps, int(state[0]))

    def restore(self, row: int, moment: RowMoment) -> None:
        self._give(row, moment.load, moment.sample_time, moment.steps)
        self.state[row] = moment.state
        self.step[row] = moment.step

    def share(self, other: ChainRows, chosen: NDArray[np.intp]) -> None:
        """The loads of other rows, without copies: row k takes that of `other`'s row chosen[k], chosen (n,)."""
        self._given, size = [other._given[k] for k in chosen.tolist()], ctypes.sizeof(Load)
        mine, theirs = (
            np.ctypeslib.as_array(ctypes.cast(rows._load, ctypes.POINTER(ctypes.c_uint8)), (rows.n, size))
            for rows in (self, other)
        )
        mine[:] = theirs[chosen]

    def _give(self, row: int, load: Array, sample_time: float, steps: int) -> None:
        values = np.ascontiguousarray(load, dtype=np.float64)
        if values.ndim != 2 or values.shape[1] != self._loads or not len(values):
            raise InputError(f"load has shape {values.shape}; expected (samples, {self._loads})")
        self._given[row] = values
        self._load[row] = Load(pointer(values), sample_time, len(values), steps)


class Each:
    """n `ChainRows` of one row each, which may differ in every parameter, stepped in one call.

    like: one of them. Attributes: criteria and measured, those of all.
    """

    def __init__(self, like: ChainRows, n: int) -> None:
        self._lib, self._threads, self._shape = library(), like.threads, (n, like._dampers)
        self._pointers = tuple((ctypes.c_void_p * n)() for _ in range(3))
        self.criteria, self.measured = (np.zeros((n, a.shape[1])) for a in (like.criteria, like.measured))

    def join(self, row: int, rows: ChainRows) -> None:
        """Makes `rows` number `row` of all, whose results are places in theirs; the caller keeps it."""
        for name in ("criteria", "measured"):
            place = getattr(self, name)[row : row + 1]
            place[:] = getattr(rows, name)
            setattr(rows, name, place)
        rows._point()
        for pointers, of in zip(self._pointers, (rows._handle, *rows._rows[:2]), strict=True):
            pointers[row] = of

    def advance(self, commands: Array) -> tuple[Array, Array]:
        """As of `ChainRows`, whose `step` stays."""
        given = np.ascontiguousarray(finite("command", commands, self._shape))
        handles, states, loads = self._pointers
        results = self.criteria.ctypes.data, self.measured.ctypes.data
        self._lib.mrdamp_rows_step_each(
            handles, len(self.criteria), states, loads, given.ctypes.data, *results, self._threads
        )
        return self.criteria, self.measured


def _again(
    made: tuple[str, tuple[Any, ...]], noise: Array | None, moments: Sequence[RowMoment], criteria: Array,
    measured: Array,
) -> ChainRows:  # fmt: skip
    kind, arguments = made
    rows: ChainRows = getattr(ChainRows, kind)(*arguments)
    if noise is not None:
        rows.noise(noise)
    for row, moment in enumerate(moments):
        rows.restore(row, moment)
    rows.criteria[:], rows.measured[:] = criteria, measured
    return rows
