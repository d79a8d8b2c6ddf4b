"""A picture of one table: a line for each contender, a dot for each size, whiskers to the extremes.

The axis is logarithmic. It places shapes as SVG text, and takes its numbers as they are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

from figures import Spread

_WIDTH, _LEFT, _RIGHT, _TOP, _ROW, _BOTTOM = 860, 170, 30, 64, 24, 44
_COLOURS = ("#56b4e9", "#0072b2", "#009e73", "#e69f00", "#d55e00")
_INK, _FAINT, _GRID, _OURS = "#222222", "#666666", "#e2e2e2", "#f3f7ea"
_FONT = "Helvetica, Arial, 'DejaVu Sans', sans-serif"


@dataclass(frozen=True)
class Row:
    """A contender and its spreads, one for each column; ours are set off."""

    name: str
    ours: bool
    spreads: Sequence[Spread | None]


@dataclass(frozen=True)
class _Axis:
    low: float
    high: float

    def x(self, value: float) -> float:
        share = math.log(value / self.low) / math.log(self.high / self.low)
        return _LEFT + share * (_WIDTH - _LEFT - _RIGHT)

    def ticks(self) -> Iterator[float]:
        """The powers of ten, and 2 and 5 times them where there is room."""
        digits = (1, 2, 5) if self.high / self.low < 2000 else (1,)
        for exponent in range(
            math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1
        ):
            for digit in digits:
                if self.low <= (tick := digit * 10.0**exponent) <= self.high:
                    yield tick


def svg(title: str, unit: str, columns: Sequence[str], rows: Sequence[Row]) -> str:
    """Draws the rows; there must be one with a spread above zero."""
    values = [bound for row in rows for spread in row.spreads if spread for bound in spread[1:]]
    low, high = min(values), max(values)
    axis = _Axis(low / 1.15, max(high, 1.01 * low) * 1.15)
    height = _TOP + _ROW * len(rows) + _BOTTOM
    parts = [f'<rect width="{_WIDTH}" height="{height}" fill="#ffffff"/>']
    parts.append(_text(12, 22, title, size=14, weight="bold"))
    parts += _legend(columns)
    parts += [part for place, row in enumerate(rows) if row.ours for part in _set_off(place)]
    parts += _grid(axis, height, unit)
    for place, row in enumerate(rows):
        parts += _dots(axis, place, row)
    body = "\n".join(f"  {part}" for part in parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_WIDTH}" height="{height}"'
        f' viewBox="0 0 {_WIDTH} {height}" font-family="{_FONT}" font-size="12">\n{body}\n</svg>\n'
    )


def _legend(columns: Sequence[str]) -> list[str]:
    parts = []
    x = float(_LEFT)
    for place, column in enumerate(columns):
        parts.append(f'<circle cx="{x:.1f}" cy="42" r="4" fill="{_colour(place)}"/>')
        parts.append(_text(x + 9, 46, column))
        x += 30 + 7 * len(column)
    return parts


def _set_off(place: int) -> list[str]:
    y = _TOP + _ROW * place
    return [f'<rect x="0" y="{y}" width="{_WIDTH}" height="{_ROW}" fill="{_OURS}"/>']


def _grid(axis: _Axis, height: int, unit: str) -> list[str]:
    parts = []
    bottom = height - _BOTTOM
    for tick in axis.ticks():
        x = axis.x(tick)
        parts.append(_line(x, _TOP, x, bottom, _GRID))
        parts.append(_text(x, bottom + 16, f"{tick:g}", anchor="middle", colour=_FAINT))
    middle = (_LEFT + _WIDTH - _RIGHT) / 2
    parts.append(_text(middle, height - 8, f"{unit} (log scale)", anchor="middle"))
    return parts


def _dots(axis: _Axis, place: int, row: Row) -> list[str]:
    y = _TOP + _ROW * (place + 0.5)
    weight = "bold" if row.ours else "normal"
    parts = [_text(_LEFT - 12, y + 4, row.name, anchor="end", weight=weight)]
    for column, spread in enumerate(row.spreads):
        if spread is not None:
            colour = _colour(column)
            parts.append(_line(axis.x(spread.least), y, axis.x(spread.greatest), y, colour))
            x = axis.x(spread.median)
            parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{colour}"/>')
    return parts


def _colour(place: int) -> str:
    return _COLOURS[place % len(_COLOURS)]


def _line(x1: float, y1: float, x2: float, y2: float, colour: str) -> str:
    return (
        f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
        f' stroke="{colour}" stroke-width="1.5"/>'
    )


def _text(
    x: float,
    y: float,
    words: str,
    *,
    size: int = 12,
    anchor: str = "start",
    colour: str = _INK,
    weight: str = "normal",
) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}"'
        f' font-weight="{weight}" fill="{colour}">{escape(words)}</text>'
    )
