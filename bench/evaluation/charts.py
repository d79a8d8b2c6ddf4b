"""The pictures of the page, as SVG: lines over sizes, and boxes. Both have logarithmic axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from figures import Spread
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator
from picture import STYLE, svg_of

from .record import Record
from .texts import OURS, best_first

_OURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
_PEERS = ("#7f7f7f", "#b8860b", "#8c6bb1", "#41ab5d", "#3690c0", "#c51b8a", "#a6611a", "#4d4d4d")
_DASHES = ("-", "--", ":")
_NOT_A_PEER = ("limit", "memcpy, recycled", "memcpy, fresh memory")
_FAINT, _GRID, _FILL = "#666666", "#e2e2e2", "#f3f7ea"


def lines(record: Record, title: str, unit: str) -> str:
    """A line for each contender over the cases, at equal distances; bars reach to the extremes."""
    cases = record.cases()
    spreads = {name: [record.spread(name, case) for case in cases] for name in best_first(record)}
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(8.6, 5.2), layout="constrained")
        axes = figure.add_subplot()
        # By the order in which they were measured, so that each has one colour in all pictures.
        ours, peers = _split(record.contenders())
        for place, name in enumerate(peers):
            _line(axes, name, spreads[name], _peer_style(name, place))
        for place, name in enumerate(ours):
            style = {"color": _OURS[place % len(_OURS)], "linewidth": 2.4, "zorder": 3}
            _line(axes, name, spreads[name], style)
        axes.set_yscale("log")
        _ticks(axes.yaxis)
        axes.set_xticks(range(len(cases)), cases)
        axes.set_ylabel(f"{unit} (log scale)")
        axes.tick_params(length=0, labelcolor=_FAINT)
        _legend(axes, list(spreads))
        figure.suptitle(title, x=0.01, ha="left", fontsize=10.5, fontweight="bold")
        return svg_of(figure)


def boxes(title: str, unit: str, samples: Mapping[str, Sequence[float]]) -> str:
    """A box for each contender, from quartile to quartile, with whiskers to 5 and 95 percent."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(8.6, 1.2 + 0.34 * len(samples)), layout="constrained")
        axes = figure.add_subplot()
        names = list(samples)
        axes.boxplot(
            [np.array(samples[name]) for name in names],
            orientation="horizontal",
            tick_labels=names,
            whis=(5, 95),
            flierprops={"marker": ".", "markersize": 3, "markeredgecolor": "#999999"},
            medianprops={"color": _OURS[1], "linewidth": 1.6},
            widths=0.55,
        )
        axes.set_xscale("log")
        _ticks(axes.xaxis)
        axes.invert_yaxis()
        for place, label in enumerate(axes.get_yticklabels(), start=1):
            if label.get_text().startswith(OURS):
                label.set_fontweight("bold")
                axes.axhspan(place - 0.5, place + 0.5, color=_FILL, zorder=0)
        axes.tick_params(length=0)
        axes.set_xlabel(f"{unit} (log scale); box: quartiles, whiskers: 5 to 95 %", color=_FAINT)
        figure.suptitle(title, x=0.01, ha="left", fontsize=10.5, fontweight="bold")
        return svg_of(figure)


def _split(names: Sequence[str]) -> tuple[list[str], list[str]]:
    ours = [name for name in names if name.startswith(OURS)]
    return ours, [name for name in names if name not in ours]


def _peer_style(name: str, place: int) -> dict[str, object]:
    if name in _NOT_A_PEER:
        return {"color": "black", "linestyle": ":", "linewidth": 1.2}
    dash = _DASHES[place // len(_PEERS) % len(_DASHES)]
    return {"color": _PEERS[place % len(_PEERS)], "linewidth": 1.1, "linestyle": dash}


def _line(
    axes: Axes, name: str, spreads: Sequence[Spread | None], style: dict[str, object]
) -> None:
    shown = [(place, spread) for place, spread in enumerate(spreads) if spread is not None]
    xs = [place for place, _ in shown]
    medians = [spread.median for _, spread in shown]
    axes.plot(xs, medians, marker="o", markersize=3.5, label=name, **style)  # type: ignore[arg-type]
    ends = [spread.least for _, spread in shown], [spread.greatest for _, spread in shown]
    axes.vlines(xs, *ends, color=str(style["color"]), linewidth=0.8)


def _legend(axes: Axes, order: Sequence[str]) -> None:
    """Names beside the lines, the slowest on top, as the lines are."""
    handles = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    names = [name for name in reversed(order) if name in handles]
    legend = axes.legend(
        [handles[name] for name in names],
        names,
        loc="center left",
        bbox_to_anchor=(1.01, 0.5),
        frameon=False,
    )
    for text in legend.get_texts():
        if text.get_text().startswith(OURS):
            text.set_fontweight("bold")


def _ticks(axis: Axis) -> None:
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high / low < 2000 else (1,)))
    axis.set_major_formatter(FuncFormatter(lambda tick, _: f"{tick:g}"))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())
    axis.grid(color=_GRID)
