"""Bytes that are no value, or nearly one: each becomes a value or an error, in little memory.

Decoding is written in Rust but makes Python's objects, so it cannot be fuzzed without Python.
Instead encodings of all kinds are changed at random, from fixed seeds, in a process of its own:
whatever kills it, panics or asks for much memory is found. As a script with a number, it makes as
many changes to each.
"""

from __future__ import annotations

import contextlib
import random
import resource
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import kinds
import numpy as np
import pytest

from hprm._hprm import decode, encode

# What decoding may ask for, beyond what the process has when it begins.
MEMORY = 1 << 30

ROUNDS = 150


def mutations(
    head: bytes, parts: list[bytes], rng: random.Random, rounds: int
) -> Iterator[tuple[bytes, Any]]:
    """Changed copies of an encoding."""
    for _ in range(rounds):
        changed, others = bytearray(head), list(parts)
        for _ in range(rng.randint(1, 3)):
            at = rng.randrange(len(changed) or 1)
            match rng.randrange(7):
                case 0:
                    changed[at : at + 1] = bytes([rng.randrange(256)])
                case 1:
                    changed[at : at + 1] = bytes([changed[at] ^ 1 << rng.randrange(8)])
                case 2:
                    del changed[at : at + rng.randint(1, 4)]
                case 3:
                    changed[at:at] = rng.randbytes(rng.randint(1, 4))
                case 4:
                    changed[at:at] = b"\xff" * rng.randint(1, 9)
                case 5:
                    end = min(len(changed), at + rng.randint(1, 40))
                    changed[at:at] = changed[rng.randrange(at + 1) : end]
                case _ if others:
                    which = rng.randrange(len(others))
                    part = bytearray(others[which])
                    part[rng.randrange(len(part))] ^= 1 << rng.randrange(8)
                    others[which] = bytes(part[: rng.choice([len(part), rng.randrange(len(part))])])
            if not changed:
                break
        yield bytes(changed), others


def look(value: Any) -> None:
    """Read what a view shows, as Python does and as NumPy does."""
    for each in value if isinstance(value, (list, tuple)) else [value]:
        if isinstance(each, memoryview):
            assert len(each.tobytes()) == each.nbytes
            each == each.toreadonly()  # noqa: B015
            for read in (each.tolist, lambda each=each: np.asarray(each).tolist()):
                with contextlib.suppress(NotImplementedError, ValueError, RuntimeError):
                    read()


def attempt(name: str, value: Any, rounds: int) -> int:
    """Decode changed encodings of a value. Return how many were values nevertheless."""
    rng = random.Random(name)
    head, parts = encode(value, local=False)
    survived = 0
    for changed, others in mutations(head, parts, rng, rounds):
        try:
            back = decode(changed, others, local=False)
            # What has been made can be looked at.
            repr(back)
            look(back)
            survived += 1
        except MemoryError:
            raise AssertionError(f"{name}: {changed!r} asks for too much memory") from None
        except Exception:
            # Whatever is wrong is said; a panic is no Exception.
            continue
    return survived


def main(rounds: int) -> None:
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    values = kinds.every()
    for value in values.values():
        decode(*encode(value, local=False), local=False)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    for name, value in values.items():
        print(name, attempt(name, value, rounds), flush=True)


def test_changed_encodings_are_values_or_errors() -> None:
    done = subprocess.run([sys.executable, __file__], capture_output=True, text=True, check=False)
    lines = done.stdout.splitlines()
    last = lines[-1] if lines else "nothing"
    assert done.returncode == 0, f"after {last}: {done.returncode} {done.stderr[-2000:]}"
    counts = [int(line.rsplit(" ", 1)[1]) for line in lines]
    assert len(counts) == len(kinds.every())
    # Some changes are harmless, most are not.
    assert 0 < sum(counts) < len(counts) * ROUNDS / 2


@pytest.mark.parametrize(
    ("head", "what"),
    [
        # A set and an object that claim more members than there are bytes.
        (b"\x01\x10\xff\xff\xff\xff\x0f", "more entries than bytes"),
        (b"\x01\x13\x00\xff\xff\xff\xff\x0f", "more entries than bytes"),
        # A number for which there is no class.
        (b"\x01\x13\x7f\x00", "nothing is made by the number 127"),
        # A reference to an object from inside of it.
        (b"\x01\x13\x10\x01\x0c\x00", "reference to nothing"),
        # A pickle in a list.
        (b"\x01\x09\x01\x0e\x02N.\x00", "a pickle inside of another value"),
        # Objects inside of objects, and sets inside of sets.
        (b"\x01" + b"\x11\x01" * 200 + b"\x00", "too deeply"),
        (b"\x01" + b"\x13\x0b\x03" * 200 + b"\x00", "too deeply"),
    ],
)
def test_what_is_wrong_is_said(head: bytes, what: str) -> None:
    with pytest.raises(ValueError, match=f"malformed payload: .*{what}"):
        decode(head, [])


def test_a_key_cannot_cost_more_than_its_bytes() -> None:
    # t = (t, t), again and again: 2 to the power of 60 elements to hash.
    head = b"\x01\x0b\x01" + b"\x0a\x02" * 60 + b"\x00\x00"
    for number in range(60, 1, -1):
        head += b"\x0c" + bytes([number])
    with pytest.raises(ValueError, match="malformed payload: a key of too many parts"):
        decode(head + b"\x00", [])


def test_arrays_lie_within_what_has_arrived() -> None:
    head, _ = encode(np.zeros(4))
    longer = head.replace(b"\x04\x40", b"\x7f\x40")
    assert longer != head
    with pytest.raises((TypeError, ValueError)):
        decode(longer, [])


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else ROUNDS)
