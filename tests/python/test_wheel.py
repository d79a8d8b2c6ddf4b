"""The wheel: extension, package and command, in an environment that has nothing else.

The variable HPRM_WHEEL names one; otherwise it is made of what is compiled already.
"""

from __future__ import annotations

import fcntl
import os
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest
from processes import call

ROOT = Path(__file__).resolve().parents[2]
# What takes longer to import than all of the package, and what programs of `.lf` files do without.
HEAVY = {
    "ast",
    "asyncio",
    "concurrent.futures",
    "ctypes",
    "dataclasses",
    "email",
    "inspect",
    "json",
    "logging",
    "multiprocessing",
    "numpy",
    "pathlib",
    "re",
    "socket",
    "subprocess",
    "tempfile",
    "typing",
    "unittest",
}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel of this checkout."""
    if stated := os.environ.get("HPRM_WHEEL"):
        return Path(stated).resolve()
    # The workers of one run of pytest share it.
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base) / "wheel"
    with folder.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            build(folder)
    (made,) = folder.iterdir()
    return made


def build(folder: Path) -> None:
    """Makes a wheel of what has been compiled."""
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel"]
    environment = {**os.environ, "CARGO_NET_OFFLINE": "true"}
    if Path(sys.prefix, ".checked").exists():
        # `make test` compiles in this profile, `make build` for release.
        environment["MATURIN_PEP517_ARGS"] = "--profile dev"
    environment["PATH"] = f"{Path(sys.executable).parent}:{environment['PATH']}"
    options = ["--no-build-isolation", "--no-deps", "--wheel-dir", folder]
    call(*pip, *options, ".", cwd=ROOT, environment=environment)


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of an environment with the wheel and NumPy."""
    folder = tmp_path_factory.mktemp("empty") / "environment"
    venv.create(folder, symlinks=True)
    python = folder / "bin" / "python"
    packages = call(
        python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=ROOT
    ).stdout
    # The NumPy of this environment, which pip would download.
    for path in Path(sysconfig.get_path("platlib")).glob("numpy*"):
        Path(packages.strip(), path.name).symlink_to(path)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", python]
    call(*pip, "install", "--no-index", "--only-binary=:all:", wheel, cwd=ROOT)
    return folder / "bin"


def alone(programs: Path) -> dict[str, str]:
    """The environment of a user that has no compiler, nor anything else on the PATH."""
    return {"PATH": str(programs), "HOME": str(programs)}


def fenced(language: str) -> str:
    """The first block of the README in this language."""
    text = (ROOT / "README.md").read_text()
    return text.partition(f"```{language}\n")[2].partition("```\n")[0]


def test_the_wheel_has_the_extension_the_package_and_the_command(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        entries = {entry.filename: entry for entry in archive.infolist()}
    assert any(name.startswith("hprm/_hprm.") and name.endswith(".so") for name in entries)
    assert {"hprm/__init__.py", "hprm/_hprm.pyi", "hprm/py.typed"} <= set(entries)
    (command,) = [name for name in entries if name.endswith(".data/scripts/hprm")]
    assert entries[command].external_attr >> 16 & 0o111, "it can be executed"


def test_the_command_needs_no_interpreter(installed: Path, tmp_path: Path) -> None:
    told = call(installed / "hprm", "--version", cwd=tmp_path, environment={"PATH": ""}).stdout
    assert told.startswith("hprm 0.")
    with (installed / "hprm").open("rb") as file:
        assert file.read(4) == b"\x7fELF"


def test_the_import_loads_nothing_that_takes_long(installed: Path, tmp_path: Path) -> None:
    question = "import sys; old = set(sys.modules); import hprm; print(*set(sys.modules) - old)"
    answer = call(installed / "python", "-c", question, cwd=tmp_path, environment=alone(installed))
    loaded = set(answer.stdout.split())
    assert "hprm._hprm" in loaded
    assert loaded & HEAVY == set()


def test_the_program_of_the_readme_runs(installed: Path, tmp_path: Path) -> None:
    (tmp_path / "Camera.lf").write_text(fenced("lf"))
    run = call(installed / "hprm", "run", "Camera.lf", cwd=tmp_path, environment=alone(installed))
    assert run.stdout == fenced("text")


def test_new_projects_run(installed: Path, tmp_path: Path) -> None:
    environment = alone(installed)
    for name, language in (("mylf", "lf"), ("mypython", "python")):
        words = ["new", name, "--lang", language]
        call(installed / "hprm", *words, cwd=tmp_path, environment=environment)
    for line in (
        "hprm run mylf/src/Mylf.lf",
        "hprm run mypython/src/mypython/app.py",
        "python mypython/src/mypython/app.py",
    ):
        program, *words = line.split()
        run = call(installed / program, *words, cwd=tmp_path, environment=environment)
        assert run.stdout.splitlines()[0] == "[display] 0 ms: 1.0", line
