"""The picture of force tracking, and `mrdamp inverse --picture`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from command_call import caller
from excitation import Array
from mrdamp.commands.inverse import add_to
from mrdamp.errors import InputError
from mrdamp.inverse.tracking import Track
from mrdamp.model import Model
from mrdamp.pictures.tracking import force_tracking

TIME = np.arange(4000, dtype=np.float64) * np.float64(1e-3)
#: Loudest from 2 to 3 s.
WANTED = np.where((TIME >= 2.0) & (TIME < 3.0), 3.0, 1.0) * 400.0 * np.sin(2 * np.pi * 4.0 * TIME)
STEPS = np.where(np.floor(8 * TIME) % 2 == 0, 0.0, 1.5)


def a_track(name: str, error: float, scale: float = 1.0, command: Array = STEPS) -> Track:
    still = np.zeros_like(TIME)
    return Track(name, TIME, scale * WANTED, scale * WANTED + error, command, still, still, start=0.0)


def lines(fig: Figure) -> list[list[Array]]:
    return [[np.asarray(line.get_xydata()) for line in ax.lines] for ax in fig.axes]


def test_each_run_stands_over_its_command_in_the_loudest_part() -> None:
    fig = force_tracking([a_track("first", 30.0), a_track("second", -60.0)], "V", seconds=1.0)
    panels = lines(fig)
    assert len(panels) == 4
    for k, error in ((0, 30.0), (2, -60.0)):
        wanted, true = panels[k]
        assert (wanted[0, 0], wanted[-1, 0]) == pytest.approx((2.0, 3.0), abs=0.003)
        np.testing.assert_allclose(wanted[:, 1], np.interp(wanted[:, 0], TIME, WANTED))
        np.testing.assert_allclose(true[:, 1] - wanted[:, 1], error)
        assert fig.axes[k].get_ylabel() == "force, N"
        assert fig.axes[k + 1].get_ylabel() == "V"
        (command,) = panels[k + 1]
        assert set(command[:, 1]) == {0.0, 1.5}
        # It is held: drawn as steps, with its corners where it changes.
        assert fig.axes[k + 1].lines[0].get_drawstyle() == "steps-post"
        np.testing.assert_allclose(np.diff(command[1:-1, 0]), 0.125, atol=1e-9)
    share = 100 * 30.0 / float(np.sqrt(np.mean(WANTED**2)))
    assert fig.axes[0].get_title("left") == "first"
    assert fig.axes[0].get_title("right") == f"RMS error {share:.1f} %"


@pytest.mark.slow
def test_the_command_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parameters = {"c0a": 400.0, "c0b": 150.0, "fya": 50.0, "fyb": 600.0, "v_ref": 0.01, "command_max": 2.0}
    model, picture = tmp_path / "model.json", tmp_path / "tracks.png"
    Model("bingham", {"command_min": 0.0, **parameters}).write(model)
    words: list[str | Path] = ["inverse", model, "--plant", model, "--no-network", "--seconds", "2"]
    words += ["--picture", picture]
    assert caller(add_to)(*words, "-o", tmp_path / "out") == 0
    assert f"picture: {picture}" in capsys.readouterr().out
    with Image.open(picture) as image:
        colours = np.asarray(image.convert("RGB")).reshape(-1, 3)
        assert image.width > 600
    # Switching and the law inverse, each in its colour.
    for colour in ((0x00, 0x72, 0xB2), (0xD5, 0x5E, 0x00)):
        assert (np.abs(colours.astype(int) - colour).max(axis=1) < 8).sum() > 100
    with pytest.raises(InputError, match=r"\.svg, \.png or \.pdf"):
        caller(add_to)(*words[:-1], tmp_path / "t.bmp", "-o", tmp_path / "none")
    assert not (tmp_path / "none").exists()
