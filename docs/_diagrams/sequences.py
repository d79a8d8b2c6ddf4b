"""Draws the sequence diagrams of the handbook: run `python docs/_diagrams/sequences.py`.

They use the colours of the page that shows them, light or dark, so pages include them by
`{raw} html` with `:file:`. A test compares the files with what this script draws.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from pathlib import Path

HERE = Path(__file__).parent
COLUMN = 230
LEFT = 140
TOP = 40
ROW = 34
STYLE = """\
.sequence { max-width: 100%; height: auto; font: 13px system-ui, sans-serif; }
.sequence text { fill: var(--color-foreground-primary, #222); }
.sequence .quiet { fill: var(--color-foreground-muted, #666); font-size: 12px; }
.sequence .life { stroke: var(--color-foreground-border, #999); stroke-dasharray: 3 4; }
.sequence .line { stroke: var(--color-foreground-secondary, #555); stroke-width: 1.4; }
.sequence .late { stroke: #d9822b; }
.sequence .head { fill: var(--color-foreground-secondary, #555); }
.sequence .box { fill: var(--color-background-secondary, #f4f4f4);
  stroke: var(--color-foreground-border, #999); }
.sequence .run { fill: #2a9d6f; }
.sequence .wait { fill: #d9a02b; opacity: 0.55; }"""


@dataclass
class Sequence:
    """A diagram: lives from left to right, time from top to bottom."""

    name: str
    title: str
    lives: list[str]
    shapes: list[str] = field(default_factory=list)
    right: int = 170
    row: float = 0

    def x(self, life: str) -> int:
        """Where the line of a life is."""
        return LEFT + self.lives.index(life) * COLUMN

    @property
    def y(self) -> float:
        """Where the current row is."""
        return TOP + 30 + self.row * ROW

    def next(self, rows: float = 1) -> None:
        """Let time pass."""
        self.row += rows

    def text(self, x: float, y: float, words: str, anchor: str = "middle", css: str = "") -> None:
        """Write words."""
        mark = f' class="{css}"' if css else ""
        self.shapes.append(
            f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}"{mark}>{escape(words)}</text>'
        )

    def message(self, sender: str, receiver: str, words: str, late: bool = False) -> None:
        """An arrow with words above it."""
        a, b = self.x(sender), self.x(receiver)
        a, b = (a + 6, b - 7) if a < b else (a - 6, b + 7)
        tip = -8 if a < b else 8
        css = "line late" if late else "line"
        drop = 10
        self.shapes.append(
            f'<line class="{css}" x1="{a}" y1="{self.y:g}" x2="{b}" y2="{self.y + drop:g}"/>'
        )
        self.shapes.append(f'<path class="head" d="M{b},{self.y + drop:g} l{tip},-5 l0,9 z"/>')
        self.text((a + b) / 2, self.y - 5, words)
        self.next()

    def bar(self, life: str, rows: float, css: str, words: str, right: bool = True) -> None:
        """What a life does for some rows, from here on: `run` or `wait`."""
        x = self.x(life)
        self.shapes.append(
            f'<rect class="{css}" x="{x - 6}" y="{self.y:g}" width="12" height="{rows * ROW:g}"'
            ' rx="2"/>'
        )
        at, anchor = (x + 13, "start") if right else (x - 13, "end")
        self.text(at, self.y + min(rows * ROW / 2, ROW / 2) + 4, words, anchor, "quiet")

    def svg(self) -> str:
        """The whole picture."""
        width = LEFT + COLUMN * (len(self.lives) - 1) + self.right
        height = self.y + 16
        lines = [
            f'<svg class="sequence" xmlns="http://www.w3.org/2000/svg" role="img"'
            f' width="{width}" viewBox="0 0 {width} {height:g}">',
            f"<title>{escape(self.title)}</title>",
            f"<style>{STYLE}</style>",
        ]
        for life in self.lives:
            x = self.x(life)
            lines.append(
                f'<line class="life" x1="{x}" y1="{TOP}" x2="{x}" y2="{height - 4:g}"/>'
                f'<rect class="box" x="{x - 55}" y="10" width="110" height="28" rx="5"/>'
                f'<text x="{x}" y="29" text-anchor="middle">{escape(life)}</text>'
            )
        return "\n".join([*lines, *self.shapes, "</svg>\n"])


def centralized() -> Sequence:
    """A tag under centralized coordination."""
    s = Sequence(
        "centralized",
        "The camera sends a message of tag 0 through the RTI, which grants the detector tag 0",
        ["camera", "RTI", "detector"],
    )
    s.bar("camera", 1, "run", "tag 0", right=False)
    s.bar("detector", 4.6, "wait", "waits for a grant")
    s.next(1.4)
    s.message("camera", "RTI", "message of tag 0")
    s.message("camera", "RTI", "0 completed, next 100 ms")
    s.row -= 0.8
    s.message("RTI", "detector", "message of tag 0")
    s.message("RTI", "detector", "grant: tag 0")
    s.bar("detector", 1, "run", "tag 0")
    s.next(1.3)
    s.message("detector", "RTI", "0 completed")
    return s


def decentralized() -> Sequence:
    """Tags under decentralized coordination: in time, early, and too late."""
    s = Sequence(
        "decentralized",
        "The camera sends straight to the detector, which waits no longer than the program says",
        ["camera", "detector"],
        right=280,
    )
    s.bar("camera", 1, "run", "100 ms is due", right=False)
    s.bar("detector", 2.3, "wait", "100 ms is due: waits for its image")
    s.next(1.6)
    s.message("camera", "detector", "image of 100 ms")
    s.row -= 0.3
    s.bar("detector", 1, "run", "100 ms, with its image")
    s.next(2.2)
    s.bar("camera", 3.2, "run", "200 ms takes long", right=False)
    s.bar("detector", 2, "wait", "200 ms is due: waits 50 ms at most")
    s.next(2)
    s.bar("detector", 1, "run", "200 ms, image absent")
    s.next(1.8)
    s.message("camera", "detector", "image of 200 ms: tardy", late=True)
    s.row -= 0.4
    s.bar("detector", 1, "run", "(200 ms, 1): the tardy handler")
    s.next(1.2)
    return s


DIAGRAMS = [centralized, decentralized]


def main() -> None:
    """Write the files."""
    for draw in DIAGRAMS:
        diagram = draw()
        (HERE / f"{diagram.name}.svg").write_text(diagram.svg())


if __name__ == "__main__":
    main()
