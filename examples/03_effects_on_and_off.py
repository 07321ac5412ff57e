"""What a real rig adds: the same test with one unmodelled effect after the other.

python examples/03_effects_on_and_off.py
"""

import numpy as np

from mrdamp import sets
from mrdamp.model import Effect, Model

EFFECTS = (
    Effect("driver_lag", {"tau": 0.015}),
    Effect("saturation", {"i_s": 2.0}),
    Effect("seal_friction", {"coulomb": 60.0}),
    Effect("backlash", {"gap": 5e-4}),
    Effect("gas_spring", {"k": 8e3, "f0": 40.0}),
    Effect("sensor_lag", {"tau": 5e-3}),
)


def main(seconds: float = 4.0) -> dict[str, float]:
    """RMS change of the force (share of its RMS) by effect."""
    damper = sets.load("dyke1996_3kN")  # `mrdamp sets` lists the others
    ideal = Model(damper.law, dict(damper.parameters))
    t = np.arange(0.0, seconds, 1e-3)
    record = {
        "displacement_m": 0.006 * np.sin(2 * np.pi * 2.0 * t),
        "command": 1.1 * (1 + np.sign(np.sin(2 * np.pi * 0.7 * t))),  # 0 and 2.2 V by turns
    }
    force = ideal.simulate(1e-3, record, hold=True)["force_N"]
    changes = {}
    for effect in EFFECTS:
        with_it = ideal.with_effects([effect]).simulate(1e-3, record, hold=True)["force_N"]
        changes[effect.name] = float(np.sqrt(np.mean((with_it - force) ** 2) / np.mean(force**2)))
        print(
            f"{effect.name:16s} {dict(effect.parameters)!s:32s} changes the force by {changes[effect.name]:6.1%}"
        )
    every = ideal.with_effects(EFFECTS).simulate(1e-3, record, hold=True)["force_N"]
    changes["all"] = float(np.sqrt(np.mean((every - force) ** 2) / np.mean(force**2)))
    print(f"{'all':49s} changes the force by {changes['all']:6.1%}")
    return changes


if __name__ == "__main__":
    main()
