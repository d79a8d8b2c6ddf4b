"""A picture of W6: a line for each contender over the sizes, and below it the ratio to a rival.

Both axes are logarithmic. A band reaches from the least to the greatest of the repetitions. A group
of workloads is a panel; panels stand side by side and have the same axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import matplotlib
from figures import Spread
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator
from picture import FAINT, GRID, STYLE, svg_of
from tables import label, number

_PANEL, _LEFT, _HEIGHT = 5.0, 0.8, 6.0
_HEIGHTS = (3, 1.3)
"""Of the times, and of the ratios below."""
_CAPTION = "size of the array (log scale); bands: from the least repetition to the greatest"
_NAME = 1.5
"""The width of a name in the legend."""
_TICK_EVERY = 2
"""Each second power of two is named: more names would touch one another."""


class _Look(NamedTuple):
    colour: str
    dashes: Any
    marker: str


_DASHED = (0, (2.4, 1.2))
LOOKS = {
    "hprm centralized": _Look("#0072b2", "-", "o"),
    "hprm decentralized": _Look("#d55e00", "-", "s"),
    "hprm spinning": _Look("#d55e00", _DASHED, "s"),
    "hprm spinning centralized": _Look("#0072b2", _DASHED, "o"),
    "limit": _Look("#444444", "-", "v"),
    "limit spinning": _Look("#444444", _DASHED, "v"),
    "iceoryx2": _Look("#009e73", "-", "^"),
    "iceoryx2 polling": _Look("#009e73", _DASHED, "^"),
}
"""Colours that people with colour blindness can tell apart. What waits in a busy loop is dashed."""
_ANOTHER = _Look("#cc79a7", "-", "D")


@dataclass(frozen=True)
class Line:
    """A contender: its times and its ratios to the rival by size; ours are set off."""

    name: str
    ours: bool
    times: Mapping[int, Spread]
    ratios: Mapping[int, Spread]


@dataclass(frozen=True)
class Panel:
    """One group of workloads."""

    title: str
    lines: Sequence[Line]


def svg(title: str, unit: str, rival: str, panels: Sequence[Panel]) -> str:
    """Draws the panels; each must have a line with a time."""
    compared = any(line.ratios for panel in panels for line in panel.lines)
    heights = _HEIGHTS if compared else _HEIGHTS[:1]
    with matplotlib.rc_context(STYLE):
        size = (_LEFT + _PANEL * len(panels), _HEIGHT * sum(heights) / sum(_HEIGHTS))
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(
            len(heights),
            len(panels),
            sharex=True,
            sharey="row",
            squeeze=False,
            gridspec_kw={"height_ratios": heights},
        )
        for place, panel in enumerate(panels):
            _times(grid[0, place], panel)
            if compared:
                _ratios(grid[1, place], panel)
            _sizes(grid[-1, place], panel)
        grid[0, 0].set_ylabel(f"{unit} (log scale)")
        if compared:
            grid[1, 0].set_ylabel(f"multiple of {rival}")
        _legend(figure)
        figure.suptitle(title, x=0.01, ha="left", fontsize=10.5, fontweight="bold")
        return svg_of(figure)


def _draw(axes: Axes, line: Line, spreads: Mapping[int, Spread]) -> None:
    look = LOOKS.get(line.name, _ANOTHER)
    sizes = sorted(spreads)
    least = [spreads[size].least for size in sizes]
    greatest = [spreads[size].greatest for size in sizes]
    front = 3 if line.ours else 2
    axes.fill_between(sizes, least, greatest, color=look.colour, alpha=0.15, lw=0, zorder=1)
    medians = [spreads[size].median for size in sizes]
    axes.plot(sizes, medians, zorder=front, **_drawn(line, look))


def _drawn(line: Line, look: _Look) -> dict[str, Any]:
    """How a line looks, in a panel and in the legend."""
    width, dot = (2.2, 4.5) if line.ours else (1.1, 3.5)
    return {
        "color": look.colour,
        "linestyle": look.dashes,
        "linewidth": width,
        "marker": look.marker,
        "markersize": dot,
        "markerfacecolor": look.colour if look.dashes == "-" else "white",
        "label": line.name,
    }


def _times(axes: Axes, panel: Panel) -> None:
    for line in panel.lines:
        _draw(axes, line, line.times)
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda tick, _: number(tick)))
    axes.set_title(panel.title, loc="left", fontsize=9.5)
    _plain(axes)


def _ratios(axes: Axes, panel: Panel) -> None:
    for line in panel.lines:
        if line.ratios:
            _draw(axes, line, line.ratios)
    axes.set_yscale("log", base=2)
    axes.yaxis.set_major_locator(LogLocator(base=2, numticks=20))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda tick, _: number(tick)))
    axes.axhline(1, color="#222222", linewidth=0.9, zorder=1.5)
    _plain(axes)


def _sizes(axes: Axes, panel: Panel) -> None:
    sizes = sorted({size for line in panel.lines for size in line.times})
    axes.set_xscale("log", base=2)
    axes.xaxis.set_major_locator(FixedLocator(sizes[::_TICK_EVERY]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda tick, _: label(round(tick))))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.tick_params(axis="x", labelsize=8)
    axes.set_xlabel(_CAPTION, color=FAINT, fontsize=8)


def _plain(axes: Axes) -> None:
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(color=GRID)
    axes.tick_params(length=0, labelcolor=FAINT)


def _legend(figure: Figure) -> None:
    shown: dict[str, Any] = {}
    for axes in figure.axes:
        handles, names = axes.get_legend_handles_labels()
        shown |= dict(zip(names, handles, strict=True))
    columns = min(len(shown), int(figure.get_figwidth() / _NAME))
    below: dict[str, Any] = {"loc": "outside lower left", "ncols": columns, "frameon": False}
    figure.legend(list(shown.values()), list(shown), **below, handlelength=3, columnspacing=1.4)
