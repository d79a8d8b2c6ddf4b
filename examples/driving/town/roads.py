"""The map of a town: junctions, lanes between them, curves through them, crossings.

A town is a grid of junctions that are moved a little, with some roads left out. Traffic keeps to
the right. What is seen of it is in `ground.py` and `scenery.py`.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from .geometry import Path, Point, bezier, shifted, wrapped

SIDE = 4
SPACING = 74.0
JITTER = 8.0
LANE_WIDTH = 3.5
SHOULDER = 1.0
# From the middle of a road to its edge, and from the middle of a junction to its stop lines.
HALF_ROAD = LANE_WIDTH + SHOULDER
REACH = 13.0
SPEED_LIMIT = 8.0
CURVE_SPEED = 5.0


@dataclass(frozen=True)
class Lane:
    """One lane of a road, or a curve through a junction, on which cars drive one way."""

    number: int
    path: Path
    start: int
    end: int
    inside: bool
    speed: float


@dataclass(frozen=True)
class Crossing:
    """Where pedestrians cross a road: its middle, and the direction of the road."""

    middle: Point
    heading: float
    road: tuple[int, int]


@dataclass(frozen=True)
class Junction:
    """Where roads meet. Its kind is ``light``, ``stop`` or, where two roads meet, ``bend``."""

    number: int
    centre: Point
    kind: str
    neighbours: tuple[int, ...]


@dataclass(frozen=True)
class Roads:
    """The whole map. Lanes have their place in ``lanes`` as their number."""

    junctions: list[Junction]
    roads: list[tuple[int, int]]
    lanes: list[Lane]
    between: dict[tuple[int, int], Lane]
    curves: dict[tuple[int, int, int], Lane]
    crossings: list[Crossing]

    def heading(self, start: int, end: int) -> float:
        """The direction of the road from one junction to another."""
        a, b = self.junctions[start].centre, self.junctions[end].centre
        return math.atan2(b[1] - a[1], b[0] - a[0])

    def curve(self, lane: Lane, onto: int) -> Lane:
        """The curve from the end of a lane onto the road to another junction."""
        return self.curves[lane.start, lane.end, onto]

    def exits(self, lane: Lane) -> list[int]:
        """The junctions to which roads lead from the end of a lane, other than back."""
        return [to for to in self.junctions[lane.end].neighbours if to != lane.start]


def build(seed: int) -> Roads:
    """The town of a seed."""
    rng = random.Random(f"roads {seed}")
    centres = [
        (
            SPACING * column + rng.uniform(-JITTER, JITTER),
            SPACING * row + rng.uniform(-JITTER, JITTER),
        )
        for row in range(SIDE)
        for column in range(SIDE)
    ]
    roads = _grid()
    for road in rng.sample(roads, len(roads)):
        if len(roads) > len(_grid()) - 3 and _can_go(roads, road):
            roads.remove(road)
    neighbours = [_around(number, roads, centres) for number in range(len(centres))]
    junctions = [
        Junction(number, centre, _kind(rng, len(neighbours[number])), neighbours[number])
        for number, centre in enumerate(centres)
    ]
    lanes, between, curves = _lanes(junctions, roads)
    crossings = [_crossing(junctions, road) for road in roads if rng.random() < 0.5]
    return Roads(junctions, roads, lanes, between, curves, crossings)


def _grid() -> list[tuple[int, int]]:
    across = [(n, n + 1) for n in range(SIDE * SIDE) if n % SIDE < SIDE - 1]
    along = [(n, n + SIDE) for n in range(SIDE * (SIDE - 1))]
    return across + along


def _can_go(roads: list[tuple[int, int]], road: tuple[int, int]) -> bool:
    """Whether every junction keeps three roads that had four, so that the town stays connected."""
    return all(sum(end in other for other in roads) >= 4 for end in road)


def _around(number: int, roads: list[tuple[int, int]], centres: list[Point]) -> tuple[int, ...]:
    """The neighbours of a junction, counter-clockwise."""
    found = [sum(road) - number for road in roads if number in road]
    x, y = centres[number]
    return tuple(sorted(found, key=lambda n: math.atan2(centres[n][1] - y, centres[n][0] - x)))


def _kind(rng: random.Random, roads: int) -> str:
    draw = rng.random()
    if roads < 3:
        return "bend"
    return "light" if draw < 0.6 else "stop"


def _crossing(junctions: list[Junction], road: tuple[int, int]) -> Crossing:
    a, b = (junctions[number].centre for number in road)
    heading = math.atan2(b[1] - a[1], b[0] - a[0])
    return Crossing(((a[0] + b[0]) / 2, (a[1] + b[1]) / 2), heading, road)


def _lanes(
    junctions: list[Junction], roads: list[tuple[int, int]]
) -> tuple[list[Lane], dict[tuple[int, int], Lane], dict[tuple[int, int, int], Lane]]:
    lanes: list[Lane] = []
    between: dict[tuple[int, int], Lane] = {}
    curves: dict[tuple[int, int, int], Lane] = {}
    for start, end in [way for a, b in roads for way in ((a, b), (b, a))]:
        a, b = junctions[start].centre, junctions[end].centre
        heading = math.atan2(b[1] - a[1], b[0] - a[0])
        first = shifted(a, heading, REACH, -LANE_WIDTH / 2)
        last = shifted(b, heading, -REACH, -LANE_WIDTH / 2)
        lane = Lane(len(lanes), Path.through([first, last]), start, end, False, SPEED_LIMIT)
        lanes.append(lane)
        between[start, end] = lane
    for (start, middle), before in list(between.items()):
        for onto in junctions[middle].neighbours:
            if onto == start:
                continue
            x, y, heading = before.path.at(before.path.length)
            after = between[middle, onto].path
            to_x, to_y, to_heading = after.at(0.0)
            path = Path.through(bezier((x, y), heading, (to_x, to_y), to_heading))
            turn = abs(wrapped(to_heading - heading))
            speed = SPEED_LIMIT if turn < 0.5 else CURVE_SPEED
            lane = Lane(len(lanes), path, start, middle, True, speed)
            lanes.append(lane)
            curves[start, middle, onto] = lane
    return lanes, between, curves
