"""Pedestrians: some cross roads where there is a crossing, others walk along the roads.

They begin to cross only when no car is near, or when those that are have stopped.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

from .bodies import Body
from .geometry import shifted
from .lights import DT, FRAMES_A_SECOND
from .roads import HALF_ROAD, REACH, Crossing, Roads

KERB = HALF_ROAD + 1.6
_WALK = 1.3
_CAR_IS_NEAR = 28.0


@dataclass
class Crosser:
    """A pedestrian at a crossing: on which side, or how far from the middle of the road."""

    body: Body
    crossing: int
    sideways: float
    beside: float
    pause: int
    towards: float = 0.0


@dataclass
class Stroller:
    """A pedestrian on the pavement of a road, back and forth."""

    body: Body
    road: tuple[int, int]
    along: float
    sideways: float
    direction: float


class Pedestrians:
    """All pedestrians of a town."""

    def __init__(self, roads: Roads, seed: int, crossers: int, strollers: int) -> None:
        self._rng = rng = random.Random(f"pedestrians {seed}")
        self._roads = roads
        self.crossers = [self._crosser(rng) for _ in range(crossers if roads.crossings else 0)]
        self.strollers = [self._stroller(rng) for _ in range(strollers)]
        self.occupied = [False] * len(roads.crossings)

    @property
    def bodies(self) -> list[Body]:
        """All of them."""
        return [it.body for it in self.crossers] + [it.body for it in self.strollers]

    @property
    def on_roads(self) -> list[Body]:
        """Those that cross a road."""
        return [it.body for it in self.crossers if it.towards]

    def step(self, cars: Sequence[Body]) -> None:
        """Moves by one frame."""
        for stroller in self.strollers:
            self._stroll(stroller)
        for crosser in self.crossers:
            self._cross(crosser, cars)
        self.occupied = [False] * len(self._roads.crossings)
        for crosser in self.crossers:
            if crosser.towards and abs(crosser.sideways) < HALF_ROAD + 0.6:
                self.occupied[crosser.crossing] = True

    def _crosser(self, rng: random.Random) -> Crosser:
        crossing = rng.randrange(len(self._roads.crossings))
        side = rng.choice((-1.0, 1.0))
        body = Body(0.0, 0.0, 0.0, colour=rng.randrange(1000))
        pause = rng.randrange(12 * FRAMES_A_SECOND)
        crosser = Crosser(body, crossing, side * KERB, rng.uniform(-1.0, 1.0), pause)
        self._place(crosser, self._roads.crossings[crossing])
        return crosser

    def _stroller(self, rng: random.Random) -> Stroller:
        road = rng.choice(self._roads.roads)
        body = Body(0.0, 0.0, 0.0, _WALK, colour=rng.randrange(1000))
        sideways = rng.choice((-1.0, 1.0)) * (KERB + rng.uniform(0.0, 0.8))
        stroller = Stroller(body, road, rng.uniform(20.0, 50.0), sideways, rng.choice((-1.0, 1.0)))
        self._stroll(stroller)
        return stroller

    def _stroll(self, stroller: Stroller) -> None:
        a, b = (self._roads.junctions[number].centre for number in stroller.road)
        if not REACH + 3 < stroller.along < math.dist(a, b) - REACH - 3:
            stroller.direction = 1.0 if stroller.along < 30 else -1.0
        stroller.along += stroller.direction * _WALK * DT
        heading = self._roads.heading(*stroller.road)
        body = stroller.body
        body.x, body.y = shifted(a, heading, stroller.along, stroller.sideways)
        body.heading = heading if stroller.direction > 0 else heading + math.pi

    def _cross(self, crosser: Crosser, cars: Sequence[Body]) -> None:
        crossing = self._roads.crossings[crosser.crossing]
        if not crosser.towards:
            crosser.pause -= 1
            if crosser.pause > 0 or not _is_safe(crossing, cars):
                return
            crosser.towards = -math.copysign(1.0, crosser.sideways)
        crosser.sideways += crosser.towards * _WALK * DT
        crosser.body.speed = _WALK
        if crosser.sideways * crosser.towards >= KERB:
            crosser.towards, crosser.body.speed = 0.0, 0.0
            crosser.pause = self._rng.randrange(4 * FRAMES_A_SECOND, 14 * FRAMES_A_SECOND)
        self._place(crosser, crossing)

    def _place(self, crosser: Crosser, crossing: Crossing) -> None:
        body = crosser.body
        body.x, body.y = shifted(
            crossing.middle, crossing.heading, crosser.beside, crosser.sideways
        )
        side = crosser.towards or -math.copysign(1.0, crosser.sideways)
        body.heading = crossing.heading + side * math.pi / 2


def _is_safe(crossing: Crossing, cars: Sequence[Body]) -> bool:
    """Whether each car is far away, or stands and leaves the crossing free."""
    for car in cars:
        distance = math.dist(car.place, crossing.middle)
        if distance < 5.5 or (distance < _CAR_IS_NEAR and car.speed > 0.5):
            return False
    return True
