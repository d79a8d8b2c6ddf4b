"""Launch descriptions as trees of text."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import Bench, finish

LAUNCH = """\
from launch import LaunchDescription
from launch.actions import *
from launch.event_handlers import *
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node, PushRosNamespace


def ended(event, context):
    return Shutdown()


def generate_launch_description():
    robot = LaunchConfiguration("robot")
    node = Node(
        package="demo", executable=[robot, "_driver"], name="driver", arguments=["-v", "--ros-args"]
    )
    paths = ["ls", [PathJoinSubstitution([robot, "x"]), "y"]]
    return LaunchDescription([
        DeclareLaunchArgument("robot"),
        LogInfo(msg=["starts ", robot]),
        GroupAction([PushRosNamespace(robot), node]),
        LaunchDescription([ExecuteProcess(cmd=paths, cwd="/tmp", env={"A": robot}, shell=True)]),
        IncludeLaunchDescription("other.launch.py"),
        RegisterEventHandler(OnProcessExit(target_action=node, on_exit=[
            TimerAction(period=1.0, actions=[ExecuteProcess(cmd=["true"])]), Shutdown(),
        ])),
        RegisterEventHandler(OnExecutionComplete(target_action=node, on_completion=ended)),
        RegisterEventHandler(OnProcessStart(on_start=ended, handle_once=True)),
        RegisterEventHandler(OnProcessIO(on_stdout=ended, on_stderr=ended)),
        RegisterEventHandler(OnShutdown(on_shutdown=[LogInfo(msg="bye")])),
        RegisterEventHandler(OnShutdown(on_shutdown=ended)),
    ])
"""

SHOWN = """\
<launch.LaunchDescription>
├── Action('<launch.actions.DeclareLaunchArgument name='robot'>')
├── LogInfo('starts ' + LaunchConfiguration('robot'))
├── Action('<launch.actions.GroupAction>')
│   ├── Action('<launch_ros.actions.PushROSNamespace>')
│   └── ExecuteProcess(cmd=[ExecInPkg(pkg='demo', exec=LaunchConfiguration('robot') \
+ '_driver'), '-v', '--ros-args', '--ros-args', '-r', LocalVar('node name')], cwd=None, env=None, \
shell=False)
├── <launch.LaunchDescription>
│   └── ExecuteProcess(cmd=['ls', PathJoinSubstitution(LaunchConfiguration('robot'), 'x') + 'y'], \
cwd=''/tmp'', env={'A': LaunchConfiguration('robot')}, shell=True)
├── Action('<launch.actions.IncludeLaunchDescription file='other.launch.py'>')
├── RegisterEventHandler('<launch.event_handlers.OnProcessExit>'):
│   └── OnProcessExit(matcher='event == ProcessExited and ExecuteLocal(event.action)', \
handler='<actions>', handle_once=False)
│       ├── Action('<launch.actions.TimerAction>')
│       │   └── ExecuteProcess(cmd=['true'], cwd=None, env=None, shell=False)
│       └── EmitEvent(event='launch.events.Shutdown')
├── RegisterEventHandler('<launch.event_handlers.OnExecutionComplete>'):
│   └── OnExecutionComplete(matcher='event == ExecutionComplete and Action(event.action)', \
handler='<function ended>', handle_once=False)
├── RegisterEventHandler('<launch.event_handlers.OnProcessStart>'):
│   └── OnProcessStart(matcher='event == ProcessStarted', handler='<function ended>', \
handle_once=True)
├── RegisterEventHandler('<launch.event_handlers.OnProcessIO>'):
│   └── OnProcessIO(matcher='event == ProcessIO', \
handler='<function ended>, <function ended>', handle_once=False)
├── RegisterEventHandler('<launch.event_handlers.OnShutdown>'):
│   └── OnShutdown(matcher='event issubclass of launch.events.Shutdown', handler='<actions>', \
handle_once=False)
│       └── LogInfo('bye')
└── RegisterEventHandler('<launch.event_handlers.OnShutdown>'):
    └── OnShutdown(matcher='event issubclass of launch.events.Shutdown', \
handler='<function ended>', handle_once=False)
"""

XML = """\
<launch>
  <arg name="rate" default="10"/>
  <node pkg="demo" exec="talker" name="one"/>
</launch>
"""

SHOWN_XML = """\
<launch.LaunchDescription>
├── Action('<launch.actions.DeclareLaunchArgument name='rate'>')
└── ExecuteProcess(cmd=[ExecInPkg(pkg='demo', exec='talker'), '--ros-args', '-r', \
LocalVar('node name')], cwd=None, env=None, shell=False)
"""


@pytest.mark.parametrize("option", ["--print-description", "-p"])
@pytest.mark.parametrize(
    ("file", "text", "shown"),
    [("a.launch.py", LAUNCH, SHOWN), ("a.launch.xml", XML, SHOWN_XML)],
)
def test_the_actions_of_a_launch_file_are_shown_as_a_tree(
    bench: Bench, tmp_path: Path, option: str, file: str, text: str, shown: str
) -> None:
    (tmp_path / file).write_text(text)
    outcome = finish(bench.call("launch", option, file))
    assert (outcome.code, outcome.out, outcome.err) == (0, shown, "")


PRINTS = """\
import launch
from launch import LaunchDescription, LaunchIntrospector


class Mine(launch.Action):
    def describe(self):
        return "what I do"


def generate_launch_description():
    made = LaunchDescription([Mine(), "no entity"])
    print(LaunchIntrospector().format_launch_description(made))
    return LaunchDescription([])
"""


def test_launch_files_may_show_descriptions_themselves(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "a.launch.py").write_text(PRINTS)
    outcome = finish(bench.call("launch", "a.launch.py"))
    assert outcome.out.splitlines() == [
        "<launch.LaunchDescription>",
        "├── Action('what I do')",
        "└── Unknown entity('no entity')",
    ]
    assert outcome.err == "error: a.launch.py starts nothing\n"
