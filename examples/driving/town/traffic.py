"""The other cars: they follow lanes, keep their distance, and obey lights, signs and crossings.

Each looks along its own path for what is on it, whatever that is. At stop signs one car after the
other enters the junction, and the driven car goes first.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .bodies import CAR_LENGTH, Body
from .geometry import Floats, Point, seen_from
from .lights import DT, GREEN, RED, Lights
from .roads import REACH, Lane, Roads

_FIRST_LOOK, _LAST_LOOK = 3, 30
_CAR_RADIUS, _WALKER_RADIUS = 2.1, 1.5
_AXLE = 1.4
_BRAKING, _HARDEST_BRAKING, _ACCELERATION = 3.0, 7.0, 2.0
_STANDS_BEFORE_LINE = 3.2
_WAITS_AT_SIGN = 12


@dataclass
class Car(Body):
    """A car on a lane: how far along it is, and where it turns at its end."""

    lane: int = 0
    along: float = 0.0
    onto: int = 0
    stood: int = 0


class Traffic:
    """All other cars of a town."""

    def __init__(self, roads: Roads, seed: int, count: int, keep_clear: Point) -> None:
        self._rng = random.Random(f"traffic {seed}")
        self._roads = roads
        self._ahead: dict[tuple[int, int], Floats] = {}
        self._holders: dict[int, Car] = {}
        self._crossings_on = _crossings_on(roads)
        self.cars: list[Car] = []
        straight = [lane for lane in roads.lanes if not lane.inside]
        for lane in self._rng.sample(straight, min(count, len(straight))):
            along = self._rng.uniform(6.0, lane.path.length - 8.0)
            x, y, heading = lane.path.at(along)
            colour = self._rng.randrange(1000)
            car = Car(x, y, heading, 5.0, colour, lane.number, along, self._choice(lane))
            if math.dist((x, y), keep_clear) > 18.0:
                self.cars.append(car)

    def step(
        self, lights: Lights, frame: int, driven: Body, walkers: Sequence[Body], busy: list[bool]
    ) -> None:
        """Moves by one frame; ``busy`` says on which crossings there are pedestrians."""
        gaps = self._gaps(driven, walkers)
        for car, gap in zip(self.cars, gaps, strict=True):
            lane = self._roads.lanes[car.lane]
            limit = lane.speed
            if not lane.inside:
                to_line = lane.path.length - car.along
                if self._must_hold(car, lane, lights, frame, driven):
                    gap = min(gap, to_line - _STANDS_BEFORE_LINE)
                curve = self._roads.curve(lane, car.onto)
                limit = min(limit, math.sqrt(curve.speed**2 + 4.0 * to_line))
                for number, place in self._crossings_on.get(car.lane, ()):
                    if busy[number] and car.along < place - 2.0:
                        gap = min(gap, place - 4.5 - car.along)
            wanted = min(limit, math.sqrt(2 * _BRAKING * max(gap, 0.0)))
            change = min(max((wanted - car.speed) / 0.3, -_HARDEST_BRAKING), _ACCELERATION)
            car.speed = max(0.0, car.speed + change * DT)
            self._move(car, lane)

    def _choice(self, lane: Lane) -> int:
        return self._rng.choice(self._roads.exits(lane))

    def _move(self, car: Car, lane: Lane) -> None:
        car.along += car.speed * DT
        if car.along >= lane.path.length:
            car.along -= lane.path.length
            car.stood = 0
            if lane.inside:
                lane = self._roads.between[lane.end, car.onto]
                car.onto = self._choice(lane)
                if self._holders.get(lane.start) is car:
                    del self._holders[lane.start]
            else:
                lane = self._roads.curve(lane, car.onto)
            car.lane = lane.number
        car.x, car.y, car.heading = lane.path.at(car.along)

    def _gaps(self, driven: Body, walkers: Sequence[Body]) -> list[float]:
        """How far each car's middle can go until something is on its path."""
        if not self.cars:
            return []
        bodies = [*self.cars, driven]
        ends = [_ends(body) for body in bodies]
        points = np.array([end for pair in ends for end in pair] + [it.place for it in walkers])
        radii = np.array([_CAR_RADIUS] * (2 * len(bodies)) + [_WALKER_RADIUS] * len(walkers))
        paths = np.stack([self._look(car) for car in self.cars])
        places = np.array([car.place for car in self.cars])
        reach = places[:, None] - points
        close = np.einsum("coi,coi->co", reach, reach) < (_LAST_LOOK + 3.0) ** 2
        for index in range(len(self.cars)):
            close[index, 2 * index : 2 * index + 2] = False
        which, what = np.nonzero(close)
        apart = paths[which] - points[what][:, None]
        near = np.einsum("npi,npi->np", apart, apart) < (radii[what] ** 2)[:, None]
        first = np.where(near.any(axis=1), near.argmax(axis=1) + _FIRST_LOOK, 1000)
        free = np.full(len(self.cars), 1000)
        np.minimum.at(free, which, first)
        return [float(place) - CAR_LENGTH / 2 - 1.5 for place in free]

    def _look(self, car: Car) -> Floats:
        """The points of the path ahead of a car."""
        lane = self._roads.lanes[car.lane]
        key = (car.lane, car.onto)
        if key not in self._ahead:
            first = [] if lane.inside else [lane.path.points]
            curve = lane if lane.inside else self._roads.curve(lane, car.onto)
            after = self._roads.between[lane.end, car.onto].path.points
            self._ahead[key] = np.concatenate([*first, curve.path.points, after])
        begin = int(car.along / lane.path.step)
        return self._ahead[key][begin + _FIRST_LOOK : begin + _LAST_LOOK]

    def _must_hold(self, car: Car, lane: Lane, lights: Lights, frame: int, driven: Body) -> bool:
        """Whether the car has to stop at the end of its lane."""
        junction = self._roads.junctions[lane.end]
        to_line = lane.path.length - car.along
        if junction.kind == "bend" or to_line > 30.0:
            return False
        if junction.kind == "light":
            colour = lights.colour(junction.number, lane.start, frame)
            can_stop = to_line - 1.0 > car.speed**2 / 8.0
            if colour == RED or (colour != GREEN and can_stop):
                return True
            return can_stop and (self._is_inside(junction.number, lane.start) or self._is_full(car))
        if self._holders.get(junction.number) is car:
            return False
        car.stood = car.stood + 1 if car.speed < 0.2 and to_line < 6.0 else car.stood
        free = junction.number not in self._holders and not _claims(driven, junction.centre)
        if car.stood < _WAITS_AT_SIGN or not free or self._is_full(car):
            return True
        self._holders[junction.number] = car
        return False

    def _is_inside(self, junction: int, arrives_from: int) -> bool:
        """Whether cars from other roads are still in a junction."""
        lanes = (self._roads.lanes[car.lane] for car in self.cars)
        return any(it.inside and it.end == junction and it.start != arrives_from for it in lanes)

    def _is_full(self, car: Car) -> bool:
        """Whether there is no room behind the junction where this car wants to go."""
        onto = self._roads.between[self._roads.lanes[car.lane].end, car.onto].number
        return any(it.lane == onto and it.along < 9.0 and it.speed < 2.0 for it in self.cars)


def _ends(body: Body) -> tuple[Point, Point]:
    dx, dy = _AXLE * math.cos(body.heading), _AXLE * math.sin(body.heading)
    return ((body.x + dx, body.y + dy), (body.x - dx, body.y - dy))


def _claims(driven: Body, centre: Point) -> bool:
    """Whether the driven car is in a junction, or close to it and on its way there."""
    distance = math.dist(driven.place, centre)
    towards = seen_from(centre, driven.place, driven.heading)[0] > 0
    return distance < REACH + 1.0 or (distance < REACH + 8.0 and towards)


def _crossings_on(roads: Roads) -> dict[int, list[tuple[int, float]]]:
    """For each lane its crossings, with how far along they are."""
    found: dict[int, list[tuple[int, float]]] = {}
    for number, crossing in enumerate(roads.crossings):
        for start, end in (crossing.road, crossing.road[::-1]):
            lane = roads.between[start, end]
            x, y, heading = lane.path.at(0.0)
            place = seen_from(crossing.middle, (x, y), heading)[0]
            found.setdefault(lane.number, []).append((number, place))
    return found
