"""The C++ chain from Python: whole records, whole frames, the attribute table (ctypes over `mrdamp.h`)."""

from __future__ import annotations

import ctypes
import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mrdamp.errors import InputError
from mrdamp.library import library_path

Array = npt.NDArray[np.float64]
_double_p = ctypes.POINTER(ctypes.c_double)

#: Columns of a run, in the order of the enum in `mrdamp.h`: force at the rod end as the damper's sensor reads it
#: (N), the same on an ideal load cell (N), force without the moving mass (N), coil current and field variable
#: (command units), rise of the fluid's temperature (K), piston displacement behind the mount (m), the law's state.
COLUMNS = ("force", "reference", "true", "current", "field", "temperature", "piston", "state")

_ABI = 1
_ERROR_SIZE = 400


class _Options(ctypes.Structure):
    _fields_ = (("hold", ctypes.c_int), ("threads", ctypes.c_int), ("substep", ctypes.c_double))


class _Frame(ctypes.Structure):
    _fields_ = (
        ("storeys", ctypes.c_int),
        ("mass", _double_p),
        ("stiffness", _double_p),
        ("damping", _double_p),
        ("friction", _double_p),
        ("damper_from", ctypes.c_int),
        ("damper_to", ctypes.c_int),
        ("acc_gain", _double_p),
        ("acc_offset", _double_p),
        ("acc_leakage", _double_p),
        ("acc_lag", _double_p),
    )


@functools.cache
def library() -> ctypes.CDLL:
    """The shared library of plugin and C entries, loaded once (it needs MuJoCo in the process)."""
    import mujoco  # noqa: F401  (loads the engine that the library is linked to)

    lib = ctypes.CDLL(str(library_path()))
    if lib.mrdamp_abi() != _ABI:
        raise ImportError(f"{library_path().name} has interface {lib.mrdamp_abi()}, not {_ABI}: reinstall mrdamp")
    c_int, c_double, c_char_p, c_void_p = ctypes.c_int, ctypes.c_double, ctypes.c_char_p, ctypes.c_void_p
    for name in ("name", "group", "unit", "meaning"):
        getattr(lib, f"mrdamp_attribute_{name}").restype = c_char_p
    for name in ("default", "min", "max"):
        getattr(lib, f"mrdamp_attribute_{name}").restype = c_double
    lib.mrdamp_law_name.restype = c_char_p
    lib.mrdamp_narx_parse.restype = c_void_p
    lib.mrdamp_narx_parse.argtypes = (c_char_p, c_char_p, c_int)
    lib.mrdamp_narx_free.argtypes = (c_void_p,)
    lib.mrdamp_narx_free.restype = None
    lib.mrdamp_narx_sample_time.argtypes = (c_void_p,)
    lib.mrdamp_narx_sample_time.restype = c_double
    lib.mrdamp_narx_inputs.argtypes = (c_void_p,)
    lib.mrdamp_narx_forward.argtypes = (c_void_p, _double_p)
    lib.mrdamp_narx_forward.restype = c_double
    lib.mrdamp_defaults.argtypes = (_double_p,)
    lib.mrdamp_defaults.restype = None
    lib.mrdamp_check.argtypes = (c_int, _double_p, c_char_p, c_int)
    lib.mrdamp_run.argtypes = (
        (c_int, c_void_p, c_int, _double_p, c_double, c_int)
        + (_double_p,) * 4
        + (ctypes.POINTER(_Options), c_int, ctypes.POINTER(c_int), _double_p, c_char_p, c_int)
    )
    lib.mrdamp_run_frame.argtypes = (
        (c_int, c_void_p, c_int, _double_p, ctypes.POINTER(_Frame), c_double, c_int)
        + (_double_p,) * 2
        + (ctypes.POINTER(_Options), _double_p, c_char_p, c_int)
    )
    return lib


@dataclass(frozen=True)
class Attribute:
    """One row of the attribute table: `group` is law, dependence, command, numerics or an effect's name."""

    name: str
    group: str
    unit: str
    default: float | None
    minimum: float
    maximum: float
    meaning: str


@functools.cache
def attributes() -> tuple[Attribute, ...]:
    """Every numeric attribute of `mrdamp.damper`, in the order of the parameter vector."""
    lib = library()
    rows = []
    for i in range(lib.mrdamp_attribute_count()):
        name, group, unit, meaning = (
            getattr(lib, f"mrdamp_attribute_{what}")(i).decode() for what in ("name", "group", "unit", "meaning")
        )
        default, low, high = (getattr(lib, f"mrdamp_attribute_{what}")(i) for what in ("default", "min", "max"))
        rows.append(Attribute(name, group, unit, None if math.isnan(default) else default, low, high, meaning))
    return tuple(rows)


