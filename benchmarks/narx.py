"""A pass of a NARX network of 15 inputs, 20 hidden units and one output, in a loop in C."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.frames import Stepper, frame
from benchmarks.result import Figure, Section, of_ratio
from benchmarks.timing import Effort, clock, interleave, ratio
from mrdamp.model import core

TITLE, WHAT, TARGET = "NARX network 15-20-1", "one pass", "<= 0.5"
INPUTS = " ".join([*(f"x:{k}" for k in range(4)), *(f"v:{k}" for k in range(4)), *(f"i:{k}" for k in range(3)),
                   *(f"F:{k}" for k in range(4, 0, -1))])  # fmt: skip


def weights() -> str:
    """A weights file with random numbers of a trained network's size; the force's last value is the last input."""
    rng = np.random.default_rng(4)

    def row(n: int, size: float) -> str:
        return " ".join(f"{value:.17g}" for value in rng.uniform(-size, size, n))

    scale = " ".join(["100"] * 4 + ["5"] * 4 + ["0.5"] * 3 + ["1e-3"] * 4)
    return "\n".join([
        "mrdamp-narx 1", "sample_time 0.001", f"inputs 15 {INPUTS}", "offset" + " 0" * 15, f"scale {scale}",
        "force 0 1000", "hidden 1 20", f"weight {row(300, 0.5)}", f"bias {row(20, 0.5)}", f"weight {row(20, 0.3)}",
        f"bias {row(1, 0.1)}", "end", "",
    ])  # fmt: skip


Loop = Callable[[int], float]


def loop(net: core.Narx, folder: Path) -> Loop | None:
    """n passes in compiled code -> the last force; None where there is no C compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return None
    library = folder / "narx_loop.so"
    source = Path(__file__).with_name("narx_loop.c")
    subprocess.run([compiler, "-O2", "-shared", "-fPIC", str(source), "-o", str(library)], check=True)
    run = ctypes.CDLL(str(library)).narx_loop
    run.restype = ctypes.c_double
    run.argtypes = (
        ctypes.c_void_p,
        ctypes.c_void_p,
        ctypes.POINTER(ctypes.c_double),
        ctypes.c_int,
        ctypes.c_long,
    )
    forward = ctypes.cast(core.library().mrdamp_narx_forward, ctypes.c_void_p)
    start = np.zeros(net.inputs)

    def passes(n: int) -> float:
        values = start.copy()
        pointer = values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
        return float(run(forward, net.handle, pointer, net.inputs - 1, n))

    return passes


def measure(effort: Effort) -> list[Section]:
    """The table."""
    text = "In double precision; the last output is fed back."
    net = core.Narx(weights())
    with tempfile.TemporaryDirectory() as folder:
        passes = loop(net, Path(folder))
        if passes is None:
            return [
                Section(
                    TITLE, text, (Figure(WHAT, unit="us", target=TARGET, skipped="no C compiler (cc, gcc)"),)
                )
            ]

        def task() -> float:
            begin = clock()
            force = passes(10 * effort.steps)
            cost = (clock() - begin) / (10 * effort.steps)
            if not 0.0 < abs(force) < 1e4:
                raise RuntimeError(f"the network's force is {force} N")
            return cost

        costs = interleave(
            {"pass": task, "step": Stepper(frame(5e-4, damper=False), effort.steps)}, effort.rounds
        )
    r = ratio(costs["pass"], costs["step"])
    low, high = np.quantile(costs["pass"], (0.25, 0.75))
    return [
        Section(
            TITLE,
            text,
            (
                Figure(WHAT, r.top, "us", TARGET, f"quartiles {low:.2f} to {high:.2f} us"),
                of_ratio("a pass over a step of the frame", r),
            ),
        )
    ]
