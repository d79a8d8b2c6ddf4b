"""Transient federates that fail are started again, as the program states (`@restart`)."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
from processes import COORDINATIONS, Bench, Outcome, finish, hear, until

SOURCE = """
reactor Up {
  output out
  timer t(0, 20 ms)
  state count = 0
  reaction(t) -> out {=
    out.set(self.count)
    self.count += 1
  =}
}
reactor Down {
  input inp
  state seen = {= [] =}
  timer t(0, 20 ms)
  state ticks = 0
  reaction(t) {= self.ticks += 1 =}
  reaction(inp) {= self.seen.append(inp.value) =}
  reaction(shutdown) {=
    print("ticks", self.ticks)
    print("seen", self.seen)
  =}
}
"""


def program(coordination: str, restart: str, body: str, timeout: str = "4 s") -> str:
    """A federation whose middle federate is started again."""
    return f"""
target Python {{ coordination: {coordination}, timeout: {timeout} }}
preamble {{=
import os
def note(name):
    with open(name + ".draft", "w") as file:
        file.write(str(os.getpid()) + chr(10))
    os.rename(name + ".draft", name + ".pid")
=}}
{SOURCE}
reactor Mid {{
  input inp
  output out
  {body}
}}
federated reactor {{
  up = new Up()
  @maxwait(50 ms)
  down = new Down()
  @transient @maxwait(50 ms) {restart}
  mid = new Mid()
  up.out -> mid.inp
  mid.out -> down.inp
}}
"""


#: Notes its process, forwards what comes, and stops all when the test says so.
FORWARD = """
  reaction(startup) {= note("mid" + str(len([it for it in os.listdir() if it.endswith(".pid")]))) =}
  reaction(inp) -> out {=
    out.set(inp.value)
    if os.path.exists("stop"): lf.request_stop()
  =}
"""


#: Leaves at once the first time.
LEAVE = FORWARD.replace(
    "    out.set",
    """    if not os.path.exists("mid1.pid"): lf.stop()
    out.set""",
)

#: A process that loads its program says so and waits for the test, once there is the file `slow`.
SLOW = """
  preamble {=
    import time
    if os.path.exists("slow"): open("loads", "w").close()
    while os.path.exists("slow") and not os.path.exists("ready"): time.sleep(0.01)
  =}
"""

#: Python runs this first: a process of `mid` that `hprm run` starts waits for the test.
WAIT = """
import os, time
words = open("/proc/self/cmdline").read().split(chr(0))
if "--launched" in words and words[-2] == "mid" and os.path.exists(AFTER):
    open("waits", "w").close()
    while not os.path.exists("go"): time.sleep(0.01)
