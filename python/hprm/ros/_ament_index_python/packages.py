"""Folders of packages, as in ``ament_index_python.packages``.

A package is looked for around the launch file that is being read, or else around the program.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hprm.ros._launch._packages import PackageError, find_package, find_share
from hprm.ros._messages.packages import program


class PackageNotFoundError(KeyError):
    """There is no such package."""

    def __str__(self) -> str:
        return str(self.args[0])


def get_package_share_directory(package_name: str, print_warning: bool = True) -> str:
    """Return the folder of a package, in which its launch files and configurations are.

    Raises ``PackageNotFoundError`` that says where it was looked for.
    """
    return _found(find_share, package_name)


def get_package_share_path(package_name: str, print_warning: bool = True) -> Path:
    """Return the folder of a package as a path."""
    return Path(get_package_share_directory(package_name))


def get_package_prefix(package_name: str) -> str:
    """Return the folder of a package's source: nothing is installed."""
    return _found(find_package, package_name)


def _found(find: Callable[[str, Path], Path], package_name: str) -> str:
    try:
        return str(find(package_name, _near()))
    except PackageError as error:
        raise PackageNotFoundError(str(error)) from None


def _near() -> Path:
    from hprm.ros._launch.launch_description_sources import reading

    return Path(reading[-1] if reading else program() or Path.cwd())
