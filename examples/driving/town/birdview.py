"""What the agent sees: the town from above around the car, which looks up; a channel a subject."""

from __future__ import annotations

import math

import cv2
import numpy as np

from . import ground
from .bodies import CAR_LENGTH, CAR_WIDTH
from .geometry import Floats, Point, corners_of, shifted
from .ground import MASK, WEST, Pixels
from .world import World

SIZE = 64
METRES = 0.5
CHANNELS = ("road", "route", "crossings", "cars", "motion", "pedestrians")
SHAPE = (len(CHANNELS), SIZE, SIZE)
# The car is in the middle of a column, and so many rows above the lowest one.
_BEHIND = 16
_ROUTE_AHEAD, _ROUTE_WIDTH = 30, 2.5
_SEEN = 30.0
_BITS = 4


class Birdview:
    """Draws the bird's-eye view of a world."""

    def __init__(self, world: World) -> None:
        cv2.setNumThreads(1)
        self._world = world
        self._layers = (ground.road_mask(world.roads), ground.crossing_mask(world.roads))

    def render(self, out: Pixels) -> None:
        """Draws into an array of `SHAPE`."""
        if out.shape != SHAPE or out.dtype != np.uint8:
            raise ValueError(
                f"a bird's-eye view is uint8 of {SHAPE}, not {out.dtype} of {out.shape}"
            )
        world = self._world
        matrix = self._matrix()
        for channel, layer in zip((0, 2), self._layers, strict=True):
            flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
            cv2.warpAffine(layer, matrix, (SIZE, SIZE), out[channel], flags, cv2.BORDER_CONSTANT, 0)
        for channel in (1, 3, 4, 5):
            out[channel] = 0
        path = world.route.path
        begin = int(world.journey.along / path.step)
        ahead = self._pixels(path.points[max(0, begin - 2) : begin + _ROUTE_AHEAD])
        width = round(_ROUTE_WIDTH / METRES)
        cv2.polylines(out[1], [ahead], False, 255, width, cv2.LINE_8, _BITS)
        for car in world.traffic.cars:
            if math.dist(car.place, world.car.place) < _SEEN:
                self._fill(out[3], car.corners())
                reach = CAR_LENGTH + car.speed
                swept = shifted(car.place, car.heading, car.speed / 2)
                self._fill(out[4], corners_of(swept, car.heading, reach, CAR_WIDTH))
        for crosser in world.pedestrians.crossers:
            body = crosser.body
            if math.dist(body.place, world.car.place) < _SEEN:
                speed = 1.6 * body.speed if crosser.towards else 0.0
                middle = shifted(body.place, body.heading, speed / 2)
                self._fill(out[5], corners_of(middle, body.heading, 1.2 + speed, 1.2))

    def _fill(self, channel: Pixels, corners: Floats) -> None:
        cv2.fillConvexPoly(channel, self._pixels(corners), 255, cv2.LINE_8, _BITS)

    def _pixels(self, points: Floats) -> Floats:
        """Where points are, in parts of a pixel."""
        car = self._world.car
        cos, sin = math.cos(car.heading), math.sin(car.heading)
        dx, dy = points[:, 0] - car.x, points[:, 1] - car.y
        columns = SIZE / 2 - (dy * cos - dx * sin) / METRES - 0.5
        rows = SIZE - _BEHIND - (dx * cos + dy * sin) / METRES - 0.5
        return np.round(np.stack([columns, rows], axis=1) * (1 << _BITS)).astype(np.int32)

    def _matrix(self) -> Floats:
        """From a pixel of the view to a pixel of the mask."""
        car = self._world.car
        cos, sin = math.cos(car.heading), math.sin(car.heading)
        scale = METRES / MASK
        # Ahead is (SIZE - BEHIND - row - 0.5), left is (SIZE / 2 - column - 0.5), in pixels.
        ahead0, left0 = SIZE - _BEHIND - 0.5, SIZE / 2 - 0.5

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
    place: Point = (SIZE / 2, SIZE - _BEHIND)
    long, wide = round(CAR_LENGTH / METRES / 2), round(CAR_WIDTH / METRES / 2)
    row, column = int(place[1]), int(place[0])
    picture[row - long : row + long, column - wide : column + wide] = (255, 255, 255)
    return picture
