"""Files beside a program that hide modules of Python's library: ``json.py`` hides ``json``.

What then imports that module, this package too, gets the wrong one. So this module imports nothing
that is not loaded when Python has started.
"""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import TracebackType


class HiddenModuleError(ImportError):
    """A file beside the program hides a module that this package needs."""

    def __init__(self, name: str, path: str) -> None:
        """Say which file hides the module ``name``."""
        self.file = _shown(path)
        beside = "" if _is_program(path) else " beside the program"
        self.message = f"{self.file}{beside} hides Python's module {name}"
        self.hint = f"rename {os.path.basename(path)}"
        super().__init__(f"{self.message}\n  hint: {self.hint}", name=name, path=path)


def found_in(error: BaseException) -> HiddenModuleError | None:
    """Return which file is the cause of an error, if one is that hides a module."""
    if isinstance(error, HiddenModuleError):
        return error
    for name in _suspects(error):
        path = _hiding(name)
        if path is not None:
            return HiddenModuleError(name, path)
    return None


def refuse(error: BaseException) -> None:
    """Raise ``HiddenModuleError`` if a hidden module is the cause of an error."""
    found = found_in(error)
    if found is not None:
        if sys.excepthook is sys.__excepthook__:
            sys.excepthook = _show
        raise found from None


def _show(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Show the error in a script, without the way through this package."""
    if isinstance(error, HiddenModuleError):
        print(f"error: {error}", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


def _suspects(error: BaseException) -> Iterator[str]:
    """Name the modules that an error of ``import``, or of an attribute of a module, is about."""
    asked = None
    if isinstance(error, ImportError):
        asked = error.name
    elif isinstance(error, AttributeError) and isinstance(error.obj, type(sys)):
        asked = error.obj.__name__
    if asked is None:
        return
    asked = asked.partition(".")[0]
    yield asked
    trace = error.__traceback__ if asked == "hprm" else None
    while trace is not None:
        # A file that imports this package, and that this package has imported as the library's.
        name = trace.tb_frame.f_globals.get("__name__")
        if isinstance(name, str):
            yield name
        trace = trace.tb_next


def _hiding(name: str) -> str | None:
    """Return the file beside the program that hides a module of the library."""
    if name not in sys.stdlib_module_names:
        return None
    loaded = sys.modules.get(name)
    path = getattr(loaded, "__file__", None)
    if loaded is not None and path is None:
        # It is a part of the interpreter.
        return None
    for folder in _folders():
        for file in (f"{name}.py", os.path.join(name, "__init__.py")):
            hiding = os.path.join(folder, file)
            if os.path.isfile(hiding) and (path is None or os.path.abspath(path) == hiding):
                return hiding
    return None


def _folders() -> list[str]:
    """Return the folders in which Python looks before it looks in its library."""
    script = getattr(sys.modules.get("__main__"), "__file__", None) or ""
    every = [os.path.abspath(it) for it in sys.path]
    some = (*every[:1], os.path.dirname(os.path.abspath(script)), os.getcwd())
    return [it for it in some if it in every and it != os.path.dirname(os.__file__)]


def _is_program(path: str) -> bool:
    script = getattr(sys.modules.get("__main__"), "__file__", None)
    return path in [os.path.abspath(it) for it in (script, *sys.argv) if it]


def _shown(path: str) -> str:
    return path.removeprefix(os.getcwd() + os.sep)
