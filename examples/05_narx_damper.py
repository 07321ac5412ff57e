"""A network damper: trained on records, evaluated one step ahead and in free run, then stepped by MuJoCo.

python examples/05_narx_damper.py
"""

import numpy as np

from mrdamp.narx import lagged, series, train_narx
from mrdamp.records import embedded
from mrdamp.simulation.stepping import drive_rig


def main(samples: int | None = None, units: int = 12, iterations: int = 60) -> tuple[float, float]:
    """Free-run errors over the force's standard deviation: in Python on a record held out, and in MuJoCo."""
    records = embedded()
    # Records with varying current, at their own 500 Hz.
    train = [series(r).part(0, samples or r.n) for r in records.train if np.ptp(r.command) > 0]
    held = [series(r).part(0, samples or r.n) for r in records.validation if np.ptp(r.command) > 0]
    fit = train_narx(
        train, held, inputs=lagged("viF", 3), hidden=(units,), initialisations=1, one_step_iterations=iterations,
        horizons=(20, 100), iterations=iterations // 4, most=3000,
    )  # fmt: skip
    for name, judged in (("one step ahead", fit.one_step), ("in free run", fit.free_run)):
        print(
            f"{name:15s} fitted {judged.pooled[0]:.3f}, held out {judged.pooled[1]:.3f} of the standard deviation"
        )
    test = held[0]
    inputs = {"displacement_m": test.x, "velocity_m_s": test.v, "command": test.i}
    force = drive_rig(fit.model, test.sample_time, inputs)["force_N"]
    error = float(np.sqrt(np.mean((force - test.force)[50:] ** 2)) / np.std(test.force))
    print(f"the same network in MuJoCo, {fit.network.topology}, on {test.name}: {error:.3f}")
    return fit.free_run.pooled[1], error


if __name__ == "__main__":
    main()
