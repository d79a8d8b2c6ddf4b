"""Events of lifecycles, as in ``launch_ros.events.lifecycle``: none is supported."""

from typing import Any

from hprm.ros._launch._plans import LaunchError


class ChangeState:
    """Not supported: a launch is evaluated before it runs."""

    def __init__(self, **kwargs: Any) -> None:
        """Raise ``LaunchError``."""
        raise LaunchError(
            "ChangeState is not supported: a launch is evaluated before it runs; call the service"
            " change_state from a node, or trigger_configure() and trigger_activate() in the node"
            " itself"
        )


class StateTransition(ChangeState):
    """Not supported: a launch is evaluated before it runs."""
