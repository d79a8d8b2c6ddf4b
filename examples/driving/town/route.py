"""The way that the car is to drive: lanes, what stands along them, how far it is."""

from __future__ import annotations

import random
from dataclasses import dataclass

from .geometry import Path, Point, seen_from
from .roads import Crossing, Lane, Roads

# How far ahead the navigation shows points of the route.
LOOKAHEAD = (4.0, 8.0, 16.0)


@dataclass(frozen=True)
class StopLine:
    """A line at which the route enters a junction that has lights or stop signs."""

    along: float
    kind: str
    junction: int
    arrives_from: int
    # Where the route leaves the junction.
    cleared: float


@dataclass(frozen=True)
class Route:
    """A path with its stop lines, and its crossings with how far along they are."""

    path: Path
    stop_lines: list[StopLine]
    crossings: list[tuple[float, Crossing]]
    # The speed limit at each sample of the path.
    limits: list[float]

    def limit(self, along: float) -> float:
        """The speed limit at a place."""
        index = int(along / self.path.step)
        return self.limits[min(max(index, 0), len(self.limits) - 1)]

    def navigation(self, along: float, place: Point, heading: float) -> list[Point]:
        """Points of the route ahead, as the car sees them."""
        targets = [self.path.at(along + ahead) for ahead in LOOKAHEAD]
        return [seen_from((x, y), place, heading) for x, y, _ in targets]


def plan(roads: Roads, seed: int, junctions: int) -> Route:
    """A random route through so many junctions, which begins and ends on a road."""
    rng = random.Random(f"route {seed}")
    lane = rng.choice([lane for lane in roads.lanes if not lane.inside])
    lanes = [lane]
    for _ in range(junctions):
        # Rather to where the route has not been yet.
        exits = roads.exits(lane)
        fresh = [to for to in exits if roads.between[lane.end, to] not in lanes]
        to = rng.choice(fresh or exits)
        lanes += [roads.curve(lane, to), roads.between[lane.end, to]]
        lane = lanes[-1]
    return _along(roads, lanes)


def _along(roads: Roads, lanes: list[Lane]) -> Route:
    path = Path.joined([lane.path for lane in lanes])
    stop_lines: list[StopLine] = []
    crossings: list[tuple[float, Crossing]] = []
    limits: list[float] = []
    along = 0.0
    for lane in lanes:
        junction = roads.junctions[lane.end]
        if lane.inside and junction.kind != "bend":
            cleared = along + lane.path.length
            line = StopLine(along, junction.kind, junction.number, lane.start, cleared)
            stop_lines.append(line)
        for crossing in roads.crossings:
            if not lane.inside and crossing.road in (
                (lane.start, lane.end),
                (lane.end, lane.start),
            ):
                x, y, heading = lane.path.at(0.0)
                crossings.append((along + seen_from(crossing.middle, (x, y), heading)[0], crossing))
        along += lane.path.length
        while len(limits) * path.step < along:
            limits.append(lane.speed)
    return Route(path, stop_lines, crossings, limits)
