"""Whole records and whole frames through the C++ chain, and its NARX networks."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp.errors import InputError, require_kind, require_one_of, require_positive
from mrdamp.model.attributes import (
    Attribute,
    attribute_index,
    attributes,
    law_number,
    law_options,
    law_parameters,
    laws,
    vector,
)
from mrdamp.model.native import (
    ERROR_SIZE,
    Array,
    Frame,
    Motions,
    Options,
    checked,
    library,
    numbers_of,
    pointer,
    whole_pointer,
)

__all__ = [
    "COLUMNS",
    "Array",
    "Attribute",
    "FrameInput",
    "Narx",
    "Sets",
    "attribute_index",
    "attributes",
    "frame_columns",
    "law_number",
    "law_options",
    "law_parameters",
    "laws",
    "library",
    "run",
    "run_frame",
    "run_frame_many",
    "run_in",
    "run_many",
    "run_records",
    "vector",
]

#: Columns of a run, in the order of the enum in `mrdamp.h`: force at the rod end as the damper's sensor reads it
#: (N), the same on an ideal load cell (N), force without the moving mass (N), coil current and field variable
#: (command units), rise of the fluid's temperature (K), piston displacement behind the mount (m), the law's state.
COLUMNS = ("force", "reference", "true", "current", "field", "temperature", "piston", "state")


class Narx:
    """A NARX network in the plugin's weights format (see `plugin_cpp/README.md`)."""

    def __init__(self, text: str) -> None:
        error = ctypes.create_string_buffer(ERROR_SIZE)
        self.text = text
        self._lib = library()
        self.handle = self._lib.mrdamp_narx_parse(text.encode(), error, ERROR_SIZE)
        if not self.handle:
            raise InputError(error.value.decode())
        self.sample_time: float = self._lib.mrdamp_narx_sample_time(self.handle)  # s
        self.inputs: int = self._lib.mrdamp_narx_inputs(self.handle)

    def __reduce__(self) -> Any:
        return Narx, (self.text,)

    def __del__(self) -> None:
        if getattr(self, "handle", None):
            self._lib.mrdamp_narx_free(self.handle)
            self.handle = None

    @classmethod
    def read(cls, path: Path) -> Narx:
        """Reads a weights file; raises InputError naming it."""
        try:
            return cls(Path(path).read_text())
        except (OSError, UnicodeDecodeError, InputError) as error:
            raise InputError(f"{path}: {error}") from None

    def forward(self, inputs: Array) -> float:
        """One pass: physical inputs (inputs,) in the order of the file -> force (N)."""
        values = np.ascontiguousarray(inputs, dtype=float)
        if values.shape != (self.inputs,):
            raise InputError(f"the network takes {self.inputs} inputs, got an array of shape {values.shape}")
        return float(self._lib.mrdamp_narx_forward(self.handle, pointer(values)))


@dataclass(frozen=True)
class Sets:
    """Parameter sets and the record that each of them runs through.

    params (sets, attributes) as by `vector`; x (m), u (command), v (m/s), a (m/s2): (n,) at the sample time dt (s).
    v and a are differentiated where they are not given. `hold`: the command is held between samples, as
    MuJoCo does; otherwise straight lines. `run_in`: a record that begins in motion is led into by motion of its own
    (`mrdamp.h`), in place of a start at rest; not for networks. substep: s, in place of the attribute.
    """

    params: Array
    dt: float
    x: Array
    u: Array
    v: Array | None = None
    a: Array | None = None
    hold: bool = False
    run_in: bool = False
    substep: float | None = None


