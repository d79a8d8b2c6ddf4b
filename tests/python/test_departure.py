"""A federate that calls `lf.stop()` ends, and the other federates continue."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import Run
from processes import COORDINATIONS
from test_trace import hprm, program

LEAVES = """
target Python {{ timeout: 30 ms{coordination} }}
reactor Leaver {{
  output out
  output later
  timer t(0, 10 ms)
  state n = 0
  reaction(t) -> out {{= self.n += 1; out.set(self.n) =}}
  reaction(t) {{=
    if self.n == 2: lf.stop()
  =}}
  reaction(shutdown) -> out, later {{=
    print("left", lf.time.logical_elapsed() // 1000000, lf.tag().microstep)
    out.set("bye")
    later.set("afterwards")
  =}}
}}
reactor Stays {{
  input inp
  input later
  output back
  timer t(0, 10 ms)
  reaction(t, inp, later) -> back {{=
    tag = lf.time.logical_elapsed() // 1000000, lf.tag().microstep
    print(*tag, inp.value, later.value)
    back.set(0)
  =}}
  reaction(shutdown) {{= print("end", lf.time.logical_elapsed() // 1000000) =}}
}}
reactor Sink {{ input inp; reaction(inp) {{= pass =}} }}
federated reactor {{
  leaver = new Leaver()
  stays = new Stays()
  sink = new Sink()
  leaver.out -> stays.inp
  leaver.later -> stays.later after 5 ms
  stays.back -> sink.inp
}}
"""

STAYS = ["0 0 1 None", "10 0 2 None", "10 1 bye None", "15 0 None afterwards"]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_what_a_federate_sends_at_its_end_arrives_in_order(launch: Run, coordination: str) -> None:
    outcome = launch(LEAVES.format(coordination=f", coordination: {coordination}"))
    assert (outcome.code, outcome.err) == (0, ""), outcome.err
    lines = outcome.out.splitlines()
    assert [line for line in lines if line.startswith("[leaver]")] == ["[leaver] left 10 1"]
    stays = [line.removeprefix("[stays] ") for line in lines if line.startswith("[stays]")]
    assert stays == [*STAYS, "20 0 None None", "30 0 None None", "end 30"]


@pytest.mark.parametrize("timeout", ["30 ms", "10 ms", "none"])
def test_every_way_to_run_it_does_the_same(tmp_path: Path, timeout: str) -> None:
    text = LEAVES.format(coordination="")
    if timeout == "none":
        # Then the program ends when nothing is left to do.
        text = text.replace("timeout: 30 ms", "").replace("timer t(0, 10 ms)", "timer t(0)")
        text = text.replace("self.n == 2", "self.n == 1")
    path = program(tmp_path, text.replace("30 ms", timeout))
    verdict = hprm("verify", path)
    assert verdict.returncode == 0, verdict.stdout + verdict.stderr


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_another_thread_may_ask(launch: Run, coordination: str) -> None:
    outcome = launch(f"""
        target Python {{ timeout: 1 minute, coordination: {coordination} }}
        preamble {{= import threading =}}
        reactor Leaver {{
          output out
          timer t(0, 10 ms)
          reaction(startup) {{= threading.Timer(0.05, lf.stop).start() =}}
          reaction(t) {{= =}}
          reaction(shutdown) -> out {{= out.set("bye") =}}
        }}
        reactor Stays {{
          input inp
          timer t(0, 1 ms)
          reaction(t) {{= =}}
          reaction(inp) {{= print(inp.value); request_stop() =}}
        }}
        federated reactor {{
          leaver = new Leaver()
          stays = new Stays()
          leaver.out -> stays.inp
        }}
        """)
    assert (outcome.code, outcome.out) == (0, "[stays] bye\n"), outcome.err
