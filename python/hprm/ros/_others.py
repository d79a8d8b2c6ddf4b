"""What a node knows of others: names, types and numbers of topics, services and nodes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from hprm.ros._graph import Endpoint
from hprm.ros._names import full_node_name
from hprm.ros._runtime import Runtime
from hprm.ros.exceptions import NodeNameNonExistentError
from hprm.ros.expand_topic_name import expand_topic_name
from hprm.ros.topic_endpoint_info import TopicEndpointInfo
from hprm.ros.validate_full_topic_name import validate_full_topic_name
from hprm.ros.validate_topic_name import validate_topic_name

Names = list[tuple[str, list[str]]]


class Others:
    """The part of a node that tells of the others; the node has what it needs."""

    _runtime: Runtime
    _name: str
    _namespace: str
    _remapping: Any

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """Return the full name of a topic, by the rules for names that the command line states."""
        return self._resolve(topic, False, only_expand)

    def resolve_service_name(self, service: str, *, only_expand: bool = False) -> str:
        """Return the full name of a service, by the rules for names."""
        return self._resolve(service, True, only_expand)

    def count_publishers(self, topic_name: str) -> int:
        """Return how many publishers a topic has."""
        return self._count("publisher", topic_name, False)

    def count_subscribers(self, topic_name: str) -> int:
        """Return how many subscriptions a topic has."""
        return self._count("subscription", topic_name, False)

    def count_clients(self, service_name: str) -> int:
        """Return how many clients a service has."""
        return self._count("client", service_name, True)

    def count_services(self, service_name: str) -> int:
        """Return how many servers a service has."""
        return self._count("service", service_name, True)

    def get_topic_names_and_types(self, no_demangle: bool = False) -> Names:
        """Return all topics with their types."""
        return _names_and_types(self._runtime.endpoints(), "publisher", "subscription")

    def get_service_names_and_types(self) -> Names:
        """Return all services with their types."""
        return _names_and_types(self._runtime.endpoints(), "service")

    def get_publisher_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> Names:
        """Return the topics to which a node publishes, with their types."""
        return self._of_node("publisher", node_name, node_namespace)

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> Names:
        """Return the topics to which a node subscribes, with their types."""
        return self._of_node("subscription", node_name, node_namespace)

    def get_service_names_and_types_by_node(self, node_name: str, node_namespace: str) -> Names:
        """Return the services that a node serves, with their types."""
        return self._of_node("service", node_name, node_namespace)

    def get_client_names_and_types_by_node(self, node_name: str, node_namespace: str) -> Names:
        """Return the services of which a node is a client, with their types."""
        return self._of_node("client", node_name, node_namespace)

    def get_publishers_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        """Return what is known of the publishers of a topic."""
        return self._infos("publisher", topic_name)

    def get_subscriptions_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        """Return what is known of the subscriptions of a topic."""
        return self._infos("subscription", topic_name)

    def get_node_names(self) -> list[str]:
        """Return the names of all nodes."""
        return [name.rpartition("/")[2] for name in self._runtime.node_names()]

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        """Return the names and namespaces of all nodes."""
        parts = (name.rpartition("/") for name in self._runtime.node_names())
        return [(name, namespace or "/") for namespace, _, name in parts]

    def get_node_names_and_namespaces_with_enclaves(self) -> list[tuple[str, str, str]]:
        """Return the names and namespaces of all nodes; there is one enclave of security."""
        return [(name, namespace, "/") for name, namespace in self.get_node_names_and_namespaces()]

    def get_fully_qualified_node_names(self) -> list[str]:
        """Return the names of all nodes with their namespaces before them."""
        return self._runtime.node_names()

    def wait_for_node(self, fully_qualified_node_name: str, timeout: float) -> bool:
        """Wait until there is a node, or for so many seconds; return whether there is."""
        name = "/" + fully_qualified_node_name.lstrip("/")
        return self._runtime.block(lambda: name in self._runtime.node_names(), round(timeout * 1e9))

    def _count(self, kind: str, name: str, is_service: bool) -> int:
        return self._runtime.count(kind, self._resolve(name, is_service, True))

    def _of_node(self, kind: str, name: str, namespace: str) -> Names:
        node = full_node_name(name, namespace)
        found = [it for it in self._runtime.endpoints() if it.node == node]
        if not found and node not in self._runtime.node_names():
            raise NodeNameNonExistentError(
                f"cannot get the names of a node that is not there: {node}"
            )
        return _names_and_types(found, kind)

    def _infos(self, kind: str, name: str) -> list[TopicEndpointInfo]:
        topic = self._resolve(name, False, False)
        found = [it for it in self._runtime.endpoints() if it.kind == kind and it.name == topic]
        return [TopicEndpointInfo.of(it, number) for number, it in enumerate(found)]

    def _resolve(self, name: str, is_service: bool, only_expand: bool) -> str:
        validate_topic_name(name, is_service=is_service)
        full = expand_topic_name(name, self._name, self._namespace)
        validate_full_topic_name(full, is_service=is_service)
        if only_expand:
            return full
        remap = self._remapping.service if is_service else self._remapping.topic
        resolved: str = remap(full, self._name, self._namespace)
        return resolved


def _names_and_types(endpoints: Iterable[Endpoint], *kinds: str) -> Names:
    found: dict[str, set[str]] = {}
    for it in endpoints:
        if it.kind in kinds:
            found.setdefault(it.name, set()).add(it.type)
    return [(name, sorted(types)) for name, types in sorted(found.items())]
