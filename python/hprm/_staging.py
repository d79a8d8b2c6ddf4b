"""Where a program finds its ``files:``: side by side, in the folder of ``__file__``.

Lingua Franca copies them there. Here that folder has links, and what is imported from it is
compiled under the name of the file itself, so that tracebacks name a file that outlives the run.
"""

import atexit
import importlib.machinery
import os
import sys
import threading
from types import CodeType

from hprm import _hprm
from hprm._source import ProgramSource

#: The environment variable that names a stage; federates use their launcher's.
STAGE = "HPRM_STAGE"

# Federates that share a process load at the same time.
_STAGING = threading.Lock()


def folder(source: ProgramSource) -> str | None:
    """Return the folder with the files of a program, if they do not lie beside it already."""
    path = os.path.abspath(source.path)
    with _STAGING:
        known = os.environ.get(STAGE)
        if known and _hprm.is_stage_of(known, path):
            return known
        stage = _hprm.stage_files(path, source.uses) if source.uses else None
        if stage is None:
            return None
        # It runs after what the program itself registers, which may still read its files.
        atexit.register(_remove, stage, os.getpid())
        made = os.environ[STAGE] = str(stage.path)
        return made


def _remove(stage: _hprm.Stage, owner: int) -> None:
    """Remove a stage, unless this is a process that its owner has forked."""
    if os.getpid() == owner:
        stage.remove()


def import_from(stage: str) -> None:
    """Let modules be imported from a stage, before others of their names."""
    sys.path_hooks.insert(0, _hook(stage))
    sys.path_importer_cache.pop(stage, None)


class _Loader(importlib.machinery.SourceFileLoader):
    """Loads a module whose file is behind a link. Its ``__file__`` is on the stage."""

    def get_code(self, fullname: str) -> CodeType | None:
        """Return the code, under the name of the file itself, beside which it is cached."""
        real = os.path.realpath(self.get_filename(fullname))
        return importlib.machinery.SourceFileLoader(fullname, real).get_code(fullname)


def _hook(stage: str):  # type: ignore[no-untyped-def]
    suffixes = importlib.machinery.SOURCE_SUFFIXES
    finder = importlib.machinery.FileFinder.path_hook(
        (importlib.machinery.ExtensionFileLoader, importlib.machinery.EXTENSION_SUFFIXES),
        (_Loader, suffixes),
    )

    def find_on_stage(path: str) -> object:
        if path != stage and not path.startswith(stage + os.sep):
            raise ImportError(f"{path} is not on the stage")
        return finder(path)

    return find_on_stage
