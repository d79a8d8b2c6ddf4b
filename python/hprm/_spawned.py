"""The main module of a program in a process that ``multiprocessing`` has started, ``__mp_main__``.

Preambles of ``.lf`` files run there, so what they define can be called there and sent to and fro.
Of a program of Python objects, its file is found there under the name that it was imported as.
Reactors stay where they are.
"""

import importlib.machinery
import importlib.util
import sys
from collections.abc import Callable, Sequence
from types import CodeType, ModuleType
from typing import Any, cast

from hprm import _hprm, _lf, _main, _module_names
from hprm._uncached import UncachedLoader

#: Nothing lies below this module, but only a package is asked for modules below it.
__path__: list[str] = []

_CODE = compile(f"__import__('sys').modules[{__name__!r}].fill(globals())", __file__, "exec")

#: Files that were imported under names that Python does not give them.
_files: dict[str, str] = {}


def fill(names: dict[str, Any]) -> None:
    """Run the preambles of the program whose main module has these ``names``."""
    source = _hprm.describe_program(names["__spec__"].origin)
    _main.prepare(source, _lf.make_module(cast("_hprm.Api", _Elsewhere()), source), names)


class _Elsewhere:
    """Stands for the runtime of the program, which is in another process."""

    def __getattr__(self, name: str) -> Callable[..., Any]:
        def refuse(*_arguments: object) -> Any:
            raise RuntimeError(
                "this needs the runtime of the program, and the process was started by "
                "multiprocessing: lf knows of times and tags only where reactions run"
            )

        return refuse


class _Loader:
    """Has ``runpy``, which multiprocessing uses, run the preambles."""

    @staticmethod
    def get_code(_name: str) -> CodeType:
        return _CODE


class _FileLoader:
    """Has ``runpy`` run nothing: the file is imported when it is needed."""

    @staticmethod
    def get_code(_name: str) -> CodeType:
        return compile("", __file__, "exec")


class _Finder:
    """Finds the modules whose names carry a path, and those of the files there."""

    @staticmethod
    def find_spec(
        name: str, _path: Sequence[str] | None = None, _target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if name in _files:
            loader = UncachedLoader(name, _files[name])
            return importlib.util.spec_from_file_location(name, _files[name], loader=loader)
        file = _module_names.path_in(name)
        if file is not None:
            _files[_module_names.of_file(file)[1]] = file
            spec = importlib.machinery.ModuleSpec(name, None, origin=file)
            spec.loader = _FileLoader()  # type: ignore[assignment]
            return spec
        path = _main.path_in(name)
        if path is None:
            return None
        spec = _main.spec(path)
        spec.loader = _Loader()  # type: ignore[assignment]
        return spec


sys.meta_path.append(_Finder)
