"""Under which name the file of a program is imported, and from which folder.

The name is the same in all processes of a program: what they pickle carries it. It is that of the
file, as ``import`` has it, except where Python would take that for another thing: a dot for the end
of a package, and ``__main__`` for the script that runs. A process that ``multiprocessing`` starts
is told the path of such a file, for ``hprm._spawned`` to read.
"""

from __future__ import annotations

import importlib.machinery
import importlib.util
import os
import sys

_SCRIPT = "__main__"
_PREFIX = "hprm._spawned.file_"


def of_file(file: str) -> tuple[str, str]:
    """Return the folder from which a file is imported, and the name of its module there.

    A file in a package is a module of it.
    """
    folder, base = os.path.split(os.path.abspath(file))
    name = _without_dots(base.removesuffix(".py"))
    if name == _SCRIPT and not _is_package(folder):
        return folder, _of_folder(folder)
    while _is_package(folder):
        folder, package = os.path.split(folder)
        name = f"{package}.{name}"
    return folder, name


def tell_processes(file: str) -> None:
    """Let processes that are yet to come find the module of a file that has not the file's name."""
    path = os.path.abspath(file)
    name = of_file(path)[1].rpartition(".")[2]
    main = sys.modules.get(_SCRIPT)
    known = getattr(main, "__spec__", None)
    if main is None or known is None or known.name != f"hprm.{_SCRIPT}":
        return
    if name != os.path.basename(path).removesuffix(".py"):
        called = _PREFIX + os.fsencode(path).hex()
        main.__spec__ = importlib.machinery.ModuleSpec(called, None, origin=path)


def path_in(name: str) -> str | None:
    """Return the path that such a process is told, if ``name`` is one."""
    if not name.startswith(_PREFIX):
        return None
    return os.fsdecode(bytes.fromhex(name.removeprefix(_PREFIX)))


def is_called(cls: str, module: str) -> bool:
    """Tell whether a class has the name of its module, but for case and signs between words."""
    stem = module.rpartition(".")[2].replace("_", "").replace("-", "")
    return cls.lower() in ("main", stem.lower())


def _is_package(folder: str) -> bool:
    """Tell whether files in a folder are modules of a package; a dot is in no name of one."""
    return os.path.isfile(os.path.join(folder, "__init__.py")) and (
        "." not in os.path.basename(folder)
    )


def _of_folder(folder: str) -> str:
    """Return the name of the ``__main__.py`` of a folder without an ``__init__.py``.

    It is a module of the package that the folder is for ``python -m``, if Python finds no other
    thing under that name.
    """
    parent, package = os.path.split(folder)
    if package and "." not in package:
        if parent not in sys.path:
            # Behind all that is there, so that it hides nothing.
            sys.path.append(parent)
        if folder in _places_of(package):
            return f"{package}.{_SCRIPT}"
    return f"{_without_dots(package)}-main"


def _places_of(package: str) -> list[str]:
    """Return the folders of a package that has no ``__init__.py``."""
    try:
        spec = importlib.util.find_spec(package)
    except ValueError:
        return []
    if spec is None or spec.origin is not None:
        return []
    return [os.path.abspath(place) for place in spec.submodule_search_locations or []]


def _without_dots(name: str) -> str:
    """Return a name that no statement can import, so it hides no module that is beside the file."""
    return name.replace(".", "-")
