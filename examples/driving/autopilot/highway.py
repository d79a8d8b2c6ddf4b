"""highway-env as a simulator: a junction with crossing traffic.

It has no camera, no lights and no pedestrians: its picture is a view from above for people. Its y
points south and its headings turn right, so both change their sign here.
"""

from __future__ import annotations

import math
import os
from typing import Any, cast

import numpy as np
from town.bodies import Body
from town.camera import HEIGHT, WIDTH
from town.controls import Control
from town.lights import FRAMES_A_SECOND
from town.overhead import ROAD, Overhead, checked

from .simulator import Pixels, SimulatorError, State
from .way import Way

_SCENE = "intersection-v2"
_START, _DESTINATIONS = "o0", ("o1", "o2", "o3")
_ACCELERATION, _BRAKING, _DRAG = 3.0, 7.0, 0.06
# How far wheels turn, and the wheelbases of the town's car and of a vehicle there.
_MOST_STEER, _WHEELBASE = 0.6, 2.7
_MOST_TURN = math.pi / 3
_CONFIG = {
    "observation": {"type": "Kinematics"},
    "action": {
        "type": "ContinuousAction",
        "acceleration_range": [-_BRAKING - 1.0, _ACCELERATION],
        "steering_range": [-_MOST_TURN, _MOST_TURN],
    },
    "simulation_frequency": FRAMES_A_SECOND,
    "policy_frequency": FRAMES_A_SECOND,
    "duration": 10**6,
    "initial_vehicle_count": 4,
    # Of each frame.
    "spawn_probability": 0.01,
    "screen_width": WIDTH,
    "screen_height": HEIGHT,
    "centering_position": [0.5, 0.6],
    "scaling": 5.5,
    "offscreen_rendering": True,
}


class Highway:
    """A car that crosses a junction of highway-env."""

    def __init__(self, seed: int, frames: int) -> None:
        # It draws into memory; without this it would look for a screen.
        os.environ.setdefault("SDL_VIDEODRIVER", "offscreen")
        try:
            import gymnasium
            import highway_env  # type: ignore[import-untyped]  # noqa: F401
        except ImportError as error:
            raise SimulatorError(
                f"highway-env cannot be loaded: {error}; it needs "
                "`pip install -r requirements-simulators.txt`, in the root of the repository"
            ) from None
        self._frames, self._frame, self._steer = frames, 0, 0.0
        self._env: Any = gymnasium.make(_SCENE, render_mode="rgb_array", config=_CONFIG)
        self._env.reset(seed=seed)
        self._world: Any = cast(Any, self._env.unwrapped)
        network: Any = self._world.road.network
        nodes = network.shortest_path(_START, _DESTINATIONS[seed % len(_DESTINATIONS)])
        lanes = [network.get_lane((*pair, 0)) for pair in zip(nodes, nodes[1:], strict=False)]
        self._lanes = [_points(lane) for lane in network.lanes_list()]
        car = self._car()
        route = [place for lane in lanes for place in _points(lane)]
        nearest = min(range(len(route)), key=lambda at: math.dist(route[at], car.place))
        self._way = Way(route[nearest:])

    def state(self) -> State:
        return self._way.state(self._frame, self._car(), self._steer)

    def take_picture(self, out: Pixels) -> None:
        out[:] = self._env.render()

    def look_down(self, out: Pixels) -> None:
        own = self._car()
        overhead = Overhead(own, checked(out))
        out[:] = 0
        for points in self._lanes:
            overhead.line(ROAD, np.array(points), 4.5)
        self._way.draw(overhead)
        for vehicle in self._world.road.vehicles:
            if vehicle is not self._world.vehicle and overhead.sees(other := _body(vehicle)):
                overhead.car(other, vehicle.LENGTH, vehicle.WIDTH)

    def step(self, control: Control) -> None:
        vehicle = self._world.vehicle
        force = _ACCELERATION * control.throttle - _BRAKING * control.brake - _DRAG * vehicle.speed
        # A car that brakes does not drive backwards.
        force = max(force, -vehicle.speed * FRAMES_A_SECOND, -_BRAKING - 1.0)
        whole = _ACCELERATION + _BRAKING + 1.0
        drive = 2.0 * (force + _BRAKING + 1.0) / whole - 1.0
        turn = -_turned(control.steer, vehicle.LENGTH)
        self._env.step(np.array([drive, turn / _MOST_TURN]))
        self._steer = control.steer
        self._frame += 1
        self._way.follow(self._car())

    def ended(self) -> str:
        if self._world.vehicle.crashed:
            return "collision"
        return self._way.end() or ("enough" if self._frame >= self._frames else "")

    def summary(self) -> str:
        return self._way.summary(self._frame, self.ended())

    def close(self) -> None:
        self._env.close()

    def _car(self) -> Body:
        return _body(self._world.vehicle)


def _body(vehicle: Any) -> Body:
    x, y = vehicle.position
    return Body(float(x), -float(y), -float(vehicle.heading), float(vehicle.speed))


def _points(lane: Any) -> list[tuple[float, float]]:
    """The middle of a lane, about every metre."""
    count = round(lane.length) + 2
    places = [lane.position(at, 0.0) for at in np.linspace(0.0, lane.length, count)]
    return [(float(x), -float(y)) for x, y in places]


def _turned(steer: float, length: float) -> float:
    """The angle of the wheels of a vehicle that turns as the town's car does."""
    slip = math.atan(0.5 * math.tan(steer * _MOST_STEER))
    sine = min(max(math.sin(slip) * length / _WHEELBASE, -0.65), 0.65)
    return math.atan(2.0 * math.tan(math.asin(sine)))
