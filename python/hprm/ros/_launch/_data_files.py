"""What ``data_files`` of a package state: which files an installation puts where.

``setup.py`` states them, or ``setup.cfg`` under ``[options.data_files]``, if ``setup.py`` does not.

``setup.py`` is run for that, in another process, with a ``setuptools`` that only notes what it is
told; once for all processes of a launch, which share what it has told. The next launch runs it
again, because what it tells may depend on which other files there are.
"""

from __future__ import annotations

import configparser
import contextlib
import fcntl
import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from glob import glob
from pathlib import Path
from typing import Any

from hprm.ros._meeting import LAUNCH

#: Where files are put, and which.
Places = list[tuple[str, list[str]]]

#: For how many seconds a ``setup.py`` may run.
PATIENCE_S = 10.0

_READS = """\
import importlib.abc, importlib.machinery, json, runpy, sys, traceback

TOPS = ("setuptools", "distutils")
told = {"files": []}


class Anything:
    def __init__(self, *arguments, **named):
        pass


def setup(*, data_files=None, **others):
    for each in data_files or ():
        if not isinstance(each, str):
            place, sources = each
            told["files"].append([str(place), [str(it) for it in sources]])


def find_packages(*arguments, **named):
    return []


class Stands(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in TOPS:
            return importlib.machinery.ModuleSpec(name, self, is_package=True)

    def exec_module(self, module):
        known = {"setup": setup, "find_packages": find_packages}
        known["find_namespace_packages"] = find_packages

        def lookup(name):
            if name.startswith("__"):
                raise AttributeError(name)
            return known.get(name, type(name, (Anything,), {}))

        module.__getattr__ = lookup


sys.meta_path.insert(0, Stands())
sys.argv = ["setup.py"]
sys.path.insert(0, "")
try:
    runpy.run_path("setup.py", run_name="__main__")
except BaseException as error:
    frames = [it for it in traceback.extract_tb(error.__traceback__) if it.filename == "setup.py"]
    line = frames[-1].lineno if frames else getattr(error, "lineno", None) or 1
    told = {"wrong": f"{line}: {type(error).__name__}: {error}"}
print()
print(json.dumps(told))
"""

_SECTION = "options.data_files"
_PATTERN = set("*?[]{}")


@cache
def stated(folder: Path, own: Path) -> tuple[Path, Places]:
    """Return which file of a package states what, once for each process.

    ``own`` is the folder of this package in the user's cache.
    """
    places = _of_script(folder, own)
    return (folder / "setup.py", places) if places else (folder / "setup.cfg", _of_cfg(folder))


@cache
def warn(text: str) -> None:
    """Say it once in a process, however often the share is asked for."""
    print(f"warning: {text}", file=sys.stderr)


def _warn_of(file: Path, wrong: str) -> None:
    warn(
        f"{file}:{wrong}\n"
        "  hint: its data_files are not known so, and files are looked for where they are in"
        " the source"
    )


# ``setup.py``.


def _of_script(folder: Path, own: Path) -> Places:
    file = folder / "setup.py"
    try:
        text = file.read_bytes()
        if b"data_files" not in text:
            return []
        # What a process does not know of may be in another launch.
        key = [os.environ.get(LAUNCH), sys.executable, os.stat(file).st_mtime_ns]
        key.append(hashlib.sha256(text).hexdigest())
    except OSError as error:
        if not isinstance(error, FileNotFoundError):
            _warn_of(file, f"1: {error}")
        return []
    told = _told(folder, own, key)
    if "wrong" in told:
        _warn_of(file, told["wrong"])
        return []
    return [(place, sources) for place, sources in told["files"]]


def _told(folder: Path, own: Path, key: list[Any]) -> dict[str, Any]:
    """Return what ``setup.py`` tells, which another process of the launch may know already."""
    noted = own / ".setup.json"
    if key[0] is None:
        return _run(folder)
    with _locked(own):
        with contextlib.suppress(OSError, ValueError, TypeError):
            known, told = json.loads(noted.read_bytes())
            if known == key:
                return dict(told)
        told = _run(folder)
        # Others never read half of it. Without a cache, each process runs the script.
        draft = noted.with_name(f"{noted.name}.{os.getpid()}")
        with contextlib.suppress(OSError):
            draft.write_text(json.dumps([key, told]))
            draft.replace(noted)
        return told


@contextlib.contextmanager
def _locked(own: Path) -> Iterator[None]:
    """Have other processes wait that want to run the same script, if there is a place for that."""
    with contextlib.ExitStack() as open_files:
        with contextlib.suppress(OSError):
            own.mkdir(parents=True, exist_ok=True)
            lock = open_files.enter_context((own / ".lock").open("wb"))
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _run(folder: Path) -> dict[str, Any]:
    try:
        done = subprocess.run(
            [sys.executable, "-c", _READS],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=PATIENCE_S,
            check=False,
        )
        lines = done.stdout.decode(errors="replace").splitlines()
        told: dict[str, Any] = json.loads(lines[-1]) if lines else {"wrong": "1: it ends early"}
        return told
    except subprocess.TimeoutExpired:
        return {"wrong": f"1: it has not ended for {PATIENCE_S:g} s"}
    except (OSError, ValueError) as error:
        return {"wrong": f"1: {error}"}


# ``setup.cfg``, as setuptools reads it.


def _of_cfg(folder: Path) -> Places:
    file = folder / "setup.cfg"
    parser = configparser.RawConfigParser()
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    try:
        text = file.read_text(encoding="utf-8")
        if _SECTION not in text:
            return []
        parser.read_string(text, "setup.cfg")
        section = dict(parser.items(_SECTION)) if parser.has_section(_SECTION) else {}
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError, configparser.Error) as error:
        _warn_of(file, f"{getattr(error, 'lineno', None) or 1}: {error}")
        return []
    return [(place, _files(folder, value)) for place, value in section.items()]


def _files(folder: Path, value: str) -> list[str]:
    """Return the files of a place: one a line, or with commas between them; patterns are filled."""
    words = value.splitlines() if "\n" in value else value.split(",")
    files: list[str] = []
    for word in filter(None, map(str.strip, words)):
        if _PATTERN.isdisjoint(word):
            files.append(word)
        else:
            files += sorted(glob(word, root_dir=folder, recursive=True))
    return files
