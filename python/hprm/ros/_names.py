"""Names of topics, services, nodes and namespaces: what is valid, and what a short one stands for.

A name as programs write it may be relative (``chatter``), private (``~/pose``), absolute
(``/chatter``), and have substitutions (``{node}``, ``{ns}``, ``{namespace}``). A *full* name is
absolute and has none of these. Functions named ``..._error`` return what is wrong and at which
index, or ``None``; rules and texts are those of rcl and rmw.
"""

from __future__ import annotations

import re
from typing import TypeAlias

#: What is wrong with a name, and the index of the first character that is wrong.
Wrong: TypeAlias = tuple[str, int]

# Of 255 characters, 8 are reserved for prefixes.
_LONGEST_TOPIC = 255 - 8
# The shortest topic in a namespace has two characters.
_LONGEST_NAMESPACE = _LONGEST_TOPIC - 2
_LONGEST_NODE = 255

_TOPIC = "topic name"
_NAMESPACE = "namespace"
_FOREIGN = re.compile(r"[^A-Za-z0-9_/]")


def topic_error(name: str) -> Wrong | None:
    """Return what is wrong with a topic's or service's name, as programs write it."""
    if not name:
        return "topic name must not be empty string", 0
    if _digit(name[0]):
        return "topic name token must not start with a number", 0
    if name.endswith("/"):
        return "topic name must not end with a forward slash", len(name) - 1
    wrong = _characters_error(name)
    if wrong is not None:
        return wrong
    number = re.search(r"/[0-9]", name)
    if name[0] == "~" and len(name) > 2 and name[1] != "/":
        return "topic name must not have a tilde '~' that is not followed by a forward slash '/'", 1
    if number:
        return "topic name token must not start with a number", number.end() - 1
    return None


def _characters_error(name: str) -> Wrong | None:
    opened: int | None = None
    for index, character in enumerate(name):
        if character == "_" or (character.isascii() and character.isalnum()):
            if opened == index - 1 and _digit(character):
                return "substitution name must not start with a number", index
        elif character == "~":
            if index != 0:
                return "topic name must not have tilde '~' unless it is the first character", index
        elif character == "}":
            if opened is None:
                return _UNBALANCED, index
            opened = None
        elif opened is not None:
            return (
                "substitution name must not contain characters other than alphanumerics or '_'",
                index,
            )
        elif character == "{":
            opened = index
        elif character != "/":
            return (
                "topic name must not contain characters other than alphanumerics, "
                "'_', '~', '{', or '}'",
                index,
            )
    return None if opened is None else (_UNBALANCED, opened)


_UNBALANCED = "topic name must not have unmatched (unbalanced) curly braces '{}'"


def full_topic_error(name: str) -> Wrong | None:
    """Return what is wrong with a topic's or service's full name."""
    wrong = _full_error(name, _TOPIC, "must not end with a '/'")
    if wrong is None and len(name) > _LONGEST_TOPIC:
        return f"topic length should not exceed '{_LONGEST_TOPIC}'", _LONGEST_TOPIC - 1
    return wrong


def namespace_error(namespace: str) -> Wrong | None:
    """Return what is wrong with a full namespace."""
    if namespace == "/":
        return None
    wrong = _full_error(namespace, _NAMESPACE, "must not end with a '/', unless only a '/'")
    if wrong is None and len(namespace) > _LONGEST_NAMESPACE:
        return f"namespace should not exceed '{_LONGEST_NAMESPACE}'", _LONGEST_NAMESPACE - 1
    return wrong


def _full_error(name: str, what: str, end: str) -> Wrong | None:
    if not name:
        return f"{what} must not be empty", 0
    if name[0] != "/":
        return f"{what} must be absolute, it must lead with a '/'", 0
    if name.endswith("/"):
        return f"{what} {end}", len(name) - 1
    if foreign := _FOREIGN.search(name):
        return (
            f"{what} must not contain characters other than alphanumerics, '_', or '/'",
            foreign.start(),
        )
    if found := re.search(r"/[/0-9]", name):
        if found[0] == "//":
            return f"{what} must not contain repeated '/'", found.end() - 1
        return f"{what} must not have a token that starts with a number", found.end() - 1
    return None


def node_name_error(name: str) -> Wrong | None:
    """Return what is wrong with a node's name, which has no namespace."""
    if not name:
        return "node name must not be empty", 0
    if foreign := re.search(r"[^A-Za-z0-9_]", name):
        return (
            "node name must not contain characters other than alphanumerics or '_'",
            foreign.start(),
        )
    if _digit(name[0]):
        return "node name must not start with a number", 0
    if len(name) > _LONGEST_NODE:
        return f"node name length should not exceed '{_LONGEST_NODE}'", _LONGEST_NODE - 1
    return None


def _digit(character: str) -> bool:
    return character in "0123456789"


def absolute_namespace(namespace: str) -> str:
    """Return the namespace that a node's constructor means: ``""`` is ``/``, ``a`` is ``/a``."""
    return namespace if namespace.startswith("/") else f"/{namespace}"


def full_node_name(name: str, namespace: str) -> str:
    """Return a node's name with its namespace: ``/robot/camera``."""
    return f"{namespace.rstrip('/')}/{name}"


def logger_name(name: str, namespace: str) -> str:
    """Return the name of a node's logger: ``robot.camera``."""
    return full_node_name(name, namespace)[1:].replace("/", ".")


def is_hidden(name: str) -> bool:
    """Return whether tools show a topic or service only if they are asked to."""
    return any(token.startswith("_") for token in name.split("/"))


def expand(name: str, node: str, namespace: str) -> str:
    """Return the absolute name that a name stands for in a node.

    It may still be invalid as a full name. Raises ``ValueError`` if the name, the node's name or
    its namespace is invalid, or if there is no such substitution.
    """
    for kind, text, wrong in (
        ("topic name", name, topic_error(name)),
        ("node name", node, node_name_error(node)),
        ("node namespace", namespace, namespace_error(namespace)),
    ):
        if wrong is not None:
            raise ValueError(f"{kind} '{text}' is invalid: {wrong[0]}")
    if name[0] == "~":
        name = full_node_name(node, namespace) + name[1:]
    known = {"{node}": node, "{ns}": namespace, "{namespace}": namespace}
    for substitution in re.findall(r"\{.*?\}", name):
        if substitution not in known:
            raise ValueError(
                f"topic name '{name}' is invalid: unknown substitution: {substitution}"
            )
        name = name.replace(substitution, known[substitution])
    return name if name[0] == "/" else f"{namespace.rstrip('/')}/{name}"
