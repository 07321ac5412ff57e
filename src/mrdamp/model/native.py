"""The shared library's C interface (`mrdamp.h`), bound by ctypes."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Iterator
from itertools import count, takewhile
from typing import Any

import numpy as np
import numpy.typing as npt

from mrdamp.errors import InputError
from mrdamp.library import library_path, load_plugin

Array = npt.NDArray[np.float64]
double_p = ctypes.POINTER(ctypes.c_double)

_ABI = 12
ERROR_SIZE = 400


class Motions(ctypes.Structure):
    """`mrdamp_record` of `mrdamp.h`."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("nset", "n")),
        *((name, ctypes.c_double) for name in ("dt", "substep")),
        *((name, ctypes.c_int) for name in ("hold", "run_in")),
        *((name, ctypes.POINTER(ctypes.c_double)) for name in ("params", "x", "v", "a", "u", "out")),
    )


class Options(ctypes.Structure):
    _fields_ = (
        ("hold", ctypes.c_int),
        ("threads", ctypes.c_int),
        ("substep", ctypes.c_double),
        ("run_in", ctypes.c_int),
        ("lanes", ctypes.c_int),
    )


class Frame(ctypes.Structure):
    _fields_ = (
        ("storeys", ctypes.c_int),
        *((name, double_p) for name in ("mass", "stiffness", "damping", "friction")),
        ("damper_from", ctypes.c_int),
        ("damper_to", ctypes.c_int),
        *(
            (name, double_p)
            for name in (
                "acc_gain", "acc_offset", "acc_leakage", "acc_lag", "acc_lag2", "friction_width", "friction_presliding",
                "one_sided", "cubic", "damping2", "acc_leakage_share", "acc_leakage2", "acc_ratio", "acc_settle",
                "acc_settle_time",
            )
        ),
        *((f"{how}_{of}", ctypes.c_double) for how in ("sway", "rock") for of in ("mass", "stiffness", "damping")),
    )  # fmt: skip


class Dampers(ctypes.Structure):
    _fields_ = (
        ("count", ctypes.c_int),
        ("law", ctypes.POINTER(ctypes.c_int)),
        ("net", ctypes.POINTER(ctypes.c_void_p)),
        ("params", double_p),
        ("command_max", double_p),
    )


class LinearStructure(ctypes.Structure):
    """`mrdamp_linear` of `mrdamp.h`."""

    _fields_ = (
        ("coordinates", ctypes.c_int),
        ("loads", ctypes.c_int),
        *((name, double_p) for name in ("rate", "load", "stroke", "push")),
        ("places", ctypes.c_int),
        ("at", double_p),
        ("absolute", ctypes.c_int),
        ("mass", ctypes.c_double),
    )


class Car(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_double) for name in ("body", "wheel", "stiffness", "damping", "tyre_stiffness")),
        ("tyre_damping", ctypes.c_double),
        ("weight", ctypes.c_double),
        ("sections", ctypes.c_int),
        ("weighting", double_p),
    )


class Load(ctypes.Structure):
    _fields_ = (
        ("values", double_p),
        ("sample_time", ctypes.c_double),
        ("samples", ctypes.c_int),
        ("steps", ctypes.c_int),
    )


