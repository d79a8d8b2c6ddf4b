"""Launch files of `hprm.ros`: what Python and YAML files ask for, as a plan, and their errors."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from ros_workspaces import demo_package, no_modules_of_launch

from hprm.ros import _launch, _launch_ros
from hprm.ros._ament_index_python.packages import (
    PackageNotFoundError,
    get_package_share_directory,
    get_package_share_path,
)
from hprm.ros._launch import LaunchError, LaunchPlan, NodePlan, ProcessPlan, evaluate
from hprm.ros._launch._packages import PackageError, find_package, find_program
from hprm.ros._launch._plans import Respawn, as_yaml
from hprm.ros._messages.packages import PACKAGES
from hprm.ros._parameter_yaml import parse_parameter_value
from hprm.ros._ros_arguments import parse_ros_arguments

HEAD = """
import os
from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument, EmitEvent, ExecuteProcess, GroupAction, IncludeLaunchDescription,
    LogInfo, OpaqueFunction, RegisterEventHandler, SetEnvironmentVariable,
    SetLaunchConfiguration, Shutdown, TimerAction, UnsetLaunchConfiguration,
)
import launch.events
from launch.conditions import (
    IfCondition, LaunchConfigurationEquals, LaunchConfigurationNotEquals, UnlessCondition,
)
from launch.event_handlers import OnExecutionComplete, OnProcessExit, OnProcessStart
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import (
    AndSubstitution, AnonName, Command, EnvironmentVariable, EqualsSubstitution, FileContent,
    FindExecutable, IfElseSubstitution, LaunchConfiguration, NotEqualsSubstitution,
    LocalSubstitution, NotSubstitution, OrSubstitution,
    PathJoinSubstitution, PathSubstitution, PythonExpression,
    TextSubstitution, ThisLaunchFile, ThisLaunchFileDir,
)
from launch_ros.actions import (
    Node, PushRosNamespace, SetParameter, SetParametersFromFile, SetRemap, SetUseSimTime,
)
from launch_ros.descriptions import ParameterFile, ParameterValue
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare, Parameter


def generate_launch_description():
    return LaunchDescription(entities())


def entities():
"""


@pytest.fixture(autouse=True)
def no_modules_of_launch_stay(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What a launch file may import is gone after the test; no package is given."""
    monkeypatch.delenv(PACKAGES, raising=False)
    with no_modules_of_launch():
        yield


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    return demo_package(tmp_path)


def written(demo: Path, body: str, name: str = "test.launch.py") -> Path:
    path = demo / "launch" / name
    path.write_text(HEAD + textwrap.indent(textwrap.dedent(body), "    "))
    return path


def plan_of(demo: Path, body: str, **arguments: str) -> LaunchPlan:
    return evaluate(written(demo, body), arguments)


def node_of(demo: Path, body: str, **arguments: str) -> NodePlan:
    (node,) = plan_of(demo, body, **arguments).nodes
    return node


def message_of(demo: Path, expression: str, **arguments: str) -> str:
    """The text of a substitution."""
    (message,) = plan_of(demo, f"return [LogInfo(msg={expression})]", **arguments).messages
    return message


def refusal(demo: Path, body: str, **arguments: str) -> str:
    with pytest.raises(LaunchError) as raised:
        plan_of(demo, body, **arguments)
    return str(raised.value)


def test_a_node_is_found_in_its_package(workspace: Path) -> None:
    node = node_of(
        workspace,
        """
        return [
            Node(
                package="demo", executable="talker", name="one", namespace="robot",
                parameters=[{"rate": 2.5, "tag": {"names": ["a", "b"]}}],
                remappings=[("chatter", "other")],
                arguments=["--verbose"], output="screen",
            )
        ]
        """,
    )
    assert node.script == workspace / "demo" / "talker.py"
    assert (node.name, node.namespace, node.output) == ("one", "/robot", "screen")
    assert node.parameters == [{"rate": 2.5, "tag.names": ["a", "b"]}]
    assert node.remappings == [("chatter", "other")]
    assert (node.package, node.executable, node.function) == ("demo", "talker", None)
    assert node.command_line() == [
        *("--verbose", "--ros-args", "-r", "__node:=one", "-r", "__ns:=/robot"),
        *("-p", "rate:=2.5", "-p", 'tag.names:=["a", "b"]', "-r", "chatter:=other"),
    ]


