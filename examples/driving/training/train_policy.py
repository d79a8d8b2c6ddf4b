"""Trains the policy by PPO, after it has imitated the expert for a while, and writes its ONNX file.

    python -m training.train_policy out/policy.npz --minutes 25

It writes `models/policy.onnx` and `models/policy.json`, which has the training curve, and goes on
from the weights in the file that is named, if it is there.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import deque
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax

from . import policy_network as network
from .environment import Drives
from .export import export_policy

MODELS = Path(__file__).resolve().parents[1] / "models"
COUNT, STEPS, EPOCHS, BATCH = 16, 128, 3, 512
DISCOUNT, TRACE, CLIP = 0.985, 0.95, 0.2
_STEADY = (-1.5, -2.3)
_OPTIMIZER = optax.chain(optax.clip_by_global_norm(0.5), optax.adam(3e-4))


def _log_prob(params: network.Params, mean: jax.Array, actions: jax.Array) -> jax.Array:
    deviation = (actions - mean) / jnp.exp(params["log_std"])
    return -(0.5 * deviation**2 + params["log_std"]).sum(axis=1)


@jax.jit
def act(
    params: network.Params, key: jax.Array, views: jax.Array, states: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Random actions, their probabilities, and values."""
    mean, values = network.apply(params, views, states)
    noise = jax.random.normal(key, mean.shape)
    actions = mean + noise * jnp.exp(params["log_std"])
    return actions, _log_prob(params, mean, actions), values


def _loss(params: network.Params, batch: dict[str, jax.Array]) -> jax.Array:
    mean, values = network.apply(params, batch["views"], batch["states"])
    ratio = jnp.exp(_log_prob(params, mean, batch["actions"]) - batch["log_probs"])
    gain = batch["advantages"]
    clipped = jnp.clip(ratio, 1 - CLIP, 1 + CLIP)
    policy = -jnp.minimum(ratio * gain, clipped * gain).mean()
    value = jnp.mean((values - batch["returns"]) ** 2)
    # The mean stays near what a car can do.
    beyond = jnp.mean(jnp.maximum(jnp.abs(mean) - 1.0, 0.0) ** 2)
    return policy + 0.25 * value - 0.002 * params["log_std"].sum() + 0.1 * beyond


def _imitation_loss(params: network.Params, batch: dict[str, jax.Array]) -> jax.Array:
    mean, values = network.apply(params, batch["views"], batch["states"])
    # The expert brakes seldom and hard: a mean over all frames would brake too late.
    brakes = 1.0 + 4.0 * (batch["actions"][:, :1] < -0.2)
    wrong = (brakes * (mean - batch["actions"]) ** 2 * jnp.array([1.0, 6.0])).mean()
    return wrong + 0.02 * jnp.mean((values - batch["returns"]) ** 2)


@partial(jax.jit, static_argnames="imitate")
def improve(
    params: network.Params, optimizer: Any, batch: dict[str, jax.Array], imitate: bool
) -> tuple[network.Params, Any, jax.Array]:
    """One step of gradient descent."""
    loss, gradients = jax.value_and_grad(_imitation_loss if imitate else _loss)(params, batch)
    updates, optimizer = _OPTIMIZER.update(gradients, optimizer, params)
    return optax.apply_updates(params, updates), optimizer, loss


