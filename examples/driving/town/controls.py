"""What moves a car, and how drivers choose it: steering to a point, keeping a speed, stopping.

A driver may be told by another one to go slower: that is an advice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

# Hard enough to stop for a light that turns yellow, soft enough for those behind.
_BRAKING = 2.5
_WHEELBASE, _MOST_STEER = 2.7, 0.6


@dataclass(frozen=True)
class Control:
    """What moves the car: throttle and brake from 0 to 1, steer from -1 (right) to 1 (left)."""

    throttle: float = 0.0
    steer: float = 0.0
    brake: float = 0.0


@dataclass(frozen=True)
class Advice:
    """The most throttle and the least brake that a driver is asked for."""

    throttle: float = 1.0
    brake: float = 0.0

    def applied(self, control: Control) -> Control:
        """The same control within these limits."""
        throttle = min(control.throttle, self.throttle)
        return Control(throttle, control.steer, max(control.brake, self.brake))


FREE = Advice()


def speed_to_stop(distance: float) -> float:
    """The speed from which a car comes to a stand in this distance, without haste."""
    return math.sqrt(2 * _BRAKING * max(distance, 0.0))


def can_stop(speed: float, distance: float) -> bool:
    """Whether a car can stop in this distance if it brakes harder than usual."""
    return distance > speed**2 / 8.0


def stop_in(speed: float, distance: float) -> Advice:
    """What brings the car to a stand in a distance, and keeps it there."""
    if distance < 0.4:
        return Advice(0.0, 1.0)
    wanted = speed_to_stop(distance)
    if speed <= wanted - 0.6:
        return FREE
    return Advice(0.0, min(1.0, max(0.0, 0.5 * (speed - wanted))))


def follow(speed: float, wanted: float) -> tuple[float, float]:
    """Throttle and brake that bring the speed to another one."""
    if wanted < 0.3:
        return (0.0, min(1.0, 0.3 + 0.4 * speed))
    difference = wanted - speed
    if difference >= -0.3:
        return (min(1.0, max(0.0, 0.5 * difference + 0.15)), 0.0)
    return (0.0, min(1.0, -0.4 * difference))


def steer_to(ahead: float, left: float) -> float:
    """The steering that leads to a point, as the car sees it."""
    distance = max(1.0, math.hypot(ahead, left))
    curvature = 2 * left / distance**2
    return min(max(math.atan(_WHEELBASE * curvature) / _MOST_STEER, -1.0), 1.0)
