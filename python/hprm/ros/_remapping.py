"""Remapping rules: other names for topics, services, nodes and namespaces.

``a:=b`` renames topics and services, ``rostopic://a:=b`` and ``rosservice://a:=b`` only one kind;
``__node:=b`` (or ``__name:=b``) renames nodes and ``__ns:=/b`` moves them. ``camera:`` in front
limits a rule to nodes of that name. The first rule that fits decides.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Flag, auto

from hprm.ros._names import expand, namespace_error, node_name_error, topic_error


class Renamed(Flag):
    """What a rule gives another name."""

    TOPIC = auto()
    SERVICE = auto()
    NODE = auto()
    NAMESPACE = auto()


@dataclass(frozen=True)
class RemapRule:
    """One rule."""

    renamed: Renamed
    #: The name that is replaced, as it was written; empty for nodes and namespaces.
    match: str
    replacement: str
    #: The name of the nodes for which the rule is, or ``None`` for all.
    node: str | None = None


_KINDS = {
    "rostopic://": Renamed.TOPIC,
    "rosservice://": Renamed.SERVICE,
    "": Renamed.TOPIC | Renamed.SERVICE,
}
_RULE = re.compile(
    r"(?:(?P<node>[A-Za-z][A-Za-z0-9_]*|_[A-Za-z0-9_]*):(?![=/]))?"
    r"(?P<kind>rostopic://|rosservice://|)(?P<match>.*?):=(?P<replacement>.*)",
    re.DOTALL,
)


def parse_remap_rule(text: str) -> RemapRule:
    """Return the rule that a text states; raise ``ValueError`` with what is wrong if none."""
    found = _RULE.fullmatch(text)
    if found is None:
        raise ValueError("a rule is written FROM:=TO")
    node, match, replacement = found["node"], found["match"], found["replacement"]
    if match in ("__node", "__name"):
        _require(node_name_error(replacement), replacement)
        return RemapRule(Renamed.NODE, "", replacement, node)
    if match == "__ns":
        _require(namespace_error(replacement), replacement)
        return RemapRule(Renamed.NAMESPACE, "", replacement, node)
    _require(topic_error(match), match)
    _require(topic_error(replacement), replacement)
    return RemapRule(_KINDS[found["kind"]], match, replacement, node)


def _require(wrong: tuple[str, int] | None, name: str) -> None:
    if wrong is not None:
        raise ValueError(f"'{name}': {wrong[0]}")


class Remapping:
    """Rules in their order."""

    def __init__(self, *rules: Iterable[RemapRule]) -> None:
        """Join lists of rules: those of the node itself come before those of its process."""
        self._rules = [rule for some in rules for rule in some]

    def node_name(self, name: str) -> str:
        """Return the name that a node gets."""
        for rule in self._rules:
            if rule.renamed is Renamed.NODE and rule.node in (None, name):
                return rule.replacement
        return name

    def namespace(self, node: str, namespace: str) -> str:
        """Return the namespace of the node of this (new) name."""
        for rule in self._rules:
            if rule.renamed is Renamed.NAMESPACE and rule.node in (None, node):
                return rule.replacement
        return namespace

    def topic(self, name: str, node: str, namespace: str) -> str:
        """Return the name of a topic of a node, for its full name."""
        return self._renamed(Renamed.TOPIC, name, node, namespace)

    def service(self, name: str, node: str, namespace: str) -> str:
        """Return the name of a service of a node, for its full name."""
        return self._renamed(Renamed.SERVICE, name, node, namespace)

    def _renamed(self, kind: Renamed, name: str, node: str, namespace: str) -> str:
        for rule in self._rules:
            if (
                kind in rule.renamed
                and rule.node in (None, node)
                and expand(rule.match, node, namespace) == name
            ):
                return expand(rule.replacement, node, namespace)
        return name
