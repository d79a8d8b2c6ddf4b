"""The town as a place to learn in: observations, rewards, several journeys at a time.

A perfect detector stops the car at lights and signs, as the fusion of the application does. So the
policy learns all else: to follow its route, to keep its distance, to wait for pedestrians.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from autopilot.agent import STATE, control_of, state_vector
from autopilot.simulator import state_of
from town.birdview import SHAPE, Birdview
from town.expert import Expert, Rules
from town.lights import FRAMES_A_SECOND, RED
from town.world import Setting, World

FRAMES_A_STEP = 2
_FASTEST = 8.3
# How much faster than it should be a car may come near to others, in m/s.
_MARGIN = 0.5
# When the next light is looked at, for those who may know: seconds from now.
_SECONDS = (0.0, 2.0, 4.0, 8.0, 16.0)
_FAR = 60.0
# How many numbers say what decides about rewards and is in no view.
UNSEEN = 5 + len(_SECONDS)

Views = npt.NDArray[np.uint8]
States = npt.NDArray[np.float32]


class Drive:
    """One journey after another, each in the town of another seed."""

    def __init__(self, seed: int, setting: Setting) -> None:
        self._seed = seed
        self._setting = setting
        self.finished: list[tuple[str, float]] = []
        self._begin()

    def _begin(self) -> None:
        self.world = World(self._seed, self._setting)
        self._birdview = Birdview(self.world)
        self._rules = Rules(self.world)
        self.expert = Expert(self.world)

    def observe(self, view: Views, state: States) -> None:
        """Writes what the agent sees."""
        self._birdview.render(view)
        state[:] = state_vector(state_of(self.world))

    def unseen(self) -> list[float]:
        """What decides about the rewards to come and is in no view: lines, lights, the way left.

        The policy never knows it. It makes the values that PPO compares with more exact.
        """
        world, along = self.world, self.world.journey.along
        left = min(world.route.path.length - along, _FAR) / _FAR
        line, known = world.next_line, [left, world.route.limit(along) / _FASTEST]
        if line is None:
            return [*known, 1.0, 0.0, 0.0, *(0.0 for _ in _SECONDS)]
        light, road = line.kind == "light", (line.junction, line.arrives_from)
        frames = [world.journey.frames + int(it * FRAMES_A_SECOND) for it in _SECONDS]
        reds = [light and world.lights.colour(*road, frame) == RED for frame in frames]
        to_line = min(line.along - along, _FAR) / _FAR
        return [*known, to_line, float(light), float(not light), *map(float, reds)]

    def step(self, action: npt.NDArray[np.floating]) -> tuple[float, bool]:
        """Drives for some frames; the reward, and whether the journey has ended."""
        world = self.world
        before, steer = world.journey.along, world.car.steer
        for _ in range(FRAMES_A_STEP):
            world.step(self._rules.advice().applied(control_of(action, world.car.speed)))
        journey = world.journey
        reward = 0.5 * (journey.along - before)
        reward -= 0.06 * min(abs(world.sideways), 2.0) * min(1.0, world.car.speed)
        reward -= 0.3 * max(0.0, world.car.speed - _FASTEST)
        reward -= 0.3 * max(0.0, world.car.speed - self.expert.safe_speed() - _MARGIN)
        reward -= 0.1 * abs(world.car.steer - steer)
        if journey.ended in ("collision", "off the road"):
            reward -= 8.0 + world.car.speed
        if journey.ended:
            self.finished.append((journey.ended, journey.along / world.route.path.length))
            self._seed += 1000
            self._begin()
            return reward, True
        return reward, False


class Drives:
    """Several journeys side by side."""

    def __init__(self, count: int, first_seed: int) -> None:
        # Each has a share of quiet and of busy towns.
        busy = [Setting(3, 12 + 4 * (n % 5), 8 + 4 * (n % 4), 4) for n in range(count)]
        self.drives = [Drive(first_seed + n, setting) for n, setting in enumerate(busy)]
        self.views = np.zeros((count, *SHAPE), np.uint8)
        self.states = np.zeros((count, STATE), np.float32)
        self._observe()

    def _observe(self) -> None:
        for drive, view, state in zip(self.drives, self.views, self.states, strict=True):
            drive.observe(view, state)

    def unseen(self) -> States:
        """What is in no view, for each journey ``UNSEEN`` numbers."""
        return np.array([drive.unseen() for drive in self.drives], np.float32)

    def step(
        self, actions: npt.NDArray[np.floating]
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
        """One step of each; what is seen after it is in ``views`` and ``states``."""
        results = [drive.step(act) for drive, act in zip(self.drives, actions, strict=True)]
        self._observe()
        rewards, ends = zip(*results, strict=True)
        return np.array(rewards, np.float32), np.array(ends)

    def finished(self) -> list[tuple[str, float]]:
        """How journeys have ended since the last call, and how much of their route they did."""
        found = [it for drive in self.drives for it in drive.finished]
        for drive in self.drives:
            drive.finished.clear()
        return found