@functools.cache
def library() -> ctypes.CDLL:
    """The shared library of plugin and C entries, loaded once. Raises EngineError for another MuJoCo."""
    load_plugin()  # brings the engine that the library is linked to

    lib = ctypes.CDLL(str(library_path()))
    if lib.mrdamp_abi() != _ABI:
        raise ImportError(
            f"{library_path().name} has interface {lib.mrdamp_abi()}, not {_ABI}: reinstall mrdamp"
        )
    c_int, c_double, c_char_p, c_void_p = ctypes.c_int, ctypes.c_double, ctypes.c_char_p, ctypes.c_void_p
    for name in ("name", "group", "unit", "meaning"):
        getattr(lib, f"mrdamp_attribute_{name}").restype = c_char_p
    for name in ("default", "min", "max"):
        getattr(lib, f"mrdamp_attribute_{name}").restype = c_double
    for name in ("law_name", "law_equations", "law_parameters", "law_search", "law_sources", "source", "effect"):
        getattr(lib, f"mrdamp_{name}").restype = c_char_p
    lib.mrdamp_narx_parse.restype = c_void_p
    lib.mrdamp_narx_parse.argtypes = (c_char_p, c_char_p, c_int)
    lib.mrdamp_narx_free.argtypes = (c_void_p,)
    lib.mrdamp_narx_free.restype = None
    lib.mrdamp_narx_sample_time.argtypes = (c_void_p,)
    lib.mrdamp_narx_sample_time.restype = c_double
    lib.mrdamp_narx_inputs.argtypes = (c_void_p,)
    lib.mrdamp_narx_forward.argtypes = (c_void_p, double_p)
    lib.mrdamp_narx_forward.restype = c_double
    lib.mrdamp_defaults.argtypes = (double_p,)
    lib.mrdamp_defaults.restype = None
    lib.mrdamp_check.argtypes = (c_int, double_p, c_char_p, c_int)
    lib.mrdamp_run_records.argtypes = (
        (c_int, c_void_p, c_int, ctypes.POINTER(Motions), c_int, c_int, c_int, ctypes.POINTER(c_int), c_char_p, c_int)
    )
    whole = ctypes.POINTER(c_int)
    lib.mrdamp_run_in.argtypes = (c_double, c_int, *(double_p,) * 3, whole, whole, c_char_p, c_int)
    lib.mrdamp_run_frame.argtypes = (
        (c_int, c_void_p, c_int, double_p, ctypes.POINTER(Frame), c_double, c_int)
        + (double_p,) * 2
        + (ctypes.POINTER(Options), double_p, c_char_p, c_int)
    )
    rest = (c_double, c_int, c_int, c_char_p, c_int)
    lib.mrdamp_rows_frame.argtypes = (
        ctypes.POINTER(Frame),
        ctypes.POINTER(Dampers),
        ctypes.POINTER(c_int),
        *rest,
    )
    linear = ctypes.POINTER(LinearStructure), ctypes.POINTER(Dampers), c_double, c_int, c_char_p, c_int
    lib.mrdamp_rows_linear.argtypes = linear
    lib.mrdamp_rows_car.argtypes = (ctypes.POINTER(Car), ctypes.POINTER(Dampers), *rest)
    for name in ("frame", "linear", "car"):
        getattr(lib, f"mrdamp_rows_{name}").restype = c_void_p
    lib.mrdamp_rows_free.argtypes = (c_void_p,)
    lib.mrdamp_rows_free.restype = None
    for name in ("size", "measurements", "criteria"):
        getattr(lib, f"mrdamp_rows_{name}").argtypes = (c_void_p,)
    lib.mrdamp_rows_noise.argtypes = (c_void_p, double_p, c_char_p, c_int)
    lib.mrdamp_rows_start.argtypes = (c_void_p, c_double, ctypes.POINTER(Load), c_void_p, c_void_p)
    lib.mrdamp_rows_start.restype = None
    # Called every control period: addresses, which are quicker to hand over than typed pointers.
    lib.mrdamp_rows_step.argtypes = (c_void_p, c_int, *(c_void_p,) * 5, c_int, c_int)
    lib.mrdamp_rows_step.restype = None
    lib.mrdamp_rows_step_each.argtypes = (c_void_p, c_int, *(c_void_p,) * 5, c_int)
    lib.mrdamp_rows_step_each.restype = None
    return lib


def rows(table: str) -> Iterator[list[str]]:
    """Fields of the rows of the C table's `source` or `effect`."""
    for row in takewhile(bool, map(getattr(library(), f"mrdamp_{table}"), count())):
        yield row.decode().split("\t")


def pointer(array: Array) -> object:
    """Pointer to the doubles of a contiguous array."""
    return array.ctypes.data_as(double_p)


def checked(function: Any, *arguments: Any) -> None:
    """Calls a function of the library that returns 0, or else writes one line; raises InputError with that line."""
    error = ctypes.create_string_buffer(ERROR_SIZE)
    if function(*arguments, error, ERROR_SIZE):
        raise InputError(error.value.decode())
