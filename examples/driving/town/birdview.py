"""What the agent sees: the town from above around the car, which looks up; a channel a subject."""

from __future__ import annotations

import math

import cv2
import numpy as np

from . import ground
from .bodies import CAR_LENGTH, CAR_WIDTH
from .geometry import Floats, Point
from .ground import MASK, WEST, Pixels
from .overhead import (
    BEHIND,
    CHANNELS,
    CROSSINGS,
    METRES,
    ROAD,
    ROUTE,
    ROUTE_AHEAD,
    ROUTE_WIDTH,
    SHAPE,
    SIZE,
    Overhead,
    checked,
)
from .world import World

__all__ = ["CHANNELS", "SHAPE", "Birdview", "colours"]


class Birdview:
    """Draws the bird's-eye view of a world."""

    def __init__(self, world: World) -> None:
        cv2.setNumThreads(1)
        self._world = world
        self._layers = (ground.road_mask(world.roads), ground.crossing_mask(world.roads))

    def render(self, out: Pixels) -> None:
        """Draws into an array of `SHAPE`."""
        world = self._world
        overhead, matrix = Overhead(world.car, checked(out)), self._matrix()
        out[:] = 0
        for channel, layer in zip((ROAD, CROSSINGS), self._layers, strict=True):
            flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
            cv2.warpAffine(layer, matrix, (SIZE, SIZE), out[channel], flags, cv2.BORDER_CONSTANT, 0)
        path = world.route.path
        begin = int(world.journey.along / path.step)
        ahead = path.points[max(0, begin - 2) : begin + ROUTE_AHEAD]
        overhead.line(ROUTE, ahead, ROUTE_WIDTH)
        for car in filter(overhead.sees, world.traffic.cars):
            overhead.car(car)
        for crosser in world.pedestrians.crossers:
            if overhead.sees(crosser.body):
                speed = crosser.body.speed if crosser.towards else 0.0
                overhead.pedestrian(crosser.body, speed)

    def _matrix(self) -> Floats:
        """From a pixel of the view to a pixel of the mask."""
        car = self._world.car
        cos, sin = math.cos(car.heading), math.sin(car.heading)
        scale = METRES / MASK
        # Ahead is (SIZE - BEHIND - row - 0.5), left is (SIZE / 2 - column - 0.5), in pixels.
        ahead0, left0 = SIZE - BEHIND - 0.5, SIZE / 2 - 0.5

        def offset(place: float, forward: float, sideways: float) -> float:
            return (place - WEST) / MASK - 0.5 + scale * (forward * ahead0 + sideways * left0)

        return np.array(
            [
                [scale * sin, -scale * cos, offset(car.x, cos, -sin)],
                [-scale * cos, -scale * sin, offset(car.y, sin, cos)],
            ]
        )


def colours(view: Pixels) -> Pixels:
    """The view for people: one picture, in colours."""
    picture = np.full((SIZE, SIZE, 3), (58, 82, 52), np.uint8)
    shades: tuple[tuple[int, tuple[int, int, int]], ...] = (
        (0, (92, 92, 96)),
        (2, (176, 176, 168)),
        (1, (70, 120, 190)),
        (4, (150, 110, 60)),
        (3, (240, 190, 60)),
        (5, (240, 90, 160)),
    )
    for channel, shade in shades:
        picture[view[channel] > 127] = shade
    place: Point = (SIZE / 2, SIZE - BEHIND)
    long, wide = round(CAR_LENGTH / METRES / 2), round(CAR_WIDTH / METRES / 2)
    row, column = int(place[1]), int(place[0])
    picture[row - long : row + long, column - wide : column + wide] = (255, 255, 255)
    return picture
