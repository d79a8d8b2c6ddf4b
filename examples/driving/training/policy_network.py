"""The network of the policy, in JAX: the bird's-eye view through patches, the state beside it.

Each convolution has the stride of its size, so that it is one multiplication of matrices. Beside
them a part that learns nothing says how far the route is free: for each row of the view, whether
anything is on the route up to there.

Beside it are the values, which only PPO needs. They also know what no view has, and what they learn
leaves the policy as it is.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from autopilot.agent import STATE

from .environment import UNSEEN

Params = dict[str, Any]
PATCHES = ((4, 6, 24), (2, 24, 48), (2, 48, 48))
FEATURES = 4 * 4 * 48
HIDDEN = 96
# The channel of the route, the first of those that can be on it, and the rows ahead of the car.
ROUTE, OBSTACLES, AHEAD = 1, 3, 44
PROFILE = 3 * AHEAD
FELT = 64
JUDGING = 96


def init(key: jax.Array) -> Params:
    """Weights to begin with."""
    keys = iter(jax.random.split(key, 16))
    params: Params = {}
    for index, (size, before, after) in enumerate(PATCHES):
        params[f"patch{index}"] = _dense(next(keys), size * size * before, after)
    params["view"] = _dense(next(keys), FEATURES, HIDDEN)
    params["felt"] = _dense(next(keys), STATE + PROFILE, FELT)
    params["both"] = _dense(next(keys), HIDDEN + FELT, HIDDEN)
    params["action"] = _dense(next(keys), HIDDEN, 2, 0.1)
    params["judging"] = _dense(next(keys), HIDDEN + UNSEEN, JUDGING)
    params["value"] = _dense(next(keys), JUDGING, 1, 0.3)
    params["log_std"] = jnp.array([-2.3, -3.5])
    return params


def apply(params: Params, views: jax.Array, states: jax.Array) -> jax.Array:
    """The mean actions: a speed, a steering."""
    return _linear(params["action"], _seen(params, views, states))


def apply_with_values(
    params: Params, views: jax.Array, states: jax.Array, unseen: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """The mean actions, and what the states are worth."""
    both = _seen(params, views, states)
    known = jnp.concatenate([jax.lax.stop_gradient(both), unseen], axis=1)
    judged = jax.nn.relu(_linear(params["judging"], known))
    return _linear(params["action"], both), _linear(params["value"], judged)[:, 0]


def _seen(params: Params, views: jax.Array, states: jax.Array) -> jax.Array:
    """What the last hidden layer makes of view and state."""
    seen = views.astype(jnp.float32) / 255.0
    x = seen.transpose(0, 2, 3, 1)
    for index, (size, _, _) in enumerate(PATCHES):
        batch, rows, columns, channels = x.shape
        x = x.reshape(batch, rows // size, size, columns // size, size, channels)
        x = x.transpose(0, 1, 3, 2, 4, 5)
        x = x.reshape(batch, rows // size, columns // size, size * size * channels)
        x = jax.nn.relu(_linear(params[f"patch{index}"], x))
    looked = jax.nn.relu(_linear(params["view"], x.reshape(x.shape[0], -1)))
    near = jnp.concatenate([states, profile(seen)], axis=1)
    felt = jax.nn.relu(_linear(params["felt"], near))
    return jax.nn.relu(_linear(params["both"], jnp.concatenate([looked, felt], axis=1)))


def profile(seen: jax.Array) -> jax.Array:
    """For cars, motion and pedestrians: up to each row ahead, whether any is on the route."""
    ahead = seen[:, :, :AHEAD]
    met = (ahead[:, ROUTE : ROUTE + 1] * ahead[:, OBSTACLES:]).max(axis=3)
    # The lowest row is the nearest one.
    return jax.lax.cummax(met, axis=2, reverse=True).reshape(len(seen), PROFILE)


def _dense(key: jax.Array, before: int, after: int, gain: float = 1.4) -> Params:
    weights = jax.random.orthogonal(key, max(before, after))[:before, :after]
    return {"w": gain * weights, "b": jnp.zeros(after)}


def _linear(layer: Params, x: jax.Array) -> jax.Array:
    return x @ layer["w"] + layer["b"]
