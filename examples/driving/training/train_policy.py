"""Trains the policy by imitation (DAgger), then by PPO, and writes its ONNX file.

    python -m training.train_policy out/policy.npz

It writes `models/policy.onnx` and `models/policy.json`, which has the training curve. Every ten
rounds it stores where it is in the file that is named, and goes on from there if that exists.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import deque
from pathlib import Path
from typing import Any

import jax
import numpy as np

from . import checkpoint, imitation, ppo
from . import policy_network as network
from .environment import Drives
from .export import export_policy

MODELS = Path(__file__).resolve().parents[1] / "models"
COUNT, STEPS, MEMORY = 16, 128, 160_000
# The expert drives in the first round; after so many rounds it does no more.
_EXPERT_ROUNDS = 6
_VALUE_ROUNDS = 2
_SAVED_EVERY = 10


class Trainer:
    """The policy as it learns: first by imitation, from some round on by PPO."""

    def __init__(self, seed: int, imitation_rounds: int, rounds: int) -> None:
        self._key = jax.random.key(seed)
        self._imitation_rounds, self._rounds = imitation_rounds, rounds
        self.params = network.init(jax.random.key(seed + 1))
        self.round, self.seconds = 0, 0.0
        self.curve: list[dict[str, Any]] = []
        self._random = np.random.default_rng(seed)
        # Seeds below 1000 are kept for judging.
        self._drives = Drives(COUNT, 1000)
        self._imitation = imitation.Imitation(self._drives, self._random, MEMORY)
        self._optimizer: Any = None
        self._ends: deque[tuple[str, float]] = deque(maxlen=60)
        self._loss = 0.0
        self._gained, self._unexplained = 0.0, 1.0

    @property
    def done(self) -> bool:
        """Whether all rounds are over."""
        return self.round >= self._rounds

    @property
    def steps(self) -> int:
        """How many steps have been driven."""
        imitated = min(self.round, self._imitation_rounds)
        return COUNT * (STEPS * imitated + ppo.STEPS * (self.round - imitated))

    @property
    def phase(self) -> str:
        """What the next round learns by."""
        return "imitation" if self.round < self._imitation_rounds else "ppo"

    def go_on(self) -> None:
        """Drives and learns for one round."""
        if self._optimizer is None or self.round == self._imitation_rounds:
            chosen = imitation.OPTIMIZER if self.phase == "imitation" else ppo.OPTIMIZER
            self._optimizer = chosen.init(self.params)
        begun = time.process_time()
        if self.phase == "imitation":
            self._imitate()
        else:
            self._reinforce()
        self.seconds += time.process_time() - begun
        self.round += 1
        self._ends.extend(self._drives.finished())

    def _imitate(self) -> None:
        it, share = self._imitation, max(0.0, 1.0 - self.round / _EXPERT_ROUNDS)
        # What it has forgotten by an interruption it gathers anew.
        rounds = 1 if len(it.memory) or not self.round else 4
        for _ in range(rounds):
            it.drive(self.params, STEPS, share)
        left = 1.0 - self.round / self._imitation_rounds
        rate = imitation.LEARNS * (0.05 + 0.95 * left)
        self.params, self._optimizer, self._loss = it.learn(self.params, self._optimizer, rate)

    def _reinforce(self) -> None:
        key = jax.random.fold_in(self._key, self.round)
        data = ppo.drive(self._drives, self.params, key)
        self._gained = float(data["rewards"].mean()) / ppo.REWARD
        self._unexplained = float((data["returns"] - data["values"]).var() / data["returns"].var())
        values_only = self.round < self._imitation_rounds + _VALUE_ROUNDS
        left = (self._rounds - self.round) / (self._rounds - self._imitation_rounds)
        self.params, self._optimizer = ppo.learn(
            self.params, self._optimizer, data, self._random, left, values_only
        )

    def restore(self, path: Path) -> None:
        """Goes on from a file, in other towns than those before."""
        self.params, told = checkpoint.restore(path, self.params)
        self.curve, self.round, self.seconds = told["curve"], told["round"], told["seconds"]
        self._drives = Drives(COUNT, 1000 + 17 * self.round)
        self._imitation = imitation.Imitation(self._drives, self._random, MEMORY)

    def note(self) -> None:
        """Adds a point to the training curve, and prints it."""
        ends = [end for end, _ in self._ends]
        share = {name: ends.count(name) / max(1, len(ends)) for name in sorted(set(ends))}
        point = {
            "phase": "imitation" if self.round <= self._imitation_rounds else "ppo",
            "round": self.round,
            "seconds": round(self.seconds, 1),
            "steps": self.steps,
            "ends": {name: round(value, 3) for name, value in share.items()},
            "driven": round(float(np.mean([done for _, done in self._ends] or [0.0])), 3),
            "loss": round(self._loss, 5),
            "reward": round(self._gained, 4),
            "unexplained": round(self._unexplained, 3),
            "std": np.exp(np.asarray(self.params["log_std"])).round(3).tolist(),
        }
        self.curve.append(point)
        print(json.dumps(point), flush=True)

    def save(self, weights: Path) -> None:
        """Stores where it is, and writes the network and its curve for the application."""
        told = {"curve": self.curve, "round": self.round, "seconds": self.seconds}
        checkpoint.store(weights, self.params, told)
        export_policy(jax.device_get(self.params), MODELS / "policy.onnx")
        (MODELS / "policy.json").write_text(json.dumps({"curve": self.curve}, indent=1) + "\n")


def main() -> None:
    """Trains for the rounds that the command line states."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("weights", type=Path)
    parser.add_argument("--imitation-rounds", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=84)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.weights.parent.mkdir(parents=True, exist_ok=True)
    trainer = Trainer(options.seed, options.imitation_rounds, options.rounds)
    if options.weights.exists():
        trainer.restore(options.weights)
    while not trainer.done:
        trainer.go_on()
        if trainer.round % _SAVED_EVERY == 0 or trainer.done:
            trainer.note()
            trainer.save(options.weights)


if __name__ == "__main__":
    main()
