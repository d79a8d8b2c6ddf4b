"""The detector: a single-shot network finds lights, signs, cars and people on a picture.

It says what is where on the picture; what follows from it is in `rules.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .network import MODELS, Network

KINDS = ("red light", "yellow light", "green light", "stop sign", "car", "person")
HEIGHT, WIDTH = 480, 640
_CERTAIN = 0.4
_SAME = 0.45


@dataclass(frozen=True)
class Scale:
    """A grid of cells over the picture: pixels a cell, and the size of boxes that it finds."""

    stride: int
    size: float
    least: float
    most: float


SCALES = (Scale(8, 20.0, 0.0, 72.0), Scale(32, 110.0, 56.0, 10000.0))


@dataclass(frozen=True)
class Detection:
    """Something on the picture: its box in pixels, and how certain it is."""

    kind: str
    score: float
    left: float
    top: float
    right: float
    bottom: float


class Detector:
    """Finds things on pictures, by a network that was trained by `training/train_detector.py`."""

    def __init__(self, path: Path = MODELS / "detector.onnx") -> None:
        cells = sum((HEIGHT // it.stride) * (WIDTH // it.stride) for it in SCALES)
        inputs = {"picture": (1, HEIGHT, WIDTH, 3)}
        self._network = Network(path, inputs, {"cells": (cells, 5 + len(KINDS))})

    def detect(self, picture: npt.NDArray[np.uint8], certain: float = _CERTAIN) -> list[Detection]:
        """What is on a picture, with at least this certainty."""
        return decode(self._network.run(picture=picture[None]), certain)


def decode(cells: npt.NDArray[np.float32], certain: float = _CERTAIN) -> list[Detection]:
    """What the cells of the network have found, the most certain first, each thing once."""
    boxes: list[npt.NDArray[np.float32]] = []
    first = 0
    for scale in SCALES:
        rows, columns = HEIGHT // scale.stride, WIDTH // scale.stride
        part = cells[first : first + rows * columns]
        first += rows * columns
        chosen = np.flatnonzero(part[:, 0] > np.log(certain / (1.0 - certain)))
        out = part[chosen]
        x = (chosen % columns + 0.5 + out[:, 1]) * scale.stride
        y = (chosen // columns + 0.5 + out[:, 2]) * scale.stride
        half = 0.5 * scale.size * np.exp(np.clip(out[:, 3:5], -6.0, 3.0))
        score = 1.0 / (1.0 + np.exp(-out[:, 0]))
        kind = out[:, 5:].argmax(axis=1)
        edges = [x - half[:, 0], y - half[:, 1], x + half[:, 0], y + half[:, 1]]
        boxes.append(np.stack([score, kind, *edges], axis=1).astype(np.float32))
    return _each_once(np.concatenate(boxes))


def _each_once(boxes: npt.NDArray[np.float32]) -> list[Detection]:
    """Non-maximum suppression: of boxes of one group that overlap, the most certain one."""
    rest = boxes[np.argsort(-boxes[:, 0], kind="stable")]
    found: list[Detection] = []
    while len(rest):
        score, kind, left, top, right, bottom = (float(value) for value in rest[0])
        box = (max(left, 0.0), max(top, 0.0), min(right, WIDTH), min(bottom, HEIGHT))
        found.append(Detection(KINDS[int(kind)], score, *box))
        same_group = (rest[:, 1] < 3) == (kind < 3)
        alike = (rest[:, 1] == kind) | (same_group & (kind < 3))
        rest = rest[~(alike & (_overlaps(rest[0], rest) > _SAME))]
    return found


def _overlaps(
    one: npt.NDArray[np.float32], others: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """Intersection over union of a box with others."""
    low = np.maximum(one[2:4], others[:, 2:4])
    high = np.minimum(one[4:6], others[:, 4:6])
    shared = np.prod(np.clip(high - low, 0.0, None), axis=1)
    areas = np.prod(others[:, 4:6] - others[:, 2:4], axis=1)
    ratio: npt.NDArray[np.float32] = shared / (np.prod(one[4:6] - one[2:4]) + areas - shared + 1e-6)
    return ratio