def run_records(
    law: str,
    records: Sequence[Sets],
    *,
    threads: int = 1,
    lanes: int = 0,
    narx: Narx | None = None,
    columns: Sequence[str] = ("force",),
    device: str = "cpu",
) -> list[Array]:
    """Parameter sets through records, all at once. Returns (sets, columns, n) for each record.

    `lanes`: sets that a core steps at once, at most: 1, 2, 4, 8; 0: what its vector units take. The same for any number
    of threads and lanes. device: `cuda` is the first NVIDIA GPU (extra `cuda`), without networks. Raises InputError.
    """
    require_kind("a whole number", int, threads=threads, lanes=lanes)
    if threads < 0:
        raise InputError(f"threads is {threads}; allowed: 0 or more")
    if not len(columns):
        raise InputError(f"columns is empty; allowed: {', '.join(COLUMNS)}")
    for name in columns:
        if name not in COLUMNS:
            raise InputError(f"column '{name}' is unknown; allowed: {', '.join(COLUMNS)}")
    numbers = np.array([COLUMNS.index(name) for name in columns], dtype=np.intc)
    for one in records:
        _check(one)
    require_one_of("", ("cpu", "cuda"), device=device)
    if device == "cuda":
        from mrdamp.gpu import run_records as on_gpu

        if narx is not None or law == "narx":
            raise InputError("networks do not run on a GPU; leave device out")
        for one in records:  # what is out of range is refused on the processor, in three samples
            params = _matrix(one.params).copy()
            params[:, attribute_index()["channel_shift_d"]] = 0.0  # whose range is that of the whole record
            run_records(law, [Sets(params, one.dt, one.x[:3], one.u[:3], substep=one.substep)])
        leads = [run_in(one.dt, one.x, one.u, one.v) if one.run_in else None for one in records]
        return on_gpu(law, records, leads, numbers.tolist())
    out, kept, motions = [], [], (Motions * len(records))()
    for motion, one in zip(motions, records, strict=True):
        n = len(one.x)
        params = _matrix(one.params)
        out.append(np.empty((len(params), len(columns), n)))
        channels = {name: _channel(name, getattr(one, name), n) for name in ("x", "v", "a", "u")}
        kept.append((params, channels))
        if one.substep is not None:
            require_positive("the chain (s)", substep=one.substep)
        motion.nset, motion.n, motion.dt, motion.substep = len(params), n, one.dt, one.substep or 0.0
        motion.hold, motion.run_in = int(one.hold), int(one.run_in and narx is None)
        for name, array in {**channels, "params": params, "out": out[-1]}.items():
            if array is not None:
                setattr(motion, name, pointer(array))
    net = narx.handle if narx else None
    checked(
        library().mrdamp_run_records, law_number(law), net, len(records), motions, threads, lanes, len(columns),
        whole_pointer(numbers),
    )  # fmt: skip
    return out


def _check(one: Sets) -> None:
    """InputError for what the library cannot see or would take as something else."""
    for name, value in (("x", one.x), ("u", one.u)):
        if value is None:
            raise InputError(f"{name} is None; a record has displacement and command")
    require_kind("True, False", bool, hold=one.hold, run_in=one.run_in)
    shift = _matrix(one.params)[:, attribute_index()["channel_shift_d"]]
    half = 0.5 * one.dt * len(one.x)
    if np.any(np.abs(shift) > half):
        raise InputError(f"channel_shift_d is {np.abs(shift).max():g} s; allowed: up to half of the record, {half:g} s")


def run_many(
    law: str,
    params: Array,
    dt: float,
    x: Array,
    u: Array,
    *,
    v: Array | None = None,
    a: Array | None = None,
    hold: bool = False,
    run_in: bool = False,
    substep: float | None = None,
    threads: int = 1,
    lanes: int = 0,
    narx: Narx | None = None,
    columns: Sequence[str] = ("force",),
    device: str = "cpu",
) -> Array:
    """Parameter sets through one record: arguments as in `Sets` and `run_records`. Returns (sets, columns, n)."""
    sets = Sets(params, dt, x, u, v, a, hold, run_in, substep)
    return run_records(law, [sets], threads=threads, lanes=lanes, narx=narx, columns=columns, device=device)[0]


