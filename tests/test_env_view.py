"""What environments draw: the picture shows drift, motion and current."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from mrdamp.envs import AmbientLoads, CableEnv, CarEnv, FrameEnv
from mrdamp.envs.view import Image
from refusals import refuses


def can_draw() -> bool:
    try:
        mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 8, 8).close()
    except Exception:  # each platform's library has an error of its own
        return False
    return True


needs_graphics = pytest.mark.skipif(not can_draw(), reason="no OpenGL here; try MUJOCO_GL=egl")


def moved(make: Callable[..., Any], value: float, steps: int = 60, **arguments: Any) -> Any:
    env = make(render_mode="rgb_array", size=(320, 240), **arguments)
    env.reset(seed=1)
    for _ in range(steps):
        env.step(np.full(env.action_space.shape, value, np.float32))
    return env


def orange(image: Image) -> int:
    r, g, b = (image[..., k].astype(int) for k in range(3))
    return int(np.sum((r > 150) & (g < 0.75 * r) & (b < 0.4 * r)))


@needs_graphics
@pytest.mark.parametrize("make", [FrameEnv, CableEnv, CarEnv])
def test_the_current_is_the_dampers_colour(make: Callable[..., Any]) -> None:
    """And another camera sees another picture."""
    off, on, front = (moved(make, u, camera=c) for u, c in ((-1.0, "damper"), (1.0, "damper"), (1.0, "front")))
    assert orange(on.render()) > 10 * (orange(off.render()) + 5)
    assert np.any(on.render() != front.render())
    for env in (off, on, front):
        env.close()


@needs_graphics
@pytest.mark.parametrize("make", [FrameEnv, CableEnv, CarEnv])
def test_motion_is_drawn_larger_than_it_is(make: Callable[..., Any]) -> None:
    """Against the picture of the structure at rest; twice the size moves more of it."""
    env = moved(make, -1.0, 120)
    assert env.render().shape == (240, 320, 3)
    state = env.get_state()
    changed = []
    env.reset(seed=1)
    rest = env.render().astype(int)
    env.set_state(state)
    for larger in (1e-3, None):
        env.exaggeration = larger
        changed.append(int((np.abs(env.render().astype(int) - rest).max(axis=2) > 40).sum()))
    assert changed[0] < 0.2 * changed[1]
    assert changed[1] > 100
    env.close()


def test_a_window_needs_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    refuses(lambda: CableEnv(render_mode="human", loads=AmbientLoads(duration=1.0)), "human needs a display")
