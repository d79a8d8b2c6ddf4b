"""Each example prints what its README says; `crates/hprm/tests/examples.rs` runs those in Rust."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from processes import rust_examples
from readme import Command, Terminals, readmes
from stories import same
from tcp_ports import free_ports

BIN = Path(sys.executable).parent
READMES = readmes()
COMMANDS = [
    pytest.param(folder, it.argv, it.printed, id=f"{folder.name}: {' '.join(it.argv)}")
    for folder, parts in READMES
    for it in parts
    if isinstance(it, Command) and it.argv[0] != "cargo"
]
TERMINALS = [
    pytest.param(folder, it, id=f"{folder.name}: {it.steps[0].command}")
    for folder, parts in READMES
    for it in parts
    if isinstance(it, Terminals)
]
ENVIRONMENT = os.environ | {"PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}"}


@pytest.mark.parametrize(("folder", "argv", "printed"), COMMANDS)
def test_a_command_prints_what_the_readme_says(
    folder: Path, argv: list[str], printed: str, tmp_path: Path
) -> None:
    place = shutil.copytree(folder, tmp_path / folder.name)
    done = subprocess.run(
        argv, cwd=place, env=ENVIRONMENT, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert same(printed, done.stdout), done.stdout + done.stderr


@pytest.mark.parametrize(("folder", "terminals"), TERMINALS)
def test_terminals_show_what_the_readme_says(
    folder: Path, terminals: Terminals, tmp_path: Path
) -> None:
    place = shutil.copytree(folder, tmp_path / folder.name)
    (port,) = free_ports(1)
    stand_ins = {"15045": str(port), "robot.local": "localhost"}
    if any("target/debug" in (step.command or "") for step in terminals.steps):
        stand_ins["target/debug/examples"] = str(rust_examples())
    terminals.run(place, ENVIRONMENT, stand_ins)


def test_each_program_is_in_its_readme() -> None:
    for folder, parts in READMES:
        ran = {word for it in parts if isinstance(it, Command) for word in it.argv}
        ran |= {word for it in parts if isinstance(it, Terminals) for word in it.words()}
        # A launch file names programs.
        launched = [path.read_text() for path in folder.glob("*.launch.py") if path.name in ran]
        ran |= {word for text in launched for word in re.findall(r'"(\w+\.py)"', text)}
        programs = {path.name for path in folder.iterdir() if path.suffix in {".lf", ".py"}}
        # What a test imports is tested with it.
        assert programs - ran <= {"Watchdog.lf", "watchdog.py"}, folder


def test_the_list_of_examples_has_each_folder() -> None:
    listed = (READMES[0][0].parent / "README.md").read_text()
    assert len(READMES) >= 12
    assert [folder.name for folder, _ in READMES if f"]({folder.name}/" not in listed] == []