"""


def start_delayed(bench: Bench, text: str, after: str = "mid0.pid") -> subprocess.Popen[str]:
    """Start `hprm run`; a process of `mid` waits before it joins, once that file is there."""
    (bench.folder / "Main.lf").write_text(text)
    (bench.folder / "sitecustomize.py").write_text(WAIT.replace("AFTER", repr(after)))
    return bench.call("run", "Main.lf", environment={"PYTHONPATH": str(bench.folder)})


def last_line(trace: Path) -> dict[str, Any]:
    """What a logical trace says of the end of its run."""
    end: dict[str, Any] = json.loads(trace.read_text().splitlines()[-1])
    return end


def ticks(trace: Path, reaction: str, *, spaced: bool = True) -> list[int]:
    """The times of a reaction in a logical trace, in steps of 20 ms, at which it runs if spaced."""
    lines = [json.loads(line) for line in trace.read_text().splitlines()]
    lines = [line for line in lines if line.get("reaction") == reaction]
    times = [line["tag"][0] for line in lines]
    if spaced:
        assert all(line["tag"][1] == 0 for line in lines)
        assert all(time % 20_000_000 == 0 for time in times)
    return [time // 20_000_000 for time in times]


def seen(outcome: Outcome) -> list[int]:
    """What `down` has received."""
    line = next(line for line in outcome.out.splitlines() if line.startswith("[down] seen"))
    return [int(number) for number in re.findall(r"\d+", line)]


def shown_restarts(bench: Bench, federation: str) -> dict[str, int]:
    """How often `hprm top` says that each federate was started again."""
    top = finish(bench.call("top", federation, "--json", "--once"))
    return {it["name"]: it["restarts"] for it in json.loads(top.out)["federates"]}


def restarts(outcome: Outcome) -> list[str]:
    """The lines that tell of restarts."""
    return [line for line in outcome.err.splitlines() if "; restart " in line]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federate_that_is_killed_comes_back(bench: Bench, coordination: str) -> None:
    text = program(coordination, '@restart("on-failure")', FORWARD, "60 s")
    process = bench.start(text, "--logical-trace", "trace")
    os.kill(bench.pid("mid0"), signal.SIGKILL)
    bench.pid("mid1")
    # The new process may be there some milliseconds before the RTI shows it.
    told = {"up": 0, "down": 0, "mid": 1}
    until(lambda: shown_restarts(bench, str(process.pid)) == told, "the restart is shown")
    (bench.folder / "stop").touch()
    outcome = finish(process)
    assert outcome.code == 0, outcome.err
    assert len(restarts(outcome)) == 1, outcome.err
    killed = (
        "warning: federate mid was killed by signal 9 (SIGKILL); restart 1 follows, after 100 ms"
    )
    assert restarts(outcome)[0].startswith(killed)
    assert outcome.errors == []
    numbers = seen(outcome)
    assert numbers == sorted(set(numbers))
    # The others went on meanwhile, at each tag, and one trace tells of both processes.
    trace = bench.folder / "trace"
    for name in ("Main.up.1", "Main.down.1"):
        assert ticks(trace, name) == list(range(ticks(trace, name)[-1] + 1)), name
    assert len(ticks(trace, "Main.mid.2")) >= 1
    end = last_line(trace)
    assert (end["outcome"], end["physical"], "missing" in end) == ("done", True, False)
    compared = finish(bench.call("diff", "trace", "trace"))
    assert compared.out.splitlines()[0] == (
        "trace and trace both depend on clocks: "
        "they decided when a federate came or went, or when all ended"
    )
    assert compared.out.splitlines()[1].startswith("equal: ")


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_process_that_joins_by_hand_is_in_the_trace(bench: Bench, coordination: str) -> None:
    process = bench.start(program(coordination, "", FORWARD, "60 s"), "--logical-trace", "trace")
    bench.pid("mid0")
    joined = bench.call("federate", "Main.lf", "mid")
    bench.pid("mid1")
    (bench.folder / "stop").touch()
    for outcome in (finish(process), finish(joined)):
        assert (outcome.code, outcome.errors) == (0, []), outcome.err
    trace = bench.folder / "trace"
    end = last_line(trace)
    assert (end["outcome"], end["physical"], "missing" in end) == ("done", True, False)
    begun = ticks(trace, "Main.mid.1", spaced=False)
    assert len(begun) == 2 and begun == sorted(begun)
    assert max(ticks(trace, "Main.mid.2")) >= begun[1]
    assert not list(bench.folder.glob("trace.*"))


def test_a_trace_names_the_federates_that_it_has_nothing_of(bench: Bench) -> None:
    text = program("centralized", "", FORWARD, "60 s")
    process = bench.start(text, "--logical-trace", "trace")
    bench.pid("mid0")
    joined = bench.call("federate", "Main.lf", "mid", "--logical-trace", "own")
    bench.pid("mid1")
    (bench.folder / "stop").touch()
    outcome = finish(process)
    assert (outcome.code, finish(joined).code) == (0, 0), outcome.err
    said = (
        "warning: the trace trace has nothing of a process of federate mid\n  hint: what a machine"
    )
    assert outcome.err.count(said) == 1, outcome.err
    trace, own = bench.folder / "trace", bench.folder / "own"
    end = last_line(trace)
    assert (end["outcome"], end["physical"], end["missing"]) == ("done", True, {"mid": 1})
    assert last_line(own)["outcome"] == "done"
    # The others are in it to their end.
    assert ticks(trace, "Main.up.1") == list(range(ticks(trace, "Main.up.1")[-1] + 1))
    assert end["end"][0] >= ticks(own, "Main.mid.2")[-1] * 20_000_000
    lines = trace.read_text().splitlines(keepends=True)
    del end["missing"], end["physical"]
    (bench.folder / "other").write_text("".join(lines[:-1]) + json.dumps(end) + "\n")
    compared = finish(bench.call("diff", "trace", "other"))
    assert compared.err == "warning: trace has nothing of 1 process of federate mid\n"
    first, second = compared.out.splitlines()
    assert first.startswith("trace depends on clocks: ") and second.startswith("equal: ")
    compared = finish(bench.call("diff", "other", "other"))
    assert (compared.err, len(compared.out.splitlines())) == ("", 1)
    verdict = json.loads(finish(bench.call("diff", "--json", "trace", "other")).out)
    assert (verdict["clocks"], verdict["missing"]) == (["trace"], {"trace": {"mid": 1}})


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_one_that_is_killed_while_it_starts_comes_back(bench: Bench, coordination: str) -> None:
    body = """
    preamble {=
      if not os.path.exists("once"):
          open("once", "w").close()
          os.kill(os.getpid(), 9)
    =}
    reaction(inp) -> out {=
      out.set(inp.value)
      lf.request_stop()
    =}
    """
    outcome = bench.run(program(coordination, '@restart("on-abnormal")', body, "60 s"))
    assert (outcome.code, len(restarts(outcome))) == (0, 1), outcome.err
    assert len(seen(outcome)) >= 1


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_one_that_is_killed_while_all_stop_does_not(bench: Bench, coordination: str) -> None:
    body = "reaction(shutdown) {= os.kill(os.getpid(), 9) =}"
    outcome = bench.run(program(coordination, '@restart("always", sec=0)', body, "100 ms"))
    assert outcome.code == 1
    told = [line for line in outcome.err.splitlines() if "mid" in line]
    assert "federate mid was killed by signal 9 (SIGKILL)" in told[0], outcome.err
    # The end of the federation may be known after the end of the process.
    assert len(restarts(outcome)) <= 1
    assert "ticks 6" in outcome.out


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_one_that_fails_each_time_runs_into_the_limit(bench: Bench, coordination: str) -> None:
    body = "reaction(startup) {= raise ValueError('no') =}"
    restart = '@restart("on-failure", sec=10 ms, burst=3, interval=1 h)'
    text = program(coordination, restart, body, "60 s")
    process = bench.start(text)
    heard = hear(process.stderr, "it is not started again")
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    heard += outcome.err
    assert outcome.code == 130
    assert heard.count("ValueError: no; restart ") == 2, heard
    assert heard.count("error: federate mid: ") == 1, heard
    assert (
        "ValueError: no; it is not started again: it has been started 3 times within 3600 s"
        in heard
    )
    assert "hint: the others go on without it" in heard
    assert "ticks" in outcome.out


def test_a_limit_is_the_exit_code_when_all_is_over(bench: Bench) -> None:
    body = "reaction(startup) {= os._exit(7) =}"
    restart = '@restart("on-failure", sec=0, burst=1)'
    outcome = bench.run(program("centralized", restart, body, "2 s"))
    assert outcome.code == 7
    outcome.assert_one_error("federate mid exited with code 7; it is not started again")
    assert "ticks 101" in outcome.out


def test_a_condition_that_does_not_hold_starts_nothing(bench: Bench) -> None:
    for end in ("os._exit(7)", "lf.stop()"):
        body = f"reaction(startup) {{= {end} =}}"
        outcome = bench.run(program("centralized", '@restart("on-abnormal")', body, "1500 ms"))
        assert outcome.code == (7 if "exit" in end else 0)
        assert restarts(outcome) == []


def test_one_that_leaves_comes_back_with_always(bench: Bench) -> None:
    body = """
    reaction(inp) -> out {=
      out.set(inp.value)
      if os.path.exists("once"): lf.request_stop()
      else: open("once", "w").close()
      lf.stop()
    =}
    """
    outcome = bench.run(program("centralized", '@restart("always")', body, "60 s"))
    assert outcome.code == 0
    assert [line.split("; ")[0] for line in restarts(outcome)] == [
        "warning: federate mid has ended with code 0"
    ]
    assert len(seen(outcome)) == 2


def test_ctrl_c_within_the_pause_ends_all_at_once(bench: Bench) -> None:
    body = "reaction(startup) {= os._exit(7) =}"
    process = bench.start(program("centralized", '@restart("on-failure", sec=1 h)', body, "60 s"))
    hear(process.stderr, "restart 1 follows, after 3600 s")
    process.send_signal(signal.SIGINT)
    outcome = finish(process)
    assert (outcome.code, outcome.errors, restarts(outcome)) == (130, [], [])
    assert "ticks" in outcome.out


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_one_that_does_not_answer_is_ended_and_comes_back(bench: Bench, coordination: str) -> None:
    body = """
    preamble {= import time =}
    reaction(inp) -> out {=
      if not os.path.exists("once"):
          open("once", "w").close()
          self.time.sleep(3600)
      out.set(inp.value)
      lf.request_stop()
    =}
    """
    text = program(coordination, '@restart("on-abnormal")', body, "60 s")
    process = bench.start(text, "--hang-timeout", "1")
    outcome = finish(process)
    assert outcome.code == 0, outcome.err
    assert len(restarts(outcome)) == 1, outcome.err
    assert "does not answer" in restarts(outcome)[0] or "not answered" in restarts(outcome)[0]


def test_a_federation_in_plain_python_states_it(bench: Bench) -> None:
    (bench.folder / "app.py").write_text("""
