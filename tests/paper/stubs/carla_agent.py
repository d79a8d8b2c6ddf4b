"""Stands for the module of that name in the paper's repository, which has simulator and agents.

Its world is a number that says how far the car is from the middle of its lane, where the wind
blows it to and fro; the agent steers against that. The world refuses an action that is not the one
for what was observed last. An observation is made as there: a dict by actor, with pictures as
arrays.
"""

from __future__ import annotations

import math
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

cfg = SimpleNamespace(
    warmup_steps=2, total_steps=int(os.environ["PAPER_STEPS"]), log_video=True, agent="other"
)
hydra_dir = os.environ["PAPER_LOGS"]
agents_dict: dict[str, Any] = {}

_HERO = "hero"


class _Agent:
    def run_step(self, obs: dict[str, Any]) -> SimpleNamespace:
        picture = obs["birdview"]["masks"]
        assert picture.shape == (6, 96, 96) and not picture.any(), "the picture is another one"
        steer = -0.5 * float(obs["state"]["offset"])
        return SimpleNamespace(throttle=0.5, steer=steer, brake=0.0)


class _World:
    def __init__(self) -> None:
        self.timestamp = {"step": 0}
        self.offset = 1.0

    def observation(self) -> dict[str, Any]:
        frame = np.full((120, 160, 3), self.timestamp["step"] % 256, np.uint8)
        return {
            _HERO: {
                "birdview": {"masks": np.zeros((6, 96, 96), np.uint8)},
                "central_rgb": {"frame": self.timestamp["step"], "data": frame},
                "state": {"offset": np.float64(self.offset)},
            }
        }

    def close(self) -> None:
        line = f"{self.timestamp['step']} steps, {self.offset:.6f} m off\n"
        Path(hydra_dir, "drove").write_text(line)


def agent_start() -> None:
    """Makes the agents of this process."""
    agents_dict[_HERO] = _Agent()


def game_start() -> tuple[_World, dict[str, Any]]:
    """Makes the agents and the world; its first observation."""
    agent_start()
    world = _World()
    return world, world.observation()


def agent_action(obs: dict[str, Any]) -> dict[str, Any]:
    """What each agent does."""
    return {name: agent.run_step(obs[name]) for name, agent in agents_dict.items()}


def game_step(world: _World, control: dict[str, Any]) -> tuple[Any, ...]:
    """Goes on by a step."""
    steer, step = control[_HERO].steer, world.timestamp["step"]
    if steer != -0.5 * world.offset:
        raise RuntimeError(f"step {step}: {steer} is no action for an offset of {world.offset}")
    world.offset += steer + math.sin(step)
    world.timestamp["step"] += 1
    obs = world.observation()
    picture = obs[_HERO]["central_rgb"]["data"]
    return obs, {_HERO: 0.0}, {_HERO: False}, {_HERO: {}}, picture, picture


def game_stop(world: _World) -> None:
    """Ends the world."""
    world.close()


def write_video(pictures: list[np.ndarray]) -> None:
    """Says of how many pictures the video would be."""
    Path(hydra_dir, "video").write_text(f"{len(pictures)} pictures\n")
