"""On what the numbers were measured: the machine and the versions, for the result files."""

from __future__ import annotations

import os
import platform
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np


def describe(hprm: Path) -> dict[str, Any]:
    """What a reader of the results needs to know about where they come from."""
    version = subprocess.run([str(hprm), "--version"], capture_output=True, text=True, check=False)
    return {
        "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "cpu": _field("/proc/cpuinfo", "model name") or platform.machine(),
        "cpus": len(os.sched_getaffinity(0)),
        "memory": _field("/proc/meminfo", "MemTotal"),
        "kernel": platform.release(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "hprm": version.stdout.strip(),
    }


def _field(file: str, name: str) -> str | None:
    """The value of the first line ``name : value`` in a file of the kernel, if it has one."""
    try:
        text = Path(file).read_text()
    except OSError:
        return None
    values = (line.partition(":")[2] for line in text.splitlines() if line.startswith(name))
    value = next(values, None)
    return value.strip() if value is not None else None
