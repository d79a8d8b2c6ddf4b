"""Paths, boxes and angles in the plane; x points east, y north, headings turn left.

It knows nothing of roads or cars.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Point = tuple[float, float]

STEP = 1.0


def wrapped(angle: float) -> float:
    """The same angle between minus and plus half a turn."""
    return math.remainder(angle, math.tau)


def shifted(point: Point, heading: float, ahead: float, left: float = 0.0) -> Point:
    """The point that lies so far ahead and to the left of one that looks along ``heading``."""
    cos, sin = math.cos(heading), math.sin(heading)
    return (point[0] + ahead * cos - left * sin, point[1] + ahead * sin + left * cos)


def seen_from(point: Point, origin: Point, heading: float) -> Point:
    """How far a point is ahead and to the left of an origin that looks along ``heading``."""
    cos, sin = math.cos(heading), math.sin(heading)
    dx, dy = point[0] - origin[0], point[1] - origin[1]
    return (dx * cos + dy * sin, dy * cos - dx * sin)


def bezier(start: Point, start_heading: float, end: Point, end_heading: float) -> list[Point]:
    """A smooth curve between two points with these headings, finely sampled."""
    reach = 0.5 * math.dist(start, end)
    first = shifted(start, start_heading, reach)
    second = shifted(end, end_heading, -reach)
    curve: list[Point] = []
    for index in range(41):
        t = index / 40
        weights = ((1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t**3)
        corners = (start, first, second, end)
        x = sum(weight * corner[0] for weight, corner in zip(weights, corners, strict=True))
        y = sum(weight * corner[1] for weight, corner in zip(weights, corners, strict=True))
        curve.append((x, y))
    return curve


@dataclass(frozen=True)
class Path:
    """A line through the plane, sampled at equal distances of about a metre."""

    points: Floats
    step: float
    headings: Floats = field(repr=False)

    @classmethod
    def through(cls, corners: list[Point]) -> Path:
        """The path along these corners."""
        xy = np.array(corners)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
        count = max(2, round(float(along[-1]) / STEP) + 1)
        wanted = np.linspace(0.0, along[-1], count)
        points = np.stack([np.interp(wanted, along, xy[:, axis]) for axis in (0, 1)], axis=1)
        segments = np.diff(points, axis=0)
        headings = np.unwrap(np.arctan2(segments[:, 1], segments[:, 0]))
        at_points = np.concatenate(
            [headings[:1], (headings[1:] + headings[:-1]) / 2, headings[-1:]]
        )
        return cls(points, float(along[-1]) / (count - 1), at_points)

    @classmethod
    def joined(cls, paths: list[Path]) -> Path:
        """One path along several of which each begins where the one before ends."""
        corners = [(float(x), float(y)) for path in paths for x, y in path.points[:-1]]
        x, y = paths[-1].points[-1]
        return cls.through([*corners, (float(x), float(y))])

    @property
    def length(self) -> float:
        """Metres from its begin to its end."""
        return self.step * (len(self.points) - 1)

    def at(self, along: float) -> tuple[float, float, float]:
        """Position and heading after so many metres; beyond its ends, those of the ends."""
        place = min(max(along / self.step, 0.0), len(self.points) - 1.0)
        index = min(int(place), len(self.points) - 2)
        rest = place - index
        before, after = self.points[index], self.points[index + 1]
        x = before[0] + rest * (after[0] - before[0])
        y = before[1] + rest * (after[1] - before[1])
        turn = self.headings[index + 1] - self.headings[index]
        return (float(x), float(y), float(self.headings[index] + rest * turn))

    def project(self, point: Point, near: float, window: float = 10.0) -> tuple[float, float]:
        """How far along the path a point is, and how far left of it; searched ``near`` there."""
        low = max(0, int((near - window) / self.step))
        high = min(len(self.points), int((near + window) / self.step) + 2)
        piece = self.points[low:high]
        offsets = piece - np.array(point)
        index = low + int(np.argmin(np.einsum("ij,ij->i", offsets, offsets)))
        x, y = (float(value) for value in self.points[index])
        ahead, left = seen_from(point, (x, y), float(self.headings[index]))
        return (min(max(index * self.step + ahead, 0.0), self.length), left)


def corners_of(centre: Point, heading: float, length: float, width: float) -> Floats:
    """The corners of a box, counter-clockwise from the right of its rear."""
    sides = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))
    return np.array([shifted(centre, heading, a * length, b * width) for a, b in sides])


def overlap(one: Floats, other: Floats) -> bool:
    """Whether two boxes of ``corners_of`` share a point: no side of either separates them."""
    for box in (one, other):
        for axis in (box[1] - box[0], box[3] - box[0]):
            first, second = one @ axis, other @ axis
            if first.max() < second.min() or second.max() < first.min():
                return False
    return True
