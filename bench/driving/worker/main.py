"""One of the four programs of the driving application, over the transport that the session names.

Run as `main.py ROLE` with the session in the environment. What the programs compute is in
examples/driving; what they do is what the reactors there do. A transport carries messages along the
edges of `edges/__init__.py`, and knows nothing of driving.
"""

from __future__ import annotations

import importlib
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

BENCH = Path(__file__).resolve().parents[2]
APPLICATION = BENCH.parent / "examples" / "driving"
sys.path.append(str(BENCH / "peers" / "worker"))

from session import Session  # noqa: E402


def main(role: str) -> None:
    """Plays the role to the end of the drive."""
    session = Session.here()
    # The same NumPy, OpenCV and ONNX Runtime as HPRM's federates have; the rest of a peer's
    # environment is its own.
    packages = session.option("packages")
    sys.path[:0] = [str(APPLICATION), packages]
    roles = importlib.import_module("roles")
    sys.path.remove(packages)
    transport: Any = importlib.import_module(f"edges.{session.transport}")
    with closing(transport.Ends(session, role)) as ends:
        getattr(roles, role)(session, ends)


if __name__ == "__main__":
    main(sys.argv[1])
