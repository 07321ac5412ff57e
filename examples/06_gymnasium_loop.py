"""The frame as a Gymnasium environment: a plain loop with a rule of thumb as the agent.

python examples/06_gymnasium_loop.py
"""

from collections.abc import Callable
from typing import Any

import gymnasium as gym

import mrdamp.envs  # noqa: F401  (registers the environments)
from mrdamp.motions import embedded_motion


def main(steps: int = 5000) -> dict[str, float]:
    """Peak drift over that without a damper, by agent."""
    env = gym.make("mrdamp/Frame-v0")
    off, on = env.action_space.low, env.action_space.high  # type: ignore[attr-defined]
    names = env.unwrapped.task.observer.names  # type: ignore[attr-defined]
    stroke, force = names.index("stroke"), names.index("force")  # of the newest control period
    agents: dict[str, Callable[[Any], Any]] = {
        "off": lambda o: off,
        "on": lambda o: on,
        "random": lambda o: env.action_space.sample(),
        "on while moving out": lambda o: on if o[stroke] * o[force] > 0 else off,
    }
    drift = {}
    for name, agent in agents.items():
        env.action_space.seed(0)
        observation, info = env.reset(seed=0, options={"motion": embedded_motion().compressed(5.0)})
        total = 0.0
        for _ in range(steps):
            observation, reward, terminated, truncated, info = env.step(agent(observation))
            total += float(reward)
            if terminated or truncated:
                break
        drift[name] = float(info["drift_ratio"])
        print(
            f"{name:20s} return {total:8.2f}   peak drift {drift[name]:.2f} of the frame's without a damper"
        )
    env.close()
    return drift


if __name__ == "__main__":
    main()
