"""Physical connections with a bound: which messages arrive, and how many are said to be dropped."""

from __future__ import annotations

import os
import signal

import pytest
from processes import COORDINATIONS, Bench, until

# The receiver reads the messages while it is busy, but for the first one; all wait at once.
PROGRAM = """\
target Python { timeout: 600 ms COORDINATION }
preamble {= import time =}
reactor Source {
  output out
  state count = 0
  logical action again
  reaction(startup, again) -> out, again {=
    out.set(self.count)
    self.count += 1
    if self.count < 8: again.schedule(0)
  =}
}
reactor Sink {
  input inp
  reaction(startup) {= time.sleep(0.2) =}
  reaction(inp) {= print(inp.value) =}
}
KIND reactor {
  source = new Source()
  sink = new Sink()
  BOUND
  source.out ~> sink.inp after 100 ms
}
"""

WAYS = [
    ("main", "", []),
    ("federated", ", coordination: decentralized", []),
    ("federated", "", []),
    ("federated", "", ["--in-process"]),
]


@pytest.mark.parametrize(("kind", "coordination", "options"), WAYS)
@pytest.mark.parametrize(
    ("bound", "values"),
    [
        ("", range(8)),
        ('@bound(3, "drop")', range(3)),
        ("@bound(3)", range(3)),
        ('@bound(3, "replace")', range(5, 8)),
        ('@bound(8, "replace")', range(8)),
    ],
)
def test_a_bound_keeps_so_many_messages(
    bench: Bench, kind: str, coordination: str, options: list[str], bound: str, values: range
) -> None:
    text = PROGRAM.replace("KIND", kind).replace("BOUND", bound)
    outcome = bench.run(text.replace("COORDINATION", coordination), *options)
    assert outcome.code == 0, outcome.err
    assert [int(line.split()[-1]) for line in outcome.out.splitlines()] == list(values)
    dropped = 8 - len(values)
    if dropped == 0:
        assert outcome.err == ""
    else:
        told = f"warning: {dropped} messages were dropped on the connection Main.source.out ~> "
        assert told + "Main.sink.inp: 3 may wait (`@bound`)" in outcome.err
        assert outcome.err.count("warning") == 1


@pytest.mark.parametrize(("kind", "coordination", "options"), WAYS)
@pytest.mark.parametrize(("count", "warnings"), [(1_200, 1), (900, 0)])
def test_many_messages_without_a_bound_are_a_warning(
    bench: Bench, kind: str, coordination: str, options: list[str], count: int, warnings: int
) -> None:
    text = PROGRAM.replace("KIND", kind).replace("BOUND", "").replace("< 8", f"< {count}")
    # All have to be sent before the first of them is due, on a busy machine, too.
    text = text.replace("after 100 ms", "after 1 s").replace("600 ms", "30 s")
    last = f"print(inp.value); lf.request_stop() if inp.value == {count - 1} else None"
    text = text.replace("print(inp.value)", last)
    outcome = bench.run(text.replace("COORDINATION", coordination), *options)
    assert outcome.code == 0, outcome.err
    assert len(outcome.out.splitlines()) == count
    told = "1000 messages wait on the connection Main.source.out ~> Main.sink.inp, because its "
    assert outcome.err.count(told) == warnings
    assert outcome.err.count('hint: `@bound(1, "replace")`') == warnings


@pytest.mark.parametrize(("kind", "coordination", "options"), WAYS[1:])
def test_a_bound_that_blocks_loses_nothing(
    bench: Bench, kind: str, coordination: str, options: list[str]
) -> None:
    text = PROGRAM.replace("KIND", kind).replace("BOUND", '@bound(2, "block")')
    # A message waits for 10 ms at least: a sender that is not blocked would send all at once.
    text = text.replace("after 100 ms", "after 10 ms").replace("600 ms", "5 s")
    text = text.replace(
        "print(inp.value)", "print(inp.value); lf.request_stop() if inp.value == 7 else None"
    )
    outcome = bench.run(text.replace("COORDINATION", coordination), *options)
    assert outcome.code == 0, outcome.err
    assert [int(line.split()[-1]) for line in outcome.out.splitlines()] == list(range(8))
    assert "dropped" not in outcome.err


