"""Nodes in launch files, as in the package ``launch_ros``."""

from hprm.ros._launch_ros import actions as actions
from hprm.ros._launch_ros import descriptions as descriptions
from hprm.ros._launch_ros import parameter_descriptions as parameter_descriptions
from hprm.ros._launch_ros import substitutions as substitutions
