"""From a wanted force to the command: the inverse of an identified law against on/off switching.

python examples/07_force_tracking.py
"""

import numpy as np

from mrdamp import sets
from mrdamp.inverse import LawInverse
from mrdamp.inverse.baselines import Fixed, Switching
from mrdamp.inverse.rig import Sizes, with_effects_of_a_rig
from mrdamp.inverse.tracking import STEP, RandomMotion, Track, track


def main(seconds: float = 8.0) -> list[Track]:
    """The runs: switching, and the inverse."""
    found = sets.load("dyke1996_3kN")
    believed = found.model()
    motion = RandomMotion(rms=3e-3, low=0.5, high=5.0, seed=1)  # m, Hz, Hz
    sizes = Sizes.of(believed, motion, found.command.max)
    real = with_effects_of_a_rig(believed, sizes)  # what is steered has lags, friction, backlash ... besides
    none = np.zeros(round(seconds / STEP))
    off, on = (track(real, motion, none, Fixed(u)).force for u in (0.0, found.command.max))
    level = 0.5 + 0.4 * np.sin(2 * np.pi * 0.8 * STEP * np.arange(len(none)))
    wanted = off + level * (on - off)
    runs = []
    for inverse in (Switching(found.command.max), LawInverse(believed)):
        run = track(real, motion, wanted, inverse, noise=sizes.noise)
        runs.append(run)
        print(
            f"{run.name:18s} RMS error {run.error:6.1f} N ({run.relative_error:.1%} of the wanted force), "
            f"command moves {run.switching(found.command.max):5.1f} full ranges a second"
        )
    return runs


if __name__ == "__main__":
    main()