@functools.cache
def attribute_index() -> dict[str, int]:
    """Position of each attribute in a parameter vector."""
    return {row.name: i for i, row in enumerate(attributes())}


@functools.cache
def laws() -> tuple[str, ...]:
    """Names of the force laws."""
    lib = library()
    return tuple(lib.mrdamp_law_name(i).decode() for i in range(lib.mrdamp_law_count()))


def law_number(law: str) -> int:
    """Number of a law in the C interface; InputError lists the laws."""
    if law not in laws():
        raise InputError(f"law '{law}' is unknown; allowed: {', '.join(laws())}")
    return laws().index(law)


@functools.cache
def law_parameters(law: str) -> tuple[str, ...]:
    """Names of the parameters that a law needs, in the contract's order."""
    lib, number = library(), law_number(law)
    names = [row.name for i, row in enumerate(attributes()) if lib.mrdamp_law_uses(number, i) == 1]
    order = _ORDER.get(law, ())
    return tuple(sorted(names, key=order.index)) if set(order) == set(names) else tuple(names)


@functools.cache
def law_options(law: str) -> tuple[str, ...]:
    """Names of the parameters that a law may take besides: dependences on the field that are no straight line."""
    lib, number = library(), law_number(law)
    return tuple(row.name for i, row in enumerate(attributes()) if lib.mrdamp_law_uses(number, i) == 2)


_ORDER = {
    "bingham": tuple("c0a c0b fya fyb v_ref".split()),
    "bouc_wen": tuple("c0a c0b alpha_a alpha_b gamma beta A n k0 x0".split()),
    "hyperbolic_tangent": tuple("k0a k0b k1a k1b c0a c0b c1a c1b m0 f0a f0b v_ref".split()),
    "modified_bouc_wen": tuple("c0a c0b c1a c1b k0 k1 x0 alpha_a alpha_b gamma beta A n".split()),
}


def defaults() -> Array:
    """The neutral parameter vector (attributes,)."""
    out = np.empty(len(attributes()))
    library().mrdamp_defaults(_pointer(out))
    return out


def vector(law: str, parameters: Mapping[str, float]) -> Array:
    """Parameter vector (attributes,) from names; effects' attributes may stand among a law's parameters.

    Raises InputError for an unknown name, a missing or surplus parameter of the law, or a value out of range.
    """
    number, index, out = law_number(law), attribute_index(), defaults()
    missing = [name for name in law_parameters(law) if name not in parameters]
    if missing:
        raise InputError(f"law {law} needs parameter '{missing[0]}'; it takes {' '.join(law_parameters(law))}")
    allowed = set(law_parameters(law)) | set(law_options(law))
    for name, value in parameters.items():
        row = attributes()[index[name]] if name in index else None
        if row is None or (row.group in ("law", "dependence") and name not in allowed):
            raise InputError(
                f"parameter '{name}' is none of law {law}; it takes {' '.join(law_parameters(law)) or 'weights alone'}"
            )
        out[index[name]] = value
    check(number, out)
    return out


def check(law: int, params: Array) -> None:
    """Checks ranges and what the law needs, as MJCF does; raises InputError."""
    error = ctypes.create_string_buffer(_ERROR_SIZE)
    if library().mrdamp_check(law, _pointer(params), error, _ERROR_SIZE):
        raise InputError(error.value.decode())


