"""A detector that learns nothing: it looks for the colours of lamps and signs above the horizon.

It finds what the rules of traffic need, in the embedded town alone: no cars and no pedestrians.
"""

from __future__ import annotations

import cv2
import numpy as np
from town.camera import HORIZON
from town.shapes import LIGHT_HEIGHT, LIGHT_WIDTH

from .detector import Detection
from .simulator import Pixels

# The lowest and highest red, green and blue of what is lit or painted.
_LAMPS = {
    "red light": ((205, 0, 0), (255, 125, 120)),
    "yellow light": ((215, 140, 0), (255, 215, 120)),
    "green light": ((0, 190, 60), (130, 255, 175)),
}
_SIGN = ((100, 0, 0), (210, 75, 80))
# A lamp's diameter, and how far above the middle of its housing it is, in metres.
_LAMP = 0.68
_ABOVE = {"red light": 0.75, "yellow light": 0.0, "green light": -0.75}
_DARK = 95
# Corners and letters of a sign are not red.
_SIGN_FILLED, _WIDEST_SIGN = (0.35, 0.8), 110
# How bright a letter is at least, and how much of the middle of a sign letters are.
_WHITE, _LETTERS = 120, 0.06
Blob = tuple[int, int, int, int, int]


class ColourDetector:
    """Finds lights and signs by their colours."""

    def detect(self, picture: Pixels) -> list[Detection]:
        """What is on a picture."""
        sky = picture[: round(HORIZON)]
        found: list[Detection] = []
        for kind, (low, high) in _LAMPS.items():
            for blob in _blobs(sky, low, high, least=5):
                light = _light(kind, blob)
                if _is_dark(sky, light):
                    found.append(light)
        for left, top, wide, high_, filled in _blobs(sky, *_SIGN, least=24):
            octagon = 0.75 < wide / high_ < 1.35 and wide < _WIDEST_SIGN
            share = filled / (wide * high_)
            lettered = _has_white(sky[top : top + high_, left : left + wide])
            if octagon and _SIGN_FILLED[0] < share < _SIGN_FILLED[1] and lettered:
                edges = (left - 1.0, top - 1.0, left + wide + 1.0, top + high_ + 1.0)
                found.append(Detection("stop sign", 1.0, *edges))
        return found


def _blobs(
    picture: Pixels, low: tuple[int, int, int], high: tuple[int, int, int], least: int
) -> list[Blob]:
    """Left, top, width, height and pixels of what has a colour between two."""
    mask = cv2.inRange(picture, np.array(low), np.array(high))
    count, _, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    blobs = [tuple(int(value) for value in stats[index]) for index in range(1, count)]
    return [(b[0], b[1], b[2], b[3], b[4]) for b in blobs if b[4] >= least]


def _light(kind: str, lamp: Blob) -> Detection:
    """The whole light around a lamp that is on."""
    left, top, wide, high, _ = lamp
    metre = max(high, 1) / _LAMP
    column, row = left + wide / 2, top + high / 2 + _ABOVE[kind] * metre
    half_wide, half_high = LIGHT_WIDTH * metre / 2, LIGHT_HEIGHT * metre / 2
    edges = (column - half_wide, row - half_high, column + half_wide, row + half_high)
    return Detection(kind, 1.0, *edges)


def _has_white(plate: Pixels) -> bool:
    """Whether there are letters in the middle of a plate."""
    rows, columns = plate.shape[0] // 4, plate.shape[1] // 8
    middle = plate[rows : plate.shape[0] - rows, columns : plate.shape[1] - columns]
    return float((middle.min(axis=2) > _WHITE).mean()) > _LETTERS


def _is_dark(picture: Pixels, light: Detection) -> bool:
    """Whether most of a light's housing is as dark as a housing is."""
    rows = slice(max(0, round(light.top) + 1), max(1, round(light.bottom) - 1))
    columns = slice(max(0, round(light.left) + 1), max(1, round(light.right) - 1))
    housing = picture[rows, columns]
    return housing.size > 0 and float(np.median(housing)) < _DARK
