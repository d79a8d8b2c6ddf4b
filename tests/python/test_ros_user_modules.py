"""Modules of packages in a workspace, which nothing has installed, are there for programs."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import Bench, finish

NODE = """\
import my_nodes.shapes
from my_nodes import shapes as same
from tools.deep.saw import cut
from tools.msg import Cut

def main():
    print(my_nodes.shapes is same, my_nodes.shapes.area(2), cut(3), Cut(depth=4).depth)
    try:
        import tools.missing
    except ModuleNotFoundError as error:
        print(error.name)

if __name__ == "__main__":
    main()
"""


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """Make a package with a program, beside a folder with another one."""
    nodes, tools = tmp_path / "src" / "my_nodes", tmp_path / "src" / "group" / "the_tools"
    for folder in (nodes / "my_nodes", tools / "tools" / "deep", tools / "msg"):
        folder.mkdir(parents=True)
    for folder in (nodes / "my_nodes", tools / "tools", tools / "tools" / "deep"):
        (folder / "__init__.py").touch()
    (nodes / "my_nodes" / "node.py").write_text(NODE)
    (nodes / "my_nodes" / "shapes.py").write_text("def area(side): return side * side\n")
    (nodes / "setup.py").write_text("entry = 'show = my_nodes.node:main'\n")
    (tools / "tools" / "deep" / "saw.py").write_text("def cut(depth): return depth\n")
    (tools / "package.xml").write_text("<package><name>tools</name></package>")
    (tools / "msg" / "Cut.msg").write_text("int32 depth\n")
    return tmp_path


def test_a_script_imports_modules_of_its_package_and_of_others(
    workspace: Path, bench: Bench
) -> None:
    outcome = finish(bench.call("ros", "run", "src/my_nodes/my_nodes/node.py"))
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.splitlines() == ["True 4 3 4", "tools.missing"]


def test_so_does_an_entry_point_that_a_launch_file_starts(workspace: Path, bench: Bench) -> None:
    (workspace / "src" / "my_nodes" / "show.launch.py").write_text(
        "from launch import LaunchDescription\n"
        "from launch_ros.actions import Node\n"
        "def generate_launch_description():\n"
        "    return LaunchDescription([Node(package='my_nodes', executable='show')])\n"
    )
    outcome = finish(bench.call("launch", "src/my_nodes/show.launch.py"))
    assert outcome.code == 0, outcome.err
    assert "True 4 3 4" in outcome.out, outcome.out


def test_what_is_installed_goes_first(workspace: Path, bench: Bench) -> None:
    folder = workspace / "src" / "my_nodes" / "json"
    folder.mkdir()
    (folder / "__init__.py").write_text("raise SystemExit('not this one')\n")
    (workspace / "src" / "my_nodes" / "my_nodes" / "node.py").write_text(
        "import json\nprint(json.dumps([1]))\n"
    )
    outcome = finish(bench.call("ros", "run", "src/my_nodes/my_nodes/node.py"))
    assert (outcome.code, outcome.out) == (0, "[1]\n"), outcome.err
