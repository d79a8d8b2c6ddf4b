"""Draws the training curves: `python -m training.curves` writes an SVG beside each JSON file.

Needs Matplotlib, and nothing that the training needs.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import matplotlib
from autopilot.picture_file import STYLE, svg_of
from matplotlib.figure import Figure

MODELS = Path(__file__).resolve().parents[1] / "models"
_GRID, _PHASES = "#e2e2e2", {"imitation": "#eef3fb", "ppo": "#fdf3e6"}
Points = list[dict[str, Any]]


def policy_curve(points: Points) -> str:
    """How many journeys were completed, and how far the policy is from the expert."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.4), layout="constrained")
        axes = figure.add_subplot()
        steps = [it["steps"] / 1000 for it in points]
        begin = 0.0
        for phase, shade in _PHASES.items():
            of_phase = [at for at, it in zip(steps, points, strict=True) if it["phase"] == phase]
            if of_phase:
                axes.axvspan(begin, of_phase[-1], color=shade, linewidth=0)
                axes.text((begin + of_phase[-1]) / 2, 0.05, phase, ha="center")
                begin = of_phase[-1]
        completed = [it["ends"].get("completed", 0.0) for it in points]
        axes.plot(steps, completed, color="#2f6bb3", marker="o", markersize=3)
        axes.set_xlabel("thousands of steps of 0.1 s")
        axes.set_ylabel("completed, of the last 60 journeys")
        axes.set_xlim(left=0)
        axes.set_ylim(0, 1.05)
        axes.set_title("The policy learns", loc="left", fontweight="bold")
        return svg_of(figure)


def detector_curve(points: Points) -> str:
    """The loss of the detector."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.4), layout="constrained")
        axes = figure.add_subplot()
        axes.plot([it["steps"] for it in points], [it["loss"] for it in points], color="#2f6bb3")
        axes.set_xlabel("steps")
        axes.set_ylabel("loss")
        axes.set_yscale("log")
        axes.grid(color=_GRID)
        axes.set_title("The detector learns", loc="left", fontweight="bold")
        return svg_of(figure)


def main() -> None:
    """Draws what there is."""
    for name, draw in (("policy", policy_curve), ("detector", detector_curve)):
        data = MODELS / f"{name}.json"
        if data.exists():
            (MODELS / f"{name}.svg").write_text(draw(json.loads(data.read_text())["curve"]))
            print(f"wrote {name}.svg")


if __name__ == "__main__":
    main()
