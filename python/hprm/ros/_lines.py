"""Lines that several threads write: each stays whole, because it is written at once."""

from __future__ import annotations

from typing import TextIO


def write_line(text: str, out: TextIO) -> None:
    """Write a line; ``print`` writes its end later, and another thread may come between."""
    out.write(f"{text}\n")
    out.flush()
