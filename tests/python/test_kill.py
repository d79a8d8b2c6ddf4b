"""``kill -9`` of every member of a federation, at every moment of its life.

Whichever process is killed, the others end soon, report it once, and leave nothing behind: the
fixture ``bench`` looks for processes and shared memory, the tests for files. The moments are
reached by what the processes do, never by waiting for a while.
"""

from __future__ import annotations

import json
import os
import signal
import time

import pytest
from processes import COORDINATIONS, Bench, Federation, Outcome, finish, until
from snippets import TELL

FEDERATES = ["sender", "receiver", "bystander"]
MOMENTS = ["start", "steady", "stop"]

ENDS_WITHIN_S = 5.0
"""How soon the others end, by docs/concepts/failures.md."""

ORPHANS_END_WITHIN_S = 1.0
"""How soon federates end if the command that has started them is killed."""

# Every federate leaves the file NAME.MOMENT when it gets there, with its process number, and stays
# there while there is a file hold.NAME.MOMENT.
PROGRAM = (
    """\
target Python { coordination: COORDINATION }
preamble {=
import os, pathlib, time
import numpy as np
"""
    + TELL
    + """\
def reach(name, moment):
    tell(f"{name}.{moment}", f"{os.getpid()}\\n")
    while pathlib.Path(f"hold.{name}.{moment}").exists():
        time.sleep(0.002)
=}
reactor Sender {
  preamble {= reach("sender", "start") =}
  output out
  timer t(0, 10 msec)
  state count = 0
  reaction(t) -> out {=
    self.count += 1
    out.set(np.full(20_000, self.count))
    if self.count == 4: reach("sender", "steady")
    if self.count >= 3 and pathlib.Path("stop").exists(): request_stop()
  =}
  reaction(shutdown) {= reach("sender", "stop") =}
}
reactor Receiver {
  preamble {= reach("receiver", "start") =}
  input inp
  reaction(inp) {=
    if inp.value[0] == 3: reach("receiver", "steady")
  =}
  reaction(shutdown) {= reach("receiver", "stop") =}
}
reactor Bystander {
  preamble {= reach("bystander", "start") =}
  timer t(0, 10 msec)
  state count = 0
  reaction(t) {=
    self.count += 1
    if self.count == 3: reach("bystander", "steady")
  =}
  reaction(shutdown) {= reach("bystander", "stop") =}
}
federated reactor {
  sender = new Sender()
  receiver = new Receiver()
  bystander = new Bystander()
  sender.out -> receiver.inp
}
"""
)


class Stage:
    """Holds members of a federation at a moment of their lives, and lets them go."""

    def __init__(self, bench: Bench, moment: str, held: list[str]) -> None:
        """Prepare: nothing has been started yet."""
        self._folder = bench.folder
        self._moment = moment
        self._holds = [self._folder / f"hold.{name}.{moment}" for name in held]
        for hold in self._holds:
            hold.touch()
        if moment == "stop":
            (self._folder / "stop").touch()

    def pid(self, name: str) -> int:
        """The process of a federate, once it has reached the moment."""
        reached = self._folder / f"{name}.{self._moment}"
        until(reached.exists, f"{name} is at {self._moment}")
        return int(reached.read_text())

    def await_held(self) -> None:
        """Wait until all federates that are to be held have reached the moment."""
        for hold in self._holds:
            self.pid(hold.name.split(".")[1])

    def release(self) -> None:
        """Let the federates continue that are held."""
        for hold in self._holds:
            hold.unlink()

    def strange_files(self) -> set[str]:
        """What lies about that neither the test nor the program has put there."""
        ours = {"Main.lf", "stop"} | {hold.name for hold in self._holds}
        ours |= {f"{name}.{moment}" for name in FEDERATES for moment in MOMENTS}
        return {path.name for path in self._folder.iterdir() if path.suffix != ".draft"} - ours


#: A federate that is killed at 200 ms, beside another one.
DYING = """
target Python { coordination: COORDINATION }
preamble {=
import os, signal
=}
reactor Victim {
  timer t(0, 10 ms)
  state count = 0
  reaction(t) {=
    self.count += 1
    if self.count == 21:
        os.kill(os.getpid(), signal.SIGKILL)
  =}
}
reactor Other {
  timer t(0, 10 ms)
  reaction(t) {= pass =}
}
federated reactor Main {
  victim = new Victim()
  other = new Other()
}
"""


def program(coordination: str) -> str:
    """The text of the program."""
    return PROGRAM.replace("COORDINATION", coordination)


def ends(federation: Federation, *names: str) -> dict[str, Outcome]:
    """How these members end, which they must do in time."""
    begun = time.monotonic()
    outcomes = federation.finish(*names)
    assert time.monotonic() - begun < ENDS_WITHIN_S
    for outcome in outcomes.values():
        assert "Traceback" not in outcome.err and "panicked" not in outcome.err, outcome.err
    return outcomes


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("victim", FEDERATES)
def test_a_federate_is_killed(bench: Bench, coordination: str, moment: str, victim: str) -> None:
    stage = Stage(bench, moment, [victim])
    federation = bench.by_hand(program(coordination), *FEDERATES)
    assert stage.pid(victim) == federation.members[victim].pid
    federation.await_joined(*FEDERATES)
    os.kill(stage.pid(victim), signal.SIGKILL)
    outcomes = ends(federation, *(name for name in ["rti", *FEDERATES] if name != victim))
    rti = outcomes.pop("rti")
    assert rti.code == 1
    rti.assert_one_error(f"error: the process of federate {victim} ended before")
    for outcome in outcomes.values():
        # One that has reached its last tag before has done its part.
        assert outcome.code == 1 or (moment == "stop" and outcome.code == 0), outcome
        assert len(outcome.errors) <= 1, outcome.err
        assert outcome.errors == [] or victim in outcome.err, outcome.err
    if moment != "stop":
        assert list(bench.folder.glob("*.stop")) == [], "shutdown reactions are for orderly ends"
    assert stage.strange_files() == set()


