"""Federations of real processes: what must hold whatever the processes are doing."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import Run
from processes import COORDINATIONS


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_clock_upstream_is_never_overtaken(launch: Run, coordination: str) -> None:
    outcome = launch(f"""\
        target Python {{ coordination: {coordination}, timeout: 400 ms }}
        preamble {{= import threading, time =}}
        reactor Sensor {{
          output out
          physical action seen
          reaction(startup) -> seen {{=
            def watch():
                for number in range(60):
                    time.sleep(0.0031)
                    seen.schedule(0, number)
            threading.Thread(target=watch, daemon=True).start()
          =}}
          reaction(seen) -> out {{= out.set(seen.value) =}}
        }}
        reactor Logger {{
          input inp
          timer t(0, 100 us)
          state numbers = []
          reaction(inp) {{= self.numbers.append(inp.value) =}}
          reaction(t) {{= pass =}}
          reaction(shutdown) {{=
            count = len(self.numbers)
            print(count > 0 and self.numbers == list(range(count)))
          =}}
        }}
        federated reactor {{
          sensor = new Sensor()
          logger = new Logger()
          sensor.out -> logger.inp
        }}
        """)
    assert (outcome.code, outcome.out) == (0, "[logger] True\n"), outcome.err


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_the_last_arrays_arrive(launch: Run, coordination: str) -> None:
    program = f"""\
        target Python {{ coordination: {coordination} }}
        preamble {{= import numpy as np =}}
        reactor Source {{
          output out
          logical action again
          state count = 0
          reaction(startup, again) -> out, again {{=
            out.set(np.full(100_000, self.count))
            self.count += 1
            if self.count == 20:
                request_stop()
            else:
                again.schedule(0)
          =}}
        }}
        reactor Sink {{
          input inp
          state total = 0
          reaction(inp) {{= self.total += int(inp.value[-1]) =}}
          reaction(shutdown) {{= print(self.total) =}}
        }}
        federated reactor {{
          source = new Source()
          sink = new[3] Sink()
          (source.out)+ -> sink.inp
        }}
        """
    for _ in range(5):
        outcome = launch(program)
        assert outcome.code == 0, outcome.err
        assert sorted(outcome.out.splitlines()) == [f"[sink__{i}] 190" for i in range(3)]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federate_that_is_behind_still_sends(launch: Run, coordination: str) -> None:
    outcome = launch(f"""\
        target Python {{ coordination: {coordination}, timeout: 20 s }}
        preamble {{= import time =}}
        reactor Slow {{
          output out
          timer t(0, 1 ms)
          state count = 0
          reaction(t) -> out {{=
            time.sleep(0.003)
            self.count += 1
            out.set(self.count)
          =}}
          reaction(shutdown) {{= print(self.count < 1000) =}}
        }}
        reactor Sink {{
          input inp
          reaction(inp) {{=
            if inp.value == 10:
                request_stop()
          =}}
        }}
        federated reactor {{
          slow = new Slow()
          sink = new Sink()
          slow.out -> sink.inp
        }}
        """)
    assert (outcome.code, outcome.out) == (0, "[slow] True\n"), outcome.err


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federate_that_leaves_early_does_not_keep_the_others_from_stopping(
    launch: Run, coordination: str
) -> None:
    outcome = launch(f"""\
        target Python {{ coordination: {coordination} }}
        preamble {{= import sys =}}
        reactor Leaver {{
          timer t(10 ms)
          reaction(t) {{= sys.exit(0) =}}
        }}
        reactor Stopper {{
          timer t(0, 10 ms)
          state count = 0
          reaction(t) {{=
            self.count += 1
            if self.count == 10:
                request_stop()
          =}}
          reaction(shutdown) {{= print(lf.time.logical_elapsed(), lf.tag().microstep) =}}
        }}
        federated reactor {{
          leaver = new Leaver()
          stopper = new Stopper()
        }}
        """)
    assert (outcome.code, outcome.out) == (0, "[stopper] 90000000 1\n"), outcome.err


def test_a_failure_is_never_an_exit_code_of_zero(run: Run) -> None:
    outcome = run("""\
        target Python
        preamble {= import sys =}
        main reactor { reaction(startup) {= sys.exit(256) =} }
        """)
    assert outcome.code == 1


def test_an_event_at_the_end_of_time_never_comes(run: Run) -> None:
    outcome = run("""\
        target Python
        main reactor {
          logical action a
          reaction(startup) -> a {=
            a.schedule(FOREVER)
            a.schedule(FOREVER)
            print("one")
          =}
          reaction(a) {= print("never") =}
        }
        """)
    assert (outcome.code, outcome.out) == (0, "one\n"), outcome.err


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_federates_may_answer_at_the_same_tag(launch: Run, coordination: str) -> None:
    outcome = launch(f"""\
        target Python {{ coordination: {coordination}, timeout: 300 ms }}
        reactor Player(name="", first=False) {{
          input heard
          input asked
          output said
          output asking
          timer t(0, 100 ms)
          state log = []
          reaction(t) -> said {{=
            if self.first:
                said.set(1)
          =}}
          reaction(heard) -> asking {{= asking.set(heard.value * 2) =}}
          reaction(asked) {{=
            self.log.append((lf.time.logical_elapsed() // MSEC(1), lf.tag().microstep, asked.value))
          =}}
          reaction(shutdown) {{= print(self.name, self.log) =}}
        }}
        federated reactor {{
          ping = new Player(name="ping", first=True)
          pong = new Player(name="pong")
          ping.said -> pong.heard
          pong.asking -> ping.asked
          pong.said -> ping.heard
          ping.asking -> pong.asked
        }}
        """)
    assert outcome.code == 0, outcome.err
    log = [(time, 0, 2) for time in (0, 100, 200, 300)]
    assert f"ping {log}" in outcome.out
    assert "pong []" in outcome.out


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federation_ends_when_nothing_is_left_to_do(launch: Run, coordination: str) -> None:
    outcome = launch(f"""\
        target Python {{ coordination: {coordination} }}
        reactor Source {{
          output out
          timer once(20 ms)
          reaction(once) -> out {{= out.set(1) =}}
          reaction(shutdown) {{= print(lf.time.logical_elapsed(), lf.tag().microstep) =}}
        }}
        reactor Sink {{
          input inp
          logical action later
          reaction(inp) -> later {{= later.schedule(MSEC(30)) =}}
          reaction(later) {{= pass =}}
          reaction(shutdown) {{= print(lf.time.logical_elapsed(), lf.tag().microstep) =}}
        }}
        reactor Alone {{
          reaction(shutdown) {{= print(lf.time.logical_elapsed(), lf.tag().microstep) =}}
        }}
        federated reactor {{
          source = new Source()
          sink = new Sink()
          alone = new Alone()
          source.out -> sink.inp after 5 ms
        }}
        """)
    assert outcome.code == 0, outcome.err
    ends = [f"[{name}] 55000000 1" for name in ("alone", "sink", "source")]
    assert sorted(outcome.out.splitlines()) == ends


def test_the_example_of_waits_in_the_docs(launch: Run) -> None:
    text = (Path(__file__).parents[2] / "docs" / "concepts" / "federations.md").read_text()
    [example] = [block for block in text.split("```")[1::2] if "absent_after" in block]
    outcome = launch(example.removeprefix("lf"))
    assert (outcome.code, outcome.err) == (0, ""), outcome.err
    lines = [line.removeprefix("[controller] ") for line in outcome.out.splitlines()]
    kinds = [line.removesuffix(", too late") for line in lines]
    # Whatever the load of the machine is, nothing is lost before the last tag.
    assert kinds.count("tick") == 5
    assert kinds.count("image") in (4, 5)
    assert kinds.count("plan") == 1


def test_a_reaction_that_reads_no_input_runs_before_the_answer_to_it_is_known(
    launch: Run,
) -> None:
    # No matter how long the answer takes, it is for the tag at which it was asked for.
    outcome = launch("""\
        target Python { coordination: decentralized, timeout: 40 ms }
        preamble {= import time =}
        reactor Asks {
          input answer
          output question
          timer t(0, 10 ms)
          state count = 0
          reaction(t) -> question {= self.count += 1; question.set(self.count) =}
          reaction(answer) {= print(self.count, answer.value) =}
        }
        reactor Answers {
          input question
          output answer
          reaction(question) -> answer {=
            time.sleep(0.02)
            answer.set(2 * question.value)
          =}
        }
        federated reactor {
          @maxwait(0)
          asks = new Asks()
          answers = new Answers()
          asks.question -> answers.question
          @absent_after(1 hour)
          answers.answer -> asks.answer
        }
        """)
    expected = "".join(f"[asks] {n} {2 * n}\n" for n in range(1, 6))
    assert (outcome.code, outcome.out, outcome.err) == (0, expected, "")


def test_a_receiver_waits_at_the_last_tag_for_a_late_sender(launch: Run) -> None:
    outcome = launch("""\
        target Python { coordination: decentralized, timeout: 20 ms }
        preamble {=
        import time
        =}
        reactor Late {
          output out
          timer t(0, 10 ms)
          reaction(t) -> out {=
            time.sleep(0.03)
            out.set(lf.time.logical_elapsed() // MSEC(10))
          =}
        }
        reactor Sink {
          input inp
          reaction(inp) {= print(inp.value) =} tardy {= print("tardy", inp.value) =}
        }
        federated reactor {
          late = new Late()
          @maxwait(1 hour)
          sink = new Sink()
          late.out -> sink.inp
        }
        """)
    expected = "".join(f"[sink] {n}\n" for n in range(3))
    assert (outcome.code, outcome.out) == (0, expected)