def test_the_command_line_says_what_the_plan_says(workspace: Path) -> None:
    node = node_of(
        workspace,
        """
        return [
            Node(
                package="demo", executable="talker",
                parameters=[{"text": "10", "yes": "true", "number": 10, "bool": True}],
                ros_arguments=["--log-level", "debug"],
            )
        ]
        """,
    )
    parsed = parse_ros_arguments(node.command_line())
    assert parsed.overrides.of("/n") == {"text": "10", "yes": "true", "number": 10, "bool": True}
    assert parsed.level is not None and parsed.level.name == "DEBUG"
    assert parsed.others == []


@pytest.mark.parametrize(
    "value",
    [True, 7, -1, 2.5, 1e300, math.inf, -math.inf, "a b", "", "1", 'x"y\\', "é: [", [1, 2], ["1"]],
)
def test_values_survive_the_command_line(value: Any) -> None:
    read = parse_parameter_value(as_yaml(value))
    assert (type(read), read) == (type(value), value)


def test_no_number_survives_the_command_line() -> None:
    read = parse_parameter_value(as_yaml(math.nan))
    assert isinstance(read, float) and math.isnan(read)


def test_a_node_without_anything_has_no_arguments(workspace: Path) -> None:
    node = node_of(workspace, 'return [Node(package="demo", executable="talker")]')
    assert node.command_line() == []
    assert (node.name, node.namespace) == (None, None)


def test_a_node_without_a_package_is_a_script(workspace: Path) -> None:
    node = node_of(workspace, 'return [Node(executable="../demo/talker.py")]')
    assert node.script.resolve() == workspace / "demo" / "talker.py"
    assert "there is no script" in refusal(workspace, 'return [Node(executable="none.py")]')


def test_entry_points_name_programs(workspace: Path) -> None:
    (workspace / "setup.py").write_text(
        "setup(entry_points={'console_scripts': ['talk = demo.talker:main',"
        " 'my_talk=demo.listener:main', 'bad = demo.none:main']})"
    )
    # A module that an entry point names only defines what is called.
    with pytest.raises(PackageError, match="has no program 'listener'"):
        find_program("demo", "listener", workspace)
    node = node_of(workspace, 'return [Node(package="demo", executable="talk")]')
    assert (node.script.name, node.function, node.root) == ("talker.py", "main", workspace)
    (workspace / "setup.cfg").write_text(
        "[options.entry_points]\nconsole_scripts =\n    hear = demo.listener:main\n"
    )
    assert find_program("demo", "hear", workspace).script.name == "listener.py"
    (workspace / "pyproject.toml").write_text('[project.scripts]\nsee = "demo.talker:main"\n')
    assert find_program("demo", "see", workspace).function == "main"
    with pytest.raises(PackageError, match="names the module demo.none, but there is no"):
        find_program("demo", "bad", workspace)


def test_programs_may_be_in_a_folder_of_scripts(workspace: Path) -> None:
    (workspace / "scripts").mkdir()
    (workspace / "scripts" / "tool").write_text("")
    assert find_program("demo", "tool", workspace).script == workspace / "scripts" / "tool"


