"""A three-storey frame under an earthquake: no damper, the damper off, on, and controlled.

python examples/04_frame_under_an_earthquake.py
"""

from dataclasses import replace

from mrdamp import sets
from mrdamp.control import clipped_optimal, passive_off, passive_on
from mrdamp.motions import embedded_motion
from mrdamp.simulation.criteria import Criteria, evaluate
from mrdamp.simulation.stepping import run_frame
from mrdamp.structures import dyke1996


def main(seconds: float | None = None) -> dict[str, Criteria]:
    """Criteria by controller; seconds: of the ground motion, None: all of it."""
    damper, frame = sets.load("dyke1996_3kN"), dyke1996()
    model = replace(damper.model(), rig="frame", structure=frame)
    motion = embedded_motion().compressed(5.0)  # the frame is a small-scale one
    if seconds is not None:
        motion = replace(motion, acceleration=motion.acceleration[: round(seconds / motion.sample_time)])
    controllers = {
        "no damper": None,
        "passive-off": passive_off(),
        "passive-on": passive_on(damper.command.max),
        "clipped-optimal": clipped_optimal(frame, damper.command.max),
    }
    found = {}
    for name, controller in controllers.items():
        run = run_frame(model, motion, controller)
        c = found[name] = evaluate(
            frame, run.time, run.drift, run.acceleration, run.force, None, run.command, None
        )
        print(
            f"{name:16s} peak drift {1e3 * c.peak_drift.max():6.2f} mm   peak acceleration "
            f"{c.peak_acceleration.max():5.2f} m/s2   peak force {c.peak_force:5.0f} N   mean {c.mean_command:.2f} V"
        )
    return found


if __name__ == "__main__":
    main()
