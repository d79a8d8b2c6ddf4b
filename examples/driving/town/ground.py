"""The town from above: a picture of the ground, and a mask of the roads.

The camera sees the picture in perspective; the bird's-eye view is cut out of the mask. Lines are
drawn with whole numbers, so that the same town gives the same pixels.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from .geometry import Floats, Point, shifted
from .pedestrians import KERB
from .roads import HALF_ROAD, LANE_WIDTH, REACH, SHOULDER, SIDE, SPACING, Roads

Pixels = npt.NDArray[np.uint8]
Colour = tuple[float, float, float]

_MARGIN = 40.0
WEST = -_MARGIN
EXTENT = SPACING * (SIDE - 1) + 2 * _MARGIN
FINE, COARSE, MASK = 0.1, 0.4, 0.25
_PAVEMENT_EDGE = KERB + 1.6
_BITS = 4

GRASS: Colour = (96, 124, 70)
_PAVEMENT: Colour = (150, 147, 142)
_KERB: Colour = (182, 180, 176)
_ASPHALT: Colour = (74, 75, 79)
_WHITE: Colour = (222, 222, 216)
_YELLOW: Colour = (206, 172, 70)


class Canvas:
    """A picture of the town with so many metres a pixel; row and column grow with y and x."""

    def __init__(self, pixels: Pixels, metres: float) -> None:
        self.pixels = pixels
        self._metres = metres

    def fill(self, corners: list[Point] | Floats, colour: Colour) -> None:
        """Fills a convex polygon."""
        cv2.fillConvexPoly(self.pixels, self._places(corners), colour, cv2.LINE_8, _BITS)

    def line(self, points: list[Point] | Floats, width: float, colour: Colour) -> None:
        """Draws a line through points."""
        thickness = max(1, round(width / self._metres))
        places = self._places(points)
        cv2.polylines(self.pixels, [places], False, colour, thickness, cv2.LINE_8, _BITS)

    def road(self, start: Point, heading: float, reach: tuple[float, float], half: float) -> Floats:
        """The corners of a strip along a direction from a point."""
        a, b = reach
        sides = ((a, -half), (b, -half), (b, half), (a, half))
        return np.array([shifted(start, heading, ahead, left) for ahead, left in sides])

    def _places(self, points: list[Point] | Floats) -> npt.NDArray[np.int32]:
        scaled = ((np.asarray(points) - WEST) / self._metres - 0.5) * (1 << _BITS)
        return np.round(scaled).astype(np.int32)


def road_mask(roads: Roads) -> Pixels:
    """White where cars may drive, at `MASK` metres a pixel."""
    size = round(EXTENT / MASK)
    canvas = Canvas(np.zeros((size, size), np.uint8), MASK)
    _surface(canvas, roads, HALF_ROAD, (255, 255, 255))
    return canvas.pixels


def crossing_mask(roads: Roads) -> Pixels:
    """White where pedestrians cross."""
    size = round(EXTENT / MASK)
    canvas = Canvas(np.zeros((size, size), np.uint8), MASK)
    for crossing in roads.crossings:
        strip = canvas.road(crossing.middle, crossing.heading, (-1.5, 1.5), HALF_ROAD)
        canvas.fill(strip, (255, 255, 255))
    return canvas.pixels


def picture(roads: Roads, seed: int, light: float) -> Pixels:
    """What the ground looks like, at `FINE` metres a pixel."""
    size = round(EXTENT / FINE)
    canvas = Canvas(np.empty((size, size, 3), np.uint8), FINE)
    canvas.pixels[:] = GRASS
    _surface(canvas, roads, _PAVEMENT_EDGE, _PAVEMENT)
    _surface(canvas, roads, HALF_ROAD + 0.3, _KERB)
    _surface(canvas, roads, HALF_ROAD, _ASPHALT)
    _mark(canvas, roads)
    for crossing in roads.crossings:
        for left in np.arange(-HALF_ROAD + 0.5, HALF_ROAD, 1.0):
            middle = shifted(crossing.middle, crossing.heading, 0.0, float(left))
            canvas.fill(canvas.road(middle, crossing.heading, (-1.5, 1.5), 0.26), _WHITE)
    return _weathered(canvas.pixels, seed, light)


def _weathered(pixels: Pixels, seed: int, light: float) -> Pixels:
    """The same with stains, at another brightness."""
    size = pixels.shape[0]
    noise = np.random.Generator(np.random.PCG64(seed))
    spots = noise.integers(0, 19, (size // 12, size // 12), dtype=np.uint8)
    stains = cv2.resize(spots, (size, size), interpolation=cv2.INTER_NEAREST)
    dirt = cv2.add(noise.integers(0, 15, (size, size), dtype=np.uint8), stains)
    dirty = cv2.add(pixels, cv2.merge([dirt, dirt, dirt]))
    # Dirt is from 0 to 32: half of it makes darker.
    levels = np.clip((np.arange(256) - 16) * light, 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(dirty, levels), np.uint8)


def _surface(canvas: Canvas, roads: Roads, half: float, colour: Colour) -> None:
    """Roads and junctions of another width."""
    wider = half - HALF_ROAD
    for start, end in roads.roads:
        a, b = roads.junctions[start].centre, roads.junctions[end].centre
        heading, length = roads.heading(start, end), math.dist(a, b)
        canvas.fill(canvas.road(a, heading, (REACH - 4, length - REACH + 4), half), colour)
    for junction in roads.junctions:
        ends: list[Point] = []
        for other in junction.neighbours:
            heading = roads.heading(junction.number, other)
            ends += [shifted(junction.centre, heading, REACH, side * half) for side in (-1.0, 1.0)]
        hull = cv2.convexHull(np.array(ends, np.float32))[:, 0].astype(np.float64)
        canvas.fill(hull, colour)
    for lane in roads.curves.values():
        if roads.junctions[lane.end].kind == "bend":
            width = LANE_WIDTH + 2 * (SHOULDER + wider)
            canvas.line(lane.path.points, width, colour)


def _mark(canvas: Canvas, roads: Roads) -> None:
    """Lines on roads: between the lanes, at the edges, and where cars stop."""
    for start, end in roads.roads:
        a, b = roads.junctions[start].centre, roads.junctions[end].centre
        heading, length = roads.heading(start, end), math.dist(a, b)
        for place in np.arange(REACH + 1.0, length - REACH - 3.0, 6.0):
            strip = canvas.road(a, heading, (float(place), float(place) + 3.0), 0.08)
            canvas.fill(strip, _YELLOW)
        for side in (-1.0, 1.0):
            edge = shifted(a, heading, 0.0, side * (HALF_ROAD - 0.7))
            canvas.fill(canvas.road(edge, heading, (REACH, length - REACH), 0.07), _WHITE)
    for lane in roads.lanes:
        if not lane.inside and roads.junctions[lane.end].kind != "bend":
            x, y, heading = lane.path.at(lane.path.length)
            strip = canvas.road((x, y), heading, (-0.25, 0.25), LANE_WIDTH / 2)
            canvas.fill(strip, _WHITE)
