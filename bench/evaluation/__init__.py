"""The evaluation of the paper on HPRM, figure by figure; `../evaluate.py` is the command.

A module for each figure measures it and says what the paper has and what differs; `record.py` is
what all of them measure into, `page.py` what shows them. Processes are started as by `../peers`.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

# What is used of them are programs beside one another, not packages.
for _folder in ("bench", "bench/peers", "examples/broadcast_gather"):
    if str(ROOT / _folder) not in sys.path:
        sys.path.append(str(ROOT / _folder))
