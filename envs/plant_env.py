"""A task of one row as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from mrdamp.control.observe import Observation
from mrdamp.envs.task import Episode, Task
from mrdamp.envs.view import Image, View
from mrdamp.errors import InputError


@dataclass(frozen=True)
class EnvState:
    """An environment's present: what `set_state` goes back to, exactly."""

    episode: Episode
    generator: dict[str, Any]


class PlantEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """One structure under control; `FrameEnv` and `CableEnv` say what it is.

    make_view: its drawing. exaggeration: how many times larger than it is motion is drawn; None: such that the
    motion without a damper can be seen well.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 200}  # noqa: RUF012

    def __init__(
        self,
        task: Task,
        make_view: Callable[[], View],
        render_mode: str | None = None,
        exaggeration: float | None = None,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise InputError(
                f"render_mode is {render_mode!r}; allowed: {', '.join(self.metadata['render_modes'])}"
            )
        if exaggeration is not None and not 0 < exaggeration < 1e6:
            raise InputError(f"exaggeration is {exaggeration}; allowed: a number > 0")
        self.task = task
        self.render_mode = render_mode
        self.exaggeration = exaggeration
        self.observation_space = task.observation_space
        self.action_space = task.action_space
        self.metadata = {**self.metadata, "render_fps": round(1 / task.rows.period)}
        self._make_view = make_view
        self._view: View | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """At rest, under a load that is drawn or given in the options."""
        super().reset(seed=seed)
        seen, infos = self.task.reset([0], [self.np_random], options)
        if self.render_mode == "human":
            self.render()
        return seen[0], infos[0]

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """One control period."""
        seen, reward, over, info = self.task.step_one(action)
        if self.render_mode == "human":
            self.render()
        return seen, reward, False, over, info

    def render(self) -> Image | None:
        """(height, width, 3) in mode `rgb_array`; a window in mode `human`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() does nothing: the environment was made without a render_mode")
            return None
        if self._view is None:
            self._view = self._make_view()
        larger = self.exaggeration or self.task.drawn_size / self.task.reference_motion(0)
        self._view.update(self.task.rows.position(0), larger, self.task.current_shares(0))
        if self.render_mode == "rgb_array":
            return self._view.image()
        self._view.show(self.task.rows.period)
        return None

    def close(self) -> None:
        """Frees the drawing; safe to call again."""
        if self._view is not None:
            self._view.close()
        self._view = None

    def get_state(self) -> EnvState:
        """The present, to go back to; also in another environment made with the same arguments."""
        return EnvState(self.task.save(0), dict(self.np_random.bit_generator.state))

    def set_state(self, state: EnvState) -> None:
        """Back to a saved present, exactly."""
        self.np_random.bit_generator.state = state.generator
        self.task.restore(0, state.episode, self.np_random)
