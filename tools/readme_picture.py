"""Draws the README's moving picture: `MUJOCO_GL=egl python tools/readme_picture.py [FILE]`.

The frame of Dyke et al. (1996) under the embedded ground motion at five times its speed, without a damper and with the
damper under clipped-optimal control, both stepped by MuJoCo. Drifts are drawn 40 times as large as they are; the
damper's colour is its current, blue (none) to orange (2.25 V). Shown at a tenth of its speed.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from mrdamp import sets
from mrdamp.control import clipped_optimal
from mrdamp.envs.frame_view import FrameView
from mrdamp.model import Model, effects_from
from mrdamp.motions import embedded_motion
from mrdamp.stepping import run_frame
from mrdamp.structures import dyke1996

FILE = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "frame.webp"
SIZE = (260, 420)  # pixels of one frame
EXAGGERATION = 40.0
FRAMES, SLOWER, RATE = 90, 10.0, 20.0  # pictures, times, pictures a second


def main() -> int:
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else FILE
    damper, frame = sets.load("dyke1996_3kN"), dyke1996()
    model = Model(
        damper.law, dict(damper.parameters), effects_from(damper.attributes()), rig="frame", structure=frame
    )
    motion = embedded_motion().compressed(5.0)
    runs = [run_frame(model, motion, c) for c in (None, clipped_optimal(frame, damper.command.max))]
    # The part where the uncontrolled frame moves most.
    length = round(FRAMES / RATE / SLOWER / 1e-3)
    size = np.convolve(np.sum(runs[0].drift**2, axis=1), np.ones(length), "valid")
    start = int(np.argmax(size))
    pick = start + np.round(np.arange(FRAMES) / RATE / SLOWER / 1e-3).astype(int)
    views = [FrameView([model], "front", SIZE) for _ in runs]
    for name in ("cylinder", "rod", "clevis", "bracket", "brace_left", "brace_right"):
        geom = views[0].model.geom(name)
        geom.matid, geom.rgba = -1, 0.0  # taken out
    views[0].cylinders.clear()
    font = ImageFont.load_default(15)
    pictures = []
    for k in pick:
        whole = Image.new("RGB", (2 * SIZE[0], SIZE[1] + 26), "white")
        for n, (view, run, name) in enumerate(zip(views, runs, ("no damper", "MR damper, controlled"), strict=True)):
            view.update(np.concatenate([[0.0], run.drift[k]]), EXAGGERATION, [run.current[k] / damper.command.max])
            whole.paste(Image.fromarray(view.image()), (n * SIZE[0], 0))
            ImageDraw.Draw(whole).text(
                (n * SIZE[0] + SIZE[0] / 2, SIZE[1] + 4), name, fill="#1f2328", font=font, anchor="ma"
            )
        pictures.append(whole)
    file.parent.mkdir(parents=True, exist_ok=True)
    pictures[0].save(
        file, save_all=True, append_images=pictures[1:], duration=round(1000 / RATE), loop=0, quality=45, method=4
    )
    print(f"{file}: {file.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
