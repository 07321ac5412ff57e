"""Draws the README's moving picture: `MUJOCO_GL=egl python tools/readme_picture.py [FILE]`.

The frame of Dyke et al. (1996) under the embedded ground motion at five times its speed, without a damper and with the
damper under clipped-optimal control, both stepped by MuJoCo. Drifts are drawn 40 times as large as they are; the
damper's colour is its current, blue (none) to orange (2.25 V). Shown at a tenth of its speed.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from mrdamp import sets
from mrdamp.control import clipped_optimal
from mrdamp.envs.frame_xml import animate
from mrdamp.motions import embedded_motion
from mrdamp.simulation.stepping import run_frame
from mrdamp.structures import dyke1996

FILE = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "frame.webp"


def main() -> int:
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else FILE
    damper, frame = sets.load("dyke1996_3kN"), dyke1996()
    model = replace(damper.model(), rig="frame", structure=frame)
    motion = embedded_motion().compressed(5.0)
    runs = [run_frame(model, motion, c) for c in (None, clipped_optimal(frame, damper.command.max))]
    drawn = animate(model, runs, ("no damper", "MR damper, controlled"), damper.command.max)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(drawn.moving)
    print(f"{file}: {file.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
