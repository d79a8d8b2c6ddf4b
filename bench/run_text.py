"""Runs a program that a benchmark has as text, which writes what it has measured."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

import federation

_TIME_LIMIT_S = 300


def run_text(text: str, folder: Path, name: str, options: Sequence[str] = ()) -> None:
    """Run a program of that name to its end; ``out`` in the folder is its HPRM_BENCH_OUT.

    Raises:
        FederationError: it has failed, or has not ended in time.

    """
    program = folder / f"{name}.lf"
    program.write_text(text)
    try:
        done = subprocess.run(
            [str(federation.command()), "run", *options, str(program)],
            env=os.environ | {"HPRM_BENCH_OUT": str(folder / "out")},
            capture_output=True,
            text=True,
            timeout=_TIME_LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        message = f"{name} has not ended for {_TIME_LIMIT_S} s"
        raise federation.FederationError(message) from None
    if done.returncode != 0:
        raise federation.FederationError(f"{name} has failed\n{done.stderr}")
