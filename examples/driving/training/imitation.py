"""Imitation of the expert (DAgger): the policy drives, the expert says what it would do there.

All that was seen is kept, so that the policy forgets nothing: an expert sees few mistakes, and a
policy that learns only from its last journeys forgets how others went.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt
import optax
from autopilot.agent import STATE, action_of
from town.birdview import SHAPE

from . import policy_network as network
from .environment import Drives

BATCH, STEPS_A_ROUND = 256, 40
LEARNS = 1e-3
# How much the driven action differs from the one that was chosen, so that it goes astray.
_ASTRAY = np.array([0.08, 0.04], np.float32)
# Below this the expert brakes for something, which is seldom and matters more.
_SLOW, _SLOW_WEIGHT, _STEER_WEIGHT = 0.0, 2.0, 8.0
Floats = npt.NDArray[np.float32]


class Memory:
    """What was seen and what the expert did; views as bits, since they are black or white."""

    def __init__(self, most: int) -> None:
        self._views = np.zeros((most, int(np.prod(SHAPE)) // 8), np.uint8)
        self._states = np.zeros((most, STATE), np.float32)
        self._actions = np.zeros((most, 2), np.float32)
        self._added = 0

    def __len__(self) -> int:
        return min(self._added, len(self._views))

    def add(self, views: npt.NDArray[np.uint8], states: Floats, actions: Floats) -> None:
        """Adds some; when it is full, in the place of the oldest ones."""
        places = (self._added + np.arange(len(views))) % len(self._views)
        self._views[places] = np.packbits(views.reshape(len(views), -1), axis=1)
        self._states[places], self._actions[places] = states, actions
        self._added += len(views)

    def sample(self, count: int, random: np.random.Generator) -> dict[str, jax.Array]:
        """Some of them."""
        chosen = random.integers(len(self), size=count)
        views = np.unpackbits(self._views[chosen], axis=1).reshape(count, *SHAPE) * np.uint8(255)
        batch = {"views": views, "states": self._states[chosen], "actions": self._actions[chosen]}
        return {name: jnp.asarray(value) for name, value in batch.items()}


class Imitation:
    """Rounds of driving and learning."""

    def __init__(self, drives: Drives, random: np.random.Generator, most: int) -> None:
        self._drives, self._random = drives, random
        self.memory = Memory(most)

    def drive(self, params: network.Params, steps: int, share: float) -> None:
        """Drives, the expert with the probability ``share``, and keeps what it would have done."""
        drives = self._drives
        for _ in range(steps):
            views, states = drives.views, drives.states
            own = np.asarray(_act(params, views, states))
            wants = [action_of(*it.expert.wants()) for it in drives.drives]
            expert = np.array(wants, np.float32)
            self.memory.add(views, states, expert)
            done = np.where(self._random.random((len(own), 1)) < share, expert, own)
            drives.step(done + _ASTRAY * self._random.standard_normal(done.shape))

    def learn(
        self, params: network.Params, optimizer: Any, rate: float
    ) -> tuple[network.Params, Any, float]:
        """Some steps of gradient descent; the mean loss besides."""
        losses = []
        optimizer.hyperparams["learning_rate"] = jnp.asarray(rate)
        for _ in range(STEPS_A_ROUND):
            batch = self.memory.sample(BATCH, self._random)
            params, optimizer, loss = _improve(params, optimizer, batch)
            losses.append(float(loss))
        return params, optimizer, float(np.mean(losses))


def loss(params: network.Params, batch: dict[str, jax.Array]) -> jax.Array:
    """How far the policy is from the expert."""
    mean = network.apply(params, batch["views"], batch["states"])
    wrong = optax.huber_loss(mean, batch["actions"], delta=0.5)
    weight = 1.0 + _SLOW_WEIGHT * (batch["actions"][:, 0] < _SLOW)
    return (weight * wrong[:, 0]).mean() + _STEER_WEIGHT * wrong[:, 1].mean()


OPTIMIZER = optax.inject_hyperparams(optax.adam)(learning_rate=LEARNS)


@jax.jit
def _act(params: network.Params, views: jax.Array, states: jax.Array) -> jax.Array:
    return network.apply(params, views, states)


@partial(jax.jit, donate_argnums=(0, 1))
def _improve(
    params: network.Params, optimizer: Any, batch: dict[str, jax.Array]
) -> tuple[network.Params, Any, jax.Array]:
    wrong, gradients = jax.value_and_grad(loss)(params, batch)
    updates, optimizer = OPTIMIZER.update(gradients, optimizer, params)
    return optax.apply_updates(params, updates), optimizer, wrong
