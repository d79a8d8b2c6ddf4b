"""``python -m hprm.ros._bags``: playing and recording bags. ``hprm bag`` starts these.

What comes before the first ``+`` is for the program that plays or records, the rest are scripts
that run in one federation with it.
"""

import importlib
import sys
from pathlib import Path

from hprm.ros import __main__ as ros
from hprm.ros._words import AND

_PROGRAMS = ("play", "record")


def main() -> int:
    """Do what the command line says, and return the exit code."""
    name, *words = sys.argv[1:] or [""]
    if name not in _PROGRAMS:
        print(f"error: {name!r} is none of {', '.join(_PROGRAMS)}", file=sys.stderr)
        return 2
    try:
        from hprm.ros._bags import BagError
    except ImportError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    if AND in words:
        # Before the scripts begin, which would go on without the bag.
        program = importlib.import_module(f"hprm.ros._bags.{name}")
        try:
            program.check(words[: words.index(AND)])
        except BagError as error:
            print(f"error: {error}", file=sys.stderr)
            return 1
    sys.argv[1:] = ["run", str(Path(__file__).with_name(f"{name}.py")), *words]
    return ros.main()


if __name__ == "__main__":
    sys.exit(main())
