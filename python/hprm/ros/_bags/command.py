"""``hprm bag``: what a bag has in it, and the same bag in the other format."""

from __future__ import annotations

import argparse
import sys

from hprm.ros import _messages


def run(options: argparse.Namespace) -> int:
    """Do what the command line says. Return the exit code; what is wrong is one error."""
    _messages.install()
    try:
        from hprm.ros._bags import BagError, BagReader, convert
    except ImportError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    try:
        if options.bag == "info":
            for path in options.paths:
                with BagReader(path) as bag:
                    print(bag.info.json() if options.json else bag.info.text())
        else:
            made = convert(options.source, options.destination, options.storage)
            print(f"{made.path}: {made.count} messages, {made.storage}")
    except BagError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0
