"""Programs of Python objects do what their twins in ``.lf`` files do: the same logical trace."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent.parent / "twins"
NAMES = sorted(path.stem for path in FOLDER.glob("*.lf"))
FEDERATED = [name for name in NAMES if "federated reactor" in (FOLDER / f"{name}.lf").read_text()]
HPRM = str(Path(sys.executable).with_name("hprm"))


def trace(command: list[str], file: str, tmp_path: Path) -> tuple[str, list[str]]:
    """Run a program. Return its logical trace, and what it has printed."""
    path = tmp_path / f"{file}.trace"
    done = subprocess.run(
        [*command, "--logical-trace", str(path), file],
        cwd=FOLDER,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr, done.stderr
    header, *steps = path.read_text().splitlines()
    # A method has a name, and its twin need not have one.
    names = {**json.loads(header), "names": None}
    # Federates that are processes print at the same time.
    return "\n".join([json.dumps(names), *steps]), sorted(done.stdout.splitlines())


def test_there_are_twelve_twins() -> None:
    assert len(NAMES) >= 12
    assert {path.stem for path in FOLDER.glob("*.py")} == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_twins_do_the_same_in_one_process(name: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "hprm", "run"]
    expected, printed = trace(command, f"{name}.lf", tmp_path)
    assert printed
    assert trace(command, f"{name}.py", tmp_path) == (expected, printed)


@pytest.mark.parametrize("coordination", ["centralized", "decentralized"])
@pytest.mark.parametrize("name", FEDERATED)
def test_twins_do_the_same_as_federations(name: str, coordination: str, tmp_path: Path) -> None:
    command = [HPRM, "run", "--property", f"coordination={coordination}"]
    expected, printed = trace(command, f"{name}.lf", tmp_path)
    assert printed
    assert trace(command, f"{name}.py", tmp_path) == (expected, printed)


@pytest.mark.parametrize("name", FEDERATED)
def test_twins_do_the_same_as_threads(name: str, tmp_path: Path) -> None:
    command = [HPRM, "run", "--in-process"]
    expected, printed = trace(command, f"{name}.lf", tmp_path)
    assert printed
    assert trace(command, f"{name}.py", tmp_path) == (expected, printed)
