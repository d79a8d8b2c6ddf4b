"""A scripted driver that knows all that is true of the town: what other drivers are measured by.

What it does about traffic and what the rules ask for are apart, so that others can have either.
"""

from __future__ import annotations

import math

import numpy as np

from .bodies import CAR_LENGTH, Body
from .controls import (
    FREE,
    Advice,
    Control,
    can_stop,
    follow,
    speed_to_stop,
    steer_to,
    stop_in,
)
from .geometry import Floats, Point, seen_from, shifted
from .lights import FRAMES_A_SECOND, GREEN, RED
from .route import StopLine
from .world import STANDS, World

_LOOK = 26.0
_CAR_RADIUS, _WALKER_RADIUS = 2.0, 1.4
# Where the middle of the car stands, before a line or a crossing.
BEFORE_LINE = 3.8
_WAIT_FRAMES = FRAMES_A_SECOND // 2


class Rules:
    """What lights and signs ask for, from what is true: a perfect detector."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._stood = 0
        self._line: StopLine | None = None

    def advice(self) -> Advice:
        """What they ask for at this frame."""
        world, line = self._world, self._world.next_line
        if line is not self._line:
            self._line, self._stood = line, 0
        if line is None:
            return FREE
        speed, to_line = world.car.speed, line.along - world.journey.along
        if line.kind == "light":
            colour = world.colour(line)
            stops = can_stop(speed, to_line - BEFORE_LINE)
            if colour == RED or (colour != GREEN and stops):
                return stop_in(speed, to_line - BEFORE_LINE)
            return FREE
        if speed < STANDS and to_line < BEFORE_LINE + 1.5:
            self._stood += 1
        if self._stood >= _WAIT_FRAMES:
            return FREE
        return stop_in(speed, to_line - BEFORE_LINE)


class Expert:
    """Drives the route, keeps its distance, and obeys the rules."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._rules = Rules(world)

    def control(self) -> Control:
        """What it does at this frame."""
        return self._rules.advice().applied(self.in_traffic())

    def in_traffic(self) -> Control:
        """What it would do if there were no lights and signs."""
        wanted, steer = self.wants()
        throttle, brake = follow(self._world.car.speed, wanted)
        return Control(throttle, steer, brake)

    def wants(self) -> tuple[float, float]:
        """The speed and the steering that it wants if there are no lights and signs."""
        world = self._world
        speed, along = world.car.speed, world.journey.along
        reach = 3.5 + 0.45 * speed
        x, y, _ = world.route.path.at(along + reach)
        ahead, left = seen_from((x, y), world.car.place, world.car.heading)
        limit = min(
            math.sqrt(world.route.limit(along + d) ** 2 + 4.0 * max(d - 2.0, 0.0))
            for d in range(0, 18, 2)
        )
        return min(limit, self.safe_speed()), steer_to(ahead, left)

    def safe_speed(self) -> float:
        """The speed from which the car comes to a stand before what is on its way."""
        return speed_to_stop(self._gap())

    def _gap(self) -> float:
        """How far the middle of the car can go."""
        world = self._world
        along, path = world.journey.along, world.route.path
        begin = int(along / path.step)
        points = path.points[begin + 2 : begin + int(_LOOK)]
        gap = 1000.0
        for place, crossing in world.route.crossings:
            number = world.roads.crossings.index(crossing)
            if world.pedestrians.occupied[number] and 0.0 < place - along - 2.0 < _LOOK:
                gap = min(gap, place - along - 5.0)
        here, reach = world.car.place, _LOOK + 8.0
        cars = [it for it in world.traffic.cars if math.dist(it.place, here) < reach]
        circles = [circle for body in cars for circle in _circles(body)]
        walkers = [it.place for it in world.pedestrians.on_roads]
        return min(gap, _free(points, circles, _CAR_RADIUS), _free(points, walkers, _WALKER_RADIUS))


def _circles(body: Body) -> list[Point]:
    """Points of a car: its two ends, and where it will be soon."""
    ends = [shifted(body.place, body.heading, at) for at in (1.4, -1.4)]
    if body.speed > 1.0:
        ends.append(shifted(body.place, body.heading, 1.4 + 0.6 * body.speed))
    return ends


def _free(points: Floats, obstacles: list[Point], radius: float) -> float:
    """How far the path is free of obstacles, less the length of the car before its middle."""
    if not obstacles:
        return 1000.0
    apart = points[:, None, :] - np.array(obstacles)
    near = (np.einsum("poi,poi->po", apart, apart) < radius**2).any(axis=1)
    if not near.any():
        return 1000.0
    return float(near.argmax()) + 2.0 - CAR_LENGTH / 2 - 1.8
