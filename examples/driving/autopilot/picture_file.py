"""Figures of Matplotlib as SVG: the same numbers give the same text, and text stays text."""

from __future__ import annotations

import io
from typing import Any

from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "hprm",
    "font.family": "sans-serif",
}


def svg_of(figure: Figure) -> str:
    """The text of the file."""
    text = io.StringIO()
    FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None})  # type: ignore[no-untyped-call]
    return text.getvalue()
