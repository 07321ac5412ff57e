"""C++ side of dampers in worlds (`plugin_cpp/core/worlds.h`): its structures, and its sources for a GPU's compiler."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path

import numpy as np

from mrdamp.model.attributes import attributes, defaults
from mrdamp.model.core import Array
from mrdamp.model.native import library


class Reading(ctypes.Structure):
    """`Reading` of `core/reading.h`."""

    _fields_ = (
        ("signal", ctypes.c_int),
        *((name, ctypes.c_double) for name in ("sensitivity", "resolution", "range", "noise")),
        ("key", ctypes.c_uint64),
    )


class Worlds(ctypes.Structure):
    """`Worlds` of `core/worlds.h`."""

    _fields_ = (
        *((n, ctypes.c_int) for n in ("worlds", "dampers", "actuators", "controls", "sensors", "readings", "sets")),
        ("timestep", ctypes.c_double),
        *(
            (name, ctypes.c_void_p)
            for name in (
                "law", "params", "net", "actuator", "control", "control_range", "force_range", "store", "lines",
                "pasts", "time", "length", "velocity", "ctrl", "force", "free", "weight", "bare", "acceleration",
                "reading_damper", "reading_column", "reading", "effects", "cutoff", "reading_store", "sensordata",
            )
        ),
    )  # fmt: skip


#: Bytes of what `core/worlds.h` stores, in the order of `mrdamp_worlds_sizes`.
_SIZES = ("Worlds", "WorldDamper", "WorldLine", "WorldPast", "Reading", "ReadingState", "SensorParams", "most")


def sizes() -> dict[str, int]:
    """Bytes of the C++ structures, and the largest number of dampers (`most`)."""
    out = (ctypes.c_int * len(_SIZES))()
    library().mrdamp_worlds_sizes(out)
    return dict(zip(_SIZES, out, strict=True))


def free_attributes(params: Array) -> tuple[int, ...]:
    """Numbers of the attributes that are not neutral in params (..., attributes); the others are compiled in."""
    rows, neutral = params.reshape(-1, params.shape[-1]), defaults()
    given = ~((rows == neutral) | (np.isnan(rows) & np.isnan(neutral)))
    return tuple(int(k) for k in np.flatnonzero(given.any(axis=0)))


def fields(free: tuple[int, ...]) -> str:
    """`core/fields.h`: the members of `Params`, all but `free` as constants."""

    def literal(x: float) -> str:
        return "kUnset" if np.isnan(x) else f"{'-' if x < 0 else ''}kInf" if np.isinf(x) else repr(float(x))

    lines = []
    for k, (row, value) in enumerate(zip(attributes(), defaults(), strict=True)):
        kind = "Real" if k in free else "static constexpr double"
        lines.append(f"{kind} {row.name} = {literal(value)};\n")
    return "".join(lines)


def sources() -> Path:
    """Folder of the C++ sources; raises ImportError where the package lacks them."""
    for folder in sys.modules["mrdamp"].__path__:
        path = Path(folder) / "cpp"
        if (path / "device" / "worlds.cu").is_file():
            return path
    raise ImportError("mrdamp: the C++ sources are missing from the package; install again: pip install .")
