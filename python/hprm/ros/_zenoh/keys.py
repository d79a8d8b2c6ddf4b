"""The names of the protocol: key expressions of topics and services, and types as in DDS."""

from __future__ import annotations

#: The first part of the keys of liveliness tokens.
ADMIN = "@ros2_lv"

#: The largest domain of ROS 2 on Linux.
LAST_DOMAIN = 232


def dds_name(type_: str) -> str:
    """Return ``std_msgs::msg::dds_::String_`` for ``std_msgs/msg/String``."""
    package, kind, name = type_.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def ros_name(type_: str) -> str:
    """Return ``std_msgs/msg/String`` for ``std_msgs::msg::dds_::String_``; others as they are."""
    parts = type_.split("::")
    if len(parts) == 4 and parts[2] == "dds_" and parts[3].endswith("_"):
        return f"{parts[0]}/{parts[1]}/{parts[3][:-1]}"
    return type_


def key(domain: int, name: str, type_: str, digest: str) -> str:
    """Return the key of a topic or a service, with its full name, its type and its hash."""
    return f"{domain}/{name.strip('/')}/{dds_name(type_)}/{digest}"


def mangled(name: str) -> str:
    """Return a name as one part of a key."""
    return name.replace("/", "%") or "%"


def demangled(name: str) -> str:
    """Return the name that :func:`mangled` has made one part of."""
    return name.replace("%", "/")


def domain(text: str) -> int:
    """Read the number of a domain.

    Raises
    ------
    ValueError
        If it is none.

    """
    if not text.isascii() or not text.isdigit() or int(text) > LAST_DOMAIN:
        raise ValueError(
            f"{text!r} is no domain of ROS 2: these are numbers from 0 to {LAST_DOMAIN}"
        )
    return int(text)


def is_wanted(name: str, wanted: tuple[str, ...]) -> bool:
    """Return whether a topic, a service or a part of an action is one of those; all if none."""
    return not wanted or any(name == it or name.startswith(f"{it}/_action/") for it in wanted)
