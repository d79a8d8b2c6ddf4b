"""What the detector learns from: random squares of pictures, and what it should say of them.

It knows the cells of the network, not the network.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from autopilot.detector import KINDS, SCALES

SIDE, BATCH = 192, 16
# What a cell is told: 1 if it should find a thing, -1 if it may, 0 if not; where the middle of the
# thing is, its size, its kind, and how much the cell counts among those that find the same thing.
TOLD = 7
# Of squares so many show a thing, each kind as often as the others.
_AIMED = 0.85
_SHOWN, _CLEAR = 0.15, 0.5
_CORE = 0.2
Array = npt.NDArray[Any]
Box = Sequence[Any]


class Crops:
    """Random squares of the pictures of a folder, as `pictures.py` writes it."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._pictures = np.load(folder / "pictures.npy", mmap_mode="r")
        self._labels: list[list[Box]] = json.loads((folder / "labels.json").read_text())
        self._seed = seed
        self._of_kind: dict[str, list[tuple[int, Box]]] = {kind: [] for kind in KINDS}
        for number, boxes in enumerate(self._labels):
            for box in boxes:
                if not box[5]:
                    self._of_kind[box[0]].append((number, box))
        noise = np.random.default_rng(seed).normal(0.0, 3.0, (2 * SIDE, 2 * SIDE, 1))
        self._noise = noise.astype(np.float32)

    def batch(self, step: int) -> tuple[Array, list[Array]]:
        """The squares of a step, and for each scale their targets; the same for the same step."""
        rng = np.random.default_rng([self._seed, step])
        crops, targets = zip(*[self._one(rng) for _ in range(BATCH)], strict=True)
        return np.stack(crops), [np.stack(scale) for scale in zip(*targets, strict=True)]

    def _one(self, rng: np.random.Generator) -> tuple[Array, list[Array]]:
        number, left, top = self._place(rng)
        crop = self._pictures[number, top : top + SIDE, left : left + SIDE].astype(np.float32)
        mirrored = bool(rng.random() < 0.5)
        crop = crop[:, ::-1] if mirrored else crop
        row, column = rng.integers(SIDE, size=2)
        crop = crop * np.float32(rng.uniform(0.8, 1.2))
        crop += self._noise[row : row + SIDE, column : column + SIDE]
        targets = empty_targets(SIDE)
        for box in self._labels[number]:
            mark(targets, box, (left, top), mirrored)
        return np.clip(crop, 0, 255).astype(np.uint8), targets

    def _place(self, rng: np.random.Generator) -> tuple[int, int, int]:
        """A picture, and the corner of a square on it."""
        height, width = self._pictures.shape[1:3]
        known = [kind for kind in KINDS if self._of_kind[kind]]
        if rng.random() >= _AIMED or not known:
            number = int(rng.integers(len(self._labels)))
            return number, int(rng.integers(width - SIDE)), int(rng.integers(height - SIDE))
        aims = self._of_kind[known[int(rng.integers(len(known)))]]
        number, box = aims[int(rng.integers(len(aims)))]
        middle = ((box[1] + box[3]) // 2, (box[2] + box[4]) // 2)
        corner = [at - int(rng.integers(16, SIDE - 16)) for at in middle]
        left, top = np.clip(corner, 0, (width - SIDE, height - SIDE))
        return number, int(left), int(top)


def empty_targets(side: int) -> list[Array]:
    """For each scale the cells of a square without things."""
    return [np.zeros((side // it.stride, side // it.stride, TOLD), np.float32) for it in SCALES]


def mark(targets: list[Array], box: Box, corner: tuple[int, int], mirrored: bool) -> None:
    """Writes a box of a picture into the cells that should find it."""
    side = targets[0].shape[0] * SCALES[0].stride
    x0, x1 = (float(min(max(box[at] - corner[0], 0), side)) for at in (1, 3))
    y0, y1 = (float(min(max(box[at] - corner[1], 0), side)) for at in (2, 4))
    shown = (x1 - x0) * (y1 - y0) / ((box[3] - box[1]) * (box[4] - box[2]))
    if shown < _SHOWN:
        return
    if mirrored:
        x0, x1 = side - x1, side - x0
    faint = bool(box[5]) or shown < _CLEAR
    middle, size = ((x0 + x1) / 2, (y0 + y1) / 2), (x1 - x0, y1 - y0)
    for scale, target in zip(SCALES, targets, strict=True):
        if faint:
            around = _cells(target, scale.stride, middle, (0.5 * size[0], 0.5 * size[1]))
            target[around & (target[..., 0] == 0.0), 0] = -1.0
        elif scale.least <= max(size) < scale.most:
            chosen = _cells(target, scale.stride, middle, (_CORE * size[0], _CORE * size[1]))
            rows, columns = np.nonzero(chosen)
            target[rows, columns, 0] = 1.0
            target[rows, columns, 1] = middle[0] / scale.stride - (columns + 0.5)
            target[rows, columns, 2] = middle[1] / scale.stride - (rows + 0.5)
            target[rows, columns, 3] = np.log(size[0] / scale.size)
            target[rows, columns, 4] = np.log(size[1] / scale.size)
            target[rows, columns, 5] = KINDS.index(box[0])
            target[rows, columns, 6] = 1.0 / np.sqrt(len(rows))


def _cells(
    target: Array, stride: int, middle: tuple[float, float], reach: tuple[float, float]
) -> npt.NDArray[np.bool_]:
    """The cells whose middles are within reach, and the one with the middle in it."""
    cells = len(target)
    found = np.zeros((cells, cells), bool)
    centres = (np.arange(cells) + 0.5) * stride
    near_x, near_y = (np.abs(centres - middle[axis]) < reach[axis] for axis in (0, 1))
    found[np.ix_(near_y, near_x)] = True
    column, row = (min(int(at // stride), cells - 1) for at in middle)
    found[row, column] = True
    return found
