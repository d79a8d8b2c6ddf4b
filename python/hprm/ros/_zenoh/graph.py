"""The nodes elsewhere and their endpoints: what the scripts are told of them, as data.

News are for all scripts: an endpoint or a node that is there, or gone; and flows that are *open*,
which scripts send to the bridge because an endpoint elsewhere takes them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from hprm.ros._graph import BRIDGE, Endpoint, Flow
from hprm.ros._offers import elsewhere
from hprm.ros._zenoh.keys import is_wanted
from hprm.ros._zenoh.tokens import Token, quality_of, read

News = tuple[Any, ...]

#: What nodes of ROS 2 Humble have in the place of a hash.
HUMBLE = "TypeHashNotSupported"


class Outside:
    """The entities of other sessions.

    Parameters
    ----------
    zid
        The identity of the session of this run, whose own tokens do not count.
    wanted
        The names of topics and services that count; all if there are none.
    warn
        Is told what users should know, once each.

    """

    def __init__(self, zid: str, wanted: tuple[str, ...], warn: Callable[[str], None]) -> None:
        """Know no entity yet."""
        self._zid, self._wanted, self._warn = zid, wanted, warn
        self._tokens: dict[str, Token] = {}
        self._here: dict[str, tuple[Endpoint, str]] = {}
        #: Names of topics that scripts subscribe to, and of services that they call.
        self._used: set[str] = set()
        self._open: Counter[Flow] = Counter()
        self._announced: set[str] = set()
        self._told: set[tuple[str, ...]] = set()

    def declare(self, endpoint: Endpoint, digest: str) -> None:
        """Note an endpoint of a script, with the hash of its type."""
        if endpoint.kind in ("subscription", "client"):
            self._used.add(endpoint.name)
        if endpoint.name not in self._here:
            self._here[endpoint.name] = endpoint, digest
            for token in self._tokens.values():
                self._fits(token)

    def add(self, text: str) -> list[News]:
        """Note a token that is there."""
        token = read(text)
        if token is None or token.session.zid == self._zid or text in self._tokens:
            return []
        if token.kind == "node":
            self._tokens[text] = token
            return [("node", BRIDGE, token.node)]
        if not is_wanted(token.name, self._wanted):
            return []
        self._tokens[text] = token
        if not self._fits(token):
            return []
        self._announced.add(text)
        news: list[News] = [("endpoint", BRIDGE, asdict(_endpoint(token)))]
        flow = _taken(token)
        if flow is not None:
            self._open[flow] += 1
            if self._open[flow] == 1:
                news.append(("open", flow.kind, flow.name))
        return news

    def known(self) -> list[News]:
        """Return what a script has to be told that begins later than others."""
        news: list[News] = []
        for text, token in self._tokens.items():
            if token.kind == "node":
                news.append(("node", BRIDGE, token.node))
            elif text in self._announced:
                news.append(("endpoint", BRIDGE, asdict(_endpoint(token))))
        return [*news, *(("open", it.kind, it.name) for it, count in self._open.items() if count)]

    def remove(self, text: str) -> list[News]:
        """Note that a token is gone."""
        token = self._tokens.pop(text, None)
        if token is None:
            return []
        if token.kind == "node":
            return [("node gone", BRIDGE, token.node)]
        if text not in self._announced:
            return []
        self._announced.remove(text)
        if token.kind in ("publisher", "service") and token.name in self._used:
            does = "publishes" if token.kind == "publisher" else "serves"
            told = f"the node {token.node} elsewhere {does} {token.name} no more"
            self._tell(told, "gone", token.name)
        news: list[News] = [("endpoint gone", BRIDGE, asdict(_endpoint(token)))]
        flow = _taken(token)
        if flow is not None:
            self._open[flow] -= 1
            if self._open[flow] == 0:
                news.append(("close", flow.kind, flow.name))
        return news

    def _fits(self, token: Token) -> bool:
        """Return whether an endpoint elsewhere has the type that its name has here, if any."""
        here = self._here.get(token.name)
        if here is None:
            return True
        endpoint, digest = here
        if (token.type, token.digest) == (endpoint.type, digest):
            return True
        what = "topic" if token.kind in ("publisher", "subscription") else "service"
        there = f"{token.type} of the node {token.node} elsewhere"
        if token.digest == HUMBLE:
            why = f"{there}, which runs on ROS 2 Humble: nodes before Iron have other keys"
        elif token.type == endpoint.type:
            why = f"another definition of {there}"
        else:
            why = there
        self._tell(
            f"the {what} {token.name} has two types, so they are not connected: {endpoint.type} of"
            f" the node {endpoint.node}, and {why}",
            token.name,
            token.type,
            token.digest,
        )
        return False

    def _tell(self, text: str, *what: str) -> None:
        if what not in self._told:
            self._told.add(what)
            self._warn(text)


def _endpoint(token: Token) -> Endpoint:
    kind: Any = token.kind
    quality = elsewhere(quality_of(token.quality))
    return Endpoint(kind, token.node, token.name, token.type, quality)


def _taken(token: Token) -> Flow | None:
    """Return the flow that is open as long as an endpoint is there."""
    match token.kind:
        case "subscription":
            return Flow("topic", token.name)
        case "service":
            return Flow("request", token.name)
    return None
