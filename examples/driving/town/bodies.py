"""What moves in a town, and the car that is driven: a kinematic bicycle."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .controls import Control
from .geometry import Floats, Point, corners_of
from .lights import DT

CAR_LENGTH, CAR_WIDTH = 4.4, 1.9
WALKER_SIZE = 0.6
_WHEELBASE = 2.7
_MOST_STEER = 0.6
_STEER_A_FRAME = 0.25
_THROTTLE, _BRAKE, _DRAG = 3.0, 7.0, 0.06


@dataclass
class Body:
    """A car or a pedestrian: where it is, where it looks, how fast it moves."""

    x: float
    y: float
    heading: float
    speed: float = 0.0
    colour: int = 0

    @property
    def place(self) -> Point:
        """Its middle."""
        return (self.x, self.y)

    def corners(self) -> Floats:
        """The corners of a car of this place and heading."""
        return corners_of(self.place, self.heading, CAR_LENGTH, CAR_WIDTH)


class DrivenCar(Body):
    """The car that is driven by controls."""

    steer = 0.0

    def drive(self, control: Control) -> None:
        """Moves by one frame."""
        wanted = min(max(control.steer, -1.0), 1.0)
        self.steer += min(max(wanted - self.steer, -_STEER_A_FRAME), _STEER_A_FRAME)
        throttle = min(max(control.throttle, 0.0), 1.0)
        brake = min(max(control.brake, 0.0), 1.0)
        force = _THROTTLE * throttle - _BRAKE * brake - _DRAG * self.speed
        self.speed = max(0.0, self.speed + force * DT)
        slip = math.atan(0.5 * math.tan(self.steer * _MOST_STEER))
        self.x += self.speed * math.cos(self.heading + slip) * DT
        self.y += self.speed * math.sin(self.heading + slip) * DT
        self.heading += self.speed * 2 * math.sin(slip) / _WHEELBASE * DT
