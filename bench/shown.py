"""Tables of the small benchmarks in a terminal, drawn by rich. Those of `bench/peers` are there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import rich.box
from rich.console import Console
from rich.table import Table


def show(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], names: int = 1) -> None:
    """Print rows of text below a title. The first columns hold names, the others numbers."""
    table = Table(box=rich.box.SIMPLE)
    for number, column in enumerate(columns):
        table.add_column(column, justify="left" if number < names else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    console = Console()
    if not console.is_terminal:
        # A file has no width: nothing is cut.
        console = Console(width=200)
    console.print(title, table, sep="\n", highlight=False)
