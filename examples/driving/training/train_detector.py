"""Trains the detector on pictures of `pictures.py`, and writes its ONNX file.

    python -m training.train_detector out/pictures --minutes 25

It writes `models/detector.onnx` and `models/detector.json`, which has the training curve. How well
it finds things in other towns is measured by `judge_detector.py`.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from autopilot.detector import KINDS, SCALES

from . import detector_network as network
from .export import export_detector

MODELS = Path(__file__).resolve().parents[1] / "models"
SIDE, BATCH = 256, 16
Array = np.ndarray[Any, Any]


class Crops:
    """Random squares of the pictures, with what the network should say of them."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._pictures = np.load(folder / "pictures.npy", mmap_mode="r")
        self._labels = json.loads((folder / "labels.json").read_text())
        self._random = np.random.default_rng(seed)

    def batch(self) -> tuple[Array, list[Array]]:
        """Squares, and for each scale their targets."""
        crops, targets = zip(*[self._one() for _ in range(BATCH)], strict=True)
        return np.stack(crops), [np.stack(scale) for scale in zip(*targets, strict=True)]

    def _one(self) -> tuple[Array, list[Array]]:
        rng = self._random
        number = int(rng.integers(len(self._labels)))
        height, width = self._pictures.shape[1:3]
        boxes = self._labels[number]
        left, top = int(rng.integers(width - SIDE)), int(rng.integers(height - SIDE))
        if rng.random() < 0.8:
            wanted = boxes[int(rng.integers(len(boxes)))]
            left = int(np.clip(wanted[1] - rng.integers(8, SIDE - 40), 0, width - SIDE))
            top = int(np.clip(wanted[2] - rng.integers(8, SIDE - 40), 0, height - SIDE))
        crop = self._pictures[number, top : top + SIDE, left : left + SIDE].astype(np.float32)
        mirrored = bool(rng.random() < 0.5)
        crop = crop[:, ::-1] if mirrored else crop
        crop = crop * rng.uniform(0.8, 1.2) + rng.normal(0.0, 3.0, crop.shape[:2] + (1,))
        crop = np.clip(crop, 0, 255).astype(np.uint8)
        targets = [np.zeros((SIDE // it.stride, SIDE // it.stride, 7), np.float32) for it in SCALES]
        for box in boxes:
            _mark(targets, box, (left, top), mirrored)
        return crop, targets


def _mark(targets: list[Array], box: list[Any], corner: tuple[int, int], mirrored: bool) -> None:
    """Writes a box into the cells that should find it: asks for it, where, how large, which kind.

    The first number is 1 in cells that should find it, and -1 in those that may.
    """
    kind, faint = KINDS.index(box[0]), bool(box[5])
    x0, x1 = (float(np.clip(box[at] - corner[0], 0, SIDE)) for at in (1, 3))
    y0, y1 = (float(np.clip(box[at] - corner[1], 0, SIDE)) for at in (2, 4))
    whole = (box[3] - box[1]) * (box[4] - box[2])
    if (x1 - x0) * (y1 - y0) < 0.15 * whole:
        return
    faint |= (x1 - x0) * (y1 - y0) < 0.5 * whole
    if mirrored:
        x0, x1 = SIDE - x1, SIDE - x0
    middle, size = ((x0 + x1) / 2, (y0 + y1) / 2), (x1 - x0, y1 - y0)
    for scale, target in zip(SCALES, targets, strict=True):
        cells = target.shape[0]
        fits = scale.least <= max(size) < scale.most and not faint
        centres = (np.arange(cells) + 0.5) * scale.stride
        column, row = (min(int(at // scale.stride), cells - 1) for at in middle)
        inside = np.zeros((cells, cells), bool)
        near_x = np.abs(centres - middle[0]) < 0.5 * size[0]
        near_y = np.abs(centres - middle[1]) < 0.5 * size[1]
        inside[np.ix_(near_y, near_x)] = True
        target[inside & (target[..., 0] == 0.0), 0] = -1.0
        if not fits:
            continue
        chosen = np.zeros((cells, cells), bool)
        near_x = np.abs(centres - middle[0]) < 0.2 * size[0]
        near_y = np.abs(centres - middle[1]) < 0.2 * size[1]
        chosen[np.ix_(near_y, near_x)] = True
        chosen[row, column] = True
        rows, columns = np.nonzero(chosen)
        target[rows, columns, 0] = 1.0
        target[rows, columns, 1] = (middle[0] - centres[columns]) / scale.stride
        target[rows, columns, 2] = (middle[1] - centres[rows]) / scale.stride
        target[rows, columns, 3] = np.log(size[0] / scale.size)
        target[rows, columns, 4] = np.log(size[1] / scale.size)
        target[rows, columns, 5] = kind
        target[rows, columns, 6] = scale.stride / 8.0


def _loss(params: network.Params, pictures: jax.Array, targets: list[jax.Array]) -> jax.Array:
    total = jnp.array(0.0)
    for out, target in zip(network.apply(params, pictures), targets, strict=True):
        wanted, asked = target[..., 0] > 0.5, target[..., 0] > -0.5
        found = jax.nn.sigmoid(out[..., 0])
        certainty = jnp.where(
            wanted, jax.nn.log_sigmoid(out[..., 0]), jax.nn.log_sigmoid(-out[..., 0])
        )
        focus = jnp.where(wanted, 2.0 * (1.0 - found) ** 1.5, found**1.5)
        count = jnp.maximum(wanted.sum(), 1.0)
        object_loss = -(asked * focus * certainty).sum() / count
        box = jnp.abs(out[..., 1:5] - target[..., 1:5]) * jnp.array([1.0, 1.0, 2.0, 2.0])
        box_loss = (wanted[..., None] * jnp.where(box < 0.1, 5 * box**2, box - 0.05)).sum() / count
        kinds = jax.nn.log_softmax(out[..., 5:])
        chosen = jnp.take_along_axis(kinds, target[..., 5:6].astype(jnp.int32), axis=-1)[..., 0]
        total = total + object_loss + 0.7 * box_loss - (wanted * chosen).sum() / count
    return total


def main() -> None:
    """Trains for the minutes that the command line states."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--minutes", type=float, default=25.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    crops = Crops(options.folder, options.seed)
    params = network.init(jax.random.key(options.seed))
    # Nothing tells how many steps the minutes are; so the rate of learning follows the time.
    optimizer = optax.inject_hyperparams(optax.adam)(learning_rate=1e-3)
    memory = optimizer.init(params)

    @jax.jit
    def improve(params: Any, memory: Any, pictures: Any, targets: Any) -> Any:
        loss, gradients = jax.value_and_grad(_loss)(params, pictures, targets)
        updates, memory = optimizer.update(gradients, memory, params)
        return optax.apply_updates(params, updates), memory, loss

    curve, recent, step, begun = [], [], 0, time.process_time()
    while (spent := time.process_time() - begun) < 60 * options.minutes:
        done = spent / (60 * options.minutes)
        rate = 2e-3 * min(1.0, (step + 1) / 200) * (0.5 * (1 + np.cos(np.pi * done)) + 0.005)
        memory.hyperparams["learning_rate"] = jnp.asarray(rate)
        pictures, targets = crops.batch()
        params, memory, loss = improve(params, memory, pictures, targets)
        recent.append(float(loss))
        step += 1
        if step % 100 == 0:
            point = {
                "seconds": round(spent, 1),
                "steps": step,
                "loss": round(float(np.mean(recent)), 4),
            }
            curve.append(point)
            recent.clear()
            print(json.dumps(point), flush=True)
        if step % 1000 == 0:
            export_detector(jax.device_get(params), MODELS / "detector.onnx")
    export_detector(jax.device_get(params), MODELS / "detector.onnx")
    (MODELS / "detector.json").write_text(json.dumps({"curve": curve}, indent=1) + "\n")


if __name__ == "__main__":
    main()
