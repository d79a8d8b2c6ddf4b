"""What launch files import from ``launch_ros.descriptions``."""

from typing import Any

from hprm.ros._launch._plans import LaunchError
from hprm.ros._launch_ros.parameter_descriptions import Parameter as Parameter
from hprm.ros._launch_ros.parameter_descriptions import ParameterFile as ParameterFile
from hprm.ros._launch_ros.parameter_descriptions import ParameterValue as ParameterValue


class ComposableNode:
    """Not supported: components are libraries in C++."""

    def __init__(self, **kwargs: Any) -> None:
        """Raise ``LaunchError``."""
        raise LaunchError("ComposableNode is not supported: components are libraries in C++")
