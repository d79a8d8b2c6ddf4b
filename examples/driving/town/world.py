"""A town with all that moves in it, the car that is driven, and what becomes of its journey.

It draws nothing: `camera.py` and `birdview.py` do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from . import roads as town_roads
from .bodies import WALKER_SIZE, Body, DrivenCar
from .controls import Control
from .geometry import overlap
from .lights import FRAMES_A_SECOND, RED, Lights
from .pedestrians import Pedestrians
from .roads import LANE_WIDTH, SHOULDER
from .route import StopLine, plan
from .traffic import Traffic

STANDS = 0.3
# How far before a line a car has to have stood, to have stopped at it.
_AT_LINE = 7.0
_ROUTE_IS_LEFT = LANE_WIDTH / 2 + SHOULDER
_REST = 8.0


@dataclass(frozen=True)
class Setting:
    """How long a route is, and how much else moves in the town."""

    junctions: int = 4
    cars: int = 20
    crossers: int = 12
    strollers: int = 14


@dataclass
class Journey:
    """What has happened on the way. ``ended`` is empty as long as the car may drive on."""

    ended: str = ""
    frames: int = 0
    along: float = 0.0
    red_lights: int = 0
    stop_signs: int = 0
    lines_passed: int = 0

    @property
    def completed(self) -> bool:
        """Whether the car has come to the end of its route."""
        return self.ended == "completed"

    @property
    def clean(self) -> bool:
        """Whether it has, and has run no red light and no stop sign."""
        return self.completed and not self.red_lights and not self.stop_signs


@dataclass
class World:
    """The town of a seed at one frame."""

    seed: int
    setting: Setting = field(default_factory=Setting)

    def __post_init__(self) -> None:
        self.roads = town_roads.build(self.seed)
        self.route = plan(self.roads, self.seed, self.setting.junctions)
        self.lights = Lights(self.roads, self.seed)
        x, y, heading = self.route.path.at(3.0)
        self.car = DrivenCar(x, y, heading)
        self.traffic = Traffic(self.roads, self.seed, self.setting.cars, (x, y))
        crossers, strollers = self.setting.crossers, self.setting.strollers
        self.pedestrians = Pedestrians(self.roads, self.seed, crossers, strollers)
        self.journey = Journey(along=3.0)
        self.sideways = 0.0
        self._stood_at = -1.0
        waits = 40 * len(self.route.stop_lines)
        self._last_frame = int(FRAMES_A_SECOND * (30 + self.route.path.length / 3.0 + waits))

    @property
    def next_line(self) -> StopLine | None:
        """The next stop line on the route."""
        lines = self.route.stop_lines
        passed = self.journey.lines_passed
        return lines[passed] if passed < len(lines) else None

    def colour(self, line: StopLine) -> str:
        """What the light at a line shows now."""
        return self.lights.colour(line.junction, line.arrives_from, self.journey.frames)

    def step(self, control: Control) -> None:
        """Moves everything by one frame; nothing if the journey has ended."""
        journey = self.journey
        if journey.ended:
            return
        self.pedestrians.step([*self.traffic.cars, self.car])
        walkers = self.pedestrians.on_roads
        busy = self.pedestrians.occupied
        self.traffic.step(self.lights, journey.frames, self.car, walkers, busy)
        self.car.drive(control)
        journey.frames += 1
        journey.along, self.sideways = self.route.path.project(self.car.place, journey.along)
        self._judge_line()
        journey.ended = self._end()

    def _judge_line(self) -> None:
        """Counts the next stop line, if the car has passed it, and whether it was allowed to."""
        line, journey = self.next_line, self.journey
        if line is None:
            return
        if self.car.speed < STANDS and 0.0 <= line.along - journey.along < _AT_LINE:
            self._stood_at = line.along
        if journey.along < line.along:
            return
        journey.lines_passed += 1
        if line.kind == "light":
            journey.red_lights += self.colour(line) == RED
        else:
            journey.stop_signs += self._stood_at != line.along

    def _end(self) -> str:
        if self._hits():
            return "collision"
        if abs(self.sideways) > _ROUTE_IS_LEFT:
            return "off the road"
        if self.journey.along >= self.route.path.length - _REST:
            return "completed"
        return "timeout" if self.journey.frames >= self._last_frame else ""

    def _hits(self) -> bool:
        return any(self.touches(it, walker=False) for it in self.traffic.cars) or any(
            self.touches(it, walker=True) for it in self.pedestrians.bodies
        )

    def touches(self, other: Body, walker: bool) -> bool:
        """Whether the car has hit another one, or a pedestrian."""
        if math.dist(other.place, self.car.place) > 6.0:
            return False
        if not walker:
            return overlap(self.car.corners(), other.corners())
        half = WALKER_SIZE / 2
        square = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
        return overlap(self.car.corners(), square + np.array(other.place))
