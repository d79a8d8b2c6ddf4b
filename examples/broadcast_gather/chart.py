"""The picture of the results: medians with whiskers to the 99th percentile, as SVG text.

The vertical axis is logarithmic, the sizes stand at equal distances. The numbers come from
`summary.py`.
"""

from __future__ import annotations

import io
from collections.abc import Mapping

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator
from summary import Summary

_STYLE = {
    "svg.fonttype": "none",  # Text stays text.
    "svg.hashsalt": "hprm",  # The same numbers give the same file.
    "font.family": "sans-serif",
    "font.sans-serif": ["Helvetica", "Arial", "DejaVu Sans", "sans-serif"],
    "axes.spines.left": False,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.axisbelow": True,
}
_COLOURS, _MARKERS = ("#0072b2", "#d55e00"), ("o", "s")
_FAINT, _GRID = "#666666", "#e2e2e2"
_SERIES_GAP = 0.2
# The labels of two series that lie close together keep to different sides of their points.
_LABELS = ({"ha": "right", "xytext": (-7, 4)}, {"ha": "left", "xytext": (7, -11)})


def svg(results: Mapping[str, Mapping[int, Summary]], title: str, subtitle: str) -> str:
    """Draws one series per coordination over the sizes."""
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(7.6, 4.6), layout="constrained")
        axes = figure.add_subplot()
        for place, (name, by_size) in enumerate(results.items()):
            _series(axes, place, name, list(by_size.values()))
        _axes(axes, list(next(iter(results.values()))))
        axes.legend(loc="upper left", frameon=False)
        axes.set_title(title, loc="left", fontsize=13, fontweight="bold", pad=26)
        above = {"textcoords": "offset points", "xytext": (0, 11)}
        axes.annotate(subtitle, (0, 1), xycoords="axes fraction", **above, fontsize=9, color=_FAINT)
        text = io.StringIO()
        FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None})
    return text.getvalue()


def _series(axes: Axes, place: int, name: str, summaries: list[Summary]) -> None:
    xs = [slot + (place - 0.5) * _SERIES_GAP for slot in range(len(summaries))]
    medians = [summary.median for summary in summaries]
    ends = [summary.p99 for summary in summaries]
    colour = _COLOURS[place]
    axes.plot(xs, medians, color=colour, alpha=0.45)
    axes.vlines(xs, medians, ends, color=colour)
    axes.plot(xs, ends, "_", color=colour, markersize=9)
    axes.plot(xs, medians, _MARKERS[place], color=colour, label=name)
    for point in zip(xs, medians, strict=True):
        label = {"fontsize": 9, "color": colour, "textcoords": "offset points", **_LABELS[place]}
        axes.annotate(f"{point[1]:.3g}", point, **label)


def _axes(axes: Axes, sizes: list[int]) -> None:
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.set_ylim(0.85 * low, 1.4 * high)
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda tick, _: f"{tick:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.grid(color=_GRID)
    axes.tick_params(length=0, labelcolor=_FAINT)
    axes.set_xticks(range(len(sizes)), [str(size) for size in sizes])
    axes.set_xlim(-0.5, len(sizes) - 0.5)
    axes.set_xlabel("array size in MB")
    axes.set_ylabel("latency of a round in ms (log scale)")
