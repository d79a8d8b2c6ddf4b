"""Pages of the handbook as stories: which code blocks a page has, and how each is run.

CONTRIBUTING.md tells writers of pages what they may rely on. Sybil finds the blocks; what a kind of
block means is here. Which pages there are, and which blocks may stay without being run, is in
`test_handbook_pages.py`.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from processes import rust_examples
from sybil import Document, Region, Sybil
from sybil.parsers.markdown.lexers import RawFencedCodeBlockLexer

ROOT = Path(__file__).resolve().parents[2]
# How long all commands of one block may take.
LIMIT = 120
INFO = re.compile(r"(?P<info>[^\n]*)\n")
DIRECTIVE = re.compile(r"\{(?P<name>[\w-]+)\}\s*(?P<argument>.*)")
OPTION = re.compile(r":(?P<name>[\w-]+):[ ]*(?P<value>.*)\n")
NOT_RUN = re.compile(r"<!-- not run: (?P<reason>[^>]+?) -->\s*\Z")
EXAMPLE = re.compile(r"cargo run --quiet --example (?P<name>\w+)")
# What a terminal shows where its reader ends a command.
CTRL_C = "^C\n"
SPEAKER = re.compile(r"\[[\w.\[\]-]+\]")


@dataclass(frozen=True)
class Block:
    """A code block of a page: what it says of itself, and its text."""

    page: Path
    line: int
    kind: str
    source: str
    caption: str = ""
    argument: str = ""
    not_run: str = ""

    @property
    def where(self) -> str:
        """File and line, as editors know them."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    @property
    def is_terminal(self) -> bool:
        """Whether it runs beside others."""
        return self.kind == "console" and bool(self.caption)

    @property
    def has_several(self) -> bool:
        """Whether each of its commands has a terminal."""
        return self.caption.endswith("terminals")

    def terminals(self) -> list[list[tuple[str, str]]]:
        """The commands of each terminal that a console block with a caption shows."""
        found = commands(self.source)
        return [[each] for each in found] if self.has_several else [found]


def block(page: Path, document: Document, region: Region) -> Block | None:
    """What a fence of a page is; nothing if it is a directive that holds no code."""
    kind, argument, options = region.lexemes["info"].strip(), "", {}
    source = str(region.lexemes["source"])
    if directive := DIRECTIVE.fullmatch(kind):
        kind, argument = directive["name"], directive["argument"].strip()
        if kind not in ("code-block", "literalinclude"):
            return None
        while option := OPTION.match(source):
            options[option["name"]] = option["value"].strip()
            source = source[option.end() :]
        source = source.removeprefix("\n")
        if kind == "code-block":
            kind = argument.removeprefix("none")
    reason = NOT_RUN.search(document.text[: region.start])
    line = document.line_column(region.start)
    return Block(
        page,
        int(re.findall(r"\d+", line)[0]),
        kind,
        source,
        options.get("caption", ""),
        argument,
        reason["reason"] if reason else "",
    )


def blocks(page: Path) -> list[Block]:
    """All code blocks of a page, from its beginning to its end."""
    found: list[Block | None] = []

    def parse(document: Document) -> list[Region]:
        lexer = RawFencedCodeBlockLexer(INFO)
        found.extend(block(page, document, region) for region in lexer(document))
        return []

    Sybil(parsers=[parse]).parse(page)
    return sorted((known for known in found if known), key=lambda known: known.line)


def pattern(expected: str) -> re.Pattern[str]:
    """What may be printed: `...` stands for anything in a line, and alone for any lines."""
    lines = []
    for line in expected.splitlines():
        if line.strip() == "...":
            lines.append(r"(?:[^\n]*\n)*")
        else:
            lines.append(re.escape(line.rstrip()).replace(r"\.\.\.", "[^\n]*") + r"[ \t]*\n")
    return re.compile("".join(lines))


def by_speaker(text: str) -> str:
    """The lines of each federate together: those of different processes have no order."""

    def speaker(line: str) -> str:
        found = SPEAKER.match(line)
        return found[0] if found else ""

    return "".join(f"{line.rstrip()}\n" for line in sorted(text.splitlines(), key=speaker))


MISSED = re.compile(r"^\.\.\. (one message|\d+ messages) missed\n", re.MULTILINE)


def same(expected: str, printed: str) -> bool:
    """Whether a page shows what was printed."""
    if printed and not printed.endswith("\n"):
        printed += "\n"
    # A watcher that the system does not run for a moment misses messages, and says so.
    printed = MISSED.sub("", printed)
    if pattern(expected).fullmatch(printed):
        return True
    return bool(pattern(by_speaker(expected)).fullmatch(by_speaker(printed)))


