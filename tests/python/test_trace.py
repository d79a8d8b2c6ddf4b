"""Logical traces: the same file however a program is run, and the first difference where not."""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import kinds
import pytest

HPRM = Path(sys.executable).with_name("hprm")
CORPUS = Path(__file__).parents[1] / "lf"
# Programs that stand beside the trace that they must leave. HPRM_BLESS=1 writes the traces anew.
EXPECTED = sorted(CORPUS.rglob("*.trace"))

FEDERATION = """\
target Python {{ timeout: 60 ms {more} }}
reactor Source(stride=1) {{
  output out
  timer t(0, 10 ms)
  state count = 0
  reaction(t) -> out {{=
    self.count += self.stride
    out.set({{"count": self.count, "names": {{"a", "b", "c", "d"}}}})
  =}}
}}
reactor Sum {{
  input[3] inp
  output out
  reaction(inp) -> out {{=
    out.set(sum(port.value["count"] for port in inp if port.is_present))
  =}}
}}
reactor Sink {{
  input inp
  logical action later(1 ms)
  reaction(inp) -> later {{= later.schedule(0, inp.value) =}}
  reaction(later) {{= pass =}}
}}
federated reactor {{
  source = new[3] Source(stride={{= bank_index + 1 =}})
  sum = new Sum()
  sink = new Sink()
  source.out -> sum.inp
  sum.out -> sink.inp after 2 ms
}}
"""


