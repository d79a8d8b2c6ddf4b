"""Liveliness tokens: the keys by which nodes and their endpoints are seen elsewhere.

The quality of service of an endpoint is a part of its token, with the numbers of ROS 2's policies;
what is as in the default profile of the protocol is left out.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

from hprm.ros._zenoh.keys import ADMIN, dds_name, demangled, mangled, ros_name

#: The kinds of entities, by how endpoints are called here.
KINDS = {"publisher": "MP", "subscription": "MS", "service": "SS", "client": "SC", "node": "NN"}
_NAMES = {short: kind for kind, short in KINDS.items()}

#: The depth that is not written.
_DEPTH = 42

_RELIABILITY = {"": "RELIABLE", "1": "RELIABLE", "2": "BEST_EFFORT"}
_DURABILITY = {"": "VOLATILE", "1": "TRANSIENT_LOCAL", "2": "VOLATILE"}
_HISTORY = {"": "KEEP_LAST", "1": "KEEP_LAST", "2": "KEEP_ALL"}


@dataclass(frozen=True)
class Session:
    """What all tokens of a session have in common."""

    domain: int
    #: The identity of the session, in hexadecimal digits.
    zid: str


@dataclass(frozen=True)
class Token:
    """A node or an endpoint."""

    session: Session
    #: ``publisher``, ``subscription``, ``service``, ``client`` or ``node``.
    kind: str
    #: The full name of the node.
    node: str
    #: The numbers of the node and of the entity within the session.
    numbers: tuple[int, int]
    #: Of an endpoint: its full name, its type as ``std_msgs/msg/String``, and the hash of that.
    name: str = ""
    type: str = ""
    digest: str = ""
    #: The quality of service, as it is written.
    quality: str = ""

    def text(self) -> str:
        """Return the key."""
        namespace, _, node = self.node.rpartition("/")
        nid, eid = self.numbers
        parts = [ADMIN, str(self.session.domain), self.session.zid, str(nid), str(eid)]
        parts += [KINDS[self.kind], "%", mangled(namespace), node]
        if self.kind != "node":
            parts += [mangled(self.name), dds_name(self.type), self.digest, self.quality]
        return "/".join(parts)


def read(text: str) -> Token | None:
    """Read a key; none if it is no token, or one of a kind that is not known.

    What follows the quality of service is not read: newer distributions of ROS 2 say more there,
    such as how the memory of large arrays may be shared.
    """
    admin, *parts = text.split("/")
    if admin != ADMIN or not (len(parts) == 8 or len(parts) >= 12) or parts[4] not in _NAMES:
        return None
    domain, zid, nid, eid, short, _, namespace, node, *endpoint = parts
    if not (domain.isdigit() and nid.isdigit() and eid.isdigit()):
        return None
    kind = _NAMES[short]
    if (kind == "node") == bool(endpoint):
        return None
    above = demangled(namespace).rstrip("/")
    session = Session(int(domain), zid)
    numbers = int(nid), int(eid)
    if kind == "node":
        return Token(session, kind, f"{above}/{node}", numbers)
    name, type_, digest, quality, *_ = endpoint
    return Token(
        session,
        kind,
        f"{above}/{node}",
        numbers,
        demangled(name),
        ros_name(demangled(type_)),
        digest,
        quality,
    )


def gid(token: str) -> bytes:
    """Return the identity of an endpoint, which is all that others expect of it."""
    return hashlib.blake2b(token.encode(), digest_size=16).digest()


def quality_text(quality: dict[str, Any]) -> str:
    """Write a quality of service, as an endpoint describes it, for a token."""
    reliability = "2" if quality.get("reliability") == "BEST_EFFORT" else ""
    durability = "1" if quality.get("durability") == "TRANSIENT_LOCAL" else ""
    # Endpoints have no depth if they keep all.
    depth = quality.get("depth", _DEPTH)
    history = "2," if depth is None else f",{'' if depth == _DEPTH else depth}"
    return f"{reliability}:{durability}:{history}:,:,:,,"


def quality_of(text: str) -> dict[str, Any]:
    """Read the quality of service of a token; what is not known is as in the default profile."""
    reliability, durability, history, *_ = [*text.split(":"), "", "", ""]
    policy, _, depth = history.partition(",")
    keeps_all = _HISTORY.get(policy) == "KEEP_ALL"
    return {
        "reliability": _RELIABILITY.get(reliability, "RELIABLE"),
        "durability": _DURABILITY.get(durability, "VOLATILE"),
        "depth": None if keeps_all else int(depth) if depth.isdigit() else _DEPTH,
    }
