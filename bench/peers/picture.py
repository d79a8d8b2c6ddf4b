"""A picture of one table: a line for each contender, a dot for each size, whiskers to the extremes.

The axis is logarithmic. The numbers are taken as they are.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
from figures import Spread
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",  # Text stays text.
    "svg.hashsalt": "hprm",  # The same numbers give the same file.
    "font.family": "sans-serif",
    "font.sans-serif": ["Helvetica", "Arial", "DejaVu Sans", "sans-serif"],
    "font.size": 9,
    "axes.spines.left": False,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.spines.bottom": False,
    "axes.axisbelow": True,
}
_COLOURS = ("#56b4e9", "#0072b2", "#009e73", "#e69f00", "#d55e00")
FAINT, GRID, _OURS = "#666666", "#e2e2e2", "#f3f7ea"
_WIDTH, _ROW, _AROUND = 8.6, 0.24, 1.1


@dataclass(frozen=True)
class Row:
    """A contender and its spreads, one for each column; ours are set off."""

    name: str
    ours: bool
    spreads: Sequence[Spread | None]


def svg(title: str, unit: str, columns: Sequence[str], rows: Sequence[Row]) -> str:
    """Draws the rows; there must be one with a spread above zero."""
    with matplotlib.rc_context(STYLE):
        size = (_WIDTH, _AROUND + _ROW * len(rows))
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.add_subplot()
        for place, column in enumerate(columns):
            _dots(axes, column, place, [row.spreads[place] for row in rows])
        _axis(axes, f"{unit} (log scale)")
        _names(axes, rows)
        below = {"loc": "lower left", "bbox_to_anchor": (0, 1), "borderaxespad": 0}
        axes.legend(**below, ncols=len(columns), frameon=False, handletextpad=0, columnspacing=1.2)
        figure.suptitle(title, x=0.01, ha="left", fontsize=10.5, fontweight="bold")
        return svg_of(figure)


def svg_of(figure: Figure) -> str:
    """A figure without the declaration of XML, so that a page can contain it."""
    text = io.StringIO()
    FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None})
    return text.getvalue()[text.getvalue().index("<svg") :]


def _dots(axes: Axes, column: str, place: int, spreads: Sequence[Spread | None]) -> None:
    colour = _COLOURS[place % len(_COLOURS)]
    shown = [(row, spread) for row, spread in enumerate(spreads) if spread is not None]
    ys = [row for row, _ in shown]
    ends = [spread.least for _, spread in shown], [spread.greatest for _, spread in shown]
    axes.hlines(ys, *ends, color=colour)
    axes.plot([spread.median for _, spread in shown], ys, "o", color=colour, label=column)


def _axis(axes: Axes, label: str) -> None:
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high / low < 2000 else (1,)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda tick, _: f"{tick:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.grid(color=GRID)
    axes.tick_params(length=0)
    axes.tick_params(axis="x", labelcolor=FAINT)
    axes.set_xlabel(label)


def _names(axes: Axes, rows: Sequence[Row]) -> None:
    axes.set_yticks(range(len(rows)), [row.name for row in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    for place, (row, label) in enumerate(zip(rows, axes.get_yticklabels(), strict=True)):
        if row.ours:
            label.set_fontweight("bold")
            axes.axhspan(place - 0.5, place + 0.5, color=_OURS, zorder=0)
