"""One process of a session: the hub or a node, over the transport that the session names.

Run as `main.py ROLE [INDEX]` with the session in the environment (`session.py`). What is said is in
`script.py`; a transport moves it and knows nothing of workloads.
"""

from __future__ import annotations

import importlib
import sys
from contextlib import closing
from typing import Any

from script import Answers, cells_of, messages
from session import Session, pin


def main(role: str, index: int) -> None:
    """Plays the role to the end of the session."""
    session = Session.here()
    pin(session.hub_cpu if role == "hub" else session.node_cpu)
    # Only now: the threads of a library stay where the process was when it started them.
    transport: Any = importlib.import_module(f"transports.{session.transport}")
    if role == "hub":
        with closing(transport.Hub(session)) as hub:
            _lead(session, hub)
    else:
        with closing(transport.Node(session, index)) as node:
            _serve(node)


def _lead(session: Session, hub: Any) -> None:
    with open(session.out, "w") as out:
        script = messages(cells_of(session.plan), out)
        step = next(script, None)
        while step is not None:
            message, answered = step
            hub.send(message)
            try:
                step = script.send(hub.receive() if answered else None)
            except StopIteration:
                step = None


def _serve(node: Any) -> None:
    answers = Answers()
    while not answers.stopped:
        reply = answers.answer(node.receive())
        if reply is not None:
            node.reply(reply)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 0)
