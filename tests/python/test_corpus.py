"""The programs of ``tests/lf`` check themselves: each must end with exit code 0.

A program's comment may say that it ends with another code, and that it means the same when its
reactors are federates: then it also runs so, as processes and as threads.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CORPUS = Path(__file__).parents[1] / "lf"
PROGRAMS = sorted(
    str(path.relative_to(CORPUS)) for path in CORPUS.rglob("*.lf") if path.parent.name != "lib"
)
FEDERATED = [
    program
    for program in PROGRAMS
    if re.search("^federated reactor", (CORPUS / program).read_text(), re.M)
]
ALSO_FEDERATED = [
    (program, coordination)
    for program in PROGRAMS
    if (said := re.search(r"Federated as well: ([a-z, ]+)\.", (CORPUS / program).read_text()))
    for coordination in said[1].split(", ")
]


def run(
    program: str, folder: Path, *properties: str, in_process: bool = False
) -> subprocess.CompletedProcess[str]:
    options = [f"--property={stated}" for stated in properties]
    if in_process:
        options.append("--in-process")
    return subprocess.run(
        [Path(sys.executable).with_name("hprm"), "run", *options, program],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def exit_code(program: str) -> int:
    said = re.search(r"Ends with exit code (\d+)\.", (CORPUS / program).read_text())
    return int(said[1]) if said else 0


def test_there_is_a_corpus_and_some_of_it_is_federated() -> None:
    assert {exit_code(program) for program in PROGRAMS} == {0, 1, 7}
    assert FEDERATED
    assert {coordination for _, coordination in ALSO_FEDERATED} == {"centralized", "decentralized"}


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_program_is_content_with_what_it_sees(program: str) -> None:
    done = run(program, CORPUS)
    assert done.returncode == exit_code(program), done.stderr


@pytest.mark.parametrize("program", PROGRAMS)
def test_workers_make_no_difference(program: str) -> None:
    if re.search(r"^target .*(single-threaded|workers)", (CORPUS / program).read_text(), re.M):
        pytest.skip("says itself how many it has")
    done = run(program, CORPUS, "workers=3")
    assert done.returncode == exit_code(program), done.stderr


@pytest.mark.parametrize("program", FEDERATED)
def test_so_is_one_whose_federates_are_threads(program: str) -> None:
    done = run(program, CORPUS, in_process=True)
    assert done.returncode == exit_code(program), done.stderr


@pytest.mark.parametrize("in_process", [False, True], ids=["processes", "threads"])
@pytest.mark.parametrize(("program", "coordination"), ALSO_FEDERATED)
def test_a_program_means_the_same_when_it_is_federated(
    program: str, coordination: str, in_process: bool, tmp_path: Path
) -> None:
    folder = tmp_path / "lf"
    shutil.copytree(CORPUS, folder)
    text = (folder / program).read_text()
    assert "main reactor" in text
    (folder / program).write_text(text.replace("main reactor", "federated reactor"))
    properties = ["fast=false", f"coordination={coordination}"]
    done = run(program, folder, *properties, in_process=in_process)
    assert done.returncode == exit_code(program), done.stderr
