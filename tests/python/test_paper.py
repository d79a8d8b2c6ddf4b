"""The programs of the paper run as they are: here, programs of ours that have their structure.

They import and call what the programs of the paper import and call: `tests/paper/stubs` stands for
CARLA, PyTorch, OpenCV, Plasma and the modules of the repository of the paper.
"""

from __future__ import annotations

import json
import math
import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
from processes import COORDINATIONS

PAPER = Path(__file__).resolve().parents[1] / "paper"
HPRM = Path(sys.executable).parent / "hprm"
STEPS = 500


def run(program: str, folder: Path) -> str:
    """What a program prints that runs in this folder."""
    variables = {
        "PAPER_LOGS": str(folder),
        "PAPER_STEPS": str(STEPS),
        "PYTHONPATH": str(PAPER / "stubs"),
    }
    done = subprocess.run(
        [HPRM, "run", PAPER / program],
        cwd=folder,
        env=os.environ | variables,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_driving_program_drives_all_steps_and_ends(coordination: str, tmp_path: Path) -> None:
    printed = run(f"Drive{coordination.capitalize()}.lf", tmp_path)
    assert "[world] the world starts\n" in printed
    # The world has refused none of the actions: each was the one for the observation before it.
    off = 1.0
    for step in range(STEPS + 1):
        off += -0.5 * off + math.sin(step)
    assert (tmp_path / "drove").read_text() == f"{STEPS + 1} steps, {off:.6f} m off\n"
    assert (tmp_path / "video").read_text() == f"{STEPS + 1} pictures\n"
    assert (tmp_path / "videos" / f"{coordination}.mp4").read_text() == f"{STEPS + 1} pictures\n"
    for node in ("world", "driver", "watcher", "merge"):
        marks = json.loads((tmp_path / "time" / f"{coordination}_{node}.json").read_text())
        assert len(marks) == STEPS
        assert all(began <= ended for began, ended in marks)


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_what_is_gathered_is_what_was_broadcast(coordination: str, tmp_path: Path) -> None:
    printed = run(f"Gather{coordination.capitalize()}.lf", tmp_path)
    assert printed.splitlines() == [f"[server] Round: {number}" for number in range(1, 11)]
    gathered = tmp_path / "logs" / "gathered" / f"{coordination}.pkl"
    assert pickle.loads(gathered.read_bytes())["equal"]
    # One object of the server and one of each client for each round.
    assert len(list((tmp_path / "plasma").iterdir())) == 5 * 10
