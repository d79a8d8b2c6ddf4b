"""Traces of runs: what ``hprm run --trace`` writes, by Perfetto's own schema, and summaries."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from perfetto_trace import Slice, arrows, read
from processes import Bench, finish, until

FEDERATION = """\
target Python {{ timeout: 50 ms, coordination: {coordination} }}
preamble {{= import numpy as np =}}
reactor Source {{
  output out
  output image
  timer t(0, 5 ms)
  state seen
  reaction(startup) {{= self.seen = self.register_user_trace_event("picture") =}}
  reaction(t) -> out, image {{=
    self.tracepoint_user_event(self.seen)
    self.tracepoint_user_value(self.seen, -7)
    out.set(lf.time.logical_elapsed())
    image.set(np.zeros(100_000))
  =}}
}}
reactor Sink {{
  input inp
  input image
  logical action again
  reaction(inp, image) -> again {{= again.schedule(0) =}}
  reaction(again) {{= pass =}} deadline(1 ns) {{= pass =}}
}}
federated reactor {{
  source = new Source()
  sink = new Sink()
  source.out -> sink.inp
  source.image -> sink.image
}}
"""


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    """Processes that leave nothing behind."""
    bench = Bench(tmp_path)
    yield bench
    assert bench.left() == set()
    assert [it.name for it in tmp_path.iterdir() if ".parts-" in it.name] == []


def reactions(slices: list[Slice]) -> list[Slice]:
    return [it for it in slices if it.category == "reaction"]


def logical(path: Path) -> list[tuple[tuple[int, int], str]]:
    """The reactions of a logical trace, with their tags."""
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    return [(tuple(it["tag"]), it["reaction"]) for it in lines if "reaction" in it]


@pytest.mark.parametrize(
    ("coordination", "boards", "options"),
    [
        ("centralized", "on", []),
        ("centralized", "off", []),
        ("decentralized", "on", []),
        ("centralized", "on", ["--in-process"]),
        ("centralized", "off", ["--workers", "2"]),
    ],
)
def test_a_trace_has_what_a_federation_did(
    bench: Bench,
    coordination: str,
    boards: str,
    options: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("HPRM_BOARDS", boards)
    by_rti = coordination == "centralized" and (boards == "off" or "--in-process" in options)
    text = FEDERATION.format(coordination=coordination)
    options = ["--trace", "run.pftrace", "--logical-trace", "logical", *options]
    outcome = bench.run(text, *options)
    assert (outcome.code, outcome.err) == (0, "")
    slices = read(bench.folder / "run.pftrace")
    ran = reactions(slices)
    assert all(it.end is not None and it.thread.startswith("worker ") for it in ran)
    # The order is that of one thread, which the logical trace does not know.
    expected = Counter(logical(bench.folder / "logical"))
    assert Counter((it.tag, it.name) for it in ran) == expected
    late = [it for it in ran if it.arguments.get("body") == "deadline handler"]
    missed = [it for it in slices if it.category == "deadline"]
    assert late
    assert len(late) == len(missed) == sum(it.name == "Main.sink.2" for it in ran)
    pairs = [(a, b) for a, b in arrows(slices) if a.category == "message"]
    received = [it for it in slices if it.name.startswith("receive ")]
    assert len(pairs) == len(received) > 10
    assert all(a.begin <= b.begin and a.tag == b.tag for a, b in pairs)
    assert {(a.process, b.process) for a, b in pairs} == {("source", "sink")}
    points = [it for it in slices if it.category == "tracepoint"]
    assert [it.arguments.get("value") for it in points[:2]] == [None, -7]
    assert {it.name for it in points} == {"picture"}
    scheduled = [it for it in slices if it.name == "schedule Main.sink.again"]
    assert len(scheduled) == sum(it.name == "Main.sink.1" for it in ran)
    grants = [(a, b) for a, b in arrows(slices) if b.name in ("TAG from RTI", "safe from RTI")]
    # Federates that do not ask the RTI before each tag may get none.
    assert grants or not by_rti
    assert {(a.process, b.process) for a, b in grants} <= {("RTI", "source"), ("RTI", "sink")}
    if by_rti:
        through = {flow for it in slices if it.name.startswith("forward ") for flow in it.flows}
        assert {flow for a, _ in pairs for flow in a.flows} <= through
    sent = [it for it in slices if it.name.startswith("send ")]
    transfers = {(it.name, it.arguments["transfer"]) for it in sent}
    if "--in-process" in options:
        assert {transfer for _, transfer in transfers} == {"by reference"}
    else:
        assert ("send Main.source.out", "inside the message") in transfers
        assert ("send Main.source.image", "in shared memory, in place") in transfers


def test_the_summary_counts_what_the_trace_has(bench: Bench) -> None:
    text = FEDERATION.format(coordination="centralized")
    assert bench.run(text, "--trace", "run.pftrace").code == 0
    slices = read(bench.folder / "run.pftrace")
    said = finish(bench.call("trace", "summary", "--json", "run.pftrace"))
    summary = json.loads(said.out)
    counts = Counter(it.name for it in reactions(slices))
    assert {it["reaction"]: it["count"] for it in summary["reactions"]} == dict(counts)
    for it in summary["reactions"]:
        took = [s.end - s.begin for s in reactions(slices) if s.name == it["reaction"] and s.end]
        assert (it["total_ns"], it["took_ns"]["max"]) == (sum(took), max(took))
        assert it["lag_ns"]["max"] >= it["lag_ns"]["p50"]
    images = next(it for it in summary["connections"] if "image" in it["connection"])
    assert images["bytes"] > 800_000 * images["messages"]
    assert summary["lost"] == 0
    table = finish(bench.call("trace", "summary", "run.pftrace"))
    assert table.code == 0
    assert "Main.source.image -> Main.sink.image" in table.out
    assert "deadline" not in table.err


def test_a_program_without_federates_is_traced(bench: Bench) -> None:
    text = """\
