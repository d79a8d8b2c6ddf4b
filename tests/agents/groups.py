"""Control groups (cgroups v2) for agents in tests, where the system lets a test have some."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

CONTROLLERS = "+memory +pids"

#: Has a shell move into a group before it becomes a program.
ENTER = 'echo $$ > "$0/cgroup.procs" && exec "$@"'

#: A group of its own from the systemd of the user, with controllers.
SCOPE = ["systemd-run", "--user", "--scope", "--quiet", "-p", "Delegate=yes", "--"]


@dataclass
class Groups:
    """Groups in which a test starts agents: each in one of its own."""

    #: Where they are; none if systemd makes them.
    folder: Path | None
    made: list[Path] = field(default_factory=list)

    def entered(self, command: list[str]) -> list[str]:
        """A command line that runs a command in a new group."""
        if self.folder is None:
            return [*SCOPE, *command]
        group = self.folder / f"agent-{len(self.made)}"
        group.mkdir()
        self.made.append(group)
        return ["sh", "-c", ENTER, str(group), *command]

    def of(self, pid: int) -> Path:
        """The group of a process."""
        return own_mount() / group_of(pid).lstrip("/")

    def close(self) -> None:
        """Removes them, and ends what is in them."""
        if self.folder is not None:
            with contextlib.suppress(OSError):
                (self.folder / "cgroup.kill").write_text("1")
            remove(self.folder)


def open_groups() -> Groups | str:
    """Groups for a test, or why there are none."""
    why = "this system has no cgroups of version 2"
    with contextlib.suppress(LookupError):
        made = make(own_mount() / group_of(os.getpid()).lstrip("/"))
        if isinstance(made, Groups):
            return made
        why = made
    if shutil.which(SCOPE[0]):
        probe = [*SCOPE, "sh", "-c", "grep -q : /proc/self/cgroup"]
        if subprocess.run(probe, capture_output=True, timeout=30).returncode == 0:
            return Groups(None)
    return why


def make(own: Path) -> Groups | str:
    """Makes a group below that of this process, whose groups have the controllers."""
    folder = own / f"hprm-test-{os.getpid()}"
    try:
        if not {"memory", "pids"} <= set((own / "cgroup.controllers").read_text().split()):
            return f"{own} has no controllers for memory and pids"
        folder.mkdir()
        (own / "cgroup.subtree_control").write_text(CONTROLLERS)
        (folder / "cgroup.subtree_control").write_text(CONTROLLERS)
    except OSError as error:
        remove(folder)
        if error.errno == errno.EBUSY:
            return f"other processes are in {own}"
        return f"no group can be made in {own}: {error.strerror}"
    return Groups(folder)


def own_mount() -> Path:
    """Where the file system of cgroups is."""
    for line in Path("/proc/self/mountinfo").read_text().splitlines():
        fields, system = line.split(" - ")
        if system.split()[0] == "cgroup2":
            return Path(fields.split()[4])
    raise LookupError("there is none")


def group_of(pid: int) -> str:
    """The group of a process, from the root of all groups on."""
    for line in Path(f"/proc/{pid}/cgroup").read_text().splitlines():
        if line.startswith("0::"):
            return line[3:]
    raise LookupError("it has none")


def remove(group: Path) -> None:
    """Removes a group and those below it, as far as nothing is in them."""
    for inner in sorted(group.rglob("*/"), reverse=True):
        with contextlib.suppress(OSError):
            inner.rmdir()
    with contextlib.suppress(OSError):
        group.rmdir()
