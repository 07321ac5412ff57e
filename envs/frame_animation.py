"""The frame in motion, as an animated picture: without a damper and with one, side by side."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from mrdamp.envs.frame_xml import FrameView
from mrdamp.model import Model
from mrdamp.simulation.stepping import FrameRun

#: Geoms of the damper, taken out where a run has none.
_DAMPER = ("cylinder", "rod", "clevis", "bracket", "brace_left", "brace_right")


@dataclass(frozen=True)
class Clip:
    """What is drawn: size of one frame (pixels), factor on the drifts, pictures, slow motion, pictures a second.

    seconds: of the ground motion that are shown.
    """

    size: tuple[int, int] = (260, 420)
    exaggeration: float = 40.0
    count: int = 90
    slower: float = 10.0
    rate: float = 20.0

    @property
    def seconds(self) -> float:
        return self.count / self.rate / self.slower


@dataclass(frozen=True)
class Animation:
    """An animated WebP and its first picture for readers who turned motion off; width and height in pixels."""

    moving: bytes
    still: bytes
    width: int
    height: int


def animate(
    model: Model, runs: Sequence[FrameRun], names: Sequence[str], command_max: float, clip: Clip | None = None
) -> Animation:
    """Draws runs of one frame over the part of the motion where the first of them moves most.

    The damper's colour is its current, from none (blue) to `command_max` (orange). Raises InputError where the machine
    has no renderer.
    """
    clip = clip or Clip()
    dt = float(runs[0].time[1] - runs[0].time[0])
    length = max(1, round(clip.seconds / dt))
    energy = np.convolve(np.sum(runs[0].drift ** 2, axis=1), np.ones(length), "valid")
    start = int(np.argmax(energy))
    samples = start + np.round(np.arange(clip.count) / clip.rate / clip.slower / dt).astype(int)
    views = [FrameView([model], "front", clip.size) for _ in runs]
    for view, run in zip(views, runs, strict=True):
        if not np.any(run.force):
            for name in _DAMPER:
                geom = view.model.geom(name)
                geom.matid, geom.rgba = -1, 0.0
            view.cylinders.clear()
    width, height = clip.size
    font = ImageFont.load_default(15)
    pictures = []
    for k in np.minimum(samples, len(runs[0].time) - 1):
        whole = Image.new("RGB", (len(runs) * width, height + 26), "white")
        for n, (view, run, name) in enumerate(zip(views, runs, names, strict=True)):
            view.update(
                np.concatenate([[0.0], run.drift[k]]), clip.exaggeration, [run.current[k] / command_max]
            )
            whole.paste(Image.fromarray(view.image()), (n * width, 0))
            place = (n * width + width / 2, height + 4)
            ImageDraw.Draw(whole).text(place, name, fill="#1f2328", font=font, anchor="ma")
        pictures.append(whole)
    moving, still = io.BytesIO(), io.BytesIO()
    duration = round(1000 / clip.rate)
    pictures[0].save(
        moving,
        "webp",
        save_all=True,
        append_images=pictures[1:],
        duration=duration,
        loop=0,
        quality=45,
        method=4,
    )
    pictures[0].save(still, "webp", quality=60)
    return Animation(moving.getvalue(), still.getvalue(), *pictures[0].size)