class Trainer:
    """The policy as it learns."""

    def __init__(self, seed: int) -> None:
        self._key = jax.random.key(seed)
        self._random = np.random.default_rng(seed)
        self.params = network.init(jax.random.key(seed + 1))
        self._optimizer = _OPTIMIZER.init(self.params)
        # Seeds below 1000 are kept for judging.
        self._drives = Drives(COUNT, 1000)
        self._ends: deque[tuple[str, float]] = deque(maxlen=60)
        self.curve: list[dict[str, Any]] = []

    def steady(self) -> None:
        """Has the policy vary its actions less, after it has learned from another one."""
        self.params["log_std"] = jnp.array(_STEADY)

    def store(self, path: Path) -> None:
        """Writes all weights and the curve into a file."""
        leaves = jax.tree_util.tree_leaves_with_path(self.params)
        arrays = {jax.tree_util.keystr(name): np.asarray(value) for name, value in leaves}
        np.savez(path, curve=json.dumps(self.curve), **arrays)

    def restore(self, path: Path) -> None:
        """Goes on from such a file. What it does not have stays as it is."""
        stored = np.load(path)
        self.params = jax.tree_util.tree_map_with_path(
            lambda name, value: jnp.asarray(stored.get(jax.tree_util.keystr(name), value)),
            self.params,
        )
        self.curve = json.loads(str(stored["curve"]))

    def round(self, imitate: float) -> None:
        """Drives for a while and learns from it; with this probability the expert drives."""
        data = self._drive(imitate)
        rows = {name: value.reshape(-1, *value.shape[2:]) for name, value in data.items()}
        for _ in range(EPOCHS):
            order = self._random.permutation(COUNT * STEPS)
            for begin in range(0, len(order), BATCH):
                chosen = order[begin : begin + BATCH]
                batch = {name: jnp.asarray(value[chosen]) for name, value in rows.items()}
                gain = batch["advantages"]
                batch["advantages"] = (gain - gain.mean()) / (gain.std() + 1e-6)
                self.params, self._optimizer, _ = improve(
                    self.params, self._optimizer, batch, imitate >= 0.0
                )

    def _drive(self, imitate: float) -> dict[str, np.ndarray[Any, Any]]:
        drives, kept = self._drives, []
        for _ in range(STEPS):
            views, states = drives.views.copy(), drives.states.copy()
            self._key, key = jax.random.split(self._key)
            actions, log_probs, values = (
                np.asarray(it) for it in act(self.params, key, views, states)
            )
            done = actions
            if imitate >= 0.0:
                actions = np.array([_expert_action(it.expert) for it in drives.drives], np.float32)
                own = self._random.random(COUNT) >= imitate
                done = np.where(own[:, None], done, actions)
            rewards, ends = drives.step(done)
            kept.append((views, states, actions, log_probs, values, rewards, ends))
        self._ends.extend(drives.finished())
        names = ("views", "states", "actions", "log_probs", "values", "rewards", "ends")
        data = {
            name: np.stack(column)
            for name, column in zip(names, zip(*kept, strict=True), strict=True)
        }
        _, _, last = act(self.params, self._key, drives.views, drives.states)
        return _with_advantages(data, np.asarray(last))

    def note(self, phase: str, seconds: float, steps: int) -> None:
        """Adds a point to the training curve, and prints it."""
        ends = [end for end, _ in self._ends]
        share = {name: ends.count(name) / max(1, len(ends)) for name in sorted(set(ends))}
        point = {
            "phase": phase,
            "seconds": round(seconds, 1),
            "steps": steps,
            "ends": {name: round(value, 3) for name, value in share.items()},
            "driven": round(float(np.mean([done for _, done in self._ends] or [0.0])), 3),
            "std": np.exp(np.asarray(self.params["log_std"])).round(3).tolist(),
        }
        self.curve.append(point)
        print(json.dumps(point), flush=True)


def _expert_action(expert: Any) -> tuple[float, float]:
    control = expert.in_traffic()
    return (control.throttle - control.brake, control.steer)


def _with_advantages(
    data: dict[str, np.ndarray[Any, Any]], last: np.ndarray[Any, Any]
) -> dict[str, np.ndarray[Any, Any]]:
    """Adds generalized advantages and returns; a journey's end is worth nothing more."""
    rewards, values, ends = data.pop("rewards"), data.pop("values"), data.pop("ends")
    gains = np.zeros_like(values)
    trace = np.zeros_like(last)
    for step in reversed(range(STEPS)):
        after = values[step + 1] if step + 1 < STEPS else last
        goes_on = 1.0 - ends[step]
        wrong = rewards[step] + DISCOUNT * after * goes_on - values[step]
        trace = wrong + DISCOUNT * TRACE * goes_on * trace
        gains[step] = trace
    return data | {"advantages": gains, "returns": gains + values}


def main() -> None:
    """Trains for the minutes that the command line states."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("weights", type=Path)
    parser.add_argument("--minutes", type=float, default=25.0)
    parser.add_argument("--imitation-rounds", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.weights.parent.mkdir(parents=True, exist_ok=True)
    trainer, begun = Trainer(options.seed), time.process_time()
    resumed = options.weights.exists()
    if resumed:
        trainer.restore(options.weights)
        trainer.steady()
    rounds = 0
    while (spent := time.process_time() - begun) < 60 * options.minutes:
        imitating = rounds < options.imitation_rounds
        if rounds == options.imitation_rounds:
            trainer.steady()
        # First the expert drives, later the policy does, and the expert says what it would do.
        share = -1.0
        if imitating:
            early = 1.0 - rounds / (0.6 * options.imitation_rounds)
            share = 0.0 if resumed else max(0.0, early)
        trainer.round(share)
        rounds += 1
        if rounds % 10 == 0:
            trainer.note("imitation" if imitating else "ppo", spent, rounds * COUNT * STEPS)
            _save(trainer, options.weights)
    _save(trainer, options.weights)


def _save(trainer: Trainer, weights: Path) -> None:
    trainer.store(weights)
    export_policy(jax.device_get(trainer.params), MODELS / "policy.onnx")
    (MODELS / "policy.json").write_text(json.dumps({"curve": trainer.curve}, indent=1) + "\n")


if __name__ == "__main__":
    main()
