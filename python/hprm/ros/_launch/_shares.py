"""The folder of a package in which launch files and programs look for its files: its share.

Nothing is installed, so that is the folder of the source. But if ``data_files`` of the package put
files elsewhere than they are there, the share is a folder of links in the user's cache: all that is
in the source, and these files where an installation has them.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import threading
from pathlib import Path
from typing import Any

from hprm.ros._launch._data_files import stated, warn


def share_of(name: str, folder: Path) -> Path:
    """Return the share of a package whose source is in a folder."""
    digest = hashlib.sha256(os.fspath(folder).encode()).hexdigest()[:16]
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    own = base / "hprm" / "shares" / digest
    placed = _placed(name, folder, own)
    if not placed:
        return folder
    share = own / name
    try:
        _fill(share, folder, placed)
    except OSError as error:
        warn(f"{folder}: its share cannot be made: {error}")
        return folder
    return share


def _placed(name: str, folder: Path, own: Path) -> dict[str, Path]:
    """Return where in the share files are that are elsewhere in the source, and where there.

    What would be installed elsewhere than in the share does not concern it, wherever that is.
    """
    placed: dict[str, Path] = {}
    file, places = stated(folder, own)
    for below, sources in places:
        # ``share/name/../other`` is not in the share of that name.
        parts = Path(os.path.normpath(below)).parts
        if parts[:1] in (("/",), ("..",)):
            warn(f"{file}: data_files put nothing in {below}: that is no share")
        if parts[:2] != ("share", name):
            continue
        for source in sources:
            path = Path(os.path.normpath(folder / source))
            place = "/".join((*parts[2:], path.name))
            if not path.is_file():
                warn(f"{file}: data_files name {source}, which is no file")
            elif folder / place != path:
                placed[place] = path
    return placed


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
