"""Federates of one machine read boards instead of asking the RTI, unless HPRM_BOARDS=off.

The handbook has it in docs/concepts/federations.md.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from processes import Bench, Outcome, finish
from random_programs import program as random_program

HPRM = Path(sys.executable).with_name("hprm")
ON = {"HPRM_BOARDS": "on"}
OFF = {"HPRM_BOARDS": "off"}

CHAIN = """
target Python { timeout: 40 ms }
reactor Source {
  output out
  timer t(0, 1 ms)
  state n = 0
  reaction(t) -> out {=
    self.n += 1
    if self.n % 3:
        out.set(self.n)
  =}
}
reactor Stage {
  input inp
  output out
  timer t(0, 2 ms)
  reaction(t) {= pass =}
  reaction(inp) -> out {= out.set(inp.value * 2) =}
}
reactor Sink {
  input inp
  input late
  timer t(0, 1 ms)
  state seen = 0
  reaction(t, inp, late) {=
    self.seen += (inp.value or 0) + (late.value or 0)
  =}
  reaction(shutdown) {= print("seen", self.seen) =}
}
federated reactor {
  source = new Source()
  stage = new Stage()
  sink = new Sink()
  source.out -> stage.inp
  stage.out -> sink.inp
  source.out -> sink.late after 3 ms
}
"""


def run(bench: Bench, text: str, *options: str, environment: dict[str, str]) -> Outcome:
    (bench.folder / "Main.lf").write_text(text)
    return finish(bench.call("run", *options, "Main.lf", environment=environment))


@pytest.mark.parametrize("target", ["timeout: 40 ms", "timeout: 40 ms, fast: true"])
def test_a_program_does_the_same(bench: Bench, target: str) -> None:
    text = CHAIN.replace("timeout: 40 ms", target)
    traces = []
    for name, environment in [("rti", OFF), ("boards", {})]:
        outcome = run(bench, text, "--logical-trace", f"{name}.jsonl", environment=environment)
        assert (outcome.code, outcome.err) == (0, ""), outcome.err
        traces.append((outcome.out, (bench.folder / f"{name}.jsonl").read_text()))
    assert traces[0] == traces[1]
    assert "seen 1" in traces[0][0]


def test_no_tag_needs_a_frame_to_the_rti(bench: Bench) -> None:
    logged = ["--log-frames-to", "frames.log"]
    outcome = run(bench, CHAIN, *logged, environment=ON)
    assert (outcome.code, outcome.err) == (0, ""), outcome.err
    lines = [line.split() for line in (bench.folder / "frames.log").read_text().splitlines()]
    with_rti = [line[4] for line in lines if "rti" in (line[1], line[3])]
    direct = [line[4] for line in lines if "rti" not in (line[1], line[3])]
    assert "Board" in with_rti
    assert direct.count("Message") > 100
    of_tags = {"Message", "TagAdvanceGrant", "NextEventTag", "LatestTagConfirmed"}
    assert of_tags.isdisjoint(with_rti)
    # That a federate has nothing to do before the end, the RTI has to know now and then.
    assert with_rti.count("Progress") < direct.count("Message") // 2


def test_federates_that_are_threads_ask_the_rti(bench: Bench) -> None:
    logged = ["--log-frames-to", "frames.log"]
    outcome = run(bench, CHAIN, "--in-process", *logged, environment=ON)
    assert (outcome.code, outcome.err) == (0, ""), outcome.err
    assert "TagAdvanceGrant" in (bench.folder / "frames.log").read_text()


def test_a_federate_that_is_killed_ends_the_others(bench: Bench) -> None:
    die = "if self.n == 20: import os, signal; os.kill(os.getpid(), signal.SIGKILL)"
    text = CHAIN.replace("self.n += 1\n", f"self.n += 1\n    {die}\n")
    outcome = run(bench, text, environment=ON)
    assert outcome.code == 1
    outcome.assert_one_error("error: federate source was killed by signal 9 (SIGKILL)")


@pytest.mark.parametrize("seed", [1, 4])
def test_random_programs_do_the_same_in_every_deployment(seed: int, tmp_path: Path) -> None:
    path = tmp_path / f"Seed{seed}.lf"
    path.write_text(random_program(seed, path.stem))
    command = [HPRM, "verify", "--runs", "5", "--run-timeout", "60", path]
    environment = {**os.environ, **ON}
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=400, check=False, env=environment
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_wrong_value_is_one_error(bench: Bench) -> None:
    outcome = run(bench, CHAIN, environment={"HPRM_BOARDS": "yes"})
    assert outcome.code == 2
    outcome.assert_one_error("the environment variable HPRM_BOARDS=yes is wrong")
    assert "neither on nor off" in outcome.err
