"""Draws what is around a car from above, into channels: the geometry of the bird's-eye view.

It knows places and headings in metres, x east and y north, and no town: other simulators draw their
views with it, too.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from .bodies import CAR_LENGTH, CAR_WIDTH, Body
from .geometry import Floats, corners_of, shifted
from .ground import Pixels

SIZE = 64
METRES = 0.5
CHANNELS = ("road", "route", "crossings", "cars", "motion", "pedestrians")
SHAPE = (len(CHANNELS), SIZE, SIZE)
ROAD, ROUTE, CROSSINGS, CARS, MOTION, PEDESTRIANS = range(len(CHANNELS))
# The car is in the middle of a column, and so many rows above the lowest one.
BEHIND = 16
ROUTE_AHEAD, ROUTE_WIDTH = 30, 2.5
# What is farther away is not on the view.
SEEN = 30.0
_BITS = 4


def checked(out: Pixels) -> Pixels:
    """The array, if a view fits into it."""
    if out.shape != SHAPE or out.dtype != np.uint8:
        raise ValueError(f"a bird's-eye view is uint8 of {SHAPE}, not {out.dtype} of {out.shape}")
    return out


class Overhead:
    """Draws for a car, which looks up from its place in the view."""

    def __init__(self, car: Body, out: Pixels) -> None:
        self._car, self._out = car, out
        self._cos, self._sin = math.cos(car.heading), math.sin(car.heading)

    def line(self, channel: int, points: Floats, metres: float) -> None:
        """A line through points, so many metres wide."""
        width = round(metres / METRES)
        pixels = [self._pixels(points)]
        cv2.polylines(self._out[channel], pixels, False, 255, width, cv2.LINE_8, _BITS)

    def fill(self, channel: int, corners: Floats) -> None:
        """A convex polygon."""
        cv2.fillConvexPoly(self._out[channel], self._pixels(corners), 255, cv2.LINE_8, _BITS)

    def car(self, car: Body, length: float = CAR_LENGTH, width: float = CAR_WIDTH) -> None:
        """Another car, and where it comes to within a second."""
        self.fill(CARS, corners_of(car.place, car.heading, length, width))
        swept = shifted(car.place, car.heading, car.speed / 2)
        self.fill(MOTION, corners_of(swept, car.heading, length + car.speed, width))

    def pedestrian(self, body: Body, speed: float) -> None:
        """A pedestrian, and the way that is walked at a speed within 1.6 seconds."""
        middle = shifted(body.place, body.heading, 0.8 * speed)
        self.fill(PEDESTRIANS, corners_of(middle, body.heading, 1.2 + 1.6 * speed, 1.2))

    def sees(self, other: Body) -> bool:
        """Whether another body is near enough to be on the view."""
        return math.dist(other.place, self._car.place) < SEEN

    def _pixels(self, points: Floats) -> Floats:
        """Where points are, in parts of a pixel."""
        dx, dy = points[:, 0] - self._car.x, points[:, 1] - self._car.y
        columns = SIZE / 2 - (dy * self._cos - dx * self._sin) / METRES - 0.5
        rows = SIZE - BEHIND - (dx * self._cos + dy * self._sin) / METRES - 0.5
        return np.round(np.stack([columns, rows], axis=1) * (1 << _BITS)).astype(np.int32)
