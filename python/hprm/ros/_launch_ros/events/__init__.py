"""Events of nodes, as in ``launch_ros.events``."""
