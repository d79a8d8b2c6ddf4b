"""The picture of the results: medians with whiskers to the 99th percentile, as SVG text.

It places shapes and nothing else; the numbers come from `summary.py`. The vertical axis is
logarithmic, the sizes stand at equal distances.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

from summary import Summary

_WIDTH, _HEIGHT = 760, 460
_LEFT, _RIGHT, _TOP, _BOTTOM = 72, 24, 70, 60
_COLOURS = ("#0072b2", "#d55e00")
_INK, _FAINT, _GRID = "#222222", "#666666", "#e2e2e2"
_FONT = "Helvetica, Arial, 'DejaVu Sans', sans-serif"
_SERIES_GAP = 22


@dataclass(frozen=True)
class _Frame:
    """Where a size and a latency lie in the picture."""

    sizes: Sequence[int]
    low: float
    high: float

    def x(self, size: int, series: int, series_count: int) -> float:
        slot = (_WIDTH - _LEFT - _RIGHT) / len(self.sizes)
        centre = _LEFT + slot * (self.sizes.index(size) + 0.5)
        return centre + (series - (series_count - 1) / 2) * _SERIES_GAP

    def y(self, latency_ms: float) -> float:
        share = math.log(latency_ms / self.low) / math.log(self.high / self.low)
        return _HEIGHT - _BOTTOM - share * (_HEIGHT - _TOP - _BOTTOM)

    def ticks(self) -> Iterator[float]:
        """The round numbers on the axis: 1, 2 and 5 times each power of ten."""
        last = math.ceil(math.log10(self.high))
        for exponent in range(math.floor(math.log10(self.low)), last + 1):
            for digit in (1, 2, 5):
                tick = digit * 10.0**exponent
                if self.low <= tick <= self.high:
                    yield tick


def svg(results: Mapping[str, Mapping[int, Summary]], title: str, subtitle: str) -> str:
    """Draws one series per coordination over the sizes."""
    summaries = [summary for by_size in results.values() for summary in by_size.values()]
    frame = _Frame(
        sizes=list(next(iter(results.values()))),
        low=_round_down(0.85 * min(summary.median for summary in summaries)),
        high=_round_up(max(summary.p99 for summary in summaries)),
    )
    parts = [*_heading(title, subtitle), *_axes(frame)]
    for index, (name, by_size) in enumerate(results.items()):
        parts += _series(frame, index, len(results), by_size)
        parts += _legend_entry(index, name)
    body = "\n".join(f"  {part}" for part in parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_WIDTH}" height="{_HEIGHT}"'
        f' viewBox="0 0 {_WIDTH} {_HEIGHT}" font-family="{_FONT}" font-size="13">\n{body}\n</svg>\n'
    )


def _heading(title: str, subtitle: str) -> list[str]:
    return [
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="#ffffff"/>',
        _text(_LEFT, 28, title, size=17, weight="bold"),
        _text(_LEFT, 48, subtitle, size=12, colour=_FAINT),
    ]


def _axes(frame: _Frame) -> list[str]:
    bottom, right = _HEIGHT - _BOTTOM, _WIDTH - _RIGHT
    middle_y, middle_x = (_TOP + bottom) / 2, (_LEFT + right) / 2
    parts = []
    for tick in frame.ticks():
        y = frame.y(tick)
        parts.append(_line(_LEFT, y, right, y, _GRID))
        parts.append(_text(_LEFT - 8, y + 4, f"{tick:g}", anchor="end", colour=_FAINT))
    parts.append(_line(_LEFT, bottom, right, bottom, _INK))
    for size in frame.sizes:
        x = frame.x(size, 0, 1)
        parts.append(_text(x, bottom + 20, f"{size}", anchor="middle", colour=_FAINT))
    parts.append(_text(middle_x, _HEIGHT - 16, "array size in MB", anchor="middle"))
    parts.append(
        f'<g transform="translate(20 {middle_y:.1f}) rotate(-90)">'
        + _text(0, 0, "latency of a round in ms (log scale)", anchor="middle")
        + "</g>"
    )
    return parts


def _series(
    frame: _Frame, index: int, series_count: int, by_size: Mapping[int, Summary]
) -> list[str]:
    colour = _COLOURS[index % len(_COLOURS)]
    points = [
        (frame.x(size, index, series_count), frame.y(summary.median), summary)
        for size, summary in by_size.items()
    ]
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y, _ in points)
    stroke = f'stroke="{colour}" stroke-width="1.5" stroke-opacity="0.45"'
    parts = [f'<polyline points="{path}" fill="none" {stroke}/>']
    # The labels of two series that lie close together keep to different sides of their points.
    anchor, dx, dy = ("end", -8, -5) if index == 0 else ("start", 8, 13)
    for x, y, summary in points:
        top = frame.y(summary.p99)
        parts.append(_line(x, y, x, top, colour, width=1.5))
        parts.append(_line(x - 5, top, x + 5, top, colour, width=1.5))
        parts.append(_marker(index, x, y, colour))
        label = f"{summary.median:.3g}"
        parts.append(_text(x + dx, y + dy, label, anchor=anchor, size=12, colour=colour))
    return parts


def _legend_entry(index: int, name: str) -> list[str]:
    colour = _COLOURS[index % len(_COLOURS)]
    x, y = _LEFT + 20, _TOP + 20 + 20 * index  # a corner that rising curves leave empty
    return [_marker(index, x, y, colour), _text(x + 12, y + 4, name)]


def _marker(index: int, x: float, y: float, colour: str) -> str:
    if index == 0:
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4.5" fill="{colour}"/>'
    return f'<rect x="{x - 4:.1f}" y="{y - 4:.1f}" width="8" height="8" fill="{colour}"/>'


def _line(x1: float, y1: float, x2: float, y2: float, colour: str, width: float = 1) -> str:
    return (
        f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
        f' stroke="{colour}" stroke-width="{width:g}"/>'
    )


def _text(
    x: float,
    y: float,
    words: str,
    *,
    size: int = 13,
    anchor: str = "start",
    colour: str = _INK,
    weight: str = "normal",
) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}"'
        f' font-weight="{weight}" fill="{colour}">{escape(words)}</text>'
    )


def _round_up(value: float) -> float:
    """The first above it of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(digit * power for digit in (1, 2, 5, 10) if digit * power > value)


def _round_down(value: float) -> float:
    """The last up to it of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(digit * power for digit in (5, 2, 1) if digit * power <= value)
