"""The folder of a package in which launch files and programs look for its files: its share.

Nothing is installed, so that is the folder of the source. But if ``data_files`` of the package's
``setup.py`` put files elsewhere than they are there, the share is a folder of links in the user's
cache: all that is in the source, and these files where an installation has them.

``setup.py`` is run for that, in another process, with a ``setuptools`` that only notes what it is
told.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import threading
from functools import cache
from pathlib import Path
from typing import Any

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


def share_of(name: str, folder: Path) -> Path:
    """Return the share of a package whose source is in a folder."""
    placed = _placed(name, folder)
    if not placed:
        return folder
    digest = hashlib.sha256(os.fspath(folder).encode()).hexdigest()[:16]
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    share = base / "hprm" / "shares" / digest / name
    try:
        _fill(share, folder, placed)
    except OSError as error:
        _warn(f"{folder}: its share cannot be made: {error}")
        return folder
    return share


def _placed(name: str, folder: Path) -> dict[str, Path]:
    """Return where in the share files are that are elsewhere in the source, and where there.

    What would be installed elsewhere than in the share does not concern it, wherever that is.
    """
    placed: dict[str, Path] = {}
    for below, sources in _data_files(folder):
        # ``share/name/../other`` is not in the share of that name.
        parts = Path(os.path.normpath(below)).parts
        if parts[:1] in (("/",), ("..",)):
            _warn(f"{folder / 'setup.py'}: data_files put nothing in {below}: that is no share")
        if parts[:2] != ("share", name):
            continue
        for source in sources:
            path = Path(os.path.normpath(folder / source))
            place = "/".join((*parts[2:], path.name))
            if not path.is_file():
                _warn(f"{folder / 'setup.py'}: data_files name {source}, which is no file")
            elif folder / place != path:
                placed[place] = path
    return placed


@cache
def _data_files(folder: Path) -> list[tuple[str, list[str]]]:
    """Return what ``setup.py`` states, once for each process."""
    file = folder / "setup.py"
    try:
        if "data_files" not in file.read_text(encoding="utf-8"):
            return []
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
    except FileNotFoundError:
        return []
    except subprocess.TimeoutExpired:
        told = {"wrong": f"1: it has not ended for {PATIENCE_S:g} s"}
    except (OSError, ValueError) as error:
        told = {"wrong": f"1: {error}"}
    if "wrong" in told:
        _warn(
            f"{file}:{told['wrong']}\n"
            "  hint: its data_files are not known so, and files are looked for where they are in"
            " the source"
        )
        return []
    return [(place, sources) for place, sources in told["files"]]


@cache
def _warn(text: str) -> None:
    """Say it once in a process, however often the share is asked for."""
    print(f"warning: {text}", file=sys.stderr)


def _fill(share: Path, folder: Path, placed: dict[str, Path]) -> None:
    """Fill a share with links; another process may do the same at the same time."""
    tree: dict[str, Any] = {}
    for place, source in placed.items():
        *above, name = place.split("/")
        below = tree
        for part in above:
            found = below.setdefault(part, {})
            # A file that has the name of a folder cannot be installed either.
            below = found if isinstance(found, dict) else {}
        below[name] = source
    _fill_folder(share, folder, tree)


def _fill_folder(share: Path, source: Path | None, tree: dict[str, Any]) -> None:
    if share.is_symlink():
        share.unlink(missing_ok=True)
    share.mkdir(parents=True, exist_ok=True)
    wanted: dict[str, Any] = {}
    if source is not None and source.is_dir():
        wanted = {it.name: it for it in source.iterdir() if not it.name.startswith(".")}
    for old in share.iterdir():
        if old.name not in wanted and old.name not in tree and not old.name.startswith("."):
            _remove(old)
    for name, it in (wanted | tree).items():
        if isinstance(it, dict):
            _fill_folder(share / name, wanted.get(name), it)
        else:
            _link(share / name, it)


def _link(link: Path, source: Path) -> None:
    """Make a link, at once: others read it meanwhile."""
    if link.is_symlink() and os.readlink(link) == os.fspath(source):
        return
    if link.is_dir() and not link.is_symlink():
        _remove(link)
    made = link.with_name(f".{link.name}.{os.getpid()}.{threading.get_ident()}")
    made.symlink_to(source)
    made.replace(link)


def _remove(old: Path) -> None:
    """Remove what was a link, or a folder of links."""
    if old.is_symlink():
        old.unlink(missing_ok=True)
    else:
        shutil.rmtree(old, ignore_errors=True)
