"""Where the files of a package are that its ``data_files`` put elsewhere."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from processes import Bench, finish
from ros_workspaces import demo_package

from hprm.ros._launch import _data_files
from hprm.ros._launch._packages import find_package, find_share

SETUP = """\
import os
from glob import glob
from setuptools import Command, find_packages, setup
from setuptools.command.build_py import build_py

package_name = "demo"
print("of the script")


class Builds(build_py, Command):
    def run(self):
        build_py.run(self)


setup(
    name=package_name,
    packages=find_packages(exclude=["test"]),
    cmdclass={"build_py": Builds},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
        (os.path.join("share", package_name, "launch"), glob("launch/*.launch.py")),
MORE
    ],
    entry_points={"console_scripts": ["talker = demo.talker:main"]},
)
"""

MORE = """\
        (f"share/{package_name}", glob("launch/*.launch.py")),
        (os.path.join("share", package_name, "config"), glob("params/*.yaml")),
        (os.path.join("share", package_name, "models", "arm"), ["urdf/arm.urdf"]),
        ("lib/demo", ["urdf/arm.urdf"]),
        "README.md",
"""


@pytest.fixture
def demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package whose files have other places when it is installed."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    demo = demo_package(tmp_path)
    for name in ("launch/a.launch.py", "params/p.yaml", "urdf/arm.urdf", "config/own.yaml"):
        (demo / name).parent.mkdir(exist_ok=True)
        (demo / name).write_text(name)
    state(demo, MORE)
    return demo


def state(demo: Path, more: str) -> None:
    (demo / "setup.py").write_text(SETUP.replace("MORE\n", more))
    forget()


def forget() -> None:
    """Know no more of packages than another process."""
    _data_files.stated.cache_clear()
    _data_files.warn.cache_clear()


def state_in_cfg(demo: Path, more: str) -> None:
    (demo / "setup.py").write_text("from setuptools import setup\nsetup()\n")
    (demo / "setup.cfg").write_text("[metadata]\nname = demo\n\n[options.data_files]\n" + more)
    forget()


def share(demo: Path) -> Path:
    return find_share("demo", demo / "launch" / "a.launch.py")


def test_files_are_where_an_installation_has_them_and_where_the_source_has_them(
    demo: Path,
) -> None:
    found = share(demo)
    assert found.name == "demo" and found != demo
    texts = {
        "a.launch.py": "launch/a.launch.py",
        "launch/a.launch.py": "launch/a.launch.py",
        "config/p.yaml": "params/p.yaml",
        "config/own.yaml": "config/own.yaml",
        "models/arm/arm.urdf": "urdf/arm.urdf",
        "params/p.yaml": "params/p.yaml",
    }
    assert {it: (found / it).read_text() for it in texts} == texts
    assert find_package("demo", demo) == demo


def test_the_folder_is_that_of_the_source_if_all_is_there(demo: Path) -> None:
    state(demo, "")
    assert share(demo) == demo
    (demo / "setup.py").unlink()
    forget()
    assert share(demo) == demo


def test_links_follow_what_the_package_states(demo: Path) -> None:
    before = share(demo)
    (demo / "params" / "p.yaml").rename(demo / "params" / "q.yaml")
    state(demo, MORE.replace("models", "config"))
    assert share(demo) == before
    assert sorted(os.listdir(before / "config")) == ["arm", "own.yaml", "q.yaml"]
    assert not (before / "models").exists()
    (demo / "models").mkdir()
    state(demo, MORE.replace('"config"', '"models"').replace('"models", "arm"', '"launch"'))
    assert share(demo) == before
    assert (before / "config").readlink() == demo / "config"
    assert sorted(os.listdir(before / "models")) == ["q.yaml"]
    assert sorted(os.listdir(before / "launch")) == ["a.launch.py", "arm.urdf"]


#: As setuptools reads it: lists with commas or lines, patterns, and ``=`` in names of files.
CFG = """\
share/ament_index/resource_index/packages = resource/demo
share/demo = package.xml, launch/*.launch.py
share/demo/config =
    params/*.yaml
    params/a=b.yaml
share/demo/models/arm: urdf/arm.urdf
lib/demo = urdf/arm.urdf
"""


def test_so_they_are_as_setup_cfg_states(demo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (demo / "params" / "a=b.yaml").write_text("params/a=b.yaml")
    state_in_cfg(demo, CFG)
    found = share(demo)
    assert sorted(os.listdir(found / "config")) == ["a=b.yaml", "own.yaml", "p.yaml"]
    texts = {
        "a.launch.py": "launch/a.launch.py",
        "config/p.yaml": "params/p.yaml",
        "config/a=b.yaml": "params/a=b.yaml",
        "models/arm/arm.urdf": "urdf/arm.urdf",
    }
    assert {it: (found / it).read_text() for it in texts} == texts
    (demo / "setup.py").unlink()
    forget()
    assert share(demo) == found
    # What `setup.py` states counts alone.
    state(demo, "")
    assert share(demo) == demo
    assert capsys.readouterr().err == ""


def test_what_is_wrong_in_setup_cfg_is_a_warning(
    demo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    state_in_cfg(demo, "share/demo/config = params/no.yaml\n/etc/demo = package.xml\n")
    assert share(demo) == demo
    told = capsys.readouterr().err
    assert told.count("setup.cfg: data_files name params/no.yaml, which is no file") == 1
    assert told.count("setup.cfg: data_files put nothing in /etc/demo: that is no share") == 1
    state_in_cfg(demo, CFG + "share/demo = again\n")
    assert share(demo) == demo
    assert "setup.cfg:12: While reading from 'setup.cfg'" in capsys.readouterr().err


@pytest.mark.parametrize("file", ["setup.py", "setup.cfg"])
@pytest.mark.parametrize("ups", range(1, 8))
def test_nothing_is_written_or_removed_outside_of_the_share(
    demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], ups: int, file: str
) -> None:
    cache = tmp_path / "cache"
    kept = [tmp_path / "victim" / "p.yaml", tmp_path / "docs" / "own"]
    kept += [cache / "hprm" / "other", cache / "hprm" / "shares" / "another" / "file"]
    for it in kept:
        it.parent.mkdir(parents=True, exist_ok=True)
        it.write_text("precious")
    out = "../" * ups + "victim"
    if file == "setup.py":
        state(demo, MORE + f'(f"share/{{package_name}}/{out}", glob("params/*.yaml")),\n')
    else:
        state_in_cfg(demo, CFG + f"share/demo/{out} = params/*.yaml\n")
    found = share(demo)
    assert found.parent.parent == cache / "hprm" / "shares"
    assert [it.read_text() for it in kept] == ["precious"] * len(kept)
    written = [it for it in tmp_path.rglob("p.yaml") if found not in it.parents]
    assert sorted(written) == sorted([demo / "params" / "p.yaml", kept[0]])
    told = capsys.readouterr().err
    refused = f"{file}: data_files put nothing in share/demo/{out}: that is no share"
    assert (refused in told) == (ups > 2)


def test_files_that_are_not_there_or_not_for_a_share_are_told(
    demo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    state(demo, MORE + '("/etc/demo", ["README.md"]), ("share/demo/launch", ["launch/no.py"])\n')
    assert share(demo) == share(demo)
    told = capsys.readouterr().err
    assert told.count("setup.py: data_files put nothing in /etc/demo: that is no share") == 1
    assert told.count("setup.py: data_files name launch/no.py, which is no file") == 1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("data_files = [\n", "setup.py:1: SyntaxError: '[' was never closed (setup.py, line 1)\n"),
        ("data_files = []\n\n1 / 0\n", "setup.py:3: ZeroDivisionError: division by zero\n"),
        ("data_files = []\nimport os\nos._exit(3)\n", "setup.py:1: it ends early\n"),
    ],
)
def test_a_script_that_is_wrong_is_a_warning(
    demo: Path, capsys: pytest.CaptureFixture[str], text: str, said: str
) -> None:
    (demo / "setup.py").write_text(text)
    forget()
    assert share(demo) == demo
    warning = capsys.readouterr().err
    assert warning.startswith("warning: ") and said in warning
    assert share(demo) == demo
    assert capsys.readouterr().err == ""


def test_a_share_that_cannot_be_made_is_a_warning(
    demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cache").write_text("a file")
    assert share(demo) == demo
    assert f"warning: {demo}: its share cannot be made: " in capsys.readouterr().err


#: Counts how often it is run, and takes long enough for others to come meanwhile.
COUNTS = """\
import time
with open("runs", "a") as file:
    file.write("x")
time.sleep(0.2)
"""

ASKS = """\
import sys
from pathlib import Path
from hprm.ros._launch._packages import find_share
print((find_share("demo", Path(sys.argv[1])) / "config" / "p.yaml").read_text())
"""


def count_runs(demo: Path) -> None:
    (demo / "setup.py").write_text(COUNTS + SETUP.replace("MORE\n", MORE))


def test_a_script_is_run_once_for_processes_that_ask_at_the_same_time(
    bench: Bench, demo: Path
) -> None:
    count_runs(demo)
    for runs, launch in (("x", "one"), ("xx", "two")):
        environment = {_data_files.LAUNCH: launch}
        asking = [bench.python("-c", ASKS, str(demo), environment=environment) for _ in range(6)]
        assert [(it.code, it.out, it.err) for it in map(finish, asking)] == [
            (0, "params/p.yaml\n", "")
        ] * 6
        # Another launch runs it again: what it tells may depend on any file.
        assert (demo / "runs").read_text() == runs


def test_a_script_that_has_changed_is_run_again_and_so_it_is_without_a_whole_note(
    demo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(_data_files.LAUNCH, "one")
    count_runs(demo)
    runs = demo / "runs"
    forget()
    found = share(demo)
    for expected in ("x", "x"):
        forget()
        assert (share(demo), runs.read_text()) == (found, expected)
    (noted,) = (tmp_path / "cache").glob("hprm/shares/*/.setup.json")
    for spoiled in ("", "{", "[]", '{"key": 1}', noted.read_text()[:-20]):
        noted.write_text(spoiled)
        runs.unlink()
        forget()
        assert (share(demo), runs.read_text()) == (found, "x")
    # The same text with another time counts as another script.
    os.utime(demo / "setup.py", ns=(0, 0))
    forget()
    assert (share(demo), runs.read_text()) == (found, "xx")
    assert sorted(it.name for it in noted.parent.iterdir()) == [".lock", ".setup.json", "demo"]