@dataclass
class Terminal:
    """A shell in which commands run one after the other, and whose folder and variables stay."""

    folder: Path
    environment: dict[str, str]
    place: Path = field(init=False)

    def __post_init__(self) -> None:
        """Begin in the folder of the story."""
        self.place = self.folder

    def start(self, command: str) -> subprocess.Popen[str]:
        """Run a command, and say at its end where it has left the shell."""
        self.state = self.folder.parent / f"state-{id(self)}"
        script = f'{command}\ncode=$?\n{{ pwd; env -0; }} > "{self.state}"\nexit $code\n'
        return subprocess.Popen(
            ["bash", "-c", script],
            cwd=self.place,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )

    def interrupt(self, process: subprocess.Popen[str], deadline: float) -> tuple[str, int]:
        """What a command has printed that Ctrl-C ends, and its exit code; 0 if that tells of it."""
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
        printed, code = self.finish(process, deadline)
        return printed, 0 if code in (-signal.SIGINT, 128 + signal.SIGINT) else code

    def finish(self, process: subprocess.Popen[str], deadline: float) -> tuple[str, int]:
        """What a command has printed, and its exit code."""
        try:
            printed, _ = process.communicate(timeout=max(deadline - time.monotonic(), 0.1))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            printed, _ = process.communicate()
            return f"{printed}[still running after {LIMIT} s]\n", 124
        if self.state.exists():
            place, _, variables = self.state.read_text().partition("\n")
            self.place = Path(place)
            self.environment = dict(
                pair.split("=", 1) for pair in variables.split("\0") if "=" in pair
            )
            self.state.unlink()
        return printed, process.returncode

    def run(self, command: str) -> tuple[str, int]:
        """Run a command to its end."""
        return self.finish(self.start(command), time.monotonic() + LIMIT)


def commands(source: str) -> list[tuple[str, str]]:
    """The commands of a console block, each with what it must print."""
    found: list[tuple[str, str]] = []
    for line in source.splitlines():
        if line.startswith("$ "):
            found.append((line[2:], ""))
        elif found and line.startswith("> ") and found[-1][0].endswith("\\"):
            found[-1] = (f"{found[-1][0]}\n{line[2:]}", "")
        else:
            assert found, f"a console block begins with `$ `, not with {line!r}"
            found[-1] = (found[-1][0], f"{found[-1][1]}{line}\n")
    return found


