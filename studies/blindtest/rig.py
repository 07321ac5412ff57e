"""The reference rig's library (`rig.c`): simulates one test of a damper or a frame."""

from __future__ import annotations

import ctypes
import functools
import os
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
Array = NDArray[np.float64]
Numbers = Mapping[str, float]

#: The laws of the plugin; `ALL_LAWS` has one more.
LAWS = ("bingham", "bouc_wen", "hyperbolic_tangent", "modified_bouc_wen")
ALL_LAWS = (*LAWS, "sigmoid")
#: Integration steps per second; inputs are given at half steps.
RATE_HZ = 25_000
INPUT_RATE_HZ = 2 * RATE_HZ

_DAMPER = ("force", "fluid", "current", "field", "heat", "piston")
_FRAME = (
    *(f"acceleration{k}" for k in (1, 2, 3)),
    *(f"displacement{k}" for k in (1, 2, 3)),
    *("force", "stroke", "current", "field", "heat"),
)
_double_p = ctypes.POINTER(ctypes.c_double)
_Callback = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double, _double_p)


class BlownUp(InputError):
    """A run that diverged because its parameters are too stiff for the rig's step."""


@functools.cache
def _library() -> tuple[ctypes.CDLL, tuple[str, ...], tuple[str, ...]]:
    """The library, and the names of the parameters of a rig and of a storey."""
    lib = ctypes.CDLL(str(_compiled()))
    for name in ("rig_damper", "rig_frame", "rig_frame_controlled"):
        getattr(lib, name).restype = ctypes.c_long
    text = ctypes.create_string_buffer(4096)
    lib.rig_names(text, len(text))
    rig, storey = text.value.decode().split("|")
    return lib, tuple(rig.split()), tuple(storey.split())


def _compiled() -> Path:
    """The library in build/, compiled where it is older than its source. Raises InputError."""
    source = Path(__file__).with_name("rig.c")
    library = ROOT / "build" / "librig.so"
    if library.is_file() and library.stat().st_mtime > source.stat().st_mtime:
        return library
    library.parent.mkdir(exist_ok=True)
    # The same bits as in every build: no fused multiply-add, no code of one machine.
    options = "-std=c99 -O3 -ffp-contract=off -fno-math-errno -fvisibility=hidden -fPIC -shared".split()
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        made = Path(folder) / library.name
        compiler = os.environ.get("CC", "gcc")
        try:
            subprocess.run([compiler, *options, str(source), "-o", str(made), "-lm"], check=True)
        except (OSError, subprocess.CalledProcessError) as error:
            raise InputError(f"{source}: {error}; a C compiler is needed: CC=...") from None
        made.replace(library)  # whole, whoever else compiles it
    return library


def run_damper(numbers: Numbers, x: Array, v: Array, u: Array) -> dict[str, Array]:
    """A rod with imposed motion.

    numbers: names as in `rig.c`, with `law` as an index into `ALL_LAWS`; missing ones are zero (neutral). x
    (m), v (m/s), u (command): (2 n - 1,) at half steps. Returns (n,) arrays at `RATE_HZ`: force on the load
    cell (N), the fluid's part, current, field, heat (K above the surroundings), piston (m).

    Raises InputError for an unknown parameter and BlownUp if a run diverges.
    """
    lib, names, _ = _library()
    n = (len(x) + 1) // 2
    out = np.empty((n, len(_DAMPER)))
    held = [_row(names, numbers), *(np.ascontiguousarray(a, dtype=float) for a in (x, v, u))]
    table, *inputs = (_pointer(a) for a in held)
    step = ctypes.c_double(1 / RATE_HZ)
    _finite(lib.rig_damper(table, step, ctypes.c_long(n), *inputs, _pointer(out)))
    return dict(zip(_DAMPER, out.T, strict=True))


def run_frame(
    numbers: Numbers, storeys: Sequence[Numbers], damper_floors: tuple[int, int], ground: Array, u: Array
) -> dict[str, Array]:
    """A shear frame of three storeys on a shaking table with the damper between two floors (0 is the ground).

    storeys: their parameters from the ground up. ground (m/s2), u: (2 n - 1,) at half steps. Returns (n,)
    arrays at `RATE_HZ`: acceleration1..3 (absolute, m/s2), displacement1..3 (relative to the ground, m),
    force (N), stroke (m), current, field, heat (K).
    """
    lib, names, storey_names = _library()
    n = (len(ground) + 1) // 2
    out = np.empty((n, len(_FRAME)))
    table = np.concatenate([_row(storey_names, s) for s in storeys])
    held = [_row(names, numbers), table, *(np.ascontiguousarray(a, dtype=float) for a in (ground, u))]
    rig, frame, *inputs = (_pointer(a) for a in held)
    ends = (ctypes.c_int(damper_floors[0]), ctypes.c_int(damper_floors[1]))
    step = ctypes.c_double(1 / RATE_HZ)
    _finite(lib.rig_frame(rig, frame, *ends, step, ctypes.c_long(n), *inputs, _pointer(out)))
    return dict(zip(_FRAME, out.T, strict=True))


def run_frame_controlled(
    numbers: Numbers,
    storeys: Sequence[Numbers],
    damper_floors: tuple[int, int],
    ground: Array,
    every: int,
    command: Callable[[float, dict[str, float]], float],
) -> dict[str, Array]:
    """The same frame with feedback.

    command: function that is called every `every` steps with the time (s) and, as numbers, the outputs of
    `run_frame` and `stroke_velocity` (m/s). The force is the load cell's, with `cell_gain` and `cell_lag`. The value
    is constant until the next call. Returns the arrays of
    `run_frame` and `command` (n,). An exception in `command` is raised here.
    """
    lib, names, storey_names = _library()
    n = (len(ground) + 1) // 2
    out, u = np.empty((n, len(_FRAME))), np.empty(n)
    table = np.concatenate([_row(storey_names, s) for s in storeys])
    rig, frame, ag = _row(names, numbers), table, np.ascontiguousarray(ground, dtype=float)
    seen = (*_FRAME, "stroke_velocity")
    failed: list[BaseException] = []

    def called(time: float, row: Any) -> float:
        try:
            return float(command(time, dict(zip(seen, row[: len(seen)], strict=True)))) if not failed else 0.0
        except BaseException as error:  # an exception cannot pass through C
            failed.append(error)
            return 0.0

    ends = (ctypes.c_int(damper_floors[0]), ctypes.c_int(damper_floors[1]))
    step = ctypes.c_double(1 / RATE_HZ)
    done = lib.rig_frame_controlled(
        _pointer(rig), _pointer(frame), *ends, step, ctypes.c_long(n), _pointer(ag), ctypes.c_long(every),
        _Callback(called), _pointer(u), _pointer(out),
    )  # fmt: skip
    if failed:
        raise failed[0]
    _finite(done)
    return {**dict(zip(_FRAME, out.T, strict=True)), "command": u}


def _row(names: tuple[str, ...], numbers: Numbers) -> Array:
    unknown = set(numbers) - set(names)
    if unknown:
        raise InputError(f"reference rig: no number {sorted(unknown)}; there are {', '.join(names)}")
    return np.array([numbers.get(name, 0.0) for name in names], dtype=float)


def _pointer(array: Array) -> object:
    return array.ctypes.data_as(_double_p)


def _finite(step: int) -> None:
    if step >= 0:
        raise BlownUp(f"reference rig: the run blows up after {step / RATE_HZ:.4f} s")