def run_in(dt: float, x: Array, u: Array, v: Array | None = None) -> slice | None:
    """The samples of a record, x (m), u (command), v (m/s), that lead into its motion; None where it begins at rest."""
    arrays = [_channel(name, value, len(x)) for name, value in (("x", x), ("v", v), ("u", u))]
    given = [None if array is None else pointer(array) for array in arrays]
    begin, end = ctypes.c_int(), ctypes.c_int()
    checked(library().mrdamp_run_in, dt, len(x), *given, ctypes.byref(begin), ctypes.byref(end))
    return slice(begin.value, end.value) if begin.value < end.value else None


def run(
    law: str,
    parameters: Mapping[str, float],
    dt: float,
    x: Array,
    v: Array | None = None,
    a: Array | None = None,
    u: Array | float = 0.0,
    *,
    hold: bool = False,
    run_in: bool = False,
    substep: float | None = None,
    threads: int = 1,
    narx: Narx | None = None,
    columns: Sequence[str] = ("force",),
) -> dict[str, Array]:
    """One damper through one record; arguments as in `run_many`. Returns an array (n,) per column."""
    command = np.full(len(x), float(u)) if np.ndim(u) == 0 else np.asarray(u, dtype=float)
    sets = Sets(vector(law, parameters), dt, np.asarray(x, dtype=float), command, v, a, hold, run_in, substep)
    out = run_records(law, [sets], threads=threads, narx=narx, columns=columns)[0]
    return dict(zip(columns, out[0], strict=True))


@dataclass(frozen=True)
class FrameInput:
    """A shear frame for `run_frame`: arrays (storeys,) in SI units, the ground up; None is ideal or none.

    `damper_between`: the two floors (0 the ground), or None without a damper. `friction` (N): dry friction per
    storey; `friction_width` (m/s): the velocity over which it turns as F tanh(v / width), 0: it builds up over
    `friction_presliding` (m) of drift, 0: 10 um.
    `one_sided` (N/m), `cubic` (N/m3): beside stiffness times drift x a storey pushes back with one_sided x while x is
    positive, and with cubic x^3; no effect of the catalogue, for a diagnosis to hold the catalogue against.
    `damping2` (N s2/m2): damping2 |v| v beside damping times the rate v of the drift.
    `acc_*`: the floors' accelerometers (gain, offset m/s2, leakage s, lag s and its second pole s; the share of the
    charge that leaks with another time constant, and that in s; the damping ratio of a lag of second order in place of
    the two poles; an offset besides, m/s2, that dies away from the start with a time constant in s, 0: 1 s).
    `sway`, `rock`: mass (kg), stiffness (N/m) and damping (N s/m) of a foundation that moves, None: rigid; rocking as
    the drift that it adds to every storey, heights h alike: I / h^2, k / h^2, c / h^2. For a diagnosis alone.
    """

    mass: Array
    stiffness: Array
    damping: Array
    damper_between: tuple[int, int] | None = (0, 1)
    friction: Array | None = None
    acc_gain: Array | None = None
    acc_offset: Array | None = None
    acc_leakage: Array | None = None
    acc_lag: Array | None = None
    acc_lag2: Array | None = None
    friction_width: Array | None = None
    friction_presliding: Array | None = None
    one_sided: Array | None = None
    cubic: Array | None = None
    damping2: Array | None = None
    acc_leakage_share: Array | None = None
    acc_leakage2: Array | None = None
    acc_ratio: Array | None = None
    acc_settle: Array | None = None
    acc_settle_time: Array | None = None
    sway: tuple[float, float, float] | None = None
    rock: tuple[float, float, float] | None = None


def frame_columns(storeys: int) -> tuple[str, ...]:
    """Names of the columns of `run_frame`: absolute accelerations (m/s2) and displacements to the ground (m) by
    floor, force and true force (N), stroke (m), stroke_velocity (m/s), current, field, temperature (K)."""
    floors = range(1, storeys + 1)
    rest = ("force", "true", "stroke", "stroke_velocity", "current", "field", "temperature")
    return (*(f"acceleration_{i}" for i in floors), *(f"displacement_{i}" for i in floors), *rest)


