"""Texts that are known from packages and parameters, as in ``launch_ros.substitutions``."""

from __future__ import annotations

from hprm.ros._launch._entities import (
    LaunchContext,
    SomeText,
    Substitution,
    described,
    normalized,
    perform,
)
from hprm.ros._launch._packages import find_package, find_program, find_share
from hprm.ros._launch.substitutions import PathJoinSubstitution, SubstitutionFailure


class FindPackageShare(Substitution):
    """The folder of a package, in which its launch files and configurations are."""

    def __init__(self, package: SomeText) -> None:
        """Take the package."""
        self.package = normalized(package)

    def perform(self, context: LaunchContext) -> str:
        """Return the folder; raise ``PackageError`` if there is none."""
        return str(find_share(perform(context, self.package), context.folder))

    def find(self, package_name: str) -> str:
        """Return the folder of a package, as seen from the working folder."""
        return self.perform(LaunchContext())

    def __truediv__(self, other: SomeText) -> PathJoinSubstitution:
        return PathJoinSubstitution([self, other])


class FindPackagePrefix(FindPackageShare):
    """The folder of a package's source: nothing is installed."""

    def perform(self, context: LaunchContext) -> str:
        """Return the folder; raise ``PackageError`` if there is none."""
        return str(find_package(perform(context, self.package), context.folder))


FindPackage = FindPackageShare


class ExecutableInPackage(Substitution):
    """The path of a program of a package."""

    def __init__(self, executable: SomeText, package: SomeText) -> None:
        """Take program and package."""
        self.executable, self.package = normalized(executable), normalized(package)

    def describe(self) -> str:
        """Return what it is, as ``launch_ros`` does."""
        return f"ExecInPkg(pkg={described(self.package)}, exec={described(self.executable)})"

    def perform(self, context: LaunchContext) -> str:
        """Return the path; raise ``PackageError`` if there is none."""
        package = perform(context, self.package)
        return str(find_program(package, perform(context, self.executable), context.folder).script)


class Parameter(Substitution):
    """The value of a parameter that ``SetParameter`` has set."""

    def __init__(self, name: SomeText, *, default: SomeText | None = None) -> None:
        """Take the name, and what counts if there is no value."""
        self.name = normalized(name)
        self._default = default

    def perform(self, context: LaunchContext) -> str:
        """Return the value; raise ``SubstitutionFailure`` if there is none."""
        name = perform(context, self.name)
        for each in reversed(context.parameters):
            if isinstance(each, tuple) and each[0] == name:
                return str(each[1])
        if self._default is None:
            raise SubstitutionFailure(f"the parameter '{name}' is not set")
        return perform(context, self._default)
