"""The network of the detector, in JAX: single-shot, two scales, one box a cell."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from autopilot.detector import KINDS, SCALES

Params = dict[str, Any]
OUTPUTS = 5 + len(KINDS)

# Name, size, stride, channels before and after; a layer of one stride and width adds its input.
BACKBONE = (
    ("stem", 4, 4, 3, 24),
    ("eighth", 3, 2, 24, 40),
    ("eighth_more", 3, 1, 40, 40),
    ("sixteenth", 3, 2, 40, 56),
    ("sixteenth_more", 3, 1, 56, 56),
    ("thirtysecond", 3, 2, 56, 72),
    ("thirtysecond_more", 3, 1, 72, 72),
)
LATERAL = (("up_sixteenth", 1, 1, 72, 56), ("up_eighth", 1, 1, 56, 40))
HEADS = (
    ("fine", 3, 1, 40, 40),
    ("fine_out", 1, 1, 40, OUTPUTS),
    ("coarse", 3, 1, 72, 48),
    ("coarse_out", 1, 1, 48, OUTPUTS),
)


def init(key: jax.Array) -> Params:
    """Weights to begin with: nearly no cell has an object."""
    params: Params = {}
    for name, size, _, before, after in (*BACKBONE, *LATERAL, *HEADS):
        key, own = jax.random.split(key)
        spread = (2.0 / (size * size * before)) ** 0.5 * (0.3 if name.endswith("_out") else 1.0)
        weights = spread * jax.random.normal(own, (size, size, before, after))
        params[name] = {"w": weights, "b": jnp.zeros(after)}
    for name in ("fine_out", "coarse_out"):
        params[name]["b"] = params[name]["b"].at[0].set(-4.0)
    return params


def apply(params: Params, pictures: jax.Array) -> list[jax.Array]:
    """For each scale, rows and columns of cells with what `autopilot.detector` decodes."""
    x = pictures.astype(jnp.float32) / 255.0 - 0.45
    kept = {}
    for name, size, stride, before, after in BACKBONE:
        y = jax.nn.relu(_conv(params[name], x, size, stride))
        x = x + y if stride == 1 and before == after else y
        kept[name] = x
    coarse = x
    x = _doubled(jax.nn.relu(_conv(params["up_sixteenth"], x, 1, 1))) + kept["sixteenth_more"]
    x = _doubled(jax.nn.relu(_conv(params["up_eighth"], x, 1, 1))) + kept["eighth_more"]
    outs = []
    for name, features in (("fine", x), ("coarse", coarse)):
        hidden = jax.nn.relu(_conv(params[name], features, 3, 1))
        outs.append(_conv(params[f"{name}_out"], hidden, 1, 1))
    assert len(outs) == len(SCALES)
    return outs


def _conv(layer: Params, x: jax.Array, size: int, stride: int) -> jax.Array:
    pad = 0 if size == stride else size // 2
    dimensions = ("NHWC", "HWIO", "NHWC")
    pads = [(pad, pad)] * 2
    y = jax.lax.conv_general_dilated(
        x, layer["w"], (stride, stride), pads, dimension_numbers=dimensions
    )
    return y + layer["b"]


def _doubled(x: jax.Array) -> jax.Array:
    return jnp.repeat(jnp.repeat(x, 2, axis=1), 2, axis=2)
