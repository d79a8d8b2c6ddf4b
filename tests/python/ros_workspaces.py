"""A workspace of ROS with a package of users, for tests of launch files."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from hprm.ros._launch import LaunchPlan, ProcessPlan
from hprm.ros._launch._plans import Parameters


def demo_package(folder: Path) -> Path:
    """Make a package `demo` in a workspace, with programs and a folder of launch files."""
    demo = folder / "ws" / "src" / "demo"
    (demo / "demo").mkdir(parents=True)
    (demo / "launch").mkdir()
    (demo / "config").mkdir()
    (demo / "package.xml").write_text("<package><name>demo</name></package>")
    for name in ("talker", "listener"):
        (demo / "demo" / f"{name}.py").write_text("def main(): pass\n")
    return demo


def assert_same_actions(plan: LaunchPlan, launch: Path, typed: list[Parameters]) -> None:
    """Look at what the files of different forms come to, which have the same actions.

    ``typed`` are the parameters of one form alone, which stand before the last ones.
    """
    talker, ear = plan.nodes
    assert (talker.executable, talker.namespace, talker.parameters) == ("talker", None, [])
    assert (ear.name, ear.namespace, ear.output) == ("ear", "/r5", "screen")
    assert ear.arguments == ["--say", "5 times", "-v", "--ros-args", "--log-level", "info", "--"]
    assert ear.environment == {"HPRM_TEST": "1", "X": "2"}
    assert ear.remappings == [("a", "b"), ("c", "d")]
    assert ear.parameters == [
        *({"all": 1}, {"rate": 5}, {"text": "5"}, {"list": [1, 2]}, *typed),
        *({"deep.down": True}, launch / "p.yaml"),
    ]
    echo = plan.processes[-1]
    assert isinstance(echo, ProcessPlan)
    assert (echo.command, echo.name, echo.delay) == (["echo", "2", "x"], "e", 1.5)
    assert plan.messages == [f"at {launch}"]
    assert [one.name for one in plan.arguments] == ["rate", "which"]


@contextmanager
def no_modules_of_launch() -> Iterator[None]:
    """Let launch files import what is theirs: the benchmarks have a module `launch`, too."""
    before = _modules_of_launch()
    for name in before:
        del sys.modules[name]
    try:
        yield
    finally:
        for name in _modules_of_launch():
            del sys.modules[name]
        sys.modules.update(before)


def _modules_of_launch() -> dict[str, ModuleType]:
    names = ("launch", "launch_ros", "launch_xml", "launch_yaml", "ament_index_python")
    return {name: it for name, it in sys.modules.items() if name.partition(".")[0] in names}
