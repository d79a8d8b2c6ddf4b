"""Where a training is, in a file: arrays by their place in a tree, and what else is told."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np


def store(path: Path, tree: Any, told: dict[str, Any]) -> None:
    """Writes both, all at once: an interruption leaves the file before it, or this one."""
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    arrays = {jax.tree_util.keystr(name): np.asarray(value) for name, value in leaves}
    unfinished = path.with_name(f"{path.stem}.part.npz")
    np.savez(unfinished, told=np.array(json.dumps(told)), **arrays)
    os.replace(unfinished, path)


def restore(path: Path, tree: Any) -> tuple[Any, dict[str, Any]]:
    """A tree of the shape of this one, and what was told."""
    with np.load(path) as stored:
        told: dict[str, Any] = json.loads(str(stored["told"]))
        arrays = jax.tree_util.tree_map_with_path(
            lambda name, _: jnp.asarray(stored[jax.tree_util.keystr(name)]), tree
        )
    return arrays, told
