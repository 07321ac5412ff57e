"""Controllers of the cable whose accelerometers have a bandwidth: `python -m studies.cable_accelerometers`.

Prints the RMS motion over that without a damper, mean over the six unseen loads, on the chain; of a policy for each
seed. No controller was tuned or trained with a bandwidth.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from mrdamp.compare.benches import compared
from mrdamp.compare.linear import CableBench
from mrdamp.envs.cable import Cable

CONTROLLERS = ("learned", "clipped-optimal", "clipped-optimal-tuned", "modulated-optimal-tuned")


@dataclass(frozen=True)
class LimitedCable(CableBench):
    """The cable with accelerometers of a bandwidth, Hz; None: ideal."""

    bandwidth: float | None = None

    @cached_property
    def structure(self) -> Cable:
        return Cable(self.cable, self.model, bandwidth=self.bandwidth)


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints a line for each controller and bandwidth."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("controllers", nargs="*", default=CONTROLLERS, metavar="NAME")
    p.add_argument("--bandwidths", nargs="*", type=float, default=[62.5, 31.25], metavar="HZ")
    p.add_argument("--jobs", type=int, default=2)
    a = p.parse_args(arguments)
    for bandwidth in (None, *a.bandwidths):
        bench = LimitedCable(command_unit="V", period=5e-3, engine="chain", bandwidth=bandwidth)
        found = compared(bench, a.controllers, amplitudes=(1.0,), jobs=a.jobs).result
        for name, values in found.values.items():
            seeds = ", ".join(f"{v:.3f}" for v in values["motion"].mean(axis=(1, 2)))
            print(
                f"{'ideal' if bandwidth is None else f'{bandwidth:g} Hz':9s} {name:26s} {seeds}", flush=True
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