class Story:
    """A page that is run, block by block, in a folder of its own."""

    def __init__(self, page: Path, folder: Path, stand_ins: dict[str, str]) -> None:
        """Prepare an empty folder; `stand_ins` are what names and ports of the page are here."""
        self.page = page
        self.folder = folder / "story"
        self.folder.mkdir()
        self.stand_ins = stand_ins
        bin_folder = Path(sys.executable).parent
        self.terminal = Terminal(
            self.folder,
            os.environ
            | {
                "PATH": f"{bin_folder}{os.pathsep}{os.environ['PATH']}",
                "NO_COLOR": "1",
                "COLUMNS": "100",
                "PYTEST_ADDOPTS": "",
                "PYTHONDONTWRITEBYTECODE": "1",
            },
        )
        self.pending: tuple[Block, str, int] | None = None
        self.session = ""

    def run(self) -> None:
        """Run every block; fail at the first that does not do what the page says."""
        remaining = [known for known in blocks(self.page) if not known.not_run]
        while remaining:
            if remaining[0].is_terminal:
                together = [remaining.pop(0)]
                while remaining and remaining[0].is_terminal and not together[-1].has_several:
                    together.append(remaining.pop(0))
                self.settle()
                self.terminals(together)
            else:
                self.one(remaining.pop(0))
        self.settle()

    def one(self, known: Block) -> None:
        """Run a block by itself."""
        if known.kind == "text":
            self.compare(known)
            return
        self.settle()
        if known.kind == "literalinclude":
            source = known.page.parent / known.argument
            shutil.copy(source, self.path(known.caption or source.name))
        elif known.kind == "console":
            self.console(known)
        elif known.caption:
            self.path(known.caption).write_text(self.here(known.source))
        elif known.kind in KINDS:
            KINDS[known.kind](self, known)
        else:
            reason = f"no test runs a block of {known.kind!r} that has no `:caption: FILE`"
            raise AssertionError(f"{known.where}: {reason}")

    def path(self, name: str) -> Path:
        """Where a file of this name belongs."""
        path = self.terminal.place / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def here(self, text: str) -> str:
        """A text of the page, with names and ports that this machine has."""
        for name, what in self.stand_ins.items():
            text = text.replace(name, what)
        # Cargo would do the same, after it has looked for changes.
        return EXAMPLE.sub(lambda found: str(rust_examples() / found["name"]), text)

    def expect(self, known: Block, command: str, expected: str, printed: str) -> None:
        """Compare what was printed with what the page shows."""
        assert same(self.here(expected), printed), (
            f"{known.where}: `{command}` printed\n{printed}\nand the page says\n{expected}"
        )

    def console(self, known: Block) -> None:
        """Run commands one after the other; those that fail are followed by `echo $?`."""
        code = 0
        for command, expected in commands(known.source):
            if command == "echo $?":
                self.expect(known, command, expected, f"{code}\n")
                code = 0
                continue
            assert code == 0, f"{known.where}: before `{command}`, a command ended with {code}"
            printed, code = self.terminal.run(self.here(command))
            self.expect(known, command, expected, printed)
        assert code == 0, f"{known.where}: `{command}` ended with {code}, and no `echo $?` says so"

    def terminals(self, together: list[Block]) -> None:
        """Run console blocks with captions at the same time, each in a terminal of its own."""
        shells = []
        for known in together:
            for *before, (last, expected) in known.terminals():
                terminal = Terminal(self.folder, self.terminal.environment)
                terminal.place = self.terminal.place
                for command, printed in before:
                    self.expect(known, command, printed, terminal.run(self.here(command))[0])
                shells.append((known, last, expected, terminal, terminal.start(self.here(last))))
        deadline = time.monotonic() + LIMIT
        # Where the page shows Ctrl-C, what the others look at is over when they are.
        shells.sort(key=lambda shell: shell[2].endswith(CTRL_C))
        ended = []
        for known, last, expected, terminal, process in shells:
            end = terminal.interrupt if expected.endswith(CTRL_C) else terminal.finish
            ended.append((known, last, expected, *end(process, deadline)))
        for known, last, expected, printed, code in ended:
            self.expect(known, last, expected.removesuffix(CTRL_C), printed)
            assert code == 0, f"{known.where}: `{last}` ended with {code}"

    def compare(self, known: Block) -> None:
        """A text is what the block before it has printed."""
        assert self.pending, f"{known.where}: no block before this text has run"
        ran, printed, code = self.pending
        if ran.kind == "lf":
            printed, code = self.terminal.run("hprm run Main.lf")
        self.pending = None
        self.expect(known, ran.where, known.source, printed)
        # An error ends with its message, which is the last line that was printed.
        assert code == 0 or "rror" in known.source, f"{ran.where} ended with {code}:\n{printed}"

    def settle(self) -> None:
        """A block that no text follows must at least have succeeded."""
        if self.pending:
            ran, printed, code = self.pending
            assert code == 0, f"{ran.where} ended with {code}:\n{printed}"
        self.pending = None

    def script(self, known: Block) -> None:
        """Run a program in Python."""
        self.path("program.py").write_text(self.here(known.source))
        self.pending = (known, *self.terminal.run("python program.py"))

    def shell(self, known: Block) -> None:
        """Run lines of a shell script, each of which must succeed."""
        self.pending = (known, *self.terminal.run(f"set -e\n{self.here(known.source)}set +e"))

    def interactive(self, known: Block) -> None:
        """Run an interactive session, which goes on from block to block."""
        self.session += f"{known.source}\n"
        self.path("session.txt").write_text(self.here(self.session))
        self.pending = (known, *self.terminal.run("python -m doctest -o ELLIPSIS session.txt"))

    def program(self, known: Block) -> None:
        """Check a program, or members of a reactor, in Lingua Franca."""
        source = self.here(known.source)
        if not re.search(r"\breactor\b", source):
            source = f"main reactor {{\n{source}}}\n"
        if not re.search(r"^\s*target\b", source, re.MULTILINE):
            source = f"target Python\n{source}"
        self.path("Main.lf").write_text(source)
        self.pending = (known, *self.terminal.run("hprm check Main.lf"))

    def compiled(self, known: Block) -> None:
        """Leave a block to rustdoc, if it has been told of the page."""
        page = known.page.relative_to(ROOT).as_posix()
        told = (ROOT / "crates" / "hprm" / "src" / "lib.rs").read_text()
        assert f'include_str!("../../../{page}")' in told, (
            f"{known.where}: crates/hprm/src/lib.rs does not include {page}, so nothing runs this"
        )

    def parsed(self, known: Block) -> None:
        """Read JSON."""
        for line in known.source.splitlines() if known.kind == "jsonl" else [known.source]:
            json.loads(line)


KINDS = {
    # Pictures: trees of folders, formats, formulas.
    "": lambda story, known: None,
    "json": Story.parsed,
    "jsonl": Story.parsed,
    "lf": Story.program,
    "pycon": Story.interactive,
    "python": Story.script,
    "rust": Story.compiled,
    "rust,no_run": Story.compiled,
    "sh": Story.shell,
}
