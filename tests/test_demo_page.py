"""The demo's page: the frame in motion first, the table of controllers, and why one accelerates the frame."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import mujoco.viewer
import numpy as np
import pytest
from PIL import Image

from mrdamp import cli, models_xml, sets
from mrdamp.control import passive_on
from mrdamp.demo import UNCONTROLLED, accelerated
from mrdamp.demo.animation import Clip, animate
from mrdamp.errors import InputError
from mrdamp.model import Model, effects_from
from mrdamp.motions import embedded_motion
from mrdamp.simulation.criteria import Criteria, evaluate
from mrdamp.simulation.stepping import FrameRun, run_frame
from mrdamp.structures import dyke1996


@pytest.fixture(scope="module")
def model() -> Model:
    found = sets.load("dyke1996_3kN")
    return Model(
        found.law, dict(found.parameters), effects_from(found.attributes()), rig="frame", structure=dyke1996()
    )


@pytest.fixture(scope="module")
def runs(model: Model) -> dict[str, FrameRun]:
    motion = embedded_motion().compressed(5.0)
    return {name: run_frame(model, motion, c) for name, c in ((UNCONTROLLED, None), ("on", passive_on(2.25)))}


def criteria(run: FrameRun) -> Criteria:
    return evaluate(dyke1996(), run.time, run.drift, run.acceleration, run.force, None, run.command, None)


def test_animation_moves_and_differs_from_its_still(model: Model, runs: dict[str, FrameRun]) -> None:
    clip = Clip(size=(60, 90), count=6, slower=5.0, rate=20.0)
    try:
        drawn = animate(model, list(runs.values()), list(runs), 2.25, clip)
    except InputError:
        pytest.skip("no renderer")
    with Image.open(io.BytesIO(drawn.moving)) as moving:
        assert getattr(moving, "n_frames", 1) == 6
        first = np.asarray(moving.convert("RGB"), dtype=float)
        moving.seek(3)
        later = np.asarray(moving.convert("RGB"), dtype=float)
    assert first.shape == (drawn.height, drawn.width, 3) == (116, 120, 3)
    left, right = (np.abs(first - later)[:90, part].mean() for part in (slice(0, 60), slice(60, 120)))
    assert left > 0.1  # the frame without a damper sways
    assert right > 0.0
    assert len(drawn.still) < len(drawn.moving)


def test_a_controller_that_accelerates_the_frame_gets_a_sentence(runs: dict[str, FrameRun]) -> None:
    found = {name: criteria(run) for name, run in runs.items()}
    free = float(found[UNCONTROLLED].peak_acceleration.max())
    assert accelerated({**found, "on": replace(found["on"], peak_acceleration=np.full(3, 0.5 * free))}) == []
    loud = replace(found["on"], peak_acceleration=np.array([1.5, 1.0, 1.0]) * free, switching_rate=80.0)
    (said,) = accelerated({**found, "on": loud})
    assert f"{1.5 * free:#.3g} m/s2 at floor 1, above the {free:#.3g} m/s2" in said
    assert "80 times a second" in said
    stiff = replace(
        found["on"], peak_acceleration=np.array([0.5, 1.0, 1.5]) * free, switching_rate=0.0,
        peak_drift=found[UNCONTROLLED].peak_drift * [0.2, 2.0, 1.0],
    )  # fmt: skip
    (said,) = accelerated({**found, "on": stiff})
    assert "storey 1 nearly rigid" in said


@pytest.mark.parametrize("name", ["frame3", "cable", "rig", "dyke1996_3kN"])
def test_the_viewer_is_given_a_file_with_a_camera_aimed_at_it(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    seen: list[mujoco.MjModel] = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(
        mujoco.viewer, "launch_from_path", lambda path: seen.append(mujoco.MjModel.from_xml_path(path))
    )
    assert cli.main(["view", name]) == 0
    (model,) = seen
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    assert camera.elevation > -30  # from the side; MuJoCo's own is 45 degrees from above
    if name in models_xml.names():
        assert Path(models_xml.path(name, "scene.xml")).is_file()
