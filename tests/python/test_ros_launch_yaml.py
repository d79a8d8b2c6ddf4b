"""Launch files in YAML: the same actions as in Python, and mistakes with their lines."""

from __future__ import annotations

from pathlib import Path

import pytest
from ros_workspaces import assert_same_actions, demo_package

from hprm.ros._launch import LaunchError, evaluate

YAML = """\
launch:
- arg: {name: rate, default: "10", description: Hz}
- let: {name: robot, value: "r$(var rate)"}
- set_env: {name: HPRM_TEST, value: "1"}
- log: {message: "at $(dirname)", unless: "false"}
- log: {message: "never", if: $(not true)}
- include:
    file: $(find-pkg-share demo)/launch/inner.yaml
    arg: [{name: which, value: talker}]
- group:
  - push-ros-namespace: {namespace: $(var robot)}
  - set_parameter: {name: all, value: 1}
  - set_remap: {from: a, to: b}
  - node:
      pkg: demo
      exec: listener
      name: ear
      args: --say "$(var rate) times" -v
      ros_args: --log-level info
      output: screen
      env: [{name: X, value: "2"}]
      remap: [{from: c, to: d}]
      param:
      - {name: rate, value: $(var rate)}
      - {name: text, value: $(var rate), type: str}
      - {name: list, value: [1, 2]}
      - {name: deep, param: [{name: down, value: true}]}
      - {from: "$(dirname)/p.yaml"}
- timer: {period: 1.5, children: [{executable: {cmd: "echo '$(eval 1 + 1)' x", name: e}}]}
- set_use_sim_time: {value: true}
"""


def test_yaml_has_the_same_actions(tmp_path: Path) -> None:
    launch = demo_package(tmp_path) / "launch"
    (launch / "p.yaml").write_text("/**: {ros__parameters: {a: 1}}\n")
    (launch / "inner.yaml").write_text(
        'launch: [{arg: {name: which}}, {node: {pkg: demo, exec: "$(var which)"}}]\n'
    )
    (launch / "test.yaml").write_text(YAML)
    plan = evaluate(launch / "test.yaml", {"rate": "5"})
    assert_same_actions(plan, launch, [])


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("- colour: {}", 2, "there is no action 'colour'; there are: arg, executable"),
        ("- node_container: {}", 2, "node_container: not supported: components are libraries"),
        ("- log: {}", 2, "log: 'message' is missing"),
        ("- log: {message: x, colour: red}", 2, "log: there is no attribute 'colour'"),
        ("- log: {message: x, if: '1', unless: '1'}", 2, "there is either 'if' or 'unless'"),
        ("- log: {message: [1]}", 2, "log: 'message' is a text"),
        ("- log: {message: $(var}", 2, "$(var is not closed"),
        ("- log: {message: $(colour x)}", 2, "there is no substitution 'colour'; there are: all"),
        ("- log: {message: $(var a b c)}", 2, "$(var) does not take 3 arguments"),
        ("- log: {message: $()}", 2, "there is no name behind $("),
        ("- log", 1, "an action is a map with its name as the only key"),
        ("- log: x", 2, "'log' has a map of attributes"),
        ("- arg: {}", 2, "arg: 'name' is missing"),
        ("- executable: {}", 2, "executable: 'cmd' is missing"),
        ('- executable: {cmd: "echo \'x"}', 2, "'cmd' cannot be read: No closing quotation"),
        ("- group: {children: 3}", 2, "actions are a list"),
        ("- log: {message: x}\n- node:\n    exec: x\n    param: 3", 4, "'param' is a list of maps"),
        ("- node: {exec: x, param: [{value: 3}]}", 2, "a parameter has a 'name'"),
        ("- node: {exec: x, param: [{name: a}]}", 2, "the parameter 'a' has no value"),
        ("- node: {exec: x, param: [{name: a, value: 1, type: x}]}", 2, "'type' is one of str"),
    ],
)
def test_mistakes_in_yaml_have_lines(tmp_path: Path, text: str, line: int, what: str) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(f"launch:\n{text}\n")
    with pytest.raises(LaunchError) as raised:
        evaluate(path)
    assert str(raised.value).startswith(f"{path}:{line}: ")
    assert what in str(raised.value)


def test_substitutions_in_yaml_may_be_nested_and_quoted(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(
        "launch:\n"
        "- let: {name: inner, value: key}\n"
        "- let: {name: key, value: found}\n"
        "- log: {message: \"$(var $(var inner)) $(env NONE 'a b') \\\\$(x) $(var none '')|\"}\n"
        "- log: {message: \"$(if $(equals $(var key) found) yes no) $(eval '1 + 2')\"}\n"
    )
    assert evaluate(path).messages == ["found a b $(x) |", "yes 3"]
