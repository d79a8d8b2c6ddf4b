"""The names under which programs import what is here: ``rclpy`` is ``hprm.ros``, and so on."""

from __future__ import annotations

import importlib
import importlib.machinery
import importlib.util
import sys
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.abc import Loader, MetaPathFinder
else:
    # Their module takes 15 ms to import, and they only say what methods there are.
    Loader = MetaPathFinder = object

#: Which module stands for which, with the modules below it.
NAMES = {
    "rclpy": "hprm.ros",
    **{
        name: f"hprm.ros._{name}"
        for name in (
            "ament_index_python",
            "launch",
            "launch_ros",
            "launch_xml",
            "launch_yaml",
            "message_filters",
            "rosbag2_py",
            "rosidl_runtime_py",
            "sensor_msgs_py",
            "tf2_geometry_msgs",
            "tf2_py",
            "tf2_ros",
            "tf2_sensor_msgs",
        )
    },
}

#: What programs may import from rclpy that is left out, and why.
LEFT_OUT = {
    "rclpy.type_description_service": "nodes do not serve the descriptions of their types",
    "rclpy.subscription_content_filter_options": "a subscription gets all messages of its topic",
    "rclpy.experimental": "there is one kind of loop for all executors",
    "rclpy.waitable": "what executors wait for are timers, subscriptions, services, clients, guard"
    " conditions and events",
}


class _Loader(Loader):
    """Gives a module that has another name."""

    def __init__(self, target: str) -> None:
        self._target = target
        self._spec: importlib.machinery.ModuleSpec | None = None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        module = importlib.import_module(self._target)
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        # The import has given it the other name; it is executed already.
        module.__spec__ = self._spec


class _Finder(MetaPathFinder):
    def find_spec(
        self, name: str, _path: Sequence[str] | None = None, _target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        top, dot, rest = name.partition(".")
        if top not in NAMES:
            return None
        target = NAMES[top] + dot + rest
        try:
            found = importlib.util.find_spec(target)
        except ModuleNotFoundError:
            found = None
        if found is None:
            if name in LEFT_OUT:
                raise ModuleNotFoundError(
                    f"hprm.ros has no {name}: {LEFT_OUT[name]}\n  hint: the handbook page"
                    " howto/rclpy says what there is not",
                    name=name,
                )
            return None
        is_package = found.submodule_search_locations is not None
        return importlib.machinery.ModuleSpec(name, _Loader(target), is_package=is_package)


def install() -> None:
    """Let programs import ``rclpy`` and what belongs to it, whatever is installed."""
    if not any(isinstance(it, _Finder) for it in sys.meta_path):
        sys.meta_path.insert(0, _Finder())
