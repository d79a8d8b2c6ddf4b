"""The network of the policy, in JAX: the bird's-eye view through patches, the state beside it.

Each convolution has the stride of its size, so that it is one multiplication of matrices.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from autopilot.agent import STATE

Params = dict[str, Any]
PATCHES = ((4, 6, 24), (2, 24, 48), (2, 48, 48))
FEATURES = 4 * 4 * 48
HIDDEN = 96


def init(key: jax.Array) -> Params:
    """Weights to begin with."""
    keys = iter(jax.random.split(key, 16))
    params: Params = {}
    for index, (size, before, after) in enumerate(PATCHES):
        params[f"patch{index}"] = _dense(next(keys), size * size * before, after)
    params["view"] = _dense(next(keys), FEATURES, HIDDEN)
    params["state"] = _dense(next(keys), STATE, 32)
    params["both"] = _dense(next(keys), HIDDEN + 32, HIDDEN)
    params["action"] = _dense(next(keys), HIDDEN, 2, 0.1)
    params["value"] = _dense(next(keys), HIDDEN, 1, 0.3)
    params["log_std"] = jnp.array([-0.7, -1.6])
    return params


def apply(params: Params, views: jax.Array, states: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The mean actions (speed up or brake, steer) and the values."""
    x = views.astype(jnp.float32).transpose(0, 2, 3, 1) / 255.0
    for index, (size, _, _) in enumerate(PATCHES):
        batch, rows, columns, channels = x.shape
        x = x.reshape(batch, rows // size, size, columns // size, size, channels)
        x = x.transpose(0, 1, 3, 2, 4, 5)
        x = x.reshape(batch, rows // size, columns // size, size * size * channels)
        x = jax.nn.relu(_linear(params[f"patch{index}"], x))
    seen = jax.nn.relu(_linear(params["view"], x.reshape(x.shape[0], -1)))
    felt = jax.nn.relu(_linear(params["state"], states))
    both = jax.nn.relu(_linear(params["both"], jnp.concatenate([seen, felt], axis=1)))
    return _linear(params["action"], both), _linear(params["value"], both)[:, 0]


def _dense(key: jax.Array, before: int, after: int, gain: float = 1.4) -> Params:
    weights = jax.random.orthogonal(key, max(before, after))[:before, :after]
    return {"w": gain * weights, "b": jnp.zeros(after)}


def _linear(layer: Params, x: jax.Array) -> jax.Array:
    return x @ layer["w"] + layer["b"]
