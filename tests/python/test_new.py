"""`hprm new`: projects that run, and whose tests pass."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pytest
from processes import call

ROOT = Path(__file__).resolve().parents[2]
HPRM = Path(sys.executable).with_name("hprm")
MEANS = [
    "0 ms: 1.0",
    "100 ms: 1.5",
    "200 ms: 2.0",
    *(f"{100 * n} ms: {n}.0" for n in range(3, 11)),
]


def steps(folder: Path, *words: str) -> list[str]:
    """Makes a project, and returns the commands that are recommended."""
    lines = call(HPRM, "new", *words, cwd=folder).stdout.splitlines()
    assert lines[0].startswith(f"made {words[0]}: a program in ")
    assert lines[1] == f"  cd {words[0]}"
    return [line.strip() for line in lines[2:]]


@pytest.mark.parametrize("language", ["lf", "python"])
def test_a_project_runs_and_its_tests_pass(tmp_path: Path, language: str) -> None:
    program, test = steps(tmp_path, "robot-arm", "--lang", language)
    project = tmp_path / "robot-arm"
    assert (program.split()[:2], test) == (["hprm", "run"], "python -m pytest")
    printed = call(HPRM, *program.split()[1:], cwd=project).stdout.splitlines()
    assert printed == [f"[display] {mean}" for mean in MEANS]
    call(HPRM, "check", program.split()[2], cwd=project)
    outcome = call(sys.executable, *test.split()[1:], "-p", "no:cacheprovider", cwd=project)
    assert "2 passed" in outcome.stdout


@pytest.mark.parametrize("language", ["lf", "python"])
def test_the_python_of_a_project_is_as_ruff_wants_it(tmp_path: Path, language: str) -> None:
    steps(tmp_path, "robot", "--lang", language)
    ruff = [sys.executable, "-m", "ruff"]
    call(*ruff, "check", "--isolated", "--select=E,F,W,I,B,UP", ".", cwd=tmp_path)
    call(*ruff, "format", "--isolated", "--check", ".", cwd=tmp_path)


def test_a_project_in_rust_runs_and_its_tests_pass(tmp_path: Path) -> None:
    words = ["robot-arm", "--lang", "rust", "--checkout", str(ROOT)]
    assert steps(tmp_path, *words) == ["cargo run", "cargo test"]
    project = tmp_path / "robot-arm"
    # The versions that have been downloaded, and what other tests have compiled.
    shutil.copy(ROOT / "Cargo.lock", project)
    target = os.environ | {"CARGO_TARGET_DIR": str(ROOT / "target")}
    printed = call("cargo", "run", "--quiet", "--offline", cwd=project, environment=target).stdout
    assert printed.splitlines() == [f"[display] {mean}" for mean in MEANS]
    outcome = call("cargo", "test", "--quiet", "--offline", cwd=project, environment=target)
    assert "1 passed" in outcome.stdout
    call("cargo", "fmt", "--check", cwd=project)


def test_no_trace_of_the_template_is_left(tmp_path: Path) -> None:
    for language in ("lf", "python", "rust"):
        steps(tmp_path, f"my{language}", "--lang", language)
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(files) == 16
    for path in files:
        text = f"{path.relative_to(tmp_path)} {path.read_text()}".lower().replace("-", "_")
        assert "new_project" not in text and "newproject" not in text, path


def test_what_exists_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "robot").mkdir()
    told = call(HPRM, "new", "robot", cwd=tmp_path, code=1).stderr
    assert told.splitlines() == [
        "error: robot exists already",
        "  hint: choose another name, or remove it first",
    ]
    assert list(tmp_path.rglob("*")) == [tmp_path / "robot"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["2d"], "a project cannot be called 2d: it must begin with a letter"),
        (["ro bot"], "it may have ASCII letters, digits, - and _ only"),
        (["import"], "the name has a meaning of its own"),
        (["signal", "--lang", "python"], "a module of Python's standard library has this name"),
        (["robot", "--checkout", "."], "--checkout is only for programs in Rust"),
        (["robot", "--lang", "rust", "--checkout", "."], ". is no clone of HPRM's repository"),
    ],
)
def test_a_mistake_is_one_error_and_nothing_is_made(
    tmp_path: Path, words: list[str], told: str
) -> None:
    lines = call(HPRM, "new", *words, cwd=tmp_path, code=1).stderr.splitlines()
    assert lines[0].startswith("error: ") and told in lines[0]
    assert lines[1].startswith("  hint: ") and len(lines) == 2
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    told = call(HPRM, "new", "file/robot", cwd=tmp_path, code=1).stderr
    assert told.startswith("error: cannot make file/robot: ")
