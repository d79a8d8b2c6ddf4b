"""The demonstration: a film of a drive, and how long a frame takes in both coordinations.

Run by `make drive`; writes `drive.mp4`, `drive.json` and `drive.svg` into `out` under the root of
the repository.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import deque
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

from .latency import PROGRESS
from .picture_file import STYLE, svg_of

HERE = Path(__file__).resolve().parents[1]
OUT = HERE.parents[1] / "out"
WARM_UP, FRAMES, FILMED = 100, 400, 600
MEASURED = {"centralized": "DrivingCentralized.lf", "decentralized": "DrivingDecentralized.lf"}


class RunError(Exception):
    """A program did not end well; the message has its last lines."""


def main() -> int:
    """Runs everything, prints a table, and returns the exit code."""
    OUT.mkdir(exist_ok=True)
    film = OUT / "drive.mp4"
    try:
        results = {
            name: _run(name, program, WARM_UP + FRAMES, []) for name, program in MEASURED.items()
        }
        filmed = _run("film", "DrivingFilm.lf", FILMED, ["--film", str(film)])
    except RunError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    for name, told in results.items():
        took = np.array(told["latencies_ns"][WARM_UP:]) / 1e6
        low, middle, high = np.percentile(took, [25, 50, 75])
        rate = told["frames_a_second"]
        print(f"{name:14} {middle:6.1f} ms a frame ({low:.1f} to {high:.1f}), {rate:.0f} frames/s")
    print(filmed["printed"])
    data, picture = OUT / "drive.json", OUT / "drive.svg"
    data.write_text(json.dumps(results) + "\n")
    picture.write_text(
        box_plot({name: it["latencies_ns"][WARM_UP:] for name, it in results.items()})
    )
    for file in (film, data, picture):
        print(f"wrote {file.relative_to(OUT.parent)}")
    return 0


def box_plot(latencies: dict[str, list[int]]) -> str:
    """A box for each coordination, from quartile to quartile, with whiskers to 5 and 95 percent."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.2), layout="constrained")
        axes = figure.add_subplot()
        values = [np.array(it) / 1e6 for it in latencies.values()]
        axes.boxplot(
            values,
            orientation="horizontal",
            tick_labels=list(latencies),
            whis=(5, 95),
            showfliers=False,
            widths=0.5,
        )
        axes.set_xlabel("milliseconds from a frame to its control")
        axes.set_xlim(left=0)
        axes.grid(axis="x", color="#e2e2e2")
        axes.set_title("Communication and inference", loc="left", fontweight="bold")
        return svg_of(figure)


def _run(name: str, program: str, frames: int, more: list[str]) -> dict[str, Any]:
    """Runs a program under a progress bar, and returns what it measured and printed."""
    with tempfile.NamedTemporaryFile(prefix="drive-") as measured:
        hprm = Path(sys.executable).parent / "hprm"
        words = ["--frames", str(frames), "--measure", measured.name, *more]
        argv = [str(hprm), "run", program, "--", *words]
        lines, code = _follow(name, argv)
        if code:
            raise RunError("\n".join([f"{program} ended with exit code {code}", *lines]))
        told: dict[str, Any] = json.loads(Path(measured.name).read_bytes())
    return told | {"printed": "\n".join(line for line in lines if " warning: " not in line)}


def _follow(name: str, argv: list[str]) -> tuple[list[str], int]:
    last: deque[str] = deque(maxlen=30)
    columns = (TextColumn("{task.description:14}"), BarColumn(), TaskProgressColumn())
    console = Console(stderr=True)
    with tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(argv, cwd=HERE, text=True, stdout=subprocess.PIPE, stderr=errors)
        assert process.stdout is not None
        try:
            with Progress(*columns, console=console, auto_refresh=False, transient=True) as bar:
                task = bar.add_task(name, total=1.0)
                for line in process.stdout:
                    text = line.rstrip().removeprefix("[simulator] ")
                    if text.startswith(PROGRESS):
                        done, total = text.removeprefix(PROGRESS).split()
                        bar.update(task, completed=int(done) / int(total), refresh=True)
                    else:
                        last.append(text)
            code = process.wait()
        finally:
            process.terminate()
            process.wait()
        errors.seek(0)
        complaints = errors.read().splitlines()
    if code:
        last.extend(complaints)
    return list(last), code


if __name__ == "__main__":
    sys.exit(main())
