"""Launch files as data, as in the package ``launch``.

A launch file is evaluated before anything starts: ``evaluate`` gives a plan, which has the
processes with all that was stated for them, and what follows when something happens.
"""

from typing import Any

from hprm.ros._launch import actions as actions
from hprm.ros._launch import conditions as conditions
from hprm.ros._launch import event_handlers as event_handlers
from hprm.ros._launch import events as events
from hprm.ros._launch import launch_description_sources as launch_description_sources
from hprm.ros._launch import substitutions as substitutions
from hprm.ros._launch import utilities as utilities
from hprm.ros._launch._entities import Action as Action
from hprm.ros._launch._entities import Condition as Condition
from hprm.ros._launch._entities import LaunchContext as LaunchContext
from hprm.ros._launch._entities import LaunchDescription as LaunchDescription
from hprm.ros._launch._entities import LaunchDescriptionEntity as LaunchDescriptionEntity
from hprm.ros._launch._entities import SomeText as SomeSubstitutionsType
from hprm.ros._launch._entities import Substitution as Substitution
from hprm.ros._launch._evaluate import declared_arguments as declared_arguments
from hprm.ros._launch._evaluate import evaluate as evaluate
from hprm.ros._launch._evaluate import parse_arguments as parse_arguments
from hprm.ros._launch._introspection import LaunchIntrospector as LaunchIntrospector
from hprm.ros._launch._plans import LaunchError as LaunchError
from hprm.ros._launch._plans import LaunchPlan as LaunchPlan
from hprm.ros._launch._plans import NodePlan as NodePlan
from hprm.ros._launch._plans import ProcessPlan as ProcessPlan
from hprm.ros._launch.event_handlers import EventHandler as EventHandler
from hprm.ros._launch.events import Event as Event
from hprm.ros._launch.launch_description_sources import (
    InvalidLaunchFileError as InvalidLaunchFileError,
)
from hprm.ros._launch.launch_description_sources import (
    LaunchDescriptionSource as LaunchDescriptionSource,
)

__all__ = [
    "Action",
    "Condition",
    "Event",
    "EventHandler",
    "InvalidLaunchFileError",
    "LaunchContext",
    "LaunchDescription",
    "LaunchDescriptionEntity",
    "LaunchDescriptionSource",
    "LaunchIntrospector",
    "SomeSubstitutionsType",
    "Substitution",
]


def __getattr__(name: str) -> Any:
    """Say of what launch has, and this package does not, what serves instead."""
    if name == "LaunchService":
        raise ImportError(
            f"launch.{name} is not there: the command `hprm launch` runs launch files"
        )
    raise AttributeError(f"module 'launch' has no attribute {name!r}")
