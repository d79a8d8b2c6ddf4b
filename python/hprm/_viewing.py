"""``hprm echo --foxglove``, and how commands that watch end: what is wrong is one error."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable

from hprm import _hprm
from hprm._watching import WatchError


def view(options: argparse.Namespace) -> int:
    """Show what passes connections of a running federation. Return the exit code."""
    return run_to_end(lambda: _view(options))


def run_to_end(watch: Callable[[], None]) -> int:
    """Watch a federation to its end, or until Ctrl-C, the usual one. Return the exit code."""
    try:
        watch()
    except WatchError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 0
    print("the federation has ended", file=sys.stderr)
    return 0


def _view(options: argparse.Namespace) -> None:
    try:
        from hprm import _foxglove
    except ModuleNotFoundError as error:
        if error.name != "foxglove":
            raise
        raise WatchError(
            f"the package foxglove-sdk is not installed for {sys.executable}",
            f"install it there: {sys.executable} -m pip install foxglove-sdk",
        ) from None
    with _hprm.watch_ports(
        options.ports, options.of, options.wait, False, options=True
    ) as messages:
        viewers = _foxglove.Viewers(options.host, options.port)
        print(f"open {viewers.address} in Foxglove; Ctrl-C ends", flush=True)
        try:
            viewers.show(messages)
        finally:
            viewers.stop()
