"""Where launch descriptions come from, as in ``launch.launch_description_sources``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from hprm._uncached import UncachedLoader
from hprm.ros import _aliases
from hprm.ros._launch._entities import (
    LaunchContext,
    LaunchDescription,
    SomeText,
    normalized,
    perform,
)
from hprm.ros._launch._plans import LaunchError

_FUNCTION = "generate_launch_description"

#: The launch files whose code runs, the innermost one last: packages are looked for around it.
reading: list[Path] = []


@contextmanager
def being_read(path: Path | None) -> Iterator[None]:
    """Have packages looked for around a launch file while its code runs."""
    if path is None:
        yield
        return
    reading.append(path)
    try:
        yield
    finally:
        reading.pop()


class InvalidLaunchFileError(LaunchError):
    """A file is no launch file."""


class InvalidPythonLaunchFileError(InvalidLaunchFileError):
    """A file in Python has no function that makes a launch description."""


class LaunchDescriptionSource:
    """What gives a launch description."""

    def __init__(self, launch_description: LaunchDescription) -> None:
        """Take a description that exists already."""
        self._description = launch_description

    @property
    def location(self) -> SomeText | None:
        """What states the file, if there is one."""
        return None

    def path(self, context: LaunchContext) -> Path | None:
        """Return the file that it comes from, if there is one."""
        return None

    def get_launch_description(self, context: LaunchContext) -> LaunchDescription:
        """Return the description."""
        return self._description


class AnyLaunchDescriptionSource(LaunchDescriptionSource):
    """A launch file in Python, XML or YAML, as its name says."""

    def __init__(self, launch_file_path: SomeText) -> None:
        """Take the path; a relative one begins at the launch file that includes it."""
        self._path = normalized(launch_file_path)

    @property
    def location(self) -> SomeText:
        """What states the file."""
        return self._path

    def path(self, context: LaunchContext) -> Path:
        """Return the path of the file."""
        return (context.folder / perform(context, self._path)).resolve()

    def get_launch_description(self, context: LaunchContext) -> LaunchDescription:
        """Read the file."""
        return load(self.path(context))


class PythonLaunchDescriptionSource(AnyLaunchDescriptionSource):
    """A launch file in Python."""


class FrontendLaunchDescriptionSource(AnyLaunchDescriptionSource):
    """A launch file in XML or YAML."""


def load(path: Path) -> LaunchDescription:
    """Return the description of a launch file; raise ``LaunchError`` if it has none."""
    if not path.is_file():
        raise LaunchError(f"there is no launch file {path}")
    if path.suffix == ".py":
        with being_read(path):
            return get_launch_description_from_python_launch_file(str(path))
    if path.suffix in (".yaml", ".yml"):
        from hprm.ros._launch._yaml import description_of_yaml

        return description_of_yaml(path)
    if path.suffix in (".xml", ".launch"):
        from hprm.ros._launch._xml import description_of_xml

        return description_of_xml(path)
    raise InvalidLaunchFileError(
        f"{path}: launch files in {path.suffix or 'this form'} are not supported: "
        "write it in Python (.py), XML (.xml) or YAML (.yaml)"
    )


def load_python_launch_file_as_module(python_launch_file_path: str) -> ModuleType:
    """Execute a launch file, and return it as a module."""
    _aliases.install()
    loader = UncachedLoader("python_launch_file", python_launch_file_path)
    spec = spec_from_file_location("python_launch_file", python_launch_file_path, loader=loader)
    if spec is None or spec.loader is None:
        raise InvalidPythonLaunchFileError(f"{python_launch_file_path} is no module")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def get_launch_description_from_python_launch_file(
    python_launch_file_path: str,
) -> LaunchDescription:
    """Return what the function ``generate_launch_description`` of a launch file returns."""
    module = load_python_launch_file_as_module(python_launch_file_path)
    function: Any = getattr(module, _FUNCTION, None)
    if function is None:
        raise InvalidPythonLaunchFileError(
            f"{python_launch_file_path} has no function {_FUNCTION}()"
        )
    description = function()
    if not isinstance(description, LaunchDescription):
        raise InvalidPythonLaunchFileError(
            f"{python_launch_file_path}: {_FUNCTION}() returns {description!r}, "
            "and no LaunchDescription"
        )
    return description


def get_launch_description_from_any_launch_file(launch_file_path: str) -> LaunchDescription:
    """Return the description of a launch file in Python, XML or YAML."""
    return load(Path(launch_file_path))
