"""Random programs do the same in every deployment, as ``hprm verify`` sees it.

``make test`` draws a few; ``make acceptance`` sets HPRM_ACCEPTANCE and draws many. One that fails
is drawn again from its seed: ``python tests/python/test_random_programs.py SEED`` prints it.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from random_programs import program

HPRM = Path(sys.executable).with_name("hprm")
SEEDS = range(400 if os.environ.get("HPRM_ACCEPTANCE") else 6)


def test_the_programs_are_valid(tmp_path: Path) -> None:
    for seed in range(40):
        path = tmp_path / f"Seed{seed}.lf"
        path.write_text(program(seed, path.stem))
        done = subprocess.run(
            [HPRM, "check", path], capture_output=True, text=True, timeout=60, check=False
        )
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("seed", SEEDS)
def test_a_program_does_the_same_in_every_deployment(seed: int, tmp_path: Path) -> None:
    path = tmp_path / f"Seed{seed}.lf"
    path.write_text(program(seed, path.stem))
    # Five runs have every deployment.
    done = subprocess.run(
        [HPRM, "verify", "--runs", "5", "--run-timeout", "60", path],
        capture_output=True,
        text=True,
        timeout=400,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


if __name__ == "__main__":
    print(program(int(sys.argv[1]), f"Seed{sys.argv[1]}"), end="")