def test_packages_are_found_around_a_file_and_by_a_variable(
    workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    beside = workspace.parent / "other_folder"
    beside.mkdir()
    (beside / "package.xml").write_text("<package>\n <name> named </name></package>")
    launch = workspace / "launch"
    assert find_package("demo", launch) == workspace
    assert find_package("demo", workspace / "demo" / "talker.py") == workspace
    assert find_package("demo", tmp_path / "ws") == workspace
    assert find_package("named", launch) == beside
    far = tmp_path / "far"
    (far / "src" / "repository" / "deep").mkdir(parents=True)
    assert find_package("deep", far) == far / "src" / "repository" / "deep"
    with pytest.raises(PackageError):
        find_package("deep", launch)
    monkeypatch.setenv(PACKAGES, f"/none:{far / 'src'}")
    assert find_package("deep", launch) == far / "src" / "repository" / "deep"
    monkeypatch.setenv(PACKAGES, str(far / "src" / "repository" / "deep"))
    assert find_package("deep", launch) == far / "src" / "repository" / "deep"


def test_errors_say_where_was_looked(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PACKAGES, "/given")
    text = refusal(workspace, 'return [Node(package="none", executable="x")]')
    assert text.startswith(f"{workspace / 'launch' / 'test.launch.py'}: package 'none' was not")
    assert "/given/**" in text and f"{workspace / 'launch'} and the folders above it" in text
    text = refusal(workspace, 'return [Node(package="demo", executable="none")]')
    assert f"package 'demo' ({workspace}) has no program 'none'" in text
    assert str(workspace / "demo" / "none.py") in text and "setup.cfg" in text


def test_arguments_are_declared_and_used(workspace: Path) -> None:
    body = """
    return [
        DeclareLaunchArgument("rate", default_value="10", description="Hz"),
        DeclareLaunchArgument("mode", choices=["fast", "slow"]),
        Node(
            package="demo", executable="talker", name=LaunchConfiguration("mode"),
            parameters=[{"rate": LaunchConfiguration("rate")}],
        ),
    ]
    """
    plan = plan_of(workspace, body, mode="slow")
    assert plan.nodes[0].parameters == [{"rate": 10}]
    assert plan.nodes[0].name == "slow"
    declared = [(one.name, one.default, one.description, one.choices) for one in plan.arguments]
    assert declared == [("rate", "10", "Hz", None), ("mode", None, None, ["fast", "slow"])]
    assert node_of(workspace, body, mode="fast", rate="2.5").parameters == [{"rate": 2.5}]
    assert "required launch argument 'mode' was not provided" in refusal(workspace, body)
    text = refusal(workspace, body, mode="odd")
    assert "launch argument 'mode' is 'odd': it has to be one of fast, slow" in text


def test_arguments_of_the_command_line_are_read() -> None:
    assert _launch.parse_arguments(["a:=1", "b:=x:=y", "c:="]) == {"a": "1", "b": "x:=y", "c": ""}
    with pytest.raises(LaunchError, match="'a=1' is no launch argument: it is written NAME:=VALUE"):
        _launch.parse_arguments(["a=1"])


@pytest.mark.parametrize(
    ("expression", "text"),
    [
        ('"plain"', "plain"),
        ('["a", TextSubstitution(text="b"), "c"]', "abc"),
        ('LaunchConfiguration("given")', "value"),
        ('LaunchConfiguration("none", default="x")', "x"),
        ('LaunchConfiguration("none", default=3)', "3"),
        ('PathJoinSubstitution(["a", ["b", "c"], LaunchConfiguration("given")])', "a/bc/value"),
        ('PathSubstitution("a") / "b"', "a/b"),
        ('EnvironmentVariable("NONE", default_value="x")', "x"),
        ('PythonExpression(["1 + ", "2"])', "3"),
        ('PythonExpression("math.floor(pi)")', "3"),
        ("PythonExpression([\"'\", LaunchConfiguration('given'), \"' == 'value'\"])", "True"),
        ('EqualsSubstitution("1", "true")', "true"),
        ('EqualsSubstitution("1.0", 1)', "true"),
        ('NotEqualsSubstitution("a", "b")', "true"),
        ('NotSubstitution("false")', "true"),
        ('AndSubstitution("true", "0")', "false"),
        ('OrSubstitution("false", "1")', "true"),
        ('IfElseSubstitution("true", "a", "b")', "a"),
        ('Command("echo hi")', "hi\n"),
        ('Command(["sh -c ", "\'echo hi >&2\'"], on_stderr="capture")', "hi\n"),
    ],
)
def test_substitutions_are_performed(workspace: Path, expression: str, text: str) -> None:
    assert message_of(workspace, expression, given="value") == text


def test_substitutions_know_where_they_are(workspace: Path) -> None:
    launch = workspace / "launch"
    assert message_of(workspace, "ThisLaunchFile()") == str(launch / "test.launch.py")
    assert message_of(workspace, "ThisLaunchFileDir()") == str(launch)
    assert message_of(workspace, 'FindPackageShare("demo")') == str(workspace)
    assert message_of(workspace, 'FindPackageShare("demo") / "x"') == str(workspace / "x")
    found = message_of(workspace, 'ExecutableInPackage("talker", "demo")')
    assert found == str(workspace / "demo" / "talker.py")
    assert message_of(workspace, 'FindExecutable(name="sh")').endswith("/sh")
    (launch / "note").write_text("text")
    assert message_of(workspace, 'FileContent([ThisLaunchFileDir(), "/note"])') == "text"
    name = message_of(workspace, '[AnonName("n"), " ", AnonName("n")]').split()
    assert name[0] == name[1] and name[0].startswith("n_")


@pytest.mark.parametrize(
    ("expression", "what"),
    [
        ('LaunchConfiguration("none")', "launch configuration 'none' does not exist; there are:"),
        ('EnvironmentVariable("NONE")', "environment variable 'NONE' does not exist"),
        ('PythonExpression("1 +")', "the expression '1 +' fails: SyntaxError"),
        ('NotSubstitution("perhaps")', "is 'perhaps': it has to be true, 1, false or 0"),
        ('Command("false")', "the command 'false' ends with 1"),
        ('Command("/none/such")', "the command '/none/such' fails"),
        ('FindExecutable(name="none-such")', "executable 'none-such' is not on the PATH"),
        ('FileContent("/none")', "the file /none cannot be read"),
        ('LocalSubstitution("event.reason")', "LocalSubstitution('event.reason') is not supported"),
        ('Parameter("none")', "the parameter 'none' is not set"),
    ],
)
def test_substitutions_that_fail_say_so(workspace: Path, expression: str, what: str) -> None:
    text = refusal(workspace, f"return [LogInfo(msg={expression})]")
    assert what in text
    assert text.startswith(str(workspace / "launch" / "test.launch.py"))


def test_conditions_decide(workspace: Path) -> None:
    plan = plan_of(
        workspace,
        """
        yes = LaunchConfiguration("yes")
        return [
            LogInfo(msg="1", condition=IfCondition(yes)),
            LogInfo(msg="2", condition=UnlessCondition(yes)),
            LogInfo(msg="3", condition=LaunchConfigurationEquals("yes", "True")),
            LogInfo(msg="4", condition=LaunchConfigurationNotEquals("yes", "True")),
            LogInfo(msg="5", condition=LaunchConfigurationEquals("none", None)),
            LogInfo(msg="6", condition=IfCondition(PythonExpression(["1 < 2"]))),
        ]
        """,
        yes="True",
    )
    assert plan.messages == ["1", "3", "5", "6"]
    text = refusal(workspace, 'return [LogInfo(msg="", condition=IfCondition("maybe"))]')
    assert "the condition 'maybe' is 'maybe': it has to be true, 1, false or 0" in text


def test_a_group_limits_what_it_sets(workspace: Path) -> None:
    plan = plan_of(
        workspace,
        """
        def node(name, **more):
            return Node(package="demo", executable="talker", name=name, **more)

        return [
            SetParameter("everywhere", 1),
            SetLaunchConfiguration("x", "out"),
            GroupAction([
                PushRosNamespace("robot"),
                PushRosNamespace("arm"),
                SetParameter("inside", LaunchConfiguration("y")),
                SetRemap("a", "b"),
                SetUseSimTime(True),
                SetEnvironmentVariable("HPRM_TEST", "1"),
                SetLaunchConfiguration("x", "in"),
                node("one", namespace="left", remappings=[("c", "d")], parameters=[{"inside": 3}]),
                node("two", namespace="/top"),
                LogInfo(msg=[LaunchConfiguration("x"), Parameter("everywhere")]),
            ], launch_configurations={"y": "2"}),
            node("three"),
            LogInfo(msg=LaunchConfiguration("x")),
            GroupAction([PushRosNamespace("stays")], scoped=False),
            node("four"),
            GroupAction([LogInfo(msg=LaunchConfiguration("x", default="none"))], forwarding=False),
        ]
        """,
    )
    one, two, three, four = plan.nodes
    assert [node.namespace for node in plan.nodes] == ["/robot/arm/left", "/top", None, "/stays"]
    assert one.parameters == [
        *({"everywhere": 1}, {"inside": 2}, {"use_sim_time": True}, {"inside": 3}),
    ]
    assert one.remappings == [("a", "b"), ("c", "d")]
    assert one.environment == two.environment == {"HPRM_TEST": "1"}
    assert three.parameters == four.parameters == [{"everywhere": 1}]
    assert three.remappings == [] and three.environment == {}
    assert plan.messages == ["in1", "out", "none"]


def test_a_launch_file_includes_another_one(workspace: Path) -> None:
    written(
        workspace,
        """
        return [
            DeclareLaunchArgument("which", default_value="listener"),
            Node(package="demo", executable=LaunchConfiguration("which")),
            LogInfo(msg=ThisLaunchFile()),
        ]
        """,
        "inner.launch.py",
    )
    plan = plan_of(
        workspace,
        """
        share = get_package_share_directory("demo")
        path = os.path.join(share, "launch", "inner.launch.py")
        source = PythonLaunchDescriptionSource(path)
        joined = PathJoinSubstitution([FindPackageShare("demo"), "launch", "inner.launch.py"])
        return [
            IncludeLaunchDescription(source, launch_arguments={"which": "talker"}.items()),
            UnsetLaunchConfiguration("which"),
            IncludeLaunchDescription(PythonLaunchDescriptionSource(joined)),
            IncludeLaunchDescription("inner.launch.py"),
            LogInfo(msg=ThisLaunchFile()),
        ]
        """,
    )
    assert [node.executable for node in plan.nodes] == ["talker", "listener", "listener"]
    names = [Path(message).name for message in plan.messages]
    assert names == ["inner.launch.py"] * 3 + ["test.launch.py"]


def test_an_error_in_an_included_file_names_that_file(workspace: Path) -> None:
    inner = written(workspace, 'return [LogInfo(msg=LaunchConfiguration("x"))]', "inner.launch.py")
    text = refusal(workspace, 'return [IncludeLaunchDescription("inner.launch.py")]')
    assert text.startswith(f"{inner}: launch configuration 'x' does not exist")
    text = refusal(workspace, 'return [IncludeLaunchDescription("test.launch.py")]')
    assert "launch files include one another: " in text
    text = refusal(workspace, 'return [IncludeLaunchDescription("none.launch.py")]')
    assert f"there is no launch file {workspace / 'launch' / 'none.launch.py'}" in text


def test_parameters_keep_their_types(workspace: Path) -> None:
    (workspace / "config" / "p.yaml").write_text("/**: {ros__parameters: {a: 1}}\n")
    node = node_of(
        workspace,
        """
        from typing import List
        two = LaunchConfiguration("two")
        share = get_package_share_directory("demo")
        listed = TextSubstitution(text="[1, 2]")
        return [
            Node(
                package="demo", executable="talker",
                parameters=[
                    PathJoinSubstitution([FindPackageShare("demo"), "config", "p.yaml"]),
                    ParameterFile(os.path.join(share, "config/p.yaml")),
                    {
                        "text": "2", "number": two, "joined": [two, ".5"], "mixed": [1, 2.5],
                        "texts": ["a", "1"], "each": [[two], [two]],
                        "typed": ParameterValue(two, value_type=str),
                        "float": ParameterValue(two, value_type=float),
                        "floats": ParameterValue("[1, 2]", value_type=str),
                        "ints": ParameterValue(listed, value_type=List[int]),
                        "robot": ParameterValue(TextSubstitution(text="<a: b>"), value_type=str),
                        "empty": TextSubstitution(text=""),
                        LaunchConfiguration("two"): True,
                    },
                ],
            )
        ]
        """,
        two="2",
    )
    assert node.parameters[:2] == [workspace / "config" / "p.yaml"] * 2
    assert node.parameters[2] == {
        "text": "2",
        "number": 2,
        "joined": 2.5,
        "mixed": [1.0, 2.5],
        "texts": ["a", "1"],
        "each": [2, 2],
        "typed": "2",
        "float": 2.0,
        "floats": "[1, 2]",
        "ints": [1, 2],
        "robot": "<a: b>",
        "empty": "",
        "2": True,
    }


@pytest.mark.parametrize(
    ("parameters", "what"),
    [
        ('{"a": 1}', "parameters is a list of dictionaries and files"),
        ("[3]", "3 is neither a dictionary of parameters nor a file"),
        ('["none.yaml"]', "there is no file of parameters"),
        ('[{"a": None}]', "the parameter 'a' cannot be None"),
        ('[{"a": [1, "x"]}]', "the parameter 'a' is a list of several types"),
        ('[{"a": TextSubstitution(text="x: y")}]', "write ParameterValue(value, value_type=str)"),
        ('[{"a": ParameterValue("x", value_type=int)}]', "'x' is no <class 'int'>"),
    ],
)
def test_wrong_parameters_are_refused(workspace: Path, parameters: str, what: str) -> None:
    body = f'return [Node(package="demo", executable="talker", parameters={parameters})]'
    assert what in refusal(workspace, body)


def test_processes_and_timers_are_planned(workspace: Path) -> None:
    plan = plan_of(
        workspace,
        """
        return [
            ExecuteProcess(
                cmd=["echo", ["a", "b"]], name="echo", cwd="/", output="screen",
                additional_env={"X": "1"}, emulate_tty=True,
            ),
            TimerAction(period=2.5, actions=[
                Node(package="demo", executable="talker", respawn=True, respawn_delay=2, prefix=""),
                TimerAction(period="1", actions=[ExecuteProcess(cmd=["ls -l"], shell=True)]),
            ]),
            ExecuteProcess(cmd=["true"], on_exit=Shutdown()),
        ]
        """,
    )
    echo, talker, shell, last = plan.processes
    assert isinstance(echo, ProcessPlan) and echo.command == ["echo", "ab"]
    assert (echo.name, echo.folder, echo.environment, echo.delay) == (
        "echo",
        Path("/"),
        {"X": "1"},
        0,
    )
    assert isinstance(talker, NodePlan)
    assert (talker.delay, talker.respawn) == (2.5, Respawn(delay=2.0, retries=-1))
    assert isinstance(shell, ProcessPlan) and (shell.delay, shell.shell) == (3.5, True)
    assert [process.required for process in plan.processes] == [False, False, False, True]
    assert last.delay == 0.0
    assert plan.nodes == [talker]


def test_a_command_that_is_a_program_of_a_package_is_a_node(workspace: Path) -> None:
    plan = plan_of(
        workspace,
        """
        first = ExecuteProcess(
            cmd=[ExecutableInPackage(package="demo", executable="talker"), "--fast"],
            additional_env={"X": "1"}, output="screen",
        )
        return [
            first,
            ExecuteProcess(cmd=["ros2", "run", "demo", "listener", "-x"], on_exit=[Shutdown()]),
            ExecuteProcess(cmd=["ros2", "topic", "list"]),
            RegisterEventHandler(OnProcessExit(target_action=first, on_exit=[Shutdown()])),
        ]
        """,
    )
    talker, listener = plan.nodes
    assert talker.script == workspace / "demo" / "talker.py"
    assert (talker.arguments, talker.environment, talker.output) == (
        ["--fast"],
        {"X": "1"},
        "screen",
    )
    assert (listener.executable, listener.arguments) == ("listener", ["-x"])
    assert talker.required and listener.required
    assert isinstance(plan.processes[2], ProcessPlan)
    text = refusal(workspace, 'return [ExecuteProcess(cmd=["ros2", "run", "demo"])]')
    assert "ros2 run needs a package and a program of it" in text


def test_the_publisher_of_static_transforms_is_there(workspace: Path) -> None:
    node = node_of(
        workspace,
        'return [Node(package="tf2_ros", executable="static_transform_publisher")]',
    )
    assert node.script.is_file()


def test_functions_get_the_context(workspace: Path) -> None:
    plan = plan_of(
        workspace,
        """
        def setup(context, executable, name=None):
            count = int(LaunchConfiguration("count").perform(context))
            assert get_package_share_directory("demo")
            context.launch_configurations["set"] = "1"
            return [
                Node(package="demo", executable=executable, name=f"{name}{number}")
                for number in range(count)
            ]

        return [
            DeclareLaunchArgument("count", default_value="2"),
            OpaqueFunction(function=setup, args=["talker"], kwargs={"name": "n"}),
            OpaqueFunction(function=lambda context: None),
            LogInfo(msg=LaunchConfiguration("set")),
        ]
        """,
    )
    assert [node.name for node in plan.nodes] == ["n0", "n1"]
    assert plan.messages == ["1"]


def test_handlers_count_if_they_are_known_before(workspace: Path) -> None:
    plan = plan_of(
        workspace,
        """
        talker = Node(package="demo", executable="talker")
        listener = Node(package="demo", executable="listener")
        note = LogInfo(msg=["it", " ended"])
        end = EmitEvent(event=launch.events.Shutdown(reason="over"))
        return [
            talker,
            RegisterEventHandler(OnProcessStart(target_action=talker, on_start=[listener])),
            RegisterEventHandler(OnProcessExit(target_action=talker, on_exit=[note, end])),
            RegisterEventHandler(OnProcessExit(target_action=listener, on_exit=note)),
        ]
        """,
    )
    assert [(node.executable, node.required, node.farewell) for node in plan.nodes] == [
        ("talker", True, ["it ended"]),
        ("listener", False, ["it ended"]),
    ]
    assert plan.messages == []


def test_actions_of_a_handler_are_evaluated_where_it_is_registered(workspace: Path) -> None:
    plan = plan_of(
        workspace,
        """
        talker = Node(package="demo", executable="talker")
        listener = Node(package="demo", executable="listener", name=LaunchConfiguration("as"))
        handler = OnProcessExit(target_action=talker, on_exit=[
            TimerAction(period=2.0, actions=[listener, SetLaunchConfiguration("as", "none")]),
        ])
        return [
            talker,
            GroupAction([
                PushRosNamespace("robot"), SetLaunchConfiguration("as", "ear"),
                RegisterEventHandler(handler), LogInfo(msg=LaunchConfiguration("as")),
            ]),
            SetLaunchConfiguration("as", "other"),
        ]
        """,
    )
    assert [node.executable for node in plan.nodes] == ["talker"]
    (reaction,) = plan.reactions
    (listener,) = reaction.plan.nodes
    assert (listener.name, listener.namespace, listener.delay) == ("ear", "/robot", 2.0)
    assert plan.messages == ["ear"]


@pytest.mark.parametrize(
    ("entity", "what"),
    [
        ("RegisterEventHandler(EventHandler(matcher=print))", "EventHandler is not supported"),
        ("TimerAction(period=1.0, actions=[Shutdown()])", "Shutdown() in a TimerAction is not"),
        ('Shutdown(reason="why")', "the launch ends before it starts anything: why"),
        ("EmitEvent(event=3)", "EmitEvent of 3 is not supported"),
        ("OpaqueCoroutine(coroutine=None)", "OpaqueCoroutine is not supported"),
        ("'node'", "'node' is no action and no launch description"),
        (
            "Node(package='demo', executable='talker', respawn=True, respawn_delay='soon')",
            "respawn_delay is 'soon': it is no number",
        ),
        ("TimerAction(period='x', actions=[])", "the period of a timer is 'x': it is no number"),
        ("Node(package='demo', executable='talker', name='a/b')", "'a/b': node name must not"),
        ("PushRosNamespace('a b')", "'/a b': namespace must not contain characters"),
    ],
)
def test_what_is_not_supported_says_so(workspace: Path, entity: str, what: str) -> None:
    body = f"""
    from launch.actions import OpaqueCoroutine
    from launch.event_handlers import EventHandler
    node = Node(package="demo", executable="talker")
    return [{entity}]
    """
    assert what in refusal(workspace, body)


def test_events_of_lifecycles_are_refused(workspace: Path) -> None:
    before = """
    from launch.events import matches_action
    from launch_ros.actions import LifecycleNode
    from launch_ros.event_handlers import OnStateTransition
    from launch_ros.events.lifecycle import ChangeState
    node = LifecycleNode(package="demo", executable="talker", name="a", namespace="")
    """
    change = "EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node)))"
    handler = "RegisterEventHandler(OnStateTransition(goal_state='active', entities=[]))"
    for entity, kind in [(change, "ChangeState"), (handler, "OnStateTransition")]:
        assert f"{kind} is not supported" in refusal(workspace, f"{before}return [{entity}]\n")


def test_components_are_refused() -> None:
    from hprm.ros._launch_ros.actions import ComposableNodeContainer, LoadComposableNodes
    from hprm.ros._launch_ros.descriptions import ComposableNode

    for kind in (ComposableNodeContainer, LoadComposableNodes, ComposableNode):
        with pytest.raises(LaunchError, match=f"{kind.__name__} is not supported"):
            kind(name="x")
    with pytest.raises(LaunchError, match="LifecycleNode with autostart is not supported"):
        _launch_ros.actions.LifecycleNode(name="a", namespace="", executable="x", autostart=True)
    with pytest.raises(ImportError, match="`hprm launch` runs launch files"):
        from hprm.ros._launch import LaunchService  # noqa: F401
    with pytest.raises(TypeError, match="Node has no argument colour"):
        _launch_ros.actions.Node(executable="x", colour="red")


@pytest.mark.parametrize(
    ("name", "text", "what"),
    [
        ("a.launch.py", "x = 1", "has no function generate_launch_description()"),
        (
            "a.launch.py",
            "def generate_launch_description():\n    return 3",
            "generate_launch_description() returns 3, and no LaunchDescription",
        ),
        ("a.launch.json", "{}", "launch files in .json are not supported"),
        ("a.yaml", "nodes: []", "has the key 'launch', and no other one"),
        ("a.yaml", "launch: [\n", ":2: expected the node content"),
    ],
)
def test_a_file_that_is_no_launch_file_is_refused(
    tmp_path: Path, name: str, text: str, what: str
) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(LaunchError) as raised:
        evaluate(path)
    assert str(raised.value).startswith(str(path))
    assert what in str(raised.value)


def test_packages_are_found_by_programs(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PACKAGES, str(workspace.parent))
    assert get_package_share_directory("demo") == str(workspace)
    assert get_package_share_path("demo") == workspace
    with pytest.raises(PackageNotFoundError) as raised:
        get_package_share_directory("none")
    assert str(raised.value).startswith("package 'none' was not found; it was looked for in\n")
    assert isinstance(raised.value, KeyError)