def without_sender(bench: Bench, coordination: str) -> tuple[Federation, Stage]:
    """A federation of which the sender is killed while a reaction of the bystander is held."""
    stage = Stage(bench, "steady", ["sender", "bystander"])
    federation = bench.by_hand(program(coordination), *FEDERATES)
    stage.await_held()
    federation.members["sender"].kill()
    return federation, stage


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_the_rti_does_not_wait_for_a_reaction_that_does_not_return(
    bench: Bench, coordination: str
) -> None:
    """It reports the failure at once, and ends; the federate ends when its reaction returns."""
    federation, stage = without_sender(bench, coordination)
    rti = federation.finish("rti", "receiver")["rti"]
    assert rti.code == 1
    rti.assert_one_error("error: the process of federate sender ended before its last tag")
    stage.release()
    bystander = federation.finish("bystander")["bystander"]
    assert bystander.code == 1
    assert len(bystander.errors) == 1, bystander.err
    federation.finish("sender")
    assert not bench.left()


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federate_by_hand_does_not_outlive_its_federation(
    bench: Bench, coordination: str
) -> None:
    """Its reaction never returns, so nothing but the process itself can end it."""
    federation, _ = without_sender(bench, coordination)
    outcomes = federation.finish()
    bystander = outcomes["bystander"]
    assert bystander.code == 1
    bystander.assert_one_error(
        "error: the federation Main has ended, and a reaction of this federate has not returned"
        " 5 s later: the process ends now"
    )
    assert not bench.left()


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("moment", MOMENTS)
def test_the_rti_is_killed(bench: Bench, coordination: str, moment: str) -> None:
    # The receiver cannot reach its last tag before the sender has.
    stage = Stage(bench, moment, ["sender"] if moment == "stop" else FEDERATES)
    federation = bench.by_hand(program(coordination), *FEDERATES)
    stage.await_held()
    federation.await_joined(*FEDERATES)
    federation.members["rti"].kill()
    federation.finish("rti")
    stage.release()
    for name, outcome in ends(federation, *FEDERATES).items():
        if moment == "stop" and name != "receiver" and outcome.code == 0:
            # It has reached its last tag and needs no other process any more.
            assert outcome.err == ""
            continue
        assert outcome.code == 1
        outcome.assert_one_error("error: federation Main: the link to the RTI is lost")
    assert stage.strange_files() == set()


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("victim", FEDERATES)
def test_a_federate_of_the_command_is_killed(
    bench: Bench, coordination: str, moment: str, victim: str
) -> None:
    stage = Stage(bench, moment, [victim])
    process = bench.start(program(coordination), "--logical-trace", "trace")
    os.kill(stage.pid(victim), signal.SIGKILL)
    begun = time.monotonic()
    outcome = finish(process)
    assert time.monotonic() - begun < ENDS_WITHIN_S
    assert outcome.code == 1
    outcome.assert_one_error(f"error: federate {victim} was killed by signal 9 (SIGKILL)")
    # The trace tells how far the federation came, and that it failed.
    assert stage.strange_files() == {"trace"}
    last = json.loads((bench.folder / "trace").read_text().splitlines()[-1])
    assert last["outcome"] == "failed"


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_the_trace_of_a_killed_federate_lacks_its_last_tag_at_most(
    bench: Bench, coordination: str
) -> None:
    process = bench.start(DYING.replace("COORDINATION", coordination), "--logical-trace", "trace")
    assert finish(process).code == 1
    lines = [json.loads(line) for line in (bench.folder / "trace").read_text().splitlines()]
    of_victim = [line["tag"][0] for line in lines if line.get("reaction") == "Main.victim.1"]
    assert of_victim[-1] in (180_000_000, 190_000_000)
    assert lines[-1]["outcome"] == "failed"
    assert lines[-1]["end"][0] in (180_000_000, 190_000_000)


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("moment", MOMENTS)
def test_the_command_is_killed(bench: Bench, coordination: str, moment: str) -> None:
    # The federates are held when the command dies, and end all the same: the kernel ends them.
    stage = Stage(bench, moment, ["sender"] if moment == "stop" else FEDERATES)
    process = bench.start(program(coordination), "--logical-trace", "trace")
    stage.await_held()
    process.kill()
    begun = time.monotonic()
    until(lambda: not bench.left(), "the federates have ended")
    assert time.monotonic() - begun < ORPHANS_END_WITHIN_S
    outcome = finish(process)
    assert (outcome.code, outcome.err) == (-signal.SIGKILL, "")
    # The parts of the trace, one of each federate. The command would have merged them.
    assert stage.strange_files() == {f"trace.parts-{process.pid}"}
