"""A trace of a run has what federates of other machines have recorded, by Perfetto's own schema."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
from collections import Counter
from pathlib import Path

import pytest
from machines import HPRM, PROGRAM, Machines, finish, listens_at, until
from perfetto.protos.perfetto.trace.perfetto_trace_pb2 import Trace
from perfetto_trace import Slice, arrows, read
from processes import rust_examples
from tcp_ports import free_ports
from test_programs import AT, COORDINATIONS, ENDLESS, belongs, left, nothing_is_left, run, start

TRACE = ["--trace", "run.pftrace"]


def labels(path: Path) -> dict[str, list[str]]:
    """What stands behind the names of processes."""
    trace = Trace()
    trace.ParseFromString(path.read_bytes())
    processes = [it.track_descriptor.process for it in trace.packet if it.track_descriptor.uuid]
    return {it.process_name: list(it.process_labels) for it in processes if it.process_name}


def bound(labels: list[str]) -> int:
    """How exact a trace says that times are, in nanoseconds."""
    (text,) = [it.removeprefix("clock ±") for it in labels if it.startswith("clock ±")]
    number, unit = text.split()
    return int(number) * {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000}[unit]


def reactions(slices: list[Slice]) -> list[Slice]:
    return [it for it in slices if it.category == "reaction"]


def check(machines: Machines, places: dict[str, str]) -> list[Slice]:
    """A trace has all reactions and messages, and says where federates run."""
    path = machines.folder / "run.pftrace"
    slices, told = read(path), labels(path)
    lines = (machines.folder / "logical").read_text().splitlines()
    did = [it for line in lines if "reaction" in (it := json.loads(line))]
    ran = reactions(slices)
    assert Counter((it.name, it.tag) for it in ran) == Counter(
        (it["reaction"], tuple(it["tag"])) for it in did
    )
    assert {it.process for it in ran} == {"source", "sink__0", "sink__1"}
    assert set(told) == {"RTI", "source", "sink__0", "sink__1"}
    for process, said in told.items():
        machine = places.get(process)
        assert [it for it in said if it.startswith("on ")] == ([f"on {machine}"] if machine else [])
    bounds = {process: bound(told[process]) for process in places}
    # On one machine that all these are, with little to do.
    assert all(0 < it < 500_000_000 for it in bounds.values()), bounds
    pairs = [(a, b) for a, b in arrows(slices) if a.category == "message"]
    received = [it for it in slices if it.name.startswith("receive ")]
    assert len(pairs) == len(received) > 10
    assert {b.process for _, b in pairs} == {"source", "sink__0", "sink__1"}
    for a, b in pairs:
        known = bounds.get(a.process, 0) + bounds.get(b.process, 0)
        assert a.tag == b.tag or a.process.startswith("sink")
        assert a.begin - known <= b.begin, (a, b)
    return slices


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_federates_of_another_machine_are_in_the_trace(
    machines: Machines, coordination: str
) -> None:
    start(machines)
    options = ["--property", f"coordination={coordination}", "--logical-trace", "logical"]
    for at, places in [
        (AT, {"sink__0": "robot2", "sink__1": "robot2"}),
        (["--at", "source=robot2", *AT[2:]], {"source": "robot2"}),
    ]:
        code, _, err = finish(run(machines, PROGRAM, *TRACE, *options, *at))
        assert (code, err) == (0, "")
        check(machines, places)
        nothing_is_left(machines)
    assert [it.name for it in machines.folder.iterdir() if ".parts-" in it.name] == []
    said = machines.spawn("robot1", HPRM, "trace", "summary", "--json", "run.pftrace")
    summary = json.loads(finish(said)[1])
    assert len(summary["reactions"]) == 5
    assert summary["lost"] == 0


def test_federates_of_three_machines_are_in_the_trace(machines: Machines) -> None:
    start(machines)
    (port,) = free_ports(1)
    connect = [part for it in machines.agents.values() for part in ("--connect", listens_at(it))]
    options = ["--fleet-keys", "keys", "--allow-root"]
    machines.start_agent("robot3", "--listen", f"127.0.0.1:{port}", *connect, *options)
    machines.wait_for("robot1", ["robot1", "robot2", "robot3"])
    at = ["--at", "sink__0=robot2", "--at", "sink__1=robot3", *AT[2:]]
    logical = ["--logical-trace", "logical"]
    code, _, err = finish(run(machines, PROGRAM, *TRACE, *logical, *at))
    assert (code, err) == (0, "")
    check(machines, {"sink__0": "robot2", "sink__1": "robot3"})
    nothing_is_left(machines)


@pytest.mark.parametrize("mode", ["init", "on"])
@pytest.mark.parametrize("offset", ["3 sec", "-3 sec"])
def test_a_clock_that_is_set_at_the_start_is_that_of_the_launcher(
    machines: Machines, mode: str, offset: str
) -> None:
    start(machines)
    options = f"clock-sync: {mode}, clock-sync-options: {{ test-offset: {offset} }}"
    program = PROGRAM.replace("timeout: 200 msec", f"timeout: 200 msec, {options}")
    before = time.time_ns()
    logical = ["--logical-trace", "logical"]
    code, _, err = finish(run(machines, program, *TRACE, *logical, *AT))
    assert (code, err) == (0, "")
    slices = check(machines, {"sink__0": "robot2", "sink__1": "robot2"})
    slack = 500_000_000
    times = [at for it in slices for at in (it.begin, it.end) if at is not None]
    assert before - slack < min(times) <= max(times) < time.time_ns() + slack
    (zero, one) = [it for it in slices if it.name == "clock set"]
    assert {zero.process, one.process} == {"sink__0", "sink__1"}
    ahead = int(offset.split()[0]) * 1_000_000_000
    assert abs(zero.arguments["offset_ns"] + ahead) < slack
    # Nothing waits for the clock of before.
    begins = [it.begin for it in slices if it.category == "reaction" and it.process == "sink__0"]
    assert len(set(begins)) == len(begins)


EXECUTABLE = """\
target Python { timeout: 50 ms }
@executable("bin/camera")
reactor Camera {
  output image
  output number
}
reactor Detector {
  input image
  input number
  reaction(image, number) {= assert image.value.shape == (480, 640) =}
}
federated reactor {
  camera = new Camera()
  detector = new Detector()
  camera.image, camera.number -> detector.image, detector.number
}
"""


def test_an_executable_on_another_machine_is_in_the_trace(machines: Machines) -> None:
    start(machines)
    (machines.folder / "bin").mkdir()
    shutil.copy(rust_examples() / "camera", machines.folder / "bin")
    at = ["--at", "camera=robot2", *AT[2:]]
    code, _, err = finish(run(machines, EXECUTABLE, *TRACE, *at))
    assert (code, err) == (0, "")
    path = machines.folder / "run.pftrace"
    slices = read(path)
    assert "on robot2" in labels(path)["camera"]
    assert {it.process for it in reactions(slices)} == {"camera", "detector"}
    pairs = {(a.process, b.process) for a, b in arrows(slices) if a.category == "message"}
    assert pairs == {("camera", "detector")}
    nothing_is_left(machines)


def traced(machines: Machines) -> subprocess.Popen[str]:
    """Starts a run that does not end, and waits until both sinks on robot2 have recorded."""
    start(machines)
    launcher = run(machines, ENDLESS, *TRACE, *AT)
    assert launcher.stdout is not None
    assert launcher.stdout.readline() == "[source] running\n"
    shares = [f"run.pftrace.parts-{launcher.pid}/federate-{number}" for number in (1, 2)]

    def size(share: str) -> int:
        path = machines.folder / share
        return path.stat().st_size if path.exists() else 0

    until(lambda: all(map(size, shares)))
    before = [*map(size, shares)]
    until(lambda: all(size(share) > it + 5_000 for share, it in zip(shares, before, strict=True)))
    # The machine keeps nothing of what has gone to the launcher, and no name of it.
    kept = (machines.folder / "cache-robot2").glob("hprm/programs/runs/*/.trace/*")
    assert list(kept) == []
    return launcher


def kill(machines: Machines, word: str, victim: str) -> None:
    """Kills a process of a run."""
    pids = [
        int(path.name)
        for path in Path("/proc").iterdir()
        if path.name.isdigit() and belongs(path, machines, word, victim)
    ]
    os.kill(min(pids), signal.SIGKILL)


@pytest.mark.parametrize("victim", ["federate", "agent", "agent here", "stand-in", "starter"])
def test_what_was_recorded_before_a_process_was_killed_is_in_the_trace(
    machines: Machines, victim: str
) -> None:
    launcher = traced(machines)
    if victim == "agent":
        machines.agents["robot2"].kill()
    elif victim == "agent here":
        machines.agents["robot1"].kill()
    else:
        words = {"federate": "robot2", "stand-in": "stand-in", "starter": " starter "}
        kill(machines, words[victim], victim)
    code, _, err = finish(launcher)
    assert (code != 0, err.count("error: ")) == (True, 1), err
    # One warning of the trace, beside those of links.
    (told,) = [line for line in err.splitlines() if "warning: trace run.pftrace: " in line]
    slices = read(machines.folder / "run.pftrace")
    for sink in ("sink__0", "sink__1"):
        ran = [it for it in reactions(slices) if it.process == sink]
        assert len(ran) > 3
    assert len(arrows(slices)) > 10
    if victim == "federate":
        assert "the records of sink__" in told and "end where the process was killed" in told
        assert any(it.name == "the process was killed: its records end here" for it in slices)
    else:
        assert "on robot2 end where the link to its machine ended" in told
        name = "its records end here, where the link to its machine ended"
        assert any(it.name == name for it in slices)
    if victim in ("starter", "agent"):
        # The files of the program are removed by the next starter; records have no files there.
        until(lambda: all("cache-" in it for it in left(machines)), 30)
        assert not list(machines.folder.glob("cache-robot2/hprm/programs/runs/*/.trace/*"))
    else:
        nothing_is_left(machines)
    assert [it.name for it in machines.folder.iterdir() if ".parts-" in it.name] == []


def test_a_killed_launcher_leaves_nothing_on_the_other_machine(machines: Machines) -> None:
    launcher = traced(machines)
    launcher.kill()
    finish(launcher)
    nothing_is_left(machines)


def test_ctrl_c_leaves_a_whole_trace(machines: Machines) -> None:
    launcher = traced(machines)
    launcher.send_signal(signal.SIGINT)
    code, _, err = finish(launcher)
    assert code == 130, err
    assert "warning: trace" not in err
    slices = read(machines.folder / "run.pftrace")
    shut = {it.process for it in reactions(slices)}
    assert shut == {"source", "sink__0", "sink__1"}
    nothing_is_left(machines)


def test_a_connection_that_is_cut_now_and_then_leaves_a_whole_trace(machines: Machines) -> None:
    machines.start_agents("--fleet-keys", "keys", "--allow-root", through=True)
    program = PROGRAM.replace("timeout: 200 msec", "timeout: 3 sec")
    launcher = run(machines, program, *TRACE, "--logical-trace", "logical", *AT)
    machines.cut_until_ended(launcher, 7)
    code, _, err = finish(launcher)
    # It may well tell of federates that do not answer meanwhile.
    assert (code, "warning: trace" in err) == (0, False), err
    lines = (machines.folder / "logical").read_text().splitlines()
    slices = reactions(read(machines.folder / "run.pftrace"))
    assert len(slices) == sum("reaction" in json.loads(line) for line in lines)
    nothing_is_left(machines)


def test_records_that_are_lost_on_another_machine_are_counted_here(machines: Machines) -> None:
    start(machines)
    program = """\
target Python { fast: true, timeout: 20 ms }
reactor Busy {
  timer t(0, 1 us)
  reaction(t) {= pass =}
}
federated reactor { busy = new Busy() }
"""
    options = ["--trace-buffer", "16", "--at", "busy=robot2", *AT[2:]]
    code, _, err = finish(run(machines, program, *TRACE, *options))
    assert code == 0
    (told,) = [line for line in err.splitlines() if line.startswith("warning: trace ")]
    assert "records of busy on robot2 are missing" in told
    assert "--trace-buffer 32" in err


def test_a_trace_that_cannot_be_written_is_told_before_anything_starts(machines: Machines) -> None:
    start(machines)
    code, out, err = finish(run(machines, PROGRAM, "--trace", "no/such/run", *AT))
    assert (code, out, err.count("error: ")) == (1, "", 1), err
    assert "no/such/run" in err
    nothing_is_left(machines)
