"""The build backend of the package: maturin, and the command `hprm` beside the extension.

maturin compiles one crate. So it is given a program in the place of cargo, `cargo.py`, which builds
the command in the same run of cargo, for the same target, and puts it where maturin finds scripts.
What a wheel is, is maturin's subject.

Wheels have all features of the command: diagrams, the screen of `hprm top`, simulation, TLS,
completions and manual pages. Their crates take minutes to compile; a build of a checkout has them
if the environment variable HPRM_WHOLE is 1. Otherwise it is not optimized when it is linked either,
which takes a fifth of the time, and makes small messages a twentieth slower.
"""

from __future__ import annotations

import fcntl
import os
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import maturin
from maturin import (
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

HERE = Path(__file__).resolve().parent
Settings = Mapping[str, Any] | None


def build_wheel(directory: str, settings: Settings = None, metadata: str | None = None) -> str:
    """Build a wheel of the extension, the package and the command."""
    with _both_crates({"HPRM_WHOLE": "1"}) as scripts:
        wheel = maturin.build_wheel(directory, settings, metadata)
        _expect_command(scripts)
    return wheel


def build_editable(directory: str, settings: Settings = None, metadata: str | None = None) -> str:
    """Build a wheel that refers to the package where it is, with the command of today."""
    with _both_crates() as scripts:
        wheel = maturin.build_editable(directory, settings, metadata)
        _expect_command(scripts)
    return wheel


def build_sdist(directory: str, settings: Settings = None) -> str:
    """Pack the sources."""
    _data()
    return maturin.build_sdist(directory, settings)


def prepare_metadata_for_build_wheel(directory: str, settings: Settings = None) -> str:
    """Write what the wheel will say of itself."""
    _data()
    return maturin.prepare_metadata_for_build_wheel(directory, settings)


prepare_metadata_for_build_editable = prepare_metadata_for_build_wheel


@contextmanager
def _both_crates(variables: Mapping[str, str] | None = None) -> Iterator[Path]:
    """Have maturin call `cargo.py`, which leaves the command in the folder that is returned."""
    data = _data()
    scripts = data / "scripts"
    # Two builds of one checkout take turns: the folder is one.
    lock = data.with_name(f"{data.name}.lock").open("w")
    fcntl.flock(lock, fcntl.LOCK_EX)
    # A command of an earlier build is not taken for this one's.
    shutil.rmtree(scripts, ignore_errors=True)
    scripts.mkdir()
    with tempfile.TemporaryDirectory(prefix="hprm-build-") as folder:
        # A script, because maturin wants one file; the interpreter need not be on the PATH.
        program = Path(folder, "cargo")
        words = [sys.executable, str(HERE / "cargo.py")]
        program.write_text(f'#!/bin/sh\nexec {shlex.join(words)} "$@"\n')
        program.chmod(0o755)
        ours = {"CARGO": str(program), "HPRM_SCRIPTS": str(scripts), **(variables or {})}
        stated = {name: os.environ.get(name) for name in ours}
        os.environ |= ours
        try:
            yield scripts
        finally:
            for name, value in stated.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value
            lock.close()


def _data() -> Path:
    """The folder of other files of the wheel; maturin expects that it exists."""
    data = Path(maturin.get_config()["data"])
    data.mkdir(parents=True, exist_ok=True)
    return data.resolve()


def _expect_command(scripts: Path) -> None:
    if not (scripts / "hprm").is_file():
        sys.exit(
            "error: the wheel has no command, because maturin has not built it with `cargo rustc`\n"
            "  hint: use the version of maturin that requirements-build.txt names"
        )
