"""Bags of ROS 2 without ROS: reading, writing and converting them, in MCAP and SQLite 3.

The formats are those of ``rosbag2``, read and written by the package ``rosbags``. What is here is
imported when it is asked for: commands say it in one error if that package is missing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hprm.ros._bags.converting import convert
    from hprm.ros._bags.errors import BagError
    from hprm.ros._bags.information import BagInfo, Topic
    from hprm.ros._bags.reading import BagReader
    from hprm.ros._bags.recording import BagWriter, Recorded

_MODULES = {
    "BagError": "errors",
    "BagInfo": "information",
    "BagReader": "reading",
    "BagWriter": "recording",
    "Recorded": "recording",
    "Topic": "information",
    "convert": "converting",
}

__all__ = ["BagError", "BagInfo", "BagReader", "BagWriter", "Recorded", "Topic", "convert"]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(name)
    # Which says what to install.
    importlib.import_module("hprm.ros._messages.cdr")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
