"""Stands for OpenCV: what the paper's programs use of it to write on pictures and to keep them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

COLOR_RGB2BGR, FONT_HERSHEY_SIMPLEX, LINE_AA = range(3)


def cvtColor(picture: np.ndarray, code: int) -> np.ndarray:  # noqa: N802
    """The same picture with its colours in another order."""
    return picture[..., ::-1]


def putText(picture: np.ndarray, text: str, *how: Any) -> np.ndarray:  # noqa: N802
    """The picture; nobody reads the text."""
    return picture


def VideoWriter_fourcc(*letters: str) -> str:  # noqa: N802
    """The name of a codec."""
    return "".join(letters)


class VideoWriter:
    """Counts pictures, and writes down how many there were."""

    def __init__(self, path: str, codec: str, rate: float, size: tuple[int, int]) -> None:
        """Has none yet."""
        self._path, self._size, self._count = Path(path), size, 0

    def write(self, picture: np.ndarray) -> None:
        """Takes a picture."""
        assert picture.shape[1::-1] == self._size
        self._count += 1

    def release(self) -> None:
        """Ends the video."""
        self._path.parent.mkdir(exist_ok=True)
        self._path.write_text(f"{self._count} pictures\n")


def destroyAllWindows() -> None:  # noqa: N802
    """There are none."""
