"""Reading launch files in YAML.

The file has a list ``launch``, each element of which is an action with its attributes::

    launch:
    - arg: {name: rate, default: "10"}
    - node: {pkg: demo, exec: talker, param: [{name: rate, value: $(var rate)}]}
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hprm.ros._launch._entities import LaunchDescription
from hprm.ros._launch._frontend import Map, listed
from hprm.ros._launch._plans import LaunchError


def description_of_yaml(path: Path) -> LaunchDescription:
    """Return what a launch file in YAML describes; raise ``LaunchError`` with its line if none."""
    content = _content(path)
    if not isinstance(content, Map) or list(content) != ["launch"]:
        raise LaunchError(f"{path}: a launch file in YAML has the key 'launch', and no other one")
    return LaunchDescription(listed(content["launch"], path, content.line))


def _content(path: Path) -> Any:
    try:
        import yaml
    except ModuleNotFoundError:
        raise LaunchError(
            f"{path}: launch files in YAML need PyYAML, which is not installed: "
            "pip install 'hprm[ros]'"
        ) from None

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        def construct_lined(self, node: yaml.MappingNode) -> Map:
            self.flatten_mapping(node)
            result = Map(self.construct_mapping(node, deep=True))
            result.line = node.start_mark.line + 1
            return result

    Loader.add_constructor("tag:yaml.org,2002:map", Loader.construct_lined)
    try:
        return yaml.load(path.read_text(encoding="utf-8"), Loader=Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = "" if mark is None else f":{mark.line + 1}"
        why = getattr(error, "problem", None) or str(error)
        raise LaunchError(f"{path}{line}: {why}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise LaunchError(f"{path}: the launch file cannot be read: {error}") from None