class Narx:
    """A NARX network in the plugin's weights format (see `plugin_cpp/README.md`)."""

    def __init__(self, text: str) -> None:
        error = ctypes.create_string_buffer(_ERROR_SIZE)
        self.text = text
        self._lib = library()
        self.handle = self._lib.mrdamp_narx_parse(text.encode(), error, _ERROR_SIZE)
        if not self.handle:
            raise InputError(error.value.decode())
        self.sample_time: float = self._lib.mrdamp_narx_sample_time(self.handle)  # s
        self.inputs: int = self._lib.mrdamp_narx_inputs(self.handle)

    def __del__(self) -> None:
        if getattr(self, "handle", None):
            self._lib.mrdamp_narx_free(self.handle)
            self.handle = None

    @classmethod
    def read(cls, path: Path) -> Narx:
        """Reads a weights file; raises InputError naming it."""
        try:
            return cls(Path(path).read_text())
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{path}: {error}") from None
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def forward(self, inputs: Array) -> float:
        """One pass: physical inputs (inputs,) in the order of the file -> force (N)."""
        values = np.ascontiguousarray(inputs, dtype=float)
        if values.shape != (self.inputs,):
            raise InputError(f"the network takes {self.inputs} inputs, got an array of shape {values.shape}")
        return float(self._lib.mrdamp_narx_forward(self.handle, _pointer(values)))


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
    substep: float | None = None,
    threads: int = 1,
    narx: Narx | None = None,
    columns: Sequence[str] = ("force",),
) -> Array:
    """Many parameter sets through one record.

    params (sets, attributes) as by `vector`; x (m), u (command), v (m/s), a (m/s2): (n,) at the sample time dt (s).
    v and a are differentiated where they are not given. `hold`: the command is held between samples, as
    MuJoCo does; otherwise straight lines. Returns (sets, columns, n); the same for any number of threads.
    """
    matrix = np.ascontiguousarray(np.atleast_2d(params), dtype=float)
    arrays = [_channel(name, value, len(x)) for name, value in (("x", x), ("v", v), ("a", a), ("u", u))]
    numbers = np.array([_column(name) for name in columns], dtype=np.intc)
    out = np.empty((len(matrix), len(columns), len(x)))
    options = _Options(int(hold), threads, substep or 0.0)
    error = ctypes.create_string_buffer(_ERROR_SIZE)
    failed = library().mrdamp_run(
        law_number(law),
        narx.handle if narx else None,
        len(matrix),
        _pointer(matrix),
        dt,
        len(x),
        *(None if array is None else _pointer(array) for array in arrays),
        ctypes.byref(options),
        len(columns),
        numbers.ctypes.data_as(ctypes.POINTER(ctypes.c_int)),
        _pointer(out),
        error,
        _ERROR_SIZE,
    )
    if failed:
        raise InputError(error.value.decode())
    return out


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
    substep: float | None = None,
    threads: int = 1,
    narx: Narx | None = None,
    columns: Sequence[str] = ("force",),
) -> dict[str, Array]:
    """One damper through one record; arguments as in `run_many`. Returns an array (n,) per column."""
    command = np.full(len(x), float(u)) if np.ndim(u) == 0 else np.asarray(u, dtype=float)
    out = run_many(
        law,
        vector(law, parameters),
        dt,
        np.asarray(x, dtype=float),
        command,
        v=v,
        a=a,
        hold=hold,
        substep=substep,
        threads=threads,
        narx=narx,
        columns=columns,
    )
    return dict(zip(columns, out[0], strict=True))


@dataclass(frozen=True)
class FrameInput:
    """A shear frame for `run_frame`: arrays (storeys,) in SI units, the ground up; None is ideal or none.

    `damper_between`: the two floors (0 the ground), or None without a damper. `friction` (N): dry friction per
    storey. `acc_*`: the floors' accelerometers (gain, offset m/s2, leakage s, lag s).
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
    matrix = np.ascontiguousarray(np.atleast_2d(params), dtype=float)
    if len(frames) != len(matrix):
        raise InputError(f"{len(frames)} frames for {len(matrix)} parameter sets")
    ground = _channel("ground_acceleration", ground_acceleration, len(ground_acceleration))
    command = _channel("u", u, len(ground_acceleration))
    assert ground is not None
    assert command is not None
    keep: list[Array] = []

    def pointer(name: str, value: Array | None, storeys: int) -> object:
        array = _channel(name, value, storeys)
        if array is None:
            return None
        keep.append(array)
        return _pointer(array)

    rows = (_Frame * len(frames))()
    n = len(ground)
    for row, frame in zip(rows, frames, strict=True):
        row.storeys = len(frame.mass)
        for name in ("mass", "stiffness", "damping", "friction", "acc_gain", "acc_offset", "acc_leakage", "acc_lag"):
            setattr(row, name, pointer(name, getattr(frame, name), row.storeys))
        row.damper_from, row.damper_to = frame.damper_between or (-1, -1)
    sizes = [(2 * row.storeys + 7) * n for row in rows]
    out = np.empty(sum(sizes))
    options = _Options(int(hold), threads, substep or 0.0)
    error = ctypes.create_string_buffer(_ERROR_SIZE)
    failed = library().mrdamp_run_frame(
        law_number(law),
        narx.handle if narx else None,
        len(matrix),
        _pointer(matrix),
        rows,
        dt,
        n,
        _pointer(ground),
        _pointer(command),
        ctypes.byref(options),
        _pointer(out),
        error,
        _ERROR_SIZE,
    )
    if failed:
        raise InputError(error.value.decode())
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


def _pointer(array: Array) -> object:
    return array.ctypes.data_as(_double_p)


def _channel(name: str, value: Array | None, n: int) -> Array | None:
    if value is None:
        return None
    array = np.ascontiguousarray(value, dtype=float)
    if array.shape != (n,):
        raise InputError(f"'{name}' has shape {array.shape}; expected ({n},)")
    return array


def _column(name: str) -> int:
    if name not in COLUMNS:
        raise InputError(f"column '{name}' is unknown; allowed: {', '.join(COLUMNS)}")
    return COLUMNS.index(name)