target Python { fast: true, timeout: 10 ms, tracing: true }
main reactor Alone {
  timer t(0, 1 ms)
  reaction(t) {= pass =}
}
"""
    (bench.folder / "Alone.lf").write_text(text)
    outcome = finish(bench.call("run", "Alone.lf"))
    assert (outcome.code, outcome.err) == (0, "")
    ran = reactions(read(bench.folder / "Alone.pftrace"))
    assert [it.tag for it in ran] == [(n * 1_000_000, 0) for n in range(11)]
    finish(bench.call("run", "--trace", "other", "Alone.lf"))
    assert len(reactions(read(bench.folder / "other"))) == 11


def test_a_ring_that_overflows_loses_records_and_says_so(bench: Bench) -> None:
    text = """\
target Python { fast: true, timeout: 20 ms }
main reactor Main {
  timer t(0, 1 us)
  reaction(t) {= pass =}
}
"""
    outcome = bench.run(text, "--trace", "run.pftrace", "--trace-buffer", "16")
    assert outcome.code == 0
    assert "warning: trace run.pftrace: " in outcome.err
    assert "records of Main are missing" in outcome.err
    assert "--trace-buffer 32" in outcome.err
    slices = read(bench.folder / "run.pftrace")
    lost = [it.arguments["lost"] for it in slices if "are missing before this" in it.name]
    said = finish(bench.call("trace", "summary", "--json", "run.pftrace"))
    assert json.loads(said.out)["lost"] == sum(lost) > 0
    # Each run of the reaction has two records, and a start, an end and waits have some more.
    assert 2 * len(reactions(slices)) <= 2 * 20_001 - sum(lost) + 100


HANGS = """\
target Python
preamble {=
  import os, pathlib, time

  def size_of_share():
      return sum(it.stat().st_size for it in pathlib.Path().glob("*.parts-*/federate-1"))
=}
reactor Source {
  output out
  timer t(0, 5 ms)
  reaction(t) -> out {= out.set(1) =}
}
reactor Sink {
  input inp
  state count = 0
  reaction(inp) {=
    self.count += 1
    if self.count == 5:
        before = size_of_share()
        self.tracepoint_user_event(self.register_user_trace_event("here"))
        while size_of_share() == before:
            time.sleep(0.01)
        pathlib.Path("sink.pid").write_text(f"{os.getpid()}\\n")
        time.sleep(60)
  =}
}
federated reactor { source = new Source()  sink = new Sink()  source.out -> sink.inp }
"""


@pytest.mark.parametrize("coordination", ["centralized", "decentralized"])
def test_a_killed_federate_leaves_what_it_did_so_far(bench: Bench, coordination: str) -> None:
    options = ["--trace", "run.pftrace", "--property", f"coordination={coordination}"]
    process = bench.start(HANGS, *options)
    os.kill(bench.pid("sink"), signal.SIGKILL)
    outcome = finish(process)
    outcome.assert_one_error("federate sink was killed by signal 9")
    assert "the records of sink end where the process was killed" in outcome.err
    slices = read(bench.folder / "run.pftrace")
    of_sink = [it for it in reactions(slices) if it.process == "sink"]
    assert [it.end is None for it in of_sink] == [False] * 4 + [True]
    assert any(it.name == "the process was killed: its records end here" for it in slices)
    assert any(it.process == "source" for it in reactions(slices))
    said = finish(bench.call("trace", "summary", "--json", "run.pftrace"))
    sink = next(it for it in json.loads(said.out)["reactions"] if "sink" in it["reaction"])
    assert (sink["count"], sink["unfinished"]) == (4, 1)


def test_members_that_were_started_by_hand_make_one_trace_together(bench: Bench) -> None:
    (bench.folder / "Main.lf").write_text(FEDERATION.format(coordination="centralized"))
    federation = bench.federation()
    federation.start("rti", "--trace", "rti.pftrace")
    for name in ("source", "sink"):
        federation.start(name, "--trace", f"{name}.pftrace")
    assert {it.code for it in federation.finish().values()} == {0}
    files = [bench.folder / f"{name}.pftrace" for name in ("rti", "source", "sink")]
    whole = bench.folder / "whole.pftrace"
    whole.write_bytes(b"".join(it.read_bytes() for it in files))
    slices = read(whole)
    assert {it.process for it in slices} == {"RTI", "source", "sink"}
    assert any(a.name.startswith("send ") for a, _ in arrows(slices))
    assert finish(bench.call("trace", "summary", "whole.pftrace")).code == 0


def test_a_file_that_is_no_trace_is_one_error(bench: Bench) -> None:
    text = FEDERATION.format(coordination="centralized")
    assert bench.run(text, "--trace", "run.pftrace").code == 0
    whole = (bench.folder / "run.pftrace").read_bytes()
    wrong = {
        "cut": (whole[: len(whole) // 2 + 1], "cut short"),
        "empty": (b"", "is empty, and no trace"),
        "text": (b"Hello, world. This is a text.\n" * 9, "is no trace of a run"),
    }
    for name, (content, message) in wrong.items():
        (bench.folder / name).write_bytes(content)
        outcome = finish(bench.call("trace", "summary", name))
        assert outcome.code == 1
        outcome.assert_one_error(name, message, "hint:")
    finish(bench.call("trace", "summary", "missing")).assert_one_error("missing", "cannot read")


def test_a_trace_that_cannot_be_written_is_said_before_anything_runs(bench: Bench) -> None:
    outcome = bench.run(FEDERATION.format(coordination="centralized"), "--trace", "no/such/run")
    assert outcome.code == 1
    outcome.assert_one_error("no/such/run")
    os.mkfifo(bench.folder / "pipe")
    outcome = bench.run(FEDERATION.format(coordination="centralized"), "--trace", "pipe")
    assert (outcome.code, outcome.out) == (1, "")
    outcome.assert_one_error("cannot write the trace pipe: nothing reads this pipe")


@pytest.mark.parametrize("option", ["--trace", "--logical-trace", "--log-frames-to"])
def test_no_option_replaces_the_program(bench: Bench, option: str) -> None:
    text = FEDERATION.format(coordination="centralized")
    outcome = bench.run(text, option, "./Main.lf")
    assert (outcome.code, outcome.out) == (1, "")
    outcome.assert_one_error(f"{option} would replace the program ./Main.lf")
    assert (bench.folder / "Main.lf").read_text() == text
    other = "--trace" if option == "--log-frames-to" else "--log-frames-to"
    outcome = bench.run(text, option, "one", other, "one")
    outcome.assert_one_error("name one file: one")
    assert not (bench.folder / "one").exists()


def test_a_trace_goes_through_a_pipe(bench: Bench) -> None:
    pipe = bench.folder / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE) as reader:
        assert reader.stdout is not None
        outcome = bench.run(FEDERATION.format(coordination="centralized"), "--trace", "pipe")
        assert outcome.code == 0, outcome.err
        (bench.folder / "run.trace").write_bytes(reader.stdout.read())
    outcome = finish(bench.call("trace", "summary", "run.trace"))
    assert outcome.code == 0, outcome.err


def test_other_programs_that_a_body_starts_are_not_traced(bench: Bench) -> None:
    inner = "target Python\nmain reactor { reaction(startup) {= print('inner') =} }\n"
    (bench.folder / "Inner.lf").write_text(inner)
    text = """\
target Python
preamble {= import subprocess, sys, pathlib =}
reactor A {
  reaction(startup) {=
    hprm = pathlib.Path(sys.executable).with_name("hprm")
    print(subprocess.run([hprm, "run", "Inner.lf"], capture_output=True, text=True).stdout)
  =}
}
federated reactor { a = new A() }
"""
    outcome = bench.run(text, "--trace", "run.pftrace")
    assert (outcome.code, "inner" in outcome.out) == (0, True)
    assert [it.name for it in reactions(read(bench.folder / "run.pftrace"))] == ["Main.a.1"]
    until(lambda: bench.left() == set(), "all have ended")