FULL = """\
target Python { COORDINATION }
preamble {= import os, pathlib, time =}
reactor Source {
  output out
  state count = 0
  timer t(0, 1 ms)
  reaction(t) -> out {=
    out.set(self.count)
    self.count += 1
    pathlib.Path("sent").write_text(str(self.count))
  =}
  reaction(shutdown) {= print("sent", self.count) =}
}
reactor Sink {
  input inp
  reaction(inp) {=
    pathlib.Path("sink.pid").write_text(f"{os.getpid()}\\n")
    while not pathlib.Path("go").exists(): time.sleep(0.001)
  =}
}
federated reactor {
  source = new Source()
  TRANSIENT
  sink = new Sink()
  @bound(3, "block")
  source.out ~> sink.inp
}
"""


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_blocked_sender_stops_when_it_is_asked_to(bench: Bench, coordination: str) -> None:
    text = FULL.replace("COORDINATION", f"coordination: {coordination}").replace("TRANSIENT", "")
    federation = bench.by_hand(text, "source", "sink")
    bench.pid("sink")
    # The sink holds one message, so that two more may wait.
    until(lambda: (bench.folder / "sent").read_text() == "3", "the source has sent three")
    federation.members["source"].send_signal(signal.SIGTERM)
    (bench.folder / "go").touch()
    ended = federation.finish()
    assert [outcome.code for outcome in ended.values()] == [0, 128 + signal.SIGTERM, 0], ended


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_receiver_that_is_killed_frees_a_blocked_sender(bench: Bench, coordination: str) -> None:
    text = FULL.replace("COORDINATION", f"coordination: {coordination}")
    federation = bench.by_hand(text.replace("TRANSIENT", "@transient"), "source", "sink")
    pid = bench.pid("sink")
    counts: list[str] = []

    def stands_still() -> bool:
        # The source has sent others before the sink has joined.
        counts.append((bench.folder / "sent").read_text())
        return len(counts) > 30 and len(set(counts[-30:])) == 1

    until(stands_still, "the source is blocked")
    os.kill(pid, signal.SIGKILL)
    until(lambda: (bench.folder / "sent").read_text() not in ("", counts[-1]), "it goes on")
    federation.members["source"].send_signal(signal.SIGTERM)
    ended = federation.finish("source", "rti")
    assert ended["source"].code == 128 + signal.SIGTERM, ended


def test_a_bound_that_would_block_for_ever_is_an_error(bench: Bench) -> None:
    text = PROGRAM.replace("COORDINATION", "").replace("BOUND", '@bound(2, "block")')
    outcome = bench.run(text.replace("KIND", "main"))
    assert outcome.code == 1
    outcome.assert_one_error("error[LF0507]", "Main.lf:22", "one process cannot wait for itself")
    text = text.replace("KIND", "federated").replace("input inp", "input inp\n  output back")
    text = text.replace("output out", "output out\n  input back\n  reaction(back) {= pass =}")
    text = text.replace("reaction(inp) {= print", "reaction(inp) -> back {= back.set(1); print")
    text = text.replace("after 100 ms", "after 100 ms\n  sink.back -> source.back after 1 s")
    outcome = bench.run(text)
    assert outcome.code == 1
    assert "its receiver sink may wait for its sender source" in outcome.err, outcome.err


@pytest.mark.parametrize(
    ("bound", "connection", "message"),
    [
        ('@bound(0, "drop")', "~>", "the number of messages of `@bound` must be from 1 to"),
        ('@bound(3, "defer")', "~>", "`@bound` has no policy `defer`"),
        ("@bound(3) @bound(4)", "~>", "`@bound` is stated twice"),
        ('@bound(3, polcy="drop")', "~>", "`@bound` has no argument `polcy`"),
        ("@bound", "~>", "takes a number of messages"),
        ("@bound(3)", "->", "`@bound` does not belong here"),
        ("@bounds(3)", "~>", "there is no attribute `@bounds`"),
    ],
)
def test_a_bound_that_means_nothing_is_an_error(
    bench: Bench, bound: str, connection: str, message: str
) -> None:
    text = PROGRAM.replace("KIND", "main").replace("BOUND", bound).replace("COORDINATION", "")
    outcome = bench.run(text.replace("~> sink.inp after 100 ms", f"{connection} sink.inp"))
    assert outcome.code == 1
    assert message in outcome.err