import os
import hprm

class Tick(hprm.Reactor):
    out = hprm.Output()
    timer = hprm.Timer("20 ms")

    @hprm.reaction(timer, effects=[out])
    def tick(self):
        self.out.set(1)

class Worker(hprm.Reactor):
    inp = hprm.Input()

    @hprm.reaction(inp)
    def work(self):
        if not os.path.exists("once"):
            open("once", "w").close()
            os._exit(3)
        self.request_stop()

class App(hprm.Federation, timeout="60 s"):
    def __init__(self):
        self.tick = Tick()
        restart = hprm.Restart("on-failure", sec="10 ms", burst=2)
        self.worker = hprm.federate(Worker(), transient=True, restart=restart)
        hprm.connect(self.tick.out, self.worker.inp)

if __name__ == "__main__":
    hprm.run(App())
""")
    outcome = finish(bench.call("run", "app.py"))
    assert outcome.code == 0, outcome.err
    assert [line.split("; ")[0] for line in restarts(outcome)] == [
        "warning: federate worker exited with code 3"
    ]
    wrong = (bench.folder / "app.py").read_text().replace("transient=True, ", "")
    (bench.folder / "app.py").write_text(wrong)
    outcome = finish(bench.call("check", "app.py"))
    assert outcome.code == 1
    assert "`restart=` belongs to a transient federate, and this one is not" in outcome.err


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_one_that_finds_the_federation_gone_has_not_failed(bench: Bench, coordination: str) -> None:
    text = program(coordination, '@restart("always", sec=0)', LEAVE, "1500 ms")
    process = start_delayed(bench, text)
    until((bench.folder / "waits").exists, "the second process starts")
    hear(process.stdout, "[down] seen")
    # Until the RTI has gone, too.
    time.sleep(0.5)
    (bench.folder / "go").touch()
    outcome = finish(process)
    assert (outcome.code, outcome.errors) == (0, []), outcome.err
    assert "warning: federate mid does not come back: the federation ends" in outcome.err


@pytest.mark.parametrize("restart", ["", '@restart("on-failure", sec=0)'])
@pytest.mark.parametrize("gone", [False, True])
def test_one_that_first_comes_when_all_end_has_not_failed(
    bench: Bench, restart: str, gone: bool
) -> None:
    # The RTI is there, and lets none join any more; or it has gone, too.
    body = FORWARD if gone else SLOW + FORWARD
    text = program("centralized", restart, body, "300 ms")
    if not gone:
        stays = """print("ends", flush=True)
    while not os.path.exists("ready"): pass
    print("ticks","""
        text = text.replace('print("ticks",', stays)
    process = start_delayed(bench, text, after="Main.lf")
    hear(process.stdout, "[down] seen" if gone else "[down] ends")
    until((bench.folder / "waits").exists, "the process starts")
    time.sleep(0.5)
    (bench.folder / "go").touch()
    if not gone:
        time.sleep(1)
        (bench.folder / "ready").touch()
    outcome = finish(process)
    assert (outcome.code, outcome.errors) == (0, []), outcome.err
    said = "warning: federate mid has not joined: the federation has ended"
    assert outcome.err.count(said) == 1, outcome.err


def start_with_successor(
    bench: Bench, text: str
) -> tuple[subprocess.Popen[str], int, subprocess.Popen[str]]:
    """A run, the process of `mid` in it, and one by hand that is to replace that and loads."""
    process = bench.start(text)
    first = bench.pid("mid0")
    (bench.folder / "slow").touch()
    by_hand = bench.call("federate", "Main.lf", "mid")
    until((bench.folder / "loads").exists, "the successor loads its program")
    return process, first, by_hand


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_successor_that_is_killed_while_it_loads_changes_nothing(
    bench: Bench, coordination: str
) -> None:
    text = program(coordination, '@restart("on-failure")', SLOW + FORWARD, "60 s")
    process, first, by_hand = start_with_successor(bench, text)
    by_hand.kill()
    finish(by_hand)
    said = "warning: another process was joining as federate mid, and has ended"
    heard = hear(process.stderr, said)
    (bench.folder / "slow").unlink()
    # It goes on, and is started again as before.
    os.kill(first, signal.SIGKILL)
    bench.pid("mid1")
    (bench.folder / "stop").touch()
    outcome = finish(process)
    assert (outcome.code, outcome.errors) == (0, []), outcome.err
    assert len(restarts(Outcome(0, "", heard + outcome.err))) == 1, outcome.err


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_one_that_is_away_comes_back_when_the_process_that_joins_instead_is_killed(
    bench: Bench, coordination: str
) -> None:
    text = program(coordination, '@restart("on-failure", sec=1 s)', SLOW + FORWARD, "60 s")
    process, first, by_hand = start_with_successor(bench, text)
    os.kill(first, signal.SIGKILL)
    heard = hear(process.stderr, "restart 1 follows")
    # The pause is over, and nothing is started while the other process joins.
    time.sleep(2)
    assert shown_restarts(bench, str(process.pid))["mid"] == 0
    by_hand.kill()
    (bench.folder / "slow").unlink()
    finish(by_hand)
    bench.pid("mid1")
    (bench.folder / "stop").touch()
    outcome = finish(process)
    assert (outcome.code, outcome.errors) == (0, []), outcome.err
    assert len(restarts(Outcome(0, "", heard + outcome.err))) == 1, outcome.err


@pytest.mark.parametrize("is_first", [False, True])
@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_what_the_command_starts_gives_way_to_a_process_that_was_started_by_hand(
    bench: Bench, coordination: str, is_first: bool
) -> None:
    text = program(
        coordination, '@restart("always", sec=0)', FORWARD if is_first else LEAVE, "60 s"
    )
    process = start_delayed(bench, text, after="Main.lf" if is_first else "mid0.pid")
    until((bench.folder / "waits").exists, "a process starts")
    if is_first:
        until(lambda: "mid" in shown_restarts(bench, str(process.pid)), "the federation runs")
    by_hand = bench.call("federate", "Main.lf", "mid")
    bench.pid("mid0" if is_first else "mid1")
    (bench.folder / "go").touch()
    heard = hear(process.stderr, "as federate mid: this federate has already joined")
    (bench.folder / "stop").touch()
    assert finish(by_hand).code == 0
    outcome = finish(process)
    assert (outcome.code, outcome.errors) == (0, []), outcome.err
    assert len(restarts(Outcome(0, "", heard + outcome.err))) == (0 if is_first else 1)
    assert not (bench.folder / ("mid1.pid" if is_first else "mid2.pid")).exists()


@pytest.mark.parametrize("restart", ["", '@restart("on-failure")'])
@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_the_loss_of_a_successor_is_not_blamed_on_its_predecessor(
    bench: Bench, coordination: str, restart: str
) -> None:
    process = bench.start(program(coordination, restart, FORWARD, "5 s"))
    first = bench.pid("mid0")
    by_hand = bench.call("federate", "Main.lf", "mid")
    second = bench.pid("mid1")
    until(lambda: not Path(f"/proc/{first}").exists(), "the predecessor has ended")
    os.kill(second, signal.SIGKILL)
    outcome = finish(process)
    assert finish(by_hand).code != 0
    assert outcome.code == 1
    outcome.assert_one_error("error: the process of federate mid ended before its last tag")


def test_one_that_is_refused_as_a_duplicate_has_not_failed(bench: Bench) -> None:
    text = program("centralized", '@restart("always", sec=0)', SLOW + LEAVE, "60 s")
    process = start_delayed(bench, text)
    until((bench.folder / "waits").exists, "the second process starts")
    (bench.folder / "slow").touch()
    by_hand = bench.call("federate", "Main.lf", "mid")
    until((bench.folder / "loads").exists, "the one by hand has joined, and loads its program")
    (bench.folder / "go").touch()
    heard = hear(process.stderr, "has already joined")
    (bench.folder / "ready").touch()
    bench.pid("mid1")
    (bench.folder / "stop").touch()
    outcome = finish(process)
    assert (outcome.code, outcome.errors) == (0, []), outcome.err
    assert len(restarts(Outcome(0, "", heard + outcome.err))) == 1
    assert finish(by_hand).code == 0


def test_one_whose_place_is_taken_within_the_pause_is_not_started_again(bench: Bench) -> None:
    text = program("centralized", '@restart("always", sec=1 h)', LEAVE, "60 s")
    process = bench.start(text)
    hear(process.stderr, "restart 1 follows, after 3600 s")
    by_hand = bench.call("federate", "Main.lf", "mid")
    bench.pid("mid1")
    hear(process.stderr, "federate mid is not started again: another process has joined as it")
    (bench.folder / "stop").touch()
    outcome = finish(process)
    assert (outcome.code, outcome.errors, restarts(outcome)) == (0, [], []), outcome.err
    assert finish(by_hand).code == 0