def hprm(*words: object, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [HPRM, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=os.environ | environment,
    )


def program(folder: Path, text: str, name: str = "Program") -> Path:
    path = folder / f"{name}.lf"
    path.write_text(text)
    return path


def trace(path: Path, file: Path, *options: str, **environment: str) -> str:
    done = hprm("run", "--logical-trace", file, *options, path, **environment)
    assert done.returncode == 0, done.stderr
    return file.read_text()


def test_there_are_expected_traces() -> None:
    assert EXPECTED


@pytest.mark.parametrize("expected", EXPECTED, ids=lambda path: path.stem)
def test_a_program_leaves_the_trace_that_is_expected(expected: Path, tmp_path: Path) -> None:
    left = trace(expected.with_suffix(".lf"), tmp_path / "trace")
    if os.environ.get("HPRM_BLESS"):
        expected.write_text(left)
    assert left == expected.read_text()


def test_the_deployment_does_not_show(tmp_path: Path) -> None:
    path = program(tmp_path, FEDERATION.format(more=""))
    central = trace(path, tmp_path / "a", PYTHONHASHSEED="1")
    decentral = trace(
        path, tmp_path / "b", "--property=coordination=decentralized", PYTHONHASHSEED="2"
    )
    whole = [sys.executable, "-m", "hprm", "run", "--logical-trace", tmp_path / "c", "--", path]
    subprocess.run(whole, check=True, timeout=60)
    assert central == decentral == (tmp_path / "c").read_text()
    assert json.loads(central.splitlines()[-1]) == {"end": [60_000_000, 0], "outcome": "done"}
    assert not list(tmp_path.glob("*.parts-*"))


WIDE = """\
target Python {{ timeout: 30 ms, fast: true }}
reactor Worker(factor=1) {{
  input inp
  output out
  logical action again
  state sum = 0
  reaction(inp) -> out, again {{=
    self.sum += inp.value * self.factor
    out.set(self.sum)
    again.schedule(MSEC(1) * (self.factor % 3), self.sum)
  =}}
  reaction(again) -> out {{= out.set(-again.value) =}}
}}
reactor Source {{
  output out
  timer t(0, 5 ms)
  state count = 0
  reaction(t) -> out {{=
    self.count += 1
    out.set(self.count)
  =}}
}}
main reactor {{
  source = new Source()
  worker = new[20] Worker(factor={{= bank_index =}})
  (source.out)+ -> worker.inp
  reaction(worker.out) {{= pass =}}
}}
""".replace("{{", "{").replace("}}", "}")


def test_the_number_of_workers_does_not_show(tmp_path: Path) -> None:
    path = program(tmp_path, WIDE)
    traces = [trace(path, tmp_path / f"{n}", f"--workers={n}") for n in (1, 2, 8)]
    assert traces[0] == traces[1] == traces[2]
    assert len(traces[0].splitlines()) > 100


def test_verify_prints_one_hash_for_a_federation(tmp_path: Path) -> None:
    path = program(tmp_path, FEDERATION.format(more=""))
    verdicts = [hprm("verify", "--json", "--runs", 5, path) for _ in range(2)]
    assert [verdict.returncode for verdict in verdicts] == [0, 0], verdicts[0].stderr
    [first, second] = [json.loads(verdict.stdout) for verdict in verdicts]
    assert first == second
    assert first["equal"] and first["runs"] == 5 and first["tardy"] == 0
    assert first["reactions"] > 30 and len(first["hash"]) == 32


CHANCE = """\
target Python {{ timeout: 30 ms, fast: true }}
preamble {{=
  import {module}
=}}
reactor Source {{
  output out
  timer t(0, 10 ms)
  reaction(t) -> out {{= out.set({value}) =}}
}}
main reactor {{
  source = new Source()
  reaction(source.out) {{= pass =}}
}}
"""


@pytest.mark.parametrize(
    ("module", "value"),
    [
        ("random", "random.random()"),
        ("time", "time.time_ns()"),
        ("os", "list({'a', 'b', 'c', 'd', 'e', 'f'})"),
    ],
)
def test_verify_catches_chance(module: str, value: str, tmp_path: Path) -> None:
    path = program(tmp_path, CHANCE.format(module=module, value=value))
    verdict = hprm("verify", path)
    assert verdict.returncode == 3, verdict.stderr
    assert "reaction Program.source.1 sets Program.source.out to" in verdict.stdout
    assert "run 1: hash seed 0, 1 worker" in verdict.stdout
    verdict = hprm("verify", "--json", path)
    assert verdict.returncode == 3
    assert json.loads(verdict.stdout)["divergence"]["reaction"] == "Program.source.1"


PHYSICAL = """\
target Python { timeout: 50 ms }
preamble {=
  import threading, time
=}
reactor Sensor {
  output out
  physical action seen
  reaction(startup) -> seen {=
    def watch():
        for number in range(5):
            time.sleep(0.002)
            seen.schedule(0, time.time_ns())
    threading.Thread(target=watch, daemon=True).start()
  =}
  reaction(seen) -> out {= out.set(seen.value) =}
}
reactor Clock {
  output out
  timer t(0, 10 ms)
  reaction(t) -> out {= out.set(lf.time.physical()) =}
}
reactor Steady {
  output out
  timer t(0, 10 ms)
  reaction(t) -> out {= out.set(lf.time.logical_elapsed()) =}
}
main reactor {
  sensor = new Sensor()
  clock = new Clock()
  steady = new Steady()
  reaction(sensor.out, clock.out) {= pass =}
  reaction(steady.out) {= pass =}
}
"""


def test_the_physical_world_is_left_out_unless_asked_for(tmp_path: Path) -> None:
    path = program(tmp_path, PHYSICAL)
    verdict = hprm("verify", "--runs", 2, path)
    assert verdict.returncode == 0, verdict.stdout
    assert "left out" in verdict.stdout
    assert hprm("verify", "--runs", 2, "--physical", path).returncode == 3


def test_diff_names_the_first_difference(tmp_path: Path) -> None:
    for name, stride in [("a", 1), ("b", 2)]:
        text = CHANCE.format(module="os", value=f"lf.time.logical_elapsed() * {stride}")
        (tmp_path / name).mkdir()
        trace(program(tmp_path / name, text), tmp_path / f"{name}.trace")
    a, b = tmp_path / "a.trace", tmp_path / "b.trace"
    found = hprm("diff", a, b)
    assert found.returncode == 3
    assert found.stdout == (
        "at (10000000 ns, 0), reaction Program.source.1 sets Program.source.out to 10000000 in "
        f"{a}, and sets Program.source.out to 20000000 in {b}\n"
    )
    found = hprm("diff", "--json", a, b)
    assert json.loads(found.stdout)["divergence"]["tag"] == [10_000_000, 0]
    assert hprm("diff", a, a).returncode == 0


def test_diff_warns_of_a_run_that_has_failed(tmp_path: Path) -> None:
    text = CHANCE.format(module="os", value="1 // (lf.time.logical_elapsed() < 20_000_000)")
    a = tmp_path / "a.trace"
    failed = hprm("run", "--logical-trace", a, program(tmp_path, text))
    assert failed.returncode == 1
    found = hprm("diff", a, a)
    assert found.returncode == 0
    assert (
        found.stderr.splitlines()
        == [f"warning: the run of {a} has failed at (20000000 ns, 0): later tags are not compared"]
        * 2
    )
    assert json.loads(hprm("diff", "--json", a, a).stdout)["failed"] == [str(a)] * 2


NAMED = {
    "app.py": """\
import hprm


class Source(hprm.Reactor):
    out = hprm.Output()

    @hprm.reaction(hprm.startup, effects=[out])
    def begin(self):
        self.out.set(VALUE)


class Main(hprm.Reactor):
    def __init__(self):
        self.source = Source()


if __name__ == "__main__":
    hprm.run(Main())
""",
    "Main.lf": """\
target Python
reactor Source {
  output out
  reaction begin(startup) -> out {= out.set(VALUE) =}
}
main reactor { source = new Source() }
""",
    "bare/Main.lf": """\
target Python
reactor Source {
  output out
  reaction(startup) -> out {= out.set(VALUE) =}
}
main reactor { source = new Source() }
""",
}


def test_diff_calls_reactions_by_their_names_and_compares_none(tmp_path: Path) -> None:
    traces = {}
    for name, text in NAMED.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        for value in (1, 2):
            path.write_text(text.replace("VALUE", str(value)))
            traces[name, value] = tmp_path / f"{len(traces)}.trace"
            trace(path, traces[name, value])
    for first in NAMED:
        for second in NAMED:
            a, b = traces[first, 1], traces[second, 2]
            found = hprm("diff", a, b)
            number = first == second == "bare/Main.lf"
            name = "Main.source." + ("1" if number else "begin")
            begins = f"at (0 ns, 0), reaction {name} sets Main.source.out to 1 in {a}"
            assert found.stdout.startswith(begins), found.stdout
            divergence = json.loads(hprm("diff", "--json", a, b).stdout)["divergence"]
            assert (divergence["reaction"], divergence["name"]) == ("Main.source.1", name)
            assert hprm("diff", a, traces[second, 1]).returncode == 0


def test_what_is_no_trace_is_said_to_be_none(tmp_path: Path) -> None:
    path = program(tmp_path, PHYSICAL)
    for wrong in (path, tmp_path / "nowhere", tmp_path):
        answer = hprm("diff", wrong, wrong)
        assert answer.returncode == 1
        assert answer.stderr.startswith("error: ") and str(wrong) in answer.stderr


# A value that may change on its way: what the sender keeps, what it does, and what a receiver does.
SHARED = """\
target Python { timeout: 30 ms }
preamble {=
  import numpy as np
=}
reactor Sender {
  output out
  timer t(0, 10 ms)
  state kept = {= KIND =}
  reaction(t) -> out {=
    SEND
  =}
}
reactor Changes {
  MUTABLE input inp
  output done
  reaction(inp) -> done {=
    CHANGE
    done.set(True)
  =}
}
reactor Reads {
  input inp
  input[2] done
  reaction(done) inp {= pass =}
  reaction(inp) {= pass =}
}
federated reactor {
  sender = new Sender()
  changes = new[2] Changes()
  reads = new Reads()
  (sender.out)+ -> changes.inp
  changes.done -> reads.done
  sender.out -> reads.inp AFTER
}
"""


def shared(kind: str, send: str, change: str = "pass", mutable: str = "", after: str = "") -> str:
    text = SHARED.replace("KIND", kind).replace("SEND", send).replace("CHANGE", change)
    return text.replace("MUTABLE", mutable).replace("AFTER", after)


@pytest.mark.parametrize(
    ("text", "reader"),
    [
        # The sender goes on changing what is on its way.
        (
            shared("np.zeros(100_000)", "self.kept += 1; out.set(self.kept)", after="after 15 ms"),
            r"reaction Main\.reads\.2 reads Main\.reads\.inp as ndarray .*"
            r" and reads .* as another ndarray",
        ),
        # A receiver changes what others read at the same tag. Workers decide on the first of them.
        (
            shared("[]", "out.set([1])", change="inp.value.append(2)"),
            r"Main\.(changes\[[01]\]|reads)\.1 reads",
        ),
    ],
)
def test_verify_sees_what_is_read_and_not_only_what_is_set(
    text: str, reader: str, tmp_path: Path
) -> None:
    verdict = hprm("verify", "--runs", 2, program(tmp_path, text, "Main"))
    assert verdict.returncode == 3, verdict.stdout + verdict.stderr
    assert re.search(reader, verdict.stdout), verdict.stdout
    assert "  hint: the value may have been changed after it was set" in verdict.stdout


@pytest.mark.parametrize(
    "text",
    [
        shared(
            "np.zeros(100_000)", "self.kept += 1; out.set(self.kept.copy())", after="after 15 ms"
        ),
        shared("[]", "out.set([1])", change="inp.value.append(2)", mutable="mutable"),
        # At the same tag, the sender's next change is still to come.
        shared("[]", "self.kept.append(1); out.set(self.kept)"),
    ],
)
def test_verify_is_content_with_copies(text: str, tmp_path: Path) -> None:
    verdict = hprm("verify", "--runs", 5, program(tmp_path, text, "Main"))
    assert verdict.returncode == 0, verdict.stdout + verdict.stderr


READS = """\
target Python { timeout: 10 ms }
reactor Sender {
  output out
  output wide
  timer t(0, 10 ms)
  reaction(t) -> out, wide {=
    wide.set([1])
    if lf.time.logical_elapsed() == 0: out.set("once")
  =}
}
reactor Reader {
  mutable input[2] inp
  input kept
  logical action act
  initial mode Only {
    reaction(inp) kept -> act {=
      inp[0].value.append(2)
      act.schedule(MSEC(1), kept.value)
      if not kept.is_present: act.schedule(0)
    =}
  }
  reaction(startup) kept {= kept.set("never") =}
  reaction(act) {= pass =} deadline(0) {= pass =}
}
main reactor {
  sender = new Sender()
  reader = new Reader()
  (sender.wide)+ -> reader.inp
  sender.out -> reader.kept
}
"""


def test_a_trace_says_what_each_reaction_found(tmp_path: Path) -> None:
    text = trace(program(tmp_path, READS, "Main"), tmp_path / "trace")
    entries = [json.loads(line) for line in text.splitlines()[1:-1]]
    found = [
        (
            entry["tag"],
            entry["reaction"].removeprefix("Main."),
            [
                (
                    read["from"].removeprefix("Main.reader."),
                    read.get("value", {}).get("text"),
                    read.get("remembered", False),
                )
                for read in entry["reads"]
            ],
        )
        for entry in entries
        if "reads" in entry
    ]
    inputs = [("inp[0]", "list of 1", False), ("inp[1]", "list of 1", False)]
    assert found == [
        ([0, 0], "reader.1", [*inputs, ("kept", "'once'", False)]),
        ([0, 0], "reader.2", [("kept", "'once'", False)]),
        ([1_000_000, 0], "reader.3", [("act", "'once'", False)]),
        ([10_000_000, 0], "reader.1", [*inputs, ("kept", "'once'", True)]),
    ]
    assert [entry.get("body") for entry in entries if entry["reaction"] == "Main.reader.3"] == [
        "deadline"
    ]


STOP = """\
target Python { timeout: 200 ms }
reactor Asks {
  output out
  timer t(0, 1 ms)
  reaction(t) -> out {=
    out.set(1)
    if lf.time.logical_elapsed() == MSEC(10): lf.request_stop()
  =}
}
reactor Schedules {
  input inp
  timer t(0, 500 us)
  logical action plain(3 ms)
  logical action drops(3 ms, 2 ms, "drop")
  reaction(t) -> plain, drops {=
    plain.schedule(0)
    drops.schedule(0)
  =}
  reaction(plain, drops) {= pass =}
  reaction(inp) {= pass =}
}
federated reactor {
  asks = new Asks()
  schedules = new Schedules()
  asks.out -> schedules.inp
}
"""

UNREAD = """\
target Python
reactor Sends {
  output out
  reaction(startup) -> out {= out.set(1) =}
}
reactor Ignores {
  input inp
  reaction(shutdown) {= print("ends at", lf.time.logical_elapsed()) =}
}
federated reactor {
  sends = new Sends()
  ignores = new Ignores()
  sends.out -> ignores.inp after 5 ms
}
"""


@pytest.mark.parametrize("text", [STOP, UNREAD])
def test_a_program_ends_alike_in_every_deployment(text: str, tmp_path: Path) -> None:
    verdict = hprm("verify", "--runs", 6, program(tmp_path, text))
    assert verdict.returncode == 0, verdict.stdout + verdict.stderr


def test_a_message_that_no_reaction_reads_is_waited_for(tmp_path: Path) -> None:
    path = program(tmp_path, UNREAD)
    for options in [[], ["--in-process"]]:
        done = hprm("run", *options, path)
        assert "ends at 5000000" in done.stdout, done.stdout + done.stderr


LATE = """\
target Python {{ timeout: 20 ms }}
preamble {{=
  import os, time
=}}
reactor Source {{
  output out
  timer t(0, 10 ms)
  reaction(t) -> out {{= out.set(1) =}}
}}
reactor Slow {{
  input inp
  output out
  reaction(inp) -> out {{=
    if lf.time.logical_elapsed() == MSEC(10) and "HPRM_TEST_SLOW" in os.environ:
        time.sleep(0.2)
    out.set(1)
  =}}
}}
reactor Hurried {{
  input inp
  output out
  reaction(inp) -> out {{=
    out.set(1)
    {clock}
  =}} deadline(100 ms) {{= {clock} =}}
}}
main reactor {{
  source = new Source()
  slow = new Slow()
  hurried = new Hurried()
  source.out -> slow.inp
  slow.out -> hurried.inp
  reaction(hurried.out) {{= pass =}}
}}
"""


@pytest.mark.parametrize("clock", ["pass", "print(lf.time.physical())"])
def test_a_missed_deadline_is_the_difference_that_is_named(clock: str, tmp_path: Path) -> None:
    path = program(tmp_path, LATE.format(clock=clock))
    trace(path, tmp_path / "met")
    trace(path, tmp_path / "missed", HPRM_TEST_SLOW="1")
    found = hprm("diff", tmp_path / "met", tmp_path / "missed")
    assert found.returncode == 3
    assert found.stdout.startswith(
        "at (10000000 ns, 0), reaction Program.hurried.1 misses its deadline in "
        f"{tmp_path / 'missed'}, but not in {tmp_path / 'met'}\n"
    )
    assert "  hint: whether a deadline is met depends on physical time" in found.stdout
    found = hprm("diff", "--json", tmp_path / "met", tmp_path / "missed")
    divergence = json.loads(found.stdout)["divergence"]
    assert divergence["reaction"] == "Program.hurried.1" and "physical time" in divergence["hint"]


def test_a_failing_run_leaves_the_trace_up_to_there(tmp_path: Path) -> None:
    text = CHANCE.format(module="os", value="1 // (lf.time.logical_elapsed() - 10_000_000)")
    path = program(tmp_path, text)
    done = hprm("run", "--logical-trace", tmp_path / "trace", path)
    assert done.returncode == 1
    lines = (tmp_path / "trace").read_text().splitlines()
    last = json.loads(lines[-1])
    assert last["outcome"] == "failed" and "ZeroDivisionError" in last["message"]
    assert json.loads(lines[1])["reaction"] == "Program.source.1"
    verdict = hprm("verify", path)
    assert verdict.returncode == 1
    assert "run 1" in verdict.stderr and "ZeroDivisionError" in verdict.stderr


def test_verify_ends_what_does_not_end(tmp_path: Path) -> None:
    path = program(tmp_path, FEDERATION.format(more="").replace("60 ms", "60 s"))
    verdict = hprm("verify", "--run-timeout", "0.5", path)
    assert verdict.returncode == 1
    assert "did not end" in verdict.stderr and "hint: " in verdict.stderr


@pytest.mark.parametrize(
    ("options", "told"), [([], 1), (["--property=coordination=centralized"], 0)]
)
def test_verify_leaves_out_what_a_fast_federation_forbids(
    options: list[str], told: int, tmp_path: Path
) -> None:
    text = FEDERATION.format(more="").replace("timeout: 60 ms", "timeout: 60 ms, fast: true")
    path = program(tmp_path, text)
    verdict = hprm("verify", *options, path)
    assert (verdict.returncode, verdict.stderr) == (0, "")
    *before, last = verdict.stdout.splitlines()
    assert before == ["no run is decentralized, as `fast` does not go together with that"] * told
    assert "6 runs did the same" in last
    verdict = hprm("verify", "--json", "--runs", 3, *options, path)
    assert json.loads(verdict.stdout)["equal"], verdict.stderr


STOPS = """\
target Python
preamble {{=
  import random
=}}
reactor Stop {{
  timer t(0, 1 ms)
  reaction(t) {{=
    if lf.time.physical() and lf.time.logical_elapsed() == 2_000_000:
        lf.request_stop()
  =}}
}}
main reactor {{
  logical action a
  stop = new Stop()
  reaction(startup) -> a {{= a.schedule(0, {value}) =}}
}}
"""


@pytest.mark.parametrize(("value", "code"), [("1", 0), ("random.random()", 3)])
def test_verify_says_first_on_which_runs_clocks_decided(
    value: str, code: int, tmp_path: Path
) -> None:
    path = program(tmp_path, STOPS.format(value=value))
    verdict = hprm("verify", "--runs", 3, path)
    assert verdict.returncode == code, verdict.stderr
    which = "run 1 and run 2 both depend" if code else "3 runs depend"
    first = f"{which} on clocks: they decided when a federate came or went, or when all ended"
    assert verdict.stdout.splitlines()[0] == first
    verdict = hprm("verify", "--json", "--runs", 2, path)
    assert json.loads(verdict.stdout)["clocks"] == ["run 1", "run 2"]


def test_verify_keeps_traces_where_it_is_told(tmp_path: Path) -> None:
    path = program(tmp_path, WIDE)
    assert hprm("verify", "--runs", 2, "--keep", tmp_path / "kept", path).returncode == 0
    kept = sorted(file.name for file in (tmp_path / "kept").iterdir())
    assert kept == ["1.trace", "2.trace"]
    assert hprm("diff", tmp_path / "kept/1.trace", tmp_path / "kept/2.trace").returncode == 0


def test_a_link_to_a_trace_is_followed(tmp_path: Path) -> None:
    path = program(tmp_path, FEDERATION.format(more=""))
    (tmp_path / "traces").mkdir()
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "traces" / "real")
    assert trace(path, link) == trace(path, tmp_path / "other")
    assert link.is_symlink() and (tmp_path / "traces" / "real").is_file()
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "Program.lf", "link", "other", "traces",
    ]  # fmt: skip


