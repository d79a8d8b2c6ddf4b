"""Trains the detector on pictures of `pictures.py`, and writes its ONNX file.

    python -m training.train_detector out/pictures out/detector.npz

It writes `models/detector.onnx` and `models/detector.json`, which has the training curve. Every 500
steps it stores where it is in the file that is named, and goes on from there if that exists. How
well it finds things in other towns is measured by `judge_detector.py`.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from autopilot.detector import SCALES, Scale

from . import checkpoint
from . import detector_network as network
from .crops import Crops
from .export import export_detector

MODELS = Path(__file__).resolve().parents[1] / "models"
_RATE, _WARM_UP, _MEAN = 3e-3, 100, 0.998
_NOTED_EVERY, _SAVED_EVERY = 100, 500


def _optimizer() -> Any:
    """Muon for the kernels, each as one matrix, and Adam for the rest."""
    kernel = optax.contrib.MuonDimensionNumbers(reduction_axis=(0, 1, 2), output_axis=3)

    def dimensions(params: network.Params) -> Any:
        return jax.tree.map(lambda it: kernel if it.ndim == 4 else None, params)

    return optax.inject_hyperparams(
        partial(optax.contrib.muon, consistent_rms=0.2, muon_weight_dimension_numbers=dimensions)
    )(learning_rate=_RATE)


OPTIMIZER = _optimizer()


@partial(jax.jit, donate_argnums=0)
def improve(state: Any, pictures: jax.Array, targets: list[jax.Array]) -> tuple[Any, jax.Array]:
    """One step of gradient descent; the weights are also averaged over the last steps."""
    wrong, gradients = jax.value_and_grad(loss)(state["params"], pictures, targets)
    updates, memory = OPTIMIZER.update(gradients, state["memory"], state["params"])
    params = optax.apply_updates(state["params"], updates)
    mean = optax.incremental_update(params, state["mean"], 1.0 - _MEAN)
    return {"params": params, "memory": memory, "mean": mean}, wrong


def loss(params: network.Params, pictures: jax.Array, targets: list[jax.Array]) -> jax.Array:
    """How wrong the cells are: whether there is a thing, where, and of which kind."""
    total = jnp.array(0.0)
    for scale, out, target in zip(SCALES, network.apply(params, pictures), targets, strict=True):
        wanted, asked = target[..., 0] > 0.5, target[..., 0] > -0.5
        weight = wanted * target[..., 6]
        found = jax.nn.sigmoid(out[..., 0])
        hit = 2.0 * weight * (1.0 - found) ** 1.5 * jax.nn.log_sigmoid(out[..., 0])
        false = (asked & ~wanted) * found**1.5 * jax.nn.log_sigmoid(-out[..., 0])
        boxes = weight * _box_loss(scale, out[..., 1:5], target[..., 1:5])
        kinds = jax.nn.log_softmax(out[..., 5:])
        chosen = jnp.take_along_axis(kinds, target[..., 5:6].astype(jnp.int32), axis=-1)[..., 0]
        count = jnp.maximum(weight.sum(), 1.0)
        total = total + (boxes - hit - false - weight * chosen).sum() / count
    return total


def _box_loss(scale: Scale, box: jax.Array, target: jax.Array) -> jax.Array:
    """What is missing of the overlap, and a pull for boxes that do not overlap."""
    size = scale.size / scale.stride
    sides = [size * jnp.exp(jnp.clip(it[..., 2:], -6.0, 3.0)) for it in (box, target)]
    high = jnp.minimum(box[..., :2] + sides[0] / 2, target[..., :2] + sides[1] / 2)
    low = jnp.maximum(box[..., :2] - sides[0] / 2, target[..., :2] - sides[1] / 2)
    shared = jnp.prod(jnp.maximum(high - low, 0.0), axis=-1)
    either = jnp.prod(sides[0], axis=-1) + jnp.prod(sides[1], axis=-1) - shared
    return 1.0 - shared / (either + 1e-6) + 0.5 * optax.huber_loss(box, target, delta=0.5).sum(-1)


def rate(step: int, steps: int) -> float:
    """How fast it learns at a step: from slow to fast to slow."""
    slower = 0.51 + 0.49 * math.cos(math.pi * step / steps)
    return _RATE * min(1.0, (step + 1) / _WARM_UP) * slower


class Trainer:
    """The detector as it learns."""

    def __init__(self, crops: Crops, seed: int, steps: int) -> None:
        params = network.init(jax.random.key(seed))
        mean = jax.tree.map(jnp.copy, params)
        self._state = {"params": params, "memory": OPTIMIZER.init(params), "mean": mean}
        self._crops, self._steps = crops, steps
        self._recent: list[float] = []
        self.step, self.seconds = 0, 0.0
        self.curve: list[dict[str, float]] = []

    @property
    def done(self) -> bool:
        """Whether all steps are over."""
        return self.step >= self._steps

    def go_on(self) -> None:
        """Learns from one batch."""
        begun = time.process_time()
        self._state["memory"].hyperparams["learning_rate"] = jnp.asarray(
            rate(self.step, self._steps)
        )
        pictures, targets = self._crops.batch(self.step)
        self._state, wrong = improve(self._state, pictures, targets)
        self._recent.append(float(wrong))
        self.seconds += time.process_time() - begun
        self.step += 1

    def note(self) -> None:
        """Adds a point to the training curve, and prints it."""
        mean = round(float(np.mean(self._recent)), 4)
        point = {"seconds": round(self.seconds, 1), "steps": self.step, "loss": mean}
        self.curve.append(point)
        self._recent.clear()
        print(json.dumps(point), flush=True)

    def restore(self, path: Path) -> None:
        """Goes on from a file."""
        self._state, told = checkpoint.restore(path, self._state)
        self.curve, self.step, self.seconds = told["curve"], told["step"], told["seconds"]

    def save(self, path: Path) -> None:
        """Stores where it is, and writes the network and its curve for the application."""
        told = {"curve": self.curve, "step": self.step, "seconds": self.seconds}
        checkpoint.store(path, self._state, told)
        export_detector(jax.device_get(self._state["mean"]), MODELS / "detector.onnx")
        (MODELS / "detector.json").write_text(json.dumps({"curve": self.curve}, indent=1) + "\n")


def main() -> None:
    """Trains for the steps that the command line states."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("weights", type=Path)
    parser.add_argument("--steps", type=int, default=12000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.weights.parent.mkdir(parents=True, exist_ok=True)
    trainer = Trainer(Crops(options.folder, options.seed), options.seed, options.steps)
    if options.weights.exists():
        trainer.restore(options.weights)
    while not trainer.done:
        trainer.go_on()
        if trainer.step % _NOTED_EVERY == 0:
            trainer.note()
        if trainer.step % _SAVED_EVERY == 0 or trainer.done:
            trainer.save(options.weights)


if __name__ == "__main__":
    main()
