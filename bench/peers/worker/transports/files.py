"""Small files by which processes of a session tell one another something before they are linked."""

from __future__ import annotations

import os
from pathlib import Path

from session import until


def publish(path: str, text: str) -> None:
    """Writes a file that nobody sees half written."""
    Path(path + ".new").write_text(text)
    os.rename(path + ".new", path)


def wait(path: str) -> str:
    """The text of a file, once it is there."""
    until(path, lambda: os.path.exists(path))
    return Path(path).read_text()
