"""Stands for a bar of progress."""

from __future__ import annotations

from collections.abc import Iterable


def tqdm(steps: Iterable[int]) -> Iterable[int]:
    """The same steps."""
    return steps
