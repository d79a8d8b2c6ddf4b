"""Joining by hand: for which federates the RTI waits, and how a federate finds its federation."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from processes import Bench, Outcome, finish, hear

PAIR = """
target Python { timeout: 10 ms }
reactor A {}
federated reactor { a = new A()  b = new A() }
"""

TRANSIENT = """
target Python { timeout: 60 s }
reactor Source {
  output out
  timer t(0, 10 ms)
  reaction(t) -> out {= out.set(1) =}
}
reactor Mid {
  input inp
  output out
  state life = 0
  reaction(startup) {=
    first = os.path.join(lf.source_directory(), "first")
    self.life = 1 if os.path.exists(first) else 0
    open(first, "w").close()
  =}
  reaction(inp) -> out {=
    out.set(self.life)
    if self.life == 0: lf.stop()
  =}
}
reactor Sink {
  input inp
  reaction(inp) {=
    print("life", inp.value, flush=True)
    if inp.value == 1: request_stop()
  =}
}
federated reactor {
  source = new Source()
  @transient
  mid = new Mid()
  sink = new Sink()
  source.out -> mid.inp
  mid.out -> sink.inp
}
"""


def test_the_rti_says_for_whom_it_waits(bench: Bench) -> None:
    federation = bench.by_hand(PAIR)
    out = federation.members["rti"].stdout
    hear(out, "waiting for federates a, b\n")
    federation.start("b")
    hear(out, "federate b joined\nwaiting for federate a\n")
    federation.start("a")
    assert [outcome.code for outcome in federation.finish().values()] == [0, 0, 0]


def clean(bench: Bench, *arguments: str) -> Outcome:
    """Run the command as another terminal would, with an environment of its own."""
    command = shutil.which("hprm", path=str(Path(sys.executable).parent))
    assert command is not None, "make build puts hprm beside python"
    done = subprocess.run(
        [command, *arguments],
        cwd=bench.folder,
        env={},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    return Outcome(done.returncode, done.stdout, done.stderr)


def test_a_federate_finds_the_federation_that_runs(bench: Bench) -> None:
    # With a property that the other terminal does not know, and must have.
    run = bench.start(TRANSIENT, "--property", "timeout=50 s")
    hear(run.stdout, "life 0\n")
    again = clean(bench, "federate", "./Main.lf", "mid")
    assert (again.code, again.err) == (0, ""), again
    outcome = finish(run)
    assert outcome.code == 0, outcome
    assert "life 1\n" in outcome.out
    assert not (bench.folder / "fed-gen").exists()
    missing = clean(bench, "federate", "Main.lf", "mid")
    assert missing.code == 1
    missing.assert_one_error("no federation of Main.lf with transient", "--rti ADDRESS")


def test_a_script_starts_a_federate_from_elsewhere(bench: Bench) -> None:
    run = bench.start(TRANSIENT)
    hear(run.stdout, "life 0\n")
    script = bench.folder / "fed-gen" / "Main" / "bin" / "federate__mid"
    again = subprocess.run([script], cwd="/", env={}, timeout=60, check=False)
    assert again.returncode == 0
    assert finish(run).code == 0


def test_of_two_federations_one_is_to_be_named(bench: Bench) -> None:
    text = TRANSIENT.replace("self.life = 1 if", "self.life = 0 if")
    runs = [bench.start(text) for _ in range(2)]
    for run in runs:
        hear(run.stdout, "life 0\n")
    refused = clean(bench, "federate", "Main.lf", "mid")
    refused.assert_one_error("2 federations of Main.lf run on this machine", "say which: --rti")
    addresses = refused.err.rpartition("one of ")[2].strip().split(", ")
    # The address is enough: the secret is on record.
    again = clean(bench, "federate", "Main.lf", "mid", "--rti", addresses[0])
    assert (again.code, again.err) == (0, ""), again
    runs[0].send_signal(signal.SIGINT)
    assert finish(runs[0]).code == 130
    # The other one needs what starts its federate.
    assert (bench.folder / "fed-gen" / "Main" / "bin" / "federate__mid").exists()
    runs[1].send_signal(signal.SIGINT)
    assert finish(runs[1]).code == 130
    assert not (bench.folder / "fed-gen").exists()


@pytest.mark.parametrize("end", ["interrupted", "failed"])
def test_nothing_is_left_of_the_commands(bench: Bench, end: str) -> None:
    kept = bench.folder / "fed-gen" / "Other"
    kept.mkdir(parents=True)
    text = TRANSIENT
    if end == "failed":
        text = text.replace("if inp.value == 1: request_stop()", "raise ValueError('no')")
    run = bench.start(text)
    hear(run.stdout, "life 0\n")
    assert end == "failed" or (bench.folder / "fed-gen" / "Main").exists()
    if end == "interrupted":
        run.send_signal(signal.SIGINT)
    assert finish(run).code == (130 if end == "interrupted" else 1)
    assert [path.name for path in (bench.folder / "fed-gen").iterdir()] == ["Other"]


def test_a_federation_that_was_killed_is_not_found(bench: Bench) -> None:
    first = bench.start(TRANSIENT)
    hear(first.stdout, "life 0\n")
    first.kill()
    first.communicate()
    missing = clean(bench, "federate", "Main.lf", "mid")
    missing.assert_one_error("no federation of Main.lf with transient")
    # The next run takes with it what that one has left.
    assert (bench.folder / "fed-gen").exists()
    (bench.folder / "first").unlink()
    second = bench.start(TRANSIENT)
    hear(second.stdout, "life 0\n")
    second.send_signal(signal.SIGINT)
    assert finish(second).code == 130
    assert not (bench.folder / "fed-gen").exists()
