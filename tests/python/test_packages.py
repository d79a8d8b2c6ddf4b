"""Imports from packages: which folders are looked through."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = "target Python import Where from <where> main reactor { w = new Where() }"


def package(folder: Path, text: str, inner: str = "") -> None:
    home = folder / "where" / "src" / "lib" / inner
    home.mkdir(parents=True)
    source = f'target Python reactor Where {{ reaction(startup) {{= print("{text}") =}} }}'
    (home / "Where.lf").write_text(source)


def run(folder: Path, program: str, packages: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [Path(sys.executable).with_name("hprm"), "run", program],
        cwd=folder,
        env=os.environ | {"LF_PACKAGES": packages},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.fixture
def project(tmp_path: Path) -> Path:
    project = tmp_path / "project"
    (project / "src").mkdir(parents=True)
    (project / "src" / "Main.lf").write_text(PROGRAM)
    return project


def test_the_packages_of_the_environment_come_last(project: Path, tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    package(shared, "shared", inner="somewhere/below")
    packages = f"{tmp_path / 'empty'}:{shared}"
    assert run(project, "src/Main.lf", packages).stdout == "shared\n"
    package(project / "lf-packages", "own")
    assert run(project, "src/Main.lf", packages).stdout == "own\n"
    package(project / "build" / "lfc_include", "fetched")
    assert run(project, "src/Main.lf", packages).stdout == "fetched\n"


def test_where_one_stands_does_not_matter(project: Path, tmp_path: Path) -> None:
    package(project / "lf-packages", "own")
    for folder, program in [
        (project, "src/Main.lf"),
        (project / "src", "Main.lf"),
        (tmp_path, "project/src/Main.lf"),
        (tmp_path, str(project / "src" / "Main.lf")),
    ]:
        assert run(folder, program).stdout == "own\n", (folder, program)


def test_a_missing_package_is_named(project: Path) -> None:
    outcome = run(project, "src/Main.lf", "/no/packages/here")
    assert outcome.returncode != 0
    assert "error[LF0105]: cannot find `<where>` among the packages" in outcome.stderr
    assert "lf-packages, /no/packages/here" in outcome.stderr