LAUNCH = """\
import os
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from launch import LaunchDescription
from launch.actions import LogInfo
from launch.substitutions import FileContent, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackagePrefix, FindPackageShare


def generate_launch_description():
    path = os.path.join(get_package_share_directory("demo"), "config", "p.yaml")
    share = PathJoinSubstitution([FindPackageShare("demo"), "models", "arm", "arm.urdf"])
    with open(path) as file:
        text = file.read()
    return LaunchDescription([
        LogInfo(msg=text),
        LogInfo(msg=FileContent(share)),
        LogInfo(msg=FindPackagePrefix("demo")),
        LogInfo(msg=get_package_prefix("demo")),
        Node(package="demo", executable="talker"),
    ])
"""

TALKER = """\
from ament_index_python.packages import get_package_share_path


def main():
    print((get_package_share_path("demo") / "config" / "p.yaml").read_text())
"""


def test_launch_files_and_programs_find_them(bench: Bench, demo: Path) -> None:
    (demo / "launch" / "a.launch.py").write_text(LAUNCH)
    (demo / "demo" / "talker.py").write_text(TALKER)
    count_runs(demo)
    outcome = finish(bench.call("launch", str(demo / "launch" / "a.launch.py")))
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.splitlines() == [
        "params/p.yaml",
        "urdf/arm.urdf",
        *[str(demo)] * 2,
        "[talker-1] params/p.yaml",
    ]
    # Both for the launch file and for the program.
    assert (demo / "runs").read_text() == "x"


def test_a_program_of_an_entry_point_finds_messages_of_its_workspace(
    bench: Bench, demo: Path
) -> None:
    (demo.parent / "demo_msgs" / "msg").mkdir(parents=True)
    (demo.parent / "demo_msgs" / "msg" / "Thing.msg").write_text("int32 count\n")
    (demo / "demo" / "talker.py").write_text(
        "from demo_msgs.msg import Thing\n\n\ndef main():\n    print(Thing(count=3))\n"
    )
    (demo / "launch" / "a.launch.py").write_text(
        LAUNCH[: LAUNCH.index("    path =")]
        + '    return LaunchDescription([Node(package="demo", executable="talker")])\n'
    )
    outcome = finish(bench.call("launch", str(demo / "launch" / "a.launch.py")))
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out == "[talker-1] demo_msgs.msg.Thing(count=3)\n"
