"""The programs of `examples/ros2_port`: the same in each run, and with other imports."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from processes import ROOT, Bench, finish

sys.path.insert(0, str(ROOT / "bench"))

from ros2_order import TAGGED

PROGRAMS = ROOT / "examples" / "ros2_port"
HPRM = Path(sys.executable).with_name("hprm")


def in_folder(word: str) -> str:
    """A word of a command line, with the folder before the names of programs."""
    return f"ros2_port/{word}" if word.endswith(".py") else word


@pytest.mark.parametrize("name", TAGGED)
def test_a_program_of_ros_2_does_the_same_in_each_run(name: str, bench: Bench) -> None:
    shutil.copytree(PROGRAMS, bench.folder / "ros2_port", dirs_exist_ok=True)
    runs = []
    for number in range(2):
        # Both at the same time: they disturb one another.
        options = ["--start-time=0", f"--logical-trace={number}.trace"]
        words = [it for word in TAGGED[name] for it in (options if word == "{}" else [word])]
        runs.append(bench.call(*(in_folder(word) for word in words)))
    for run in runs:
        assert finish(run).code == 0
    compare = [HPRM, "diff", *(bench.folder / f"{number}.trace" for number in range(2))]
    done = subprocess.run(compare, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    # More than the first tags.
    compared = re.search(r"(\d+) reactions compared", done.stdout)
    assert compared and int(compared[1]) >= 10, done.stdout


def test_a_trace_that_cannot_be_written_is_one_error(bench: Bench) -> None:
    scripts = [str(PROGRAMS / "talker.py"), "+", str(PROGRAMS / "listener.py")]
    done = finish(bench.call("ros", "run", "--logical-trace=missing/a.trace", *scripts))
    assert done.code == 1
    assert done.err.startswith("error: cannot write the trace missing/a.trace"), done.err
    assert done.err.count("error:") == 1, done.err


def test_with_other_imports_a_program_runs_with_python_alone(tmp_path: Path) -> None:
    before = (PROGRAMS / "talker.py").read_text()
    page = (ROOT / "docs" / "howto" / "from-ros2.md").read_text()
    lines = [line.strip() for line in page.partition("```diff")[2].partition("```")[0].splitlines()]
    removed = [line[1:] for line in lines if line.startswith("-")]
    added = [line[1:] for line in lines if line.startswith("+")]
    assert "\n".join(removed) in before
    after = before.replace("\n".join(removed), "\n".join(added))
    (tmp_path / "talker.py").write_text(after)
    command = [sys.executable, "talker.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