def test_a_trace_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    path = program(tmp_path, FEDERATION.format(more=""))
    done = hprm("run", "--logical-trace", tmp_path, path)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"error: cannot write the trace {tmp_path}: is a directory\n"


@pytest.mark.parametrize("limit", [None, 1024, 3072], ids=["full", "short", "merged"])
@pytest.mark.parametrize("way", ["whole", "processes", "threads"])
def test_a_trace_that_cannot_be_written_to_its_end_leaves_nothing(
    tmp_path: Path, limit: int | None, way: str
) -> None:
    text = FEDERATION.format(more="")
    text = text.replace("federated reactor", "main reactor") if way == "whole" else text
    path = program(tmp_path, text)
    folder = tmp_path / "traces"
    folder.mkdir()
    # The disk is full, or a file may not be longer: a share, or all of them together.
    file = Path("/dev/full") if limit is None else folder / "trace"
    words = [HPRM, "run", "--json", "--logical-trace", file]
    done = subprocess.run(
        [*words, *(["--in-process"] if way == "threads" else []), path],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        cwd=folder,
        env=os.environ | {"TMPDIR": str(folder)},
        preexec_fn=lambda: limit and resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert done.returncode == 1, done.stderr
    (line,) = filter(None, done.stderr.splitlines())
    report = json.loads(line)
    assert report["kind"] == "trace"
    # Not a share of it, which the user does not know.
    assert f"cannot write the trace {file}: " in report["message"]
    assert way == "whole" or limit != 1024 or report["federate"] is not None
    assert ("make room" if limit is None else "ulimit -f") in report["hint"]
    assert list(folder.iterdir()) == []


KINDS = """\
target Python {{ timeout: 0 s }}
preamble {{=
import sys
from functools import cache
sys.path.insert(0, {folder!r})
import kinds
values = cache(kinds.every)
=}}
reactor Source(which="") {{
  output out
  reaction(startup) -> out {{= out.set(values()[self.which]) =}}
}}
reactor Pass {{
  input inp
  output out
  reaction(inp) -> out {{= out.set([inp.value, inp.value]) =}}
}}
reactor Sink {{
  input inp
  reaction(inp) {{= =}}
}}
federated reactor {{
  source = new Sources()
  passing = new Passes()
  sink = new Sinks()
  source.out -> passing.inp
  passing.out -> sink.inp
}}
reactor Sources {{
  output[{width}] out
  s = new[{width}] Source(which={{= kinds_of[bank_index] =}})
  s.out -> out
}}
reactor Passes {{
  input[{width}] inp
  output[{width}] out
  p = new[{width}] Pass()
  inp -> p.inp
  p.out -> out
}}
reactor Sinks {{
  input[{width}] inp
  s = new[{width}] Sink()
  inp -> s.inp
}}
"""


def test_a_value_of_every_kind_is_the_same_in_every_deployment(tmp_path: Path) -> None:
    names = list(kinds.every())
    text = KINDS.format(folder=str(Path(kinds.__file__).parent), width=len(names))
    text = text.replace("import kinds\n", f"import kinds\nkinds_of = {names!r}\n")
    # A sixth run would be one more in processes, each of which imports all libraries.
    verdict = hprm("verify", "--runs", 5, program(tmp_path, text))
    assert verdict.returncode == 0, verdict.stdout + verdict.stderr
    assert "did the same" in verdict.stdout and "left out" not in verdict.stdout
