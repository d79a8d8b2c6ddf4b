"""Launch files in XML: the same actions as in YAML and Python, and mistakes with their lines."""

from __future__ import annotations

from pathlib import Path

import pytest
from ros_workspaces import assert_same_actions, demo_package, no_modules_of_launch

from hprm.ros._launch import LaunchError, ProcessPlan, evaluate

XML = """\
<?xml version="1.0"?>
<launch version="0.1.1">
  <!-- a comment -->
  <arg name="rate" default="10" description="Hz"><choice value="5"/><choice value="10"/></arg>
  <let name="robot" value="r$(var rate)"/>
  <set_env name="HPRM_TEST" value="1"/>
  <log message="at $(dirname)" unless="false"/>
  <log message="never" if="$(not true)"/>
  <include file="$(find-pkg-share demo)/launch/inner.xml">
    <arg name="which" value="talker"/>
  </include>
  <group>
    <push-ros-namespace namespace="$(var robot)"/>
    <set_parameter name="all" value="1"/>
    <set_remap from="a" to="b"/>
    <node pkg="demo" exec="listener" name="ear" args='--say "$(var rate) times" -v'
          ros_args="--log-level info" output="screen">
      <env name="X" value="2"/>
      <remap from="c" to="d"/>
      <param name="rate" value="$(var rate)"/>
      <param name="text" value="$(var rate)" type="str"/>
      <param name="list" value="1, 2" value-sep=","/>
      <param name="half" value="0.5"/>
      <param name="word" value="half of it"/>
      <param name="deep"><param name="down" value="true"/></param>
      <param from="$(dirname)/p.yaml"/>
    </node>
  </group>
  <timer period="1.5">
    <executable cmd="echo '$(eval 1 + 1)' x" name="e" shell="true"/>
  </timer>
</launch>
"""


def test_xml_has_the_same_actions(tmp_path: Path) -> None:
    launch = demo_package(tmp_path) / "launch"
    (launch / "p.yaml").write_text("/**: {ros__parameters: {a: 1}}\n")
    (launch / "inner.xml").write_text(
        '<launch><arg name="which"/><node pkg="demo" exec="$(var which)"/></launch>\n'
    )
    (launch / "test.launch.xml").write_text(XML)
    plan = evaluate(launch / "test.launch.xml", {"rate": "5"})
    assert_same_actions(plan, launch, [{"half": 0.5}, {"word": "half of it"}])
    echo = plan.processes[-1]
    assert isinstance(echo, ProcessPlan) and echo.shell
    assert plan.arguments[0].choices == ["5", "10"]


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("<launch>\n<colour/>\n</launch>", 2, "there is no action 'colour'; there are: arg"),
        ("<launch>\n<log/>\n</launch>", 2, "log: 'message' is missing"),
        ("<launch>\n\n<log message='x' colour='red'/></launch>", 3, "no attribute 'colour'"),
        ("<launch>\n<group scoped='x'/></launch>", 2, "'scoped' is 'x': it has to be true"),
        ("<launch>\n<log message='x'></launch>", 2, "mismatched tag"),
        ("<launch>\nhello\n</launch>", 2, "the text 'hello' belongs to no attribute"),
        ("<robot/>", 1, "a launch file in XML has the element 'launch'"),
        ("<launch colour='red'/>", 1, "launch: there is no attribute 'colour'"),
        ("<launch>\n<node exec='x' param='1'>\n<param/></node></launch>", 3, "an attribute, too"),
        ("", 1, "no element found"),
    ],
)
def test_mistakes_in_xml_have_lines(tmp_path: Path, text: str, line: int, what: str) -> None:
    path = tmp_path / "a.launch.xml"
    path.write_text(text)
    with pytest.raises(LaunchError) as raised:
        evaluate(path)
    assert str(raised.value).startswith(f"{path}:{line}: ")
    assert what in str(raised.value)


def test_launch_files_in_python_include_those_in_xml_and_yaml(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text("<launch><log message='xml'/></launch>")
    (tmp_path / "b.yaml").write_text("launch: [{log: {message: yaml}}]")
    (tmp_path / "all.launch.py").write_text(
        "from launch import LaunchDescription\n"
        "from launch.actions import IncludeLaunchDescription\n"
        "from launch_xml.launch_description_sources import XMLLaunchDescriptionSource\n"
        "from launch_yaml.launch_description_sources import YAMLLaunchDescriptionSource\n"
        "def generate_launch_description():\n"
        "    return LaunchDescription([\n"
        "        IncludeLaunchDescription(XMLLaunchDescriptionSource('a.xml')),\n"
        "        IncludeLaunchDescription(YAMLLaunchDescriptionSource('b.yaml')),\n"
        "    ])\n"
    )
    with no_modules_of_launch():
        assert evaluate(tmp_path / "all.launch.py").messages == ["xml", "yaml"]
