"""Draws the pictures of the models that ship: `MUJOCO_GL=egl python tools/model_pictures.py [FOLDER]`.

Each model's scene in a moment of motion under a command: `models_xml/NAME/picture.webp`. What
moves it is named in `MOMENTS`: a joint's velocity at the start and the damper's command.
"""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

import mrdamp  # noqa: F401  registers the plugins
from mrdamp import models_xml

FOLDER = Path(__file__).resolve().parents[1] / "models_xml"
SIZE = 400, 400  # pixels
#: Model -> camera, joint, its velocity at the start (m/s), command of all dampers (V), time of the picture (s).
MOMENTS = {
    "cable": ("along", "node7", 1.0, 4.0, 0.02),
    "car": ("corner", "", 5.0, 1.0, 0.93),
    "frame3": ("corner", "storey1", 0.25, 2.25, 0.02),
    "quarter_car": ("corner", "suspension", 0.5, 2.0, 0.05),
    "rig": ("front", "piston", 0.08, 1.5, 0.1),
}


def draw(name: str) -> Image.Image:
    """The model's picture. Raises InputError for an unknown model."""
    camera, joint, velocity, command, end = MOMENTS[name]
    model = mujoco.MjModel.from_xml_path(str(models_xml.path(name, "scene.xml")))
    model.vis.global_.offwidth, model.vis.global_.offheight = SIZE
    data = mujoco.MjData(model)
    data.qvel[model.joint(joint).dofadr[0] if joint else 0] = velocity
    for actuator in map(model.actuator, range(model.nu)):
        if actuator.name.endswith("damper"):
            data.ctrl[actuator.id] = command
    while data.time < end:
        mujoco.mj_step(model, data)
    with mujoco.Renderer(model, SIZE[1], SIZE[0]) as renderer:
        renderer.update_scene(data, camera)
        return Image.fromarray(np.asarray(renderer.render()))


def main() -> int:
    """Writes them and prints their sizes."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    for name in models_xml.names():
        file = folder / name / "picture.webp"
        file.parent.mkdir(parents=True, exist_ok=True)
        draw(name).save(file, quality=80, method=6)
        print(f"{file}: {file.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
