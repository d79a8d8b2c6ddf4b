"""What the detector's federate does with a picture: what is on it, and what follows for the car."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Protocol

from town.controls import FREE, Advice

from .colour_detector import ColourDetector
from .detector import Detection, Detector
from .options import Options
from .rules import Rules
from .simulator import Pixels

_FIRST_SLOW = 20


@dataclass(frozen=True)
class Shot:
    """A picture, and how fast the car was when it was taken."""

    picture: Pixels
    speed: float


@dataclass(frozen=True)
class Sight:
    """What was seen on a picture, and what lights and signs on it ask for."""

    detections: list[Detection] = field(default_factory=list)
    advice: Advice = FREE


class Eyes(Protocol):
    """Finds things on pictures."""

    def detect(self, picture: Pixels) -> list[Detection]:
        """What is on a picture."""
        ...


class Lookout:
    """Looks at each picture, and remembers what matters of those before it."""

    def __init__(self, eyes: Eyes | None) -> None:
        self._eyes, self._rules = eyes, Rules()

    def look(self, picture: Pixels, speed: float) -> Sight:
        """What is on a picture, and what follows; nothing if there are no eyes."""
        if self._eyes is None:
            return Sight()
        detections = self._eyes.detect(picture)
        return Sight(detections, self._rules.advice(detections, speed))


class SlowLookout(Lookout):
    """A lookout that takes longer for some pictures, as on a machine with too much to do."""

    def __init__(self, eyes: Eyes | None, seconds: float, pictures: int) -> None:
        super().__init__(eyes)
        self._seconds, self._slow = seconds, range(_FIRST_SLOW, _FIRST_SLOW + pictures)
        self._number = 0

    def look(self, picture: Pixels, speed: float) -> Sight:
        if self._number in self._slow:
            time.sleep(self._seconds)
        self._number += 1
        return super().look(picture, speed)


def open_eyes(detector: str) -> Eyes | None:
    """The detector of this name."""
    if detector == "off":
        return None
    return Detector() if detector == "network" else ColourDetector()


def open_lookout(options: Options) -> Lookout:
    """A lookout with the detector that is asked for, as quick or slow as is asked for."""
    eyes = open_eyes(options.detector)
    if options.slow:
        return SlowLookout(eyes, options.slow, options.slow_frames)
    return Lookout(eyes)
