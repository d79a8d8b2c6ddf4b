"""``hprm top``: what it says of federations that run, and of those that are stuck on purpose.

docs/howto/top.md says what is in the JSON object.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import pty
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import termios
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from processes import COORDINATIONS, Bench, finish, processes, until
from snippets import TELL

HPRM = str(Path(sys.executable).with_name("hprm"))

# The camera sends for ever, the planner sends on what comes and has a timer of its own; all stop
# when there is a file `stop`.
PROGRAM = (
    """\
target Python { coordination: COORDINATION }
preamble {=
import os, pathlib, time
"""
    + TELL
    + """\
def is_over(): return pathlib.Path("stop").exists()

def sleep():
    while not is_over(): time.sleep(0.01)

def compute():
    while not is_over(): pass
=}
reactor Camera {
  output out
  timer t(0, 10 msec)
  state count = 0
  reaction(t) -> out {=
    self.count += 1
    if self.count == 5: here("camera")
    CAMERA
    if is_over(): request_stop()
  =}
}
reactor Planner {
  input inp
  output out
  timer t(0, 10 msec)
  reaction(inp, t) -> out {=
    if inp.is_present:
        here("planner")
        PLANNER
        out.set(inp.value)
  =}
}
reactor Motor {
  input inp
  reaction(inp) {= MOTOR =}
}
federated reactor {
  camera = new Camera()
  MAXWAIT
  planner = new Planner()
  motor = new Motor()
  camera.out -> planner.inp
  planner.out -> motor.inp
}
"""
)
SEND = "out.set(self.count)"


def program(
    coordination: str = "centralized",
    camera: str = SEND,
    planner: str = "pass",
    motor: str = "pass",
    maxwait: str = "",
) -> str:
    """The text of the program, with these statements in its bodies."""
    text = PROGRAM.replace("COORDINATION", coordination).replace("MAXWAIT", maxwait)
    return text.replace("CAMERA", camera).replace("PLANNER", planner).replace("MOTOR", motor)


class Watched:
    """What the command says of a federation."""

    def __init__(self, object_: dict[str, Any]) -> None:
        self.object = object_

    def __getitem__(self, name: str) -> dict[str, Any]:
        federates: list[dict[str, Any]] = self.object["federates"]
        found = [it for it in federates if it["name"] == name]
        assert len(found) == 1, self.object
        return found[0]

    def kinds(self, name: str) -> set[str]:
        """What a federate waits for."""
        return {it["kind"] for it in self[name]["waits_for"]}


def top(bench: Bench, *words: str) -> str:
    """What ``hprm top --once`` prints."""
    interval = () if "--interval" in words else ("--interval", "0.1")
    outcome = finish(bench.call("top", "--once", *interval, *words))
    assert (outcome.code, outcome.err) == (0, ""), outcome
    return outcome.out


def look(bench: Bench, process: int, *words: str) -> Watched:
    """What is to be seen of the federation of a process."""
    return Watched(json.loads(top(bench, str(process), "--json", *words)))


def see(
    bench: Bench, process: int, expected: Callable[[Watched], bool], interval: float = 0.1
) -> Watched:
    """The same, once it is there and as expected."""
    seen: list[Watched] = []

    def is_expected() -> bool:
        words = ("top", str(process), "--json", "--interval", str(interval))
        found = json.loads(finish(bench.call(*words)).out)
        if "error" not in found:
            seen.append(Watched(found))
        return "error" not in found and expected(seen[-1])

    try:
        until(is_expected, "it is explained")
    except AssertionError:
        print(json.dumps(seen[-1].object, indent=1) if seen else "no federation was found")
        raise
    return seen[-1]


def end(bench: Bench, run: subprocess.Popen[str]) -> None:
    """Stop a federation, which must end well."""
    (bench.folder / "stop").touch()
    outcome = finish(run)
    assert (outcome.code, outcome.errors) == (0, []), outcome


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federation_that_runs_is_shown_with_its_rates(bench: Bench, coordination: str) -> None:
    run = bench.start(program(coordination))
    bench.pid("planner")

    def has_rates(seen: Watched) -> bool:
        """Whether the motor, which is the last to begin, had begun before the first look."""
        connections = seen.object["connections"][:2]
        return all(it["messages"] > 4 and it["messages_per_second"] > 1 for it in connections)

    seen = see(bench, run.pid, has_rates, interval=1)
    assert seen.object["coordination"] == coordination
    assert (seen.object["federation"], seen.object["rti"]["process"]) == ("Main", run.pid)
    assert [it["name"] for it in seen.object["federates"]] == ["camera", "planner", "motor"]
    assert seen["camera"]["process"] == bench.pid("camera")
    assert {it["state"] for it in seen.object["federates"]} <= {"running", "idle", "waiting"}
    # A hundred tags in a second, fewer on a busy machine, and more when it has caught up.
    assert 1 < seen["camera"]["tags_per_second"] < 1000
    first, second = seen.object["connections"]
    assert (first["from"], first["to"]) == ("Main.camera.out", "Main.planner.inp")
    assert (second["from_federate"], second["to_federate"]) == ("planner", "motor")
    for connection in (first, second):
        assert connection["messages_per_second"] < 1000
        assert connection["bytes"] >= connection["messages"]
    text = top(bench, str(run.pid))
    assert "Main: 3 federates" in text
    assert "Main.camera.out -> Main.planner.inp" in text
    end(bench, run)


@pytest.mark.parametrize("body", ["sleep()", "compute()"])
@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_reaction_that_does_not_return(bench: Bench, coordination: str, body: str) -> None:
    run = bench.start(program(coordination, camera=f"if self.count > 5: {body}\n    {SEND}"))
    # A busy machine has the motor run its last tag when the planner waits already.
    seen = see(
        bench,
        run.pid,
        lambda it: (
            it["camera"]["state"] == "reacting"
            and it["planner"]["state"] == "waiting"
            and it["motor"]["state"] in ("waiting", "idle")
            # What one shows may be older than what another one does.
            and it["motor"]["chain"] == ["motor", "planner", "camera"]
        ),
    )
    camera, planner, motor = seen["camera"], seen["planner"], seen["motor"]
    [reaction] = camera["reactions"]
    assert reaction["name"] == "Main.camera.1"
    line = (bench.folder / "Main.lf").read_text().splitlines().index("  reaction(t) -> out {=") + 1
    assert reaction["place"].endswith(f"Main.lf:{line}")
    assert camera["reacts_for_ns"] > 200_000_000
    assert f"in reaction Main.camera.1 ({reaction['place']})" in camera["does"]
    assert (camera["cause"], planner["cause"], motor["cause"]) == ("camera",) * 3
    assert planner["chain"] == ["planner", "camera"]
    assert seen.kinds("planner") == {"message"}
    assert camera["lag_ns"] > 200_000_000
    lines = top(bench, str(run.pid)).splitlines()
    at = next(n for n, line in enumerate(lines) if line.startswith("camera has been at tag ("))
    assert lines[at + 1].startswith("  planner waits for ")
    assert lines[at + 2].startswith("    motor waits for ")
    end(bench, run)


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_process_that_is_stopped(bench: Bench, coordination: str) -> None:
    run = bench.start(program(coordination))
    camera = bench.pid("camera")
    bench.pid("planner")
    os.kill(camera, signal.SIGSTOP)
    seen = see(
        bench,
        run.pid,
        lambda it: (
            it["planner"]["state"] == "waiting"
            and it["motor"]["state"] in ("waiting", "idle")
            and it["motor"]["chain"] == ["motor", "planner", "camera"]
        ),
    )
    assert seen["camera"]["state"] == "stopped"
    assert f"kill -CONT {camera}" in seen["camera"]["does"]
    os.kill(camera, signal.SIGCONT)
    see(bench, run.pid, lambda it: it["planner"]["state"] != "waiting")
    end(bench, run)


def test_a_sender_that_does_not_send(bench: Bench) -> None:
    # Its tags take long, so the planner, whose timer is as fast, waits for it nearly all the time.
    camera = f"if self.count < 6: {SEND}\n    else: time.sleep(0.15)"
    run = bench.start(program("decentralized", camera=camera, maxwait="@maxwait(1 hour)"))
    seen = see(
        bench,
        run.pid,
        lambda it: it.kinds("planner") == {"message"} and it["motor"]["cause"] == "camera",
    )
    [wait] = seen["planner"]["waits_for"]
    assert (wait["kind"], wait["on"]) == ("message", ["camera"])
    assert "camera to send on Main.camera.out -> Main.planner.inp" in wait["text"]
    assert " min more" in wait["text"]
    os.killpg(run.pid, signal.SIGKILL)
    run.communicate()


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_receiver_that_does_not_keep_up(bench: Bench, coordination: str) -> None:
    camera = "out.set(bytes(12_000))"
    run = bench.start(
        program(coordination, camera=camera, planner="sleep()").replace("10 msec", "1 msec", 1)
    )
    # A federate is told as reacting when it has been at its tag for a while.
    seen = see(
        bench,
        run.pid,
        lambda it: "flow-control" in it.kinds("camera") and it["planner"]["state"] == "reacting",
    )
    [wait] = [it for it in seen["camera"]["waits_for"] if it["kind"] == "flow-control"]
    assert wait["on"] == ["planner"]
    assert "planner to process what it has been sent" in wait["text"]
    assert seen["camera"]["cause"] == "planner"
    end(bench, run)


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federate_that_has_not_joined(bench: Bench, coordination: str) -> None:
    federation = bench.by_hand(program(coordination), "camera", "planner")
    federation.await_joined("camera", "planner")
    rti = federation.members["rti"].pid
    # What the RTI shows of one may be older than what that shows itself.
    names = ("camera", "planner")
    seen = see(bench, rti, lambda it: all(it[f]["chain"] == [f, "motor"] for f in names))
    assert (seen["motor"]["state"], seen["motor"]["process"]) == ("absent", None)
    for name in names:
        assert (seen[name]["state"], seen.kinds(name)) == ("waiting", {"joining"})
    assert "motor has not joined\n" in top(bench, str(rti))
    federation.start("motor")
    see(bench, rti, lambda it: it["motor"]["state"] != "absent")
    (bench.folder / "stop").touch()
    assert {it.code for it in federation.finish().values()} == {0}


def test_an_rti_that_is_stopped(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    # Otherwise the federates of one machine do not ask it.
    monkeypatch.setenv("HPRM_BOARDS", "off")
    federation = bench.by_hand(program(), "camera", "planner", "motor")
    bench.pid("planner")
    rti = federation.members["rti"].pid
    os.kill(rti, signal.SIGSTOP)
    seen = see(bench, rti, lambda it: it["planner"]["state"] == "waiting")
    assert (seen["planner"]["cause"], seen.object["rti"]["state"]) == ("RTI", "stopped")
    assert seen.kinds("planner") == {"grant"}
    assert f"kill -CONT {rti}" in top(bench, str(rti))
    os.kill(rti, signal.SIGCONT)
    (bench.folder / "stop").touch()
    assert {it.code for it in federation.finish().values()} == {0}


def test_an_end_to_which_a_federate_does_not_agree(bench: Bench) -> None:
    planner = 'while not pathlib.Path("go").exists(): time.sleep(0.01)'
    run = bench.start(program(camera=f"if self.count < 6: {SEND}", planner=planner))
    bench.pid("camera")
    see(bench, run.pid, lambda it: it["planner"]["state"] == "reacting")
    (bench.folder / "stop").touch()
    # What the RTI shows may be older than what a federate does.
    chain = ["camera", "planner"]
    see(bench, run.pid, lambda it: (it.kinds("camera"), it["camera"]["chain"]) == ({"stop"}, chain))
    (bench.folder / "go").touch()
    end(bench, run)


def test_federates_as_threads_have_boards_too(bench: Bench) -> None:
    run = bench.start(program(camera=f"if self.count > 5: sleep()\n    {SEND}"), "--in-process")
    seen = see(bench, run.pid, lambda it: it["camera"]["state"] == "reacting")
    assert len({it["process"] for it in seen.object["federates"]}) == 1
    see(bench, run.pid, lambda it: it["motor"]["chain"] == ["motor", "planner", "camera"])
    end(bench, run)


def test_a_store_whose_memory_is_held(bench: Bench) -> None:
    keep = "self.kept = inp.value; time.sleep(0)"
    text = program(camera="out.set(np.zeros(1_000_000))", planner=f"{keep}; sleep()").replace(
        "import os,", "import numpy as np\nimport os,"
    )
    run = bench.start(text.replace("out.set(inp.value)", "pass"))
    seen = see(bench, run.pid, lambda it: bool(it["camera"].get("store", {}).get("held")))
    [held] = seen["camera"]["store"]["held"]
    assert held["federate"] == "planner"
    assert held["bytes"] % 8_000_000 < 1_000 <= held["bytes"] <= seen["camera"]["store"]["in_use"]
    assert "held by planner" in top(bench, str(run.pid))
    end(bench, run)


def test_one_federate_alone(bench: Bench) -> None:
    run = bench.start(program())
    bench.pid("planner")
    seen = look(bench, run.pid, "--federate", "motor")
    assert [it["name"] for it in seen.object["federates"]] == ["motor"]
    assert [it["to_federate"] for it in seen.object["connections"]] == ["motor"]
    wrong = finish(bench.call("top", str(run.pid), "--once", "--federate", "wheel"))
    assert wrong.code == 1
    wrong.assert_one_error("Main has no federate wheel", "camera, planner, motor")
    end(bench, run)


def test_a_watcher_that_is_killed_disturbs_nothing(bench: Bench) -> None:
    run = bench.start(program())
    bench.pid("planner")
    watchers = [bench.call("top", str(run.pid), "--once", "--interval", "60") for _ in range(3)]
    for watcher in watchers:
        maps = Path(f"/proc/{watcher.pid}/maps")
        until(lambda maps=maps: "memfd:hprm-board" in maps.read_text(), "it watches")  # type: ignore[misc]
        watcher.kill()
    tags = look(bench, run.pid)["motor"]["tags"]
    see(bench, run.pid, lambda it: it["motor"]["tags"] > tags)
    end(bench, run)


class Screen:
    """``hprm top`` in a terminal of its own."""

    def __init__(self, process: int, rows: int) -> None:
        """Start it beside a federation, in a terminal with so many rows."""
        self.child, self.terminal = pty.fork()
        if self.child == 0:
            fcntl.ioctl(0, termios.TIOCSWINSZ, struct.pack("HHHH", rows, 100, 0, 0))
            os.execv(HPRM, [HPRM, "top", str(process), "--interval", "0.1"])
        os.set_blocking(self.terminal, False)
        self.shown = bytearray()

    def resize(self, rows: int) -> None:
        """Make the terminal as high as that; what was shown before does not count any more."""
        self.shown.clear()
        fcntl.ioctl(self.terminal, termios.TIOCSWINSZ, struct.pack("HHHH", rows, 100, 0, 0))

    def shows(self, text: bytes) -> bool:
        """Return whether it has shown that."""
        with contextlib.suppress(OSError):
            self.shown.extend(os.read(self.terminal, 65536))
        return text in self.shown


def test_the_screen_shows_all_federates_again_after_it_was_small(bench: Bench) -> None:
    run = bench.start(program())
    bench.pid("planner")
    screen = Screen(run.pid, 30)
    until(lambda: screen.shows(b"camera") and screen.shows(b"motor"), "all are shown")
    os.write(screen.terminal, b"\x1b[B\x1b[B")
    for rows in (6, 30):
        screen.resize(rows)
        until(lambda: screen.shows(b"q: end"), "it is drawn anew")
    # The first row of the table, with its colours.
    first = rb"\x1b\[3;1H(\x1b\[[0-9;]*m)*camera"
    until(lambda: screen.shows(b"motor") and re.search(first, screen.shown), "all are there again")
    os.kill(screen.child, signal.SIGTERM)
    os.waitpid(screen.child, 0)
    os.close(screen.terminal)
    end(bench, run)


@pytest.mark.parametrize("ending", [signal.SIGTERM, None], ids=["signal", "hangup"])
def test_the_screen_ends_with_its_terminal_and_on_a_signal(
    bench: Bench, ending: signal.Signals | None
) -> None:
    run = bench.start(program())
    bench.pid("planner")
    screen = Screen(run.pid, 24)
    child, terminal, shows = screen.child, screen.terminal, screen.shows
    until(lambda: shows(b"planner"), "it is shown")
    if ending is None:
        os.close(terminal)
    else:
        os.kill(child, ending)
    ended: list[int] = []
    until(lambda: ended.extend(os.waitpid(child, os.WNOHANG)) or ended[-2] == child, "it ends")
    # Without its terminal, it notices first that it cannot draw, or gets the signal of the kernel.
    expected = {1, -signal.SIGHUP} if ending is None else {-ending}
    assert os.waitstatus_to_exitcode(ended[-1]) in expected
    if ending is not None:
        until(lambda: shows(b"\x1b[?1049l"), "the screen of before is back")
        os.close(terminal)
    end(bench, run)


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_program_that_is_watched_does_the_same(bench: Bench, coordination: str) -> None:
    text = program(coordination).replace(" }", ", timeout: 500 msec }", 1)
    traces = []
    for watched in (False, True):
        for mark in bench.folder.glob("*.pid"):
            mark.unlink()
        run = bench.start(text, "--logical-trace", "trace.jsonl")
        while watched and run.poll() is None:
            finish(bench.call("top", str(run.pid), "--once", "--interval", "0.01"))
        assert finish(run).code == 0
        traces.append((bench.folder / "trace.jsonl").read_text())
    assert traces[0] == traces[1]
    assert traces[0].count("\n") > 100


def test_a_name_has_no_effect_on_a_terminal(bench: Bench) -> None:
    (bench.folder / "a\x1b[2Jb.lf").write_text(program())
    run = bench.call("run", "a\x1b[2Jb.lf")
    bench.pid("planner")
    assert look(bench, run.pid).object["federation"] == r"a\u{1b}[2Jb"
    shown = top(bench, str(run.pid))
    assert shown.startswith(r"a\u{1b}[2Jb: ") and "\x1b" not in shown
    end(bench, run)


def test_several_federations_and_none(bench: Bench) -> None:
    runs = []
    for name in ("One", "Two", "Two"):
        for mark in bench.folder.glob("*.pid"):
            mark.unlink()
        (bench.folder / f"{name}.lf").write_text(program())
        runs.append(bench.call("run", f"{name}.lf"))
        bench.pid("planner")
    assert look(bench, runs[0].pid).object["federation"] == "One"
    assert json.loads(top(bench, "One", "--json"))["rti"]["process"] == runs[0].pid
    wrong = finish(bench.call("top", "--once"))
    assert wrong.code == 1
    wrong.assert_one_error("several federations run", *(f"process {run.pid}: " for run in runs))
    wrong = finish(bench.call("top", "Two"))
    wrong.assert_one_error("several federations of Two run", *(str(run.pid) for run in runs[1:]))
    (bench.folder / "stop").touch()
    assert [finish(run).code for run in runs] == [0, 0, 0]
    wrong = finish(bench.call("top", "One"))
    assert wrong.code == 1
    assert len(wrong.errors) == 1
    assert "of this user runs on this machine" in wrong.err
    wrong = finish(bench.call("top", str(os.getpid()), "--json"))
    assert wrong.code == 1
    error = json.loads(wrong.out)["error"]
    assert error["message"] == f"process {os.getpid()} belongs to no federation"
    gone = max(processes()) + 100_000
    finish(bench.call("top", str(gone))).assert_one_error(f"there is no process {gone}")


def test_federations_of_other_users_are_not_shown(bench: Bench) -> None:
    if os.geteuid() != 0:
        finish(bench.call("top", "1")).assert_one_error("process 1 belongs to another user")
        return
    run = bench.start(program())
    bench.pid("planner")
    with tempfile.TemporaryDirectory() as folder:
        # Where the other user can execute it.
        os.chmod(folder, 0o755)
        copy = shutil.copy(HPRM, folder)
        for words, message in (
            (["Main"], "no federation Main of this user runs"),
            ([str(run.pid)], f"process {run.pid} belongs to another user"),
        ):
            outcome = subprocess.run(
                [copy, "top", *words],
                user=65534,
                group=65534,
                extra_groups=[],
                capture_output=True,
                text=True,
                check=False,
                cwd="/",
                timeout=30,
            )
            assert outcome.returncode == 1
            assert message in outcome.stderr or "no federation of this user" in outcome.stderr
            assert outcome.stderr.count("error") == 1
    end(bench, run)
