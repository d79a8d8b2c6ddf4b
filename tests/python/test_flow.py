"""A federate that sends faster than another one receives: memory stays bounded, nothing is lost.

The receiver stands still, in a reaction or altogether. The sender stops after a few
megabytes, and continues when the receiver does.
"""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest
from conftest import Run
from processes import COORDINATIONS, Bench, finish, until
from snippets import TELL

MESSAGES = 6_000
SIZE = 12_000
"""In one piece just small enough to travel in a message; all of them are 72 MB."""

LIMIT = 8 << 20
"""What may be under way when a tag begins, as in docs/concepts/federations.md."""

# The number of a message is in its first bytes. The source says how many it has sent, as the length
# of a file. It has no more tags after the last message: however far its tags lag behind physical
# time by then, the federation can stop.
PROGRAM = (
    """\
target Python { coordination: COORDINATION, keepalive: true }
preamble {=
import pathlib, time
"""
    + TELL
    + """\
=}
reactor Source {
  output out
  logical action again(10 usec)
  state count = 0
  state log = {= open("sent", "wb", buffering=0) =}
  reaction(startup, again) -> out, again {=
    if self.count == 0: here("source")
    out.set(self.count.to_bytes(4, "little") + bytes(SIZE))
    self.log.write(b"x")
    self.count += 1
    if self.count < MESSAGES: again.schedule(0)
  =}
}
reactor Sink {
  input inp
  state count = 0
  reaction(inp) {=
    assert int.from_bytes(inp.value[:4], "little") == self.count
    if self.count == 3:
        here("sink")
        while BUSY and not pathlib.Path("go").exists(): time.sleep(0.005)
    self.count += 1
    if self.count == MESSAGES: request_stop()
  =}
  reaction(shutdown) {= print("received", self.count) =}
}
federated reactor {
  source = new Source()
  sink = new Sink()
  source.out ARROW sink.inp
}
"""
)


def program(coordination: str, arrow: str, busy: bool) -> str:
    """The text of the program."""
    text = PROGRAM.replace("COORDINATION", coordination).replace("ARROW", arrow)
    text = text.replace("BUSY", str(busy)).replace("MESSAGES", str(MESSAGES))
    return text.replace("SIZE", str(SIZE))


class Rest:
    """Whether a process is at rest: it waits, and has used no processor for a while."""

    WHILE_S = 0.2

    def __init__(self, pid: int) -> None:
        """Nothing has been looked at."""
        self._stat = Path(f"/proc/{pid}/stat")
        self._used: tuple[str, ...] = ()
        self._since = 0.0

    def __call__(self) -> bool:
        """Look once."""
        fields = self._stat.read_text().rsplit(")", 1)[1].split()
        state, used = fields[0], tuple(fields[11:13])
        now = time.monotonic()
        if state != "S" or used != self._used:
            self._used, self._since = used, now
        return now >= self._since + self.WHILE_S


def peak(pid: int) -> int:
    """The most memory that a process has had so far, in bytes."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    [line] = [line for line in lines if line.startswith("VmHWM:")]
    return int(line.split()[1]) * 1024


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize(("arrow", "how"), [("->", "busy"), ("->", "stopped"), ("~>", "stopped")])
def test_a_federate_that_sends_too_fast_waits(
    bench: Bench, coordination: str, arrow: str, how: str
) -> None:
    text = program(coordination, arrow, how == "busy")
    federation = bench.by_hand(text, "source", "sink")
    source, sink = bench.pid("source"), bench.pid("sink")
    if how == "stopped":
        os.kill(sink, signal.SIGSTOP)
    until(Rest(source), "the source is at rest")
    sent = (bench.folder / "sent").stat().st_size
    # What the sink had processed when it was stopped does not count.
    processed = 4 if how == "busy" else MESSAGES // 4
    assert sent * SIZE < LIMIT + processed * SIZE + LIMIT // 4 + SIZE, sent
    rti = federation.members["rti"].pid
    peaks = {name: peak(pid) for name, pid in {"source": source, "rti": rti}.items()}
    assert all(most < 80_000_000 for most in peaks.values()), peaks

    os.kill(sink, signal.SIGCONT)
    (bench.folder / "go").touch()
    for name, member in federation.members.items():
        outcome = finish(member)
        assert outcome.code == 0, (name, outcome.err)
        if name == "sink":
            assert outcome.out == f"received {MESSAGES}\n"
    assert (bench.folder / "sent").stat().st_size == MESSAGES


class Still:
    """Whether a file has not grown for a while."""

    def __init__(self, path: Path) -> None:
        """Nothing has been looked at."""
        self._path, self._size, self._since = path, -1, 0.0

    def __call__(self) -> bool:
        """Look once."""
        size, now = self._path.stat().st_size if self._path.exists() else -1, time.monotonic()
        if size != self._size or size <= 0:
            self._size, self._since = size, now
        return now >= self._since + 0.5


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federate_that_sends_references_too_fast_waits(bench: Bench, coordination: str) -> None:
    size, messages, sent = 400_000, 1_000, bench.folder / "sent"
    text = program(coordination, "->", True).replace(str(MESSAGES), str(messages))
    (bench.folder / "Main.lf").write_text(text.replace(str(SIZE), str(size)))
    federation = bench.call("run", "--in-process", "Main.lf")
    until(Still(sent), "the source waits")
    counts = sent.stat().st_size * size / 16
    assert LIMIT - 2 * size < counts < LIMIT + LIMIT // 4 + size
    (bench.folder / "go").touch()
    outcome = finish(federation)
    assert (outcome.code, outcome.out) == (0, f"[sink] received {messages}\n"), outcome.err
    assert sent.stat().st_size == messages


FLOOD = """\
target Python { coordination: COORDINATION }
reactor Source {
  output out
  logical action again
  state sent = 0
  reaction(startup, again) -> out, again {=
    out.set(bytes(1024))
    self.sent += 1
    if self.sent < 10_000:
        again.schedule(0)
    else:
        request_stop()
  =}
}
reactor Sink {
  input inp
  state seen = 0
  reaction(inp) {= self.seen += 1 =}
  reaction(shutdown) {= print(self.seen) =}
}
federated reactor {
  source = new Source()
  sink = new Sink()
  source.out -> sink.inp
}
"""


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federate_that_looks_for_messages_sees_that_it_may_write_again(
    launch: Run, coordination: str
) -> None:
    # A federate that did not see it would busy-poll for a second, dozens of times.
    outcome = launch(FLOOD.replace("COORDINATION", coordination), "--spin=1s")
    assert (outcome.code, outcome.out) == (0, "[sink] 10000\n"), outcome.err
