"""The main module of a program in a process that ``multiprocessing`` has started, ``__mp_main__``.

Preambles of files run there, so what they define can be called there and sent to and fro. Reactors
stay where they are.
"""

import importlib.machinery
import sys
from collections.abc import Callable, Sequence
from types import CodeType, ModuleType
from typing import Any, cast

from hprm import _hprm, _lf, _main

#: Nothing lies below this module, but only a package is asked for modules below it.
__path__: list[str] = []

_CODE = compile(f"__import__('sys').modules[{__name__!r}].fill(globals())", __file__, "exec")


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


class _Finder:
    """Finds the modules whose names carry a path."""

    @staticmethod
    def find_spec(
        name: str, _path: Sequence[str] | None = None, _target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        path = _main.path_in(name)
        if path is None:
            return None
        spec = _main.spec(path)
        spec.loader = _Loader()  # type: ignore[assignment]
        return spec


sys.meta_path.append(_Finder)
