"""Proximal policy optimization: the policy drives with some chance, and does more of what paid.

It begins with a policy that drives well already. So its first rounds learn only what states are
worth, its steps become smaller and smaller, and the expert's actions hold it, less and less. An
epoch that has led too far from the policy that drove is the last one of its round.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt
import optax
from autopilot.agent import action_of

from . import imitation
from . import policy_network as network
from .environment import Drives

STEPS, EPOCHS, BATCH = 384, 4, 1024
DISCOUNT, TRACE, CLIP = 0.985, 0.95, 0.2
# What rewards are multiplied by, so that what a state is worth is about one.
REWARD = 0.05
# How far, as a divergence of Kullback and Leibler, a round may lead from the policy that drove.
_FAR = 0.015
_VALUE, _HOLD, _LEARNS = 0.5, 10.0, 1e-4
OPTIMIZER = optax.inject_hyperparams(
    lambda learning_rate: optax.chain(optax.clip_by_global_norm(0.5), optax.adam(learning_rate))
)(learning_rate=_LEARNS)
# What is kept of a step, what it leads to, and what is learned from.
_SEEN = ("views", "states", "unseen", "drawn", "log_probs")
_NAMES = (*_SEEN, "values", "actions", "rewards", "ends")
_LEARNED = (*_SEEN, "actions", "advantages", "returns")
Data = dict[str, npt.NDArray[Any]]


def drive(drives: Drives, params: network.Params, key: jax.Array) -> Data:
    """What was seen, done and gained in some steps of all drives, with advantages and returns."""
    kept = []
    for step in range(STEPS):
        views, states = drives.views.copy(), drives.states.copy()
        unseen = drives.unseen()
        chosen = _act(params, jax.random.fold_in(key, step), views, states, unseen)
        actions, log_probs, values = (np.asarray(it) for it in chosen)
        wants = [action_of(*it.expert.wants()) for it in drives.drives]
        rewards, ends = drives.step(actions)
        experts = np.array(wants, np.float32)
        seen = (views, states, unseen)
        kept.append((*seen, actions, log_probs, values, experts, REWARD * rewards, ends))
    columns = zip(_NAMES, zip(*kept, strict=True), strict=True)
    data = {name: np.stack(column) for name, column in columns}
    seen = (drives.views, drives.states, drives.unseen())
    _, last = network.apply_with_values(params, *map(jnp.asarray, seen))
    return with_advantages(data, np.asarray(last))


def with_advantages(data: Data, last: npt.NDArray[Any]) -> Data:
    """Adds generalized advantages and returns; a journey's end is worth nothing more."""
    rewards, values, ends = data["rewards"], data["values"], data["ends"]
    gains = np.zeros_like(values)
    trace = np.zeros_like(last)
    for step in reversed(range(len(rewards))):
        after = values[step + 1] if step + 1 < len(rewards) else last
        goes_on = 1.0 - ends[step]
        wrong = rewards[step] + DISCOUNT * after * goes_on - values[step]
        trace = wrong + DISCOUNT * TRACE * goes_on * trace
        gains[step] = trace
    return data | {"advantages": gains, "returns": gains + values}


def learn(
    params: network.Params,
    optimizer: Any,
    data: Data,
    random: np.random.Generator,
    left: float,
    values_only: bool,
) -> tuple[network.Params, Any]:
    """Some epochs over what was gathered; ``left`` is the share of all rounds that follow."""
    rows = {name: data[name].reshape(-1, *data[name].shape[2:]) for name in _LEARNED}
    gain = rows["advantages"]
    rows["advantages"] = (gain - gain.mean()) / (gain.std() + 1e-6)
    optimizer.hyperparams["learning_rate"] = jnp.asarray(_LEARNS * (0.05 + 0.95 * left))
    hold, count = jnp.asarray(_HOLD * left), len(gain)
    for _ in range(EPOCHS):
        order = random.permutation(count)
        far = []
        for begin in range(0, count, BATCH):
            chosen = order[begin : begin + BATCH]
            batch = {name: jnp.asarray(value[chosen]) for name, value in rows.items()}
            params, optimizer, distance = _improve(params, optimizer, batch, hold, values_only)
            far.append(float(distance))
        if np.mean(far) > _FAR:
            break
    return params, optimizer


def _log_prob(params: network.Params, mean: jax.Array, actions: jax.Array) -> jax.Array:
    deviation = (actions - mean) / jnp.exp(params["log_std"])
    return -(0.5 * deviation**2 + params["log_std"]).sum(axis=1)


@jax.jit
def _act(
    params: network.Params, key: jax.Array, views: jax.Array, states: jax.Array, unseen: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Random actions, their probabilities, and values."""
    mean, values = network.apply_with_values(params, views, states, unseen)
    actions = mean + jax.random.normal(key, mean.shape) * jnp.exp(params["log_std"])
    return actions, _log_prob(params, mean, actions), values


def _loss(
    params: network.Params, batch: dict[str, jax.Array], hold: jax.Array, values_only: bool
) -> tuple[jax.Array, jax.Array]:
    """The loss, and how far the policy is from the one that drove."""
    seen = (batch["views"], batch["states"], batch["unseen"])
    mean, values = network.apply_with_values(params, *seen)
    value = _VALUE * jnp.mean((values - batch["returns"]) ** 2)
    if values_only:
        return value, jnp.zeros(())
    ratio = jnp.exp(_log_prob(params, mean, batch["drawn"]) - batch["log_probs"])
    gain = batch["advantages"]
    clipped = jnp.clip(ratio, 1 - CLIP, 1 + CLIP)
    policy = -jnp.minimum(ratio * gain, clipped * gain).mean()
    distance = (ratio - 1.0 - jnp.log(ratio)).mean()
    return policy + value + hold * imitation.loss(params, batch), distance


@partial(jax.jit, static_argnames="values_only")
def _improve(
    params: network.Params,
    optimizer: Any,
    batch: dict[str, jax.Array],
    hold: jax.Array,
    values_only: bool,
) -> tuple[network.Params, Any, jax.Array]:
    gradients, distance = jax.grad(_loss, has_aux=True)(params, batch, hold, values_only)
    updates, optimizer = OPTIMIZER.update(gradients, optimizer, params)
    return optax.apply_updates(params, updates), optimizer, distance
