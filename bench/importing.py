"""How long `import hprm` takes, from a wheel in an environment of its own.

Run by `make try-wheel`; `python bench/importing.py WHEEL` measures any wheel.

Prints the median and the slowest of many fresh interpreters, beside one that imports nothing.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

REPETITIONS = 30


def main(wheel: str) -> None:
    """Installs the wheel and prints a table."""
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, symlinks=True)
        python = str(Path(folder, "bin", "python"))
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", python]
        subprocess.run([*pip, "install", "--quiet", wheel], check=True)
        rows = {name: measured(python, name) for name in ("pass", "import hprm", "import numpy")}
    for statement, times in rows.items():
        print(f"{statement:14}{statistics.median(times):7.1f} ms, at most {max(times):7.1f} ms")
    own = statistics.median(rows["import hprm"]) - statistics.median(rows["pass"])
    print(f"import hprm takes {own:.1f} ms beyond the interpreter's start: {REPETITIONS} runs")


def measured(python: str, statement: str) -> list[float]:
    """Milliseconds of interpreters that run a statement, after a few that warm up."""
    times = []
    for _ in range(REPETITIONS + 3):
        start = time.perf_counter()
        subprocess.run([python, "-c", statement], check=True)
        times.append((time.perf_counter() - start) * 1e3)
    return times[3:]


if __name__ == "__main__":
    main(sys.argv[1])
