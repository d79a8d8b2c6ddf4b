"""What options of several benchmarks have in common."""

from __future__ import annotations

import argparse


def positive(text: str) -> int:
    """Return the whole number above 0 that an option states."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a whole number above 0")
    return int(text)
