"""Full names of topics, as in ``rclpy.expand_topic_name``."""

from hprm.ros._names import expand


def expand_topic_name(topic_name: str, node_name: str, node_namespace: str) -> str:
    """Return the absolute name that a topic's name stands for in a node.

    It may still be invalid; ``validate_full_topic_name`` says so. Raises ``ValueError`` if the
    topic's name, the node's name or its namespace is invalid.
    """
    return expand(topic_name, node_name, node_namespace)
