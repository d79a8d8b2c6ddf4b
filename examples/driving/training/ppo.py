"""Proximal policy optimization: the policy drives with some chance, and does more of what paid.

It begins with a policy that drives well already. So its steps are small, its first rounds learn
only what states are worth, and the expert's actions hold it where rewards say little.
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

STEPS, EPOCHS, BATCH = 128, 3, 512
DISCOUNT, TRACE, CLIP = 0.985, 0.95, 0.15
_VALUE, _HOLD = 0.25, 1.0
OPTIMIZER = optax.chain(optax.clip_by_global_norm(0.5), optax.adam(1e-4))
Data = dict[str, npt.NDArray[Any]]


def drive(drives: Drives, params: network.Params, key: jax.Array) -> Data:
    """What was seen, done and gained in some steps of all drives, with advantages and returns."""
    kept = []
    for step in range(STEPS):
        views, states = drives.views.copy(), drives.states.copy()
        chosen = _act(params, jax.random.fold_in(key, step), views, states)
        actions, log_probs, values = (np.asarray(it) for it in chosen)
        wants = [action_of(*it.expert.wants()) for it in drives.drives]
        rewards, ends = drives.step(actions)
        experts = np.array(wants, np.float32)
        kept.append((views, states, actions, log_probs, values, experts, rewards, ends))
    names = ("views", "states", "drawn", "log_probs", "values", "actions", "rewards", "ends")
    data = {n: np.stack(column) for n, column in zip(names, zip(*kept, strict=True), strict=True)}
    _, last = network.apply(params, jnp.asarray(drives.views), jnp.asarray(drives.states))
    return with_advantages(data, np.asarray(last))


def with_advantages(data: Data, last: npt.NDArray[Any]) -> Data:
    """Adds generalized advantages and returns; a journey's end is worth nothing more."""
    rewards, values, ends = data.pop("rewards"), data.pop("values"), data.pop("ends")
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
    values_only: bool,
) -> tuple[network.Params, Any]:
    """Some epochs over what was gathered."""
    rows = {name: value.reshape(-1, *value.shape[2:]) for name, value in data.items()}
    count = len(rows["returns"])
    for _ in range(EPOCHS):
        order = random.permutation(count)
        for begin in range(0, count, BATCH):
            chosen = order[begin : begin + BATCH]
            batch = {name: jnp.asarray(value[chosen]) for name, value in rows.items()}
            gain = batch["advantages"]
            batch["advantages"] = (gain - gain.mean()) / (gain.std() + 1e-6)
            params, optimizer = _improve(params, optimizer, batch, values_only)
    return params, optimizer


def _log_prob(params: network.Params, mean: jax.Array, actions: jax.Array) -> jax.Array:
    deviation = (actions - mean) / jnp.exp(params["log_std"])
    return -(0.5 * deviation**2 + params["log_std"]).sum(axis=1)


@jax.jit
def _act(
    params: network.Params, key: jax.Array, views: jax.Array, states: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Random actions, their probabilities, and values."""
    mean, values = network.apply(params, views, states)
    actions = mean + jax.random.normal(key, mean.shape) * jnp.exp(params["log_std"])
    return actions, _log_prob(params, mean, actions), values


def _loss(params: network.Params, batch: dict[str, jax.Array], values_only: bool) -> jax.Array:
    mean, values = network.apply(params, batch["views"], batch["states"])
    value = _VALUE * jnp.mean((values - batch["returns"]) ** 2)
    if values_only:
        # The policy stays what it is while the values become right.
        return value + 10.0 * imitation.loss(params, batch)
    ratio = jnp.exp(_log_prob(params, mean, batch["drawn"]) - batch["log_probs"])
    gain = batch["advantages"]
    clipped = jnp.clip(ratio, 1 - CLIP, 1 + CLIP)
    policy = -jnp.minimum(ratio * gain, clipped * gain).mean()
    return policy + value + _HOLD * imitation.loss(params, batch)


@partial(jax.jit, static_argnames="values_only")
def _improve(
    params: network.Params, optimizer: Any, batch: dict[str, jax.Array], values_only: bool
) -> tuple[network.Params, Any]:
    gradients = jax.grad(_loss)(params, batch, values_only)
    updates, optimizer = OPTIMIZER.update(gradients, optimizer, params)
    return optax.apply_updates(params, updates), optimizer
