"""`make bench-gpu`: samples per second of the chain on a GPU over those of one core, and the time to compile.

The card's figures include the copies of parameters and forces. Every law, with a driver's lag.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time

import numpy as np

from benchmarks.c_entry import LAWS
from mrdamp import gpu
from mrdamp.errors import InputError
from mrdamp.model import core
from mrdamp.model.attributes import vector

SETS, SAMPLES, DT = 32768, 2000, 1e-3
ON_CORE = 64  # sets


def row(law: str) -> str:
    """Of one law: first call, second call (compiled before), samples/s of both, their ratio, largest difference."""
    t = np.arange(SAMPLES) * DT
    x, u = 0.01 * np.sin(15.0 * t), 1.0 + np.sin(3.0 * t)
    one = vector(law, {**LAWS[law], "driver_lag_tau": 0.02})
    params = np.repeat(one[None], SETS, axis=0) * np.random.default_rng(1).uniform(0.98, 1.02, (SETS, 1))

    def seconds(count: int, device: str) -> tuple[float, core.Array]:
        begin = time.perf_counter()
        force = core.run_many(law, params[:count], DT, x, u, device=device)
        return time.perf_counter() - begin, force

    first, _ = seconds(SETS, "cuda")
    again, force = seconds(SETS, "cuda")
    own, expected = seconds(ON_CORE, "cpu")
    off = np.abs(force[:ON_CORE] - expected).max() / np.abs(expected).max()
    card, processor = SETS * SAMPLES / again, ON_CORE * SAMPLES / own
    return f"{law:20s} {first:8.1f} {again:8.2f} {card:10.2e} {processor:10.2e} {card / processor:7.0f} {off:9.1e}"


def main() -> int:
    """2 without a card."""
    with tempfile.TemporaryDirectory() as cache:
        os.environ["XDG_CACHE_HOME"] = cache
        try:
            print(f"{gpu.first_device().name}: {SETS} sets of {SAMPLES} samples; a core: {ON_CORE} sets")
            print(f"{'law':20s}  first s  again s  samples/s       core   ratio       off")
            for law in LAWS:
                print(row(law), flush=True)
        except InputError as error:
            print(f"bench-gpu: {error}", file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
