"""Physical connections with a bound: which messages arrive, and how many are said to be dropped."""

from __future__ import annotations

import pytest
from processes import Bench

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
