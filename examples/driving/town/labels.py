"""What is to be found on a picture: the boxes of what can be seen on it, from what was drawn.

The same polygons are drawn again with the numbers of things for colours. So a thing that stands
behind another one has the box of what is left of it, or none.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .camera import HEIGHT, WIDTH, Camera, Shown

KINDS = ("red light", "yellow light", "green light", "stop sign", "car", "person")
# What is smaller is not to be found, and not wrong to find either.
LEAST_HEIGHT = {"car": 9, "person": 12, "stop sign": 9}
_LEAST_LIGHT_HEIGHT = 9
_LEAST_FILLED = 0.25


@dataclass(frozen=True)
class Label:
    """The box of a thing on a picture, in pixels."""

    kind: str
    left: int
    top: int
    right: int
    bottom: int
    # Whether it is too small, or hidden too much, to ask for it.
    faint: bool


def labels(camera: Camera, shown: Shown) -> list[Label]:
    """All that can be seen on a picture that the camera has just taken."""
    marks = np.full((HEIGHT, WIDTH), -1, np.int32)
    for polygon, thing in zip(shown.polygons, shown.things, strict=True):
        cv2.fillConvexPoly(marks, polygon, (thing,), cv2.LINE_8, 4)
    found: list[Label] = []
    for thing in sorted(set(shown.things)):
        kind = camera.kind(thing)
        if kind in KINDS:
            rows, columns = np.nonzero(marks == thing)
            if len(rows):
                found.append(_label(kind, rows, columns, _whole_area(shown, thing)))
    return found


def _whole_area(shown: Shown, thing: int) -> int:
    """How many pixels a thing would cover if nothing were before it."""
    alone = np.zeros((HEIGHT, WIDTH), np.uint8)
    for polygon, number in zip(shown.polygons, shown.things, strict=True):
        if number == thing:
            cv2.fillConvexPoly(alone, polygon, (1,), cv2.LINE_8, 4)
    return int(np.count_nonzero(alone))


def _label(
    kind: str,
    rows: np.ndarray[tuple[int], np.dtype[np.int64]],
    columns: np.ndarray[tuple[int], np.dtype[np.int64]],
    whole: int,
) -> Label:
    left, right = int(columns.min()), int(columns.max()) + 1
    top, bottom = int(rows.min()), int(rows.max()) + 1
    least = LEAST_HEIGHT.get(kind, _LEAST_LIGHT_HEIGHT)
    hidden = len(rows) < max(_LEAST_FILLED * whole, 12)
    return Label(kind, left, top, right, bottom, hidden or bottom - top < least)
