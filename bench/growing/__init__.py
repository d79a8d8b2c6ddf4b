"""What HPRM costs as federations and messages grow; `../growth.py` is the command.

`programs.py` has the federations, `measures.py` what is taken from a run of one.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

# What is used of them are programs beside one another, not packages.
for _folder in ("bench", "bench/peers", "examples/broadcast_gather"):
    if str(ROOT / _folder) not in sys.path:
        sys.path.append(str(ROOT / _folder))
