"""Stands for PyTorch: a hub, which has a detector that finds nothing on any picture."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np


class _Results:
    def __init__(self, picture: np.ndarray) -> None:
        self._picture = picture

    def render(self) -> list[np.ndarray]:
        return [self._picture]


def _load(repository: str, model: str, **options: Any) -> Any:
    assert (repository, model) == ("ultralytics/yolov5", "yolov5n") and options["pretrained"]
    return _Results


hub = SimpleNamespace(load=_load)
