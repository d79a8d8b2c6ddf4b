"""What lights and signs ask for, from what the detector sees: where to stop, and when to go on.

Distances follow from how high over the horizon a light is, and from how large a sign is. What is
not seen for a moment stays where it was, as far as the car has moved since.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from town.camera import CAMERA_AHEAD, CAMERA_HEIGHT, FOCAL, HORIZON, WIDTH
from town.controls import FREE, Advice, can_stop, stop_in
from town.lights import DT, FRAMES_A_SECOND
from town.shapes import LIGHT_BEYOND, LIGHT_HEIGHT, LIGHT_MIDDLE, SIGN_RIGHT, SIGN_SIZE

from .detector import Detection

# How certain a detection has to be to count.
CERTAIN = 0.5
_STANDS = 0.3
# Where the middle of the car is to stand, before a line.
_BEFORE_LINE = 3.8
_FARTHEST = 32.0
_FORGOTTEN = FRAMES_A_SECOND // 2
_WAIT = FRAMES_A_SECOND // 2
# A sign is done with when the car has come so far from where it has stood.
_BEHIND = 14.0
_CLOSE = 12.0


@dataclass
class Line:
    """A stop line that has been seen: how far ahead it is, and how long ago it was seen."""

    distance: float
    kind: str
    unseen: int = 0
    times: int = 1


@dataclass
class Rules:
    """What has been seen so far, and what follows from it."""

    light: Line | None = None
    sign: Line | None = None
    stood: int = 0
    driven: float = field(default=1000.0)

    def advice(self, detections: Sequence[Detection], speed: float) -> Advice:
        """What is asked for at a frame."""
        moved = speed * DT
        self.driven += moved
        self.light = _updated(self.light, _nearest(detections, _light_line), moved, _FORGOTTEN)
        sign = _nearest(detections, _sign_line)
        patience = _FORGOTTEN if self.sign is None or self.sign.distance > _CLOSE else 1000
        self.sign = _updated(self.sign, sign, moved, patience)
        for_light, for_sign = self._for_light(speed), self._for_sign(speed)
        throttle = min(for_light.throttle, for_sign.throttle)
        return Advice(throttle, max(for_light.brake, for_sign.brake))

    def _for_light(self, speed: float) -> Advice:
        light = self.light
        if light is None or light.kind == "green light" or light.distance < -1.0:
            return FREE
        distance = light.distance - _BEFORE_LINE
        if light.kind == "yellow light" and not can_stop(speed, distance):
            return FREE
        return stop_in(speed, distance)

    def _for_sign(self, speed: float) -> Advice:
        sign = self.sign
        if sign is None or sign.times < 3 or self.driven < _BEHIND:
            return FREE
        if speed < _STANDS and sign.distance < _BEFORE_LINE + 1.5:
            self.stood += 1
        if self.stood >= _WAIT:
            self.stood, self.sign, self.driven = 0, None, 0.0
            return FREE
        return stop_in(speed, sign.distance - _BEFORE_LINE)


def _updated(line: Line | None, seen: Line | None, moved: float, patience: int) -> Line | None:
    """A line after the car has moved, with what is seen now."""
    if seen is not None:
        seen.times = line.times + 1 if line is not None else 1
        return seen
    if line is None or line.unseen >= patience:
        return None
    line.distance -= moved
    line.unseen += 1
    return line


def _nearest(
    detections: Sequence[Detection], line_of: Callable[[Detection], Line | None]
) -> Line | None:
    """The nearest line of those that these detections stand for."""
    lines = [line for it in detections if (line := line_of(it)) is not None]
    return min(lines, key=lambda line: line.distance, default=None)


def _light_line(it: Detection) -> Line | None:
    """The line that a light belongs to, if it is one of the car's lane."""
    if not it.kind.endswith("light") or it.score < CERTAIN:
        return None
    above = HORIZON - (it.top + it.bottom) / 2
    if above < 8.0 or it.top < 1.0:
        return None
    away = FOCAL * (LIGHT_MIDDLE - CAMERA_HEIGHT) / above
    by_height = FOCAL * LIGHT_HEIGHT / (it.bottom - it.top)
    left = (WIDTH / 2 - (it.left + it.right) / 2) / FOCAL * away
    line = away + CAMERA_AHEAD - LIGHT_BEYOND
    fits = 0.6 < by_height / away < 1.6 and abs(left) < 5.0 and -2.0 < line < _FARTHEST
    return Line(line, it.kind) if fits else None


def _sign_line(it: Detection) -> Line | None:
    """The line that a sign stands at, if it is one of the car's lane."""
    if it.kind != "stop sign" or it.score < CERTAIN:
        return None
    size = max(it.right - it.left, it.bottom - it.top)
    away = FOCAL * SIGN_SIZE / size
    left = (WIDTH / 2 - (it.left + it.right) / 2) / FOCAL * away
    fits = abs(left + SIGN_RIGHT) < 2.6 and away < _FARTHEST
    return Line(away + CAMERA_AHEAD - 0.3, it.kind) if fits else None