def run_frame_many(
    law: str,
    params: Array,
    frames: Sequence[FrameInput],
    dt: float,
    ground_acceleration: Array,
    u: Array,
    *,
    hold: bool = False,
    substep: float | None = None,
    threads: int = 1,
    narx: Narx | None = None,
) -> list[dict[str, Array]]:
    """Many frames (one per row of params) through one ground motion (n,), m/s2, with the command u (n,).

    Returns per frame an array (n,) for each of `frame_columns`.
    """
    matrix = _matrix(params)
    if len(frames) != len(matrix):
        raise InputError(f"{len(frames)} frames for {len(matrix)} parameter sets")
    n = len(ground_acceleration)
    ground, command = _channel("ground_acceleration", ground_acceleration, n), _channel("u", u, n)
    assert ground is not None
    assert command is not None
    keep: list[Array] = []
    rows = (Frame * len(frames))()
    for row, frame in zip(rows, frames, strict=True):
        fill_frame(row, frame, keep)
    sizes = [(2 * row.storeys + 7) * n for row in rows]
    out = np.empty(sum(sizes))
    options = Options(int(hold), threads, substep or 0.0, 0, 0)
    net = narx.handle if narx else None
    checked(
        library().mrdamp_run_frame, law_number(law), net, len(matrix), pointer(matrix), rows, dt, n, pointer(ground),
        pointer(command), ctypes.byref(options), pointer(out),
    )  # fmt: skip
    parts = np.split(out, np.cumsum(sizes)[:-1])
    return [
        dict(zip(frame_columns(row.storeys), part.reshape(-1, n), strict=True))
        for row, part in zip(rows, parts, strict=True)
    ]


def run_frame(
    law: str,
    parameters: Mapping[str, float],
    frame: FrameInput,
    dt: float,
    ground_acceleration: Array,
    u: Array | float = 0.0,
    *,
    hold: bool = False,
    substep: float | None = None,
    narx: Narx | None = None,
) -> dict[str, Array]:
    """One frame through one ground motion; arguments as in `run_frame_many`."""
    command = np.full(len(ground_acceleration), float(u)) if np.ndim(u) == 0 else np.asarray(u, dtype=float)
    return run_frame_many(
        law, vector(law, parameters), [frame], dt, ground_acceleration, command, hold=hold, substep=substep, narx=narx
    )[0]


_STOREY_ROWS = tuple(f.name for f in fields(FrameInput) if f.name not in ("damper_between", "sway", "rock"))


def fill_frame(row: Frame, frame: FrameInput, keep: list[Array]) -> None:
    """Writes a frame into the C entry's structure; the arrays that it then points to are added to keep."""
    row.storeys = len(frame.mass)
    for name in _STOREY_ROWS:
        array = _channel(name, getattr(frame, name), row.storeys)
        if array is not None:
            keep.append(array)
            setattr(row, name, pointer(array))
    row.damper_from, row.damper_to = frame.damper_between or (-1, -1)
    row.sway_mass, row.sway_stiffness, row.sway_damping = frame.sway or (0.0, 0.0, 0.0)
    row.rock_mass, row.rock_stiffness, row.rock_damping = frame.rock or (0.0, 0.0, 0.0)


def _channel(name: str, value: Array | None, n: int) -> Array | None:
    if value is None:
        return None
    array = numbers_of(name, value)
    if array.shape != (n,):
        raise InputError(f"'{name}' has shape {array.shape}; expected ({n},)")
    return array


def _matrix(params: Array) -> Array:
    """(sets, attributes), contiguous; one set may be (attributes,)."""
    matrix = np.atleast_2d(numbers_of("params", params))
    if matrix.ndim != 2 or matrix.shape[1] != len(attributes()):
        raise InputError(f"params has shape {np.shape(params)}; expected (sets, {len(attributes())}), as by `vector`")
    return matrix
