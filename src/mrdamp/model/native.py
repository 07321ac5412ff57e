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

_ABI = 14
ERROR_SIZE = 400


class Motions(ctypes.Structure):
    """`mrdamp_record` of `mrdamp.h`."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("nset", "n")),
        *((name, ctypes.c_double) for name in ("dt", "substep")),
        *((name, ctypes.c_int) for name in ("hold", "run_in")),
        *((name, double_p) for name in ("params", "x", "v", "a", "u", "out")),
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
        ("grounds", ctypes.c_int),
        ("mass", ctypes.c_double),
    )


class Car(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_double) for name in ("body", "wheel", "stiffness", "damping")),
        *((name, ctypes.c_double) for name in ("tyre_stiffness", "tyre_damping", "weight")),
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


def _entries() -> dict[str, tuple[Any, ...]]:
    """What an entry returns and takes; those that take nothing but a whole number are left to ctypes."""
    whole, real, text, address, p = ctypes.c_int, ctypes.c_double, ctypes.c_char_p, ctypes.c_void_p, ctypes.POINTER
    error, making = (text, whole), (p(Dampers), p(whole), real, whole, whole)
    texts = ("attribute_name", "attribute_group", "attribute_unit", "attribute_meaning", "law_name", "law_equations",
             "law_parameters", "law_search", "law_sources", "source", "effect")  # fmt: skip
    return {
        **dict.fromkeys(texts, (text,)),
        **dict.fromkeys(("attribute_default", "attribute_min", "attribute_max"), (real,)),
        "narx_parse": (address, text, *error),
        "narx_free": (None, address),
        "narx_sample_time": (real, address),
        "narx_inputs": (whole, address),
        "narx_forward": (real, address, double_p),
        "defaults": (None, double_p),
        "check": (whole, whole, double_p, *error),
        "run_records": (whole, whole, address, whole, p(Motions), whole, whole, whole, p(whole), *error),
        "run_in": (whole, real, whole, double_p, double_p, double_p, p(whole), p(whole), *error),
        "true_motion": (None, real, real, real, real, whole, double_p, double_p, double_p),
        "run_frame": (
            whole, whole, address, whole, double_p, p(Frame), real, whole, double_p, double_p, p(Options), double_p,
            *error,
        ),
        "rows_frame": (address, p(Frame), *making, *error),
        "rows_linear": (address, p(LinearStructure), p(Dampers), real, whole, *error),
        "rows_car": (address, p(Car), p(Dampers), real, whole, whole, *error),
        **dict.fromkeys(("rows_size", "rows_measurements", "rows_criteria"), (whole, address)),
        "rows_free": (None, address),
        "rows_noise": (whole, address, double_p, *error),
        "rows_within": (None, address, double_p),
        "rows_start": (None, address, real, p(Load), address, address),
        # Called every control period: addresses, which are quicker to hand over than typed pointers.
        "rows_step": (None, address, whole, *(address,) * 5, whole, whole),
        "rows_step_each": (None, address, whole, *(address,) * 5, whole),
        "worlds_sizes": (None, p(whole)),
        "worlds_net": (address, address),
        **dict.fromkeys(("worlds_act", "worlds_read"), (None, address, whole)),
    }  # fmt: skip


@functools.cache
def library() -> ctypes.CDLL:
    """The shared library of plugin and C entries, loaded once. Raises EngineError for another MuJoCo."""
    load_plugin()  # brings the engine that the library is linked to
    lib = ctypes.CDLL(str(library_path()))
    if lib.mrdamp_abi() != _ABI:
        raise ImportError(
            f"{library_path().name} has interface {lib.mrdamp_abi()}, not {_ABI}: reinstall mrdamp"
        )
    for name, (result, *arguments) in _entries().items():
        entry = getattr(lib, f"mrdamp_{name}")
        entry.restype, entry.argtypes = result, arguments or None
    return lib


def rows(table: str) -> Iterator[list[str]]:
    """Fields of the rows of the C table's `source` or `effect`."""
    for row in takewhile(bool, map(getattr(library(), f"mrdamp_{table}"), count())):
        yield row.decode().split("\t")


def numbers_of(name: str, value: Any) -> Array:
    """An array of doubles, contiguous; InputError for anything but real numbers."""
    try:
        array = np.asarray(value)
        if np.iscomplexobj(array):
            raise ValueError
        return np.ascontiguousarray(array, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} is no array of real numbers") from None


def pointer(array: Array) -> object:
    return array.ctypes.data_as(double_p)


def whole_pointer(array: npt.NDArray[np.intc]) -> object:
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_int))


def checked(function: Any, *arguments: Any) -> None:
    """Calls a function of the library that returns 0, or else writes one line; raises InputError with that line."""
    error = ctypes.create_string_buffer(ERROR_SIZE)
    if function(*arguments, error, ERROR_SIZE):
        raise InputError(error.value.decode())
