"""Opening a session of Zenoh, as a program of ROS 2 does: with a router, or as one.

A router on this machine lets programs find one another. If none listens where it should be, the
session is the router itself, so that two runs on one machine need nothing else.
"""

from __future__ import annotations

import ipaddress
import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hprm.ros._zenoh import keys

if TYPE_CHECKING:
    import zenoh

#: Where a router of ROS 2 listens.
ROUTER = "tcp/localhost:7447"

#: Variables that programs of ROS 2 read, too.
DOMAIN, CONFIG, OVERRIDE = "ROS_DOMAIN_ID", "ZENOH_SESSION_CONFIG_URI", "ZENOH_CONFIG_OVERRIDE"


#: For how many milliseconds a session tries to reach a router where something listens.
_ANSWER_MS = 5_000


class BridgeError(Exception):
    """There can be no bridge."""


@dataclass(frozen=True)
class Settings:
    """What the user says of the bridge."""

    #: Where the router listens.
    endpoint: str = ROUTER
    domain: int = 0
    #: The names of topics, services and actions that are bridged; all if there are none.
    wanted: tuple[str, ...] = ()
    #: How much later than its stamp a message may arrive, if stamps are to be tags.
    wait_ns: int | None = None

    @classmethod
    def of(
        cls, endpoint: str, domain: str | None, wanted: list[str], wait_s: float | None = None
    ) -> Settings:
        """Read the settings of a command line, and of the environment.

        Raises
        ------
        BridgeError
            If they are wrong.

        """
        try:
            number = keys.domain(os.environ.get(DOMAIN) or "0" if domain is None else domain)
        except ValueError as error:
            raise BridgeError(
                f"{error}\n  hint: it is that of --domain-id, or of {DOMAIN}"
            ) from None
        if not _is_endpoint(endpoint):
            raise BridgeError(f"{endpoint!r} is no endpoint of Zenoh\n  hint: one is {ROUTER}")
        wait_ns = None if wait_s is None else round(wait_s * 1e9)
        return cls(endpoint, number, tuple(f"/{it.strip('/')}" for it in wanted), wait_ns)


def open_session(endpoint: str, tell: Callable[[str], None]) -> zenoh.Session:
    """Open the session, or say why there is none.

    Raises
    ------
    BridgeError
        If the package is missing, or the router cannot be reached.

    """
    library = _library()
    if not is_local(endpoint):
        return _open(library, {"mode": "client", "connect/endpoints": [endpoint]}, endpoint)
    try:
        session = _open(
            library, {"mode": "router", "listen/endpoints": [_numeric(endpoint)]}, endpoint
        )
    except BridgeError as error:
        if "in use" not in str(error):
            raise
        own = {"listen/endpoints": ["tcp/127.0.0.1:0"], "connect/endpoints": [endpoint]}
        # What is there may be something else than a router.
        tries = {"connect/timeout_ms": _ANSWER_MS, "connect/exit_on_failure": True}
        return _open(library, {"mode": "peer", **own, **tries}, endpoint)
    tell(f"no router of Zenoh listens at {endpoint}, so this run is one as long as it lasts")
    return session


def is_local(endpoint: str) -> bool:
    """Return whether an endpoint is on this machine, and reached over its loopback."""
    host = _host(endpoint).lower()
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def overrides(text: str) -> dict[str, str]:
    """Read ``KEY=VALUE;KEY=VALUE``, where values are JSON5."""
    pairs = [it.partition("=") for it in text.split(";") if it.strip()]
    wrong = [key for key, equals, _ in pairs if not equals]
    if wrong:
        raise BridgeError(f"{OVERRIDE} is KEY=VALUE;KEY=VALUE, and {wrong[0]!r} has no =")
    return {key.strip(): value.strip() for key, _, value in pairs}


def _library() -> Any:
    try:
        import zenoh
        import zenoh.ext
    except ModuleNotFoundError as missing:
        if (missing.name or "").partition(".")[0] != "zenoh":
            raise
        raise BridgeError(
            f"the package eclipse-zenoh is not installed for {sys.executable}, so nothing can be"
            f" sent over Zenoh\n  hint: install it there: {sys.executable} -m pip install"
            " 'hprm[zenoh]'"
        ) from None
    return zenoh


def _open(library: Any, stated: dict[str, Any], endpoint: str) -> zenoh.Session:
    file = os.environ.get(CONFIG)
    try:
        config = library.Config.from_file(file) if file else library.Config()
    except library.ZError as error:
        raise BridgeError(f"{CONFIG}: {file} cannot be used: {why(error)}") from None
    values = {key: json.dumps(value) for key, value in stated.items()}
    wanted = overrides(os.environ.get(OVERRIDE, ""))
    try:
        values["scouting/multicast/enabled"] = "false"
        # As ROS 2 has it: Zenoh's leaves files behind.
        values["transport/shared_memory/enabled"] = "false"
        # Caches of publishers need it.
        values["timestamping/enabled"] = "true"
        for key, value in (values | wanted).items():
            config.insert_json5(key, value)
    except library.ZError:
        # Zenoh shows its parser's insides.
        text = f"{OVERRIDE}: Zenoh has no {key}={value}"
        hint = 'values are JSON5, as in mode="client";scouting/multicast/enabled=true'
        raise BridgeError(f"{text}\n  hint: {hint}") from None
    try:
        session: zenoh.Session = library.open(config)
    except library.ZError as error:
        raise BridgeError(
            f"there is no session of Zenoh at {endpoint}: {why(error)}\n"
            "  hint: does a router of Zenoh listen there?"
        ) from None
    return session


def why(error: Exception) -> str:
    """Return what Zenoh says, without where in its source it was noticed."""
    return str(error).partition(" at /")[0].split("\n")[0].rstrip("! .")


def _is_endpoint(text: str) -> bool:
    """Return whether a text is an endpoint; of those with a port, that is a number."""
    protocol, slash, address = text.partition("/")
    if not slash or not protocol or not address:
        return False
    if protocol.startswith(("unix", "serial", "vsock")):
        return True
    host, _, port = address.rpartition(":")
    port = port.partition("?")[0].partition("#")[0]
    return bool(host) and port.isascii() and port.isdigit() and 0 < int(port) < 1 << 16


def _host(endpoint: str) -> str:
    address = endpoint.partition("/")[2]
    return address.rpartition(":")[0].strip("[]")


def _numeric(endpoint: str) -> str:
    """Return the endpoint at which nothing but this machine reaches a router."""
    return endpoint.replace("/localhost:", "/127.0.0.1:")
