"""C++ side of dampers in worlds: structures of `plugin_cpp/core/worlds.h`."""

from __future__ import annotations

import ctypes

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
