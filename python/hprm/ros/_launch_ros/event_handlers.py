"""What is done when something happens to a node, as in ``launch_ros.event_handlers``."""

from hprm.ros._launch.event_handlers import EventHandler


class OnStateTransition(EventHandler):
    """Not supported: a launch is evaluated before it runs."""
