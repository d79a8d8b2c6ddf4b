"""What the READMEs of `examples/` say: commands, terminals, and what these print.

A block `sh` has commands, one a line, each of which prints the block `text` behind it. A block
`console` has terminals: a line `NAME$ COMMAND` starts a command in a terminal of that name, a line
`NAME$` goes on to read it, and the lines below are what it prints until then. Output is compared as
in the pages of the handbook.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from processes import until
from stories import same

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
BLOCK = re.compile(r"^```(sh|text|console)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PROMPT = re.compile(r"([a-z]+)\$(?: (.*))?")


@dataclass(frozen=True)
class Command:
    """A command, and what it prints."""

    argv: list[str]
    printed: str


@dataclass
class Step:
    """What one terminal shows, until the reader looks at another one."""

    terminal: str
    command: str | None
    printed: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Terminals:
    """Commands that run beside one another."""

    steps: list[Step]

    def words(self) -> set[str]:
        """All words of all commands."""
        return {word for step in self.steps for word in shlex.split(step.command or "")}

    def run(self, place: Path, environment: Mapping[str, str], replaced: dict[str, str]) -> None:
        """Start each command as soon as the terminals show what is above it."""
        running: dict[str, Terminal] = {}
        try:
            for step in self.steps:
                if step.command is not None:
                    command = substitute(step.command, replaced)
                    running[step.terminal] = Terminal(command, place, environment)
                terminal = running[step.terminal]
                terminal.expected += [substitute(line, replaced) for line in step.printed]
                until(terminal.has_come, f"{terminal.expected} is shown, not {terminal.lines}")
            for terminal in running.values():
                terminal.end()
        finally:
            for terminal in running.values():
                terminal.close()


class Terminal:
    """A command that runs, and what it has printed."""

    def __init__(self, command: str, place: Path, environment: Mapping[str, str]) -> None:
        self.lines: list[str] = []
        self.expected: list[str] = []
        self.process = subprocess.Popen(
            shlex.split(command), cwd=place, env=environment, stdout=subprocess.PIPE, text=True
        )
        self.reader = threading.Thread(target=self.read)
        self.reader.start()

    def read(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as lines:
            for line in lines:
                self.lines.append(line.rstrip("\n"))

    def has_come(self) -> bool:
        """Whether all lines have been printed that are expected so far."""
        expected = "".join(f"{line}\n" for line in self.expected)
        return same(expected, "\n".join(self.lines))

    def end(self) -> None:
        """Wait for the end, and compare all that was printed."""
        assert self.process.wait(60) == 0, self.lines
        self.reader.join()
        assert self.has_come(), self.lines

    def close(self) -> None:
        """Leave nothing behind, whatever has failed."""
        self.process.kill()
        self.process.wait()
        self.reader.join()


def substitute(text: str, replaced: dict[str, str]) -> str:
    for old, new in replaced.items():
        text = text.replace(old, new)
    return text


def readmes() -> list[tuple[Path, list[Command | Terminals]]]:
    """Each folder of examples, and what its README says."""
    found = sorted(EXAMPLES.glob("*/README.md"))
    return [(path.parent, list(parts(path.read_text()))) for path in found]


def parts(text: str) -> Iterator[Command | Terminals]:
    blocks = [(match[1], match[2]) for match in BLOCK.finditer(text)]
    for (kind, content), (_, printed) in zip(blocks, [*blocks[1:], ("", "")], strict=True):
        if kind == "sh":
            for line in content.splitlines():
                yield Command(shlex.split(line), printed)
        elif kind == "console":
            yield terminals(content)


def terminals(content: str) -> Terminals:
    steps: list[Step] = []
    for line in content.splitlines():
        if prompt := PROMPT.fullmatch(line):
            steps.append(Step(prompt[1], prompt[2]))
        else:
            steps[-1].printed.append(line)
    return Terminals(steps)
