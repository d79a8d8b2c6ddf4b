"""zenoh: a peer for each program, linked over TCP on loopback; messages pickled in band.

With shared memory, messages of 4 KB and more are written into a buffer of the provider.
"""

from __future__ import annotations

import pickle
import time
from typing import Any

from session import Session
from transports import files
from transports.zenoh import Writer, free_port, open_session, reader

from edges import ROLES, arriving, leaving


class Ends:
    """A publisher for each edge that leaves, a subscriber for each that arrives."""

    def __init__(self, session: Session, role: str) -> None:
        """Links to the programs before it in the list; waits until all that it says is read."""
        port = free_port()
        before = ROLES[: ROLES.index(role)]
        others = [int(files.wait(session.path(f"port-{other}"))) for other in before]
        self._link = open_session(session, listen=[port], connect=others)
        files.publish(session.path(f"port-{role}"), str(port))
        self._readers = {edge: reader(self._link, f"drive/{edge}") for edge in arriving(role)}
        self._writers = {
            edge: Writer(session, self._link, f"drive/{edge}") for edge in leaving(role)
        }
        for writer in self._writers.values():
            writer.wait_for_reader()

    def send(self, edge: str, message: Any) -> None:
        """Pickles and publishes."""
        self._writers[edge].write(pickle.dumps(message, protocol=5))

    def receive(self, edge: str) -> Any:
        """Takes the next sample and unpickles it."""
        return pickle.loads(self._readers[edge].recv().payload.to_bytes())

    def close(self) -> None:
        """Lets the last messages go and ends."""
        time.sleep(0.3)
        self._link.close()
