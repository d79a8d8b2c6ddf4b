"""Watching connections of a running federation: `hprm echo` and `hprm rate`.

The handbook has it in docs/howto/echo.md.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
from processes import COORDINATIONS, Bench, finish, hear, hear_number

HPRM = str(Path(sys.executable).with_name("hprm"))

# A federation that goes on until it is stopped, and a value of every kind.
VALUES = """\
target Python { coordination: COORDINATION, keepalive: true }
preamble {=
import numpy as np
from fractions import Fraction
class Opaque:
    def __reduce__(self):
        return Opaque, ()
VALUES = {
    "number": 42,
    "text": "x" * 300,
    "array": np.arange(12, dtype=np.float32).reshape(3, 4),
    "large": np.full((100, 1000, 10), 7, dtype=np.uint8),
    "dict": {"a": [1, 2.5, None], "b": (True, b"raw"), "c": np.array([1, 2])},
    "pickle": Opaque(),
    "fraction": [Fraction(1, 3)],
    "times": {"at": np.array(["2026-01-01"], "M8[D]"), "n": 1},
    "set": {1 + 2j},
}
=}
reactor Source {
  output[9] outs
  timer t(0, 10 ms)
  reaction(t) -> outs {=
    for out, value in zip(outs, VALUES.values()):
        out.set(value)
  =}
}
reactor Sink {
  input[9] inputs
  reaction(inputs) {= pass =}
}
federated reactor {
  source = new Source()
  sink = new Sink()
  source.outs -> sink.inputs after 1 ms
}
"""

# A federation with an array of a megabyte at each tag, which lies in the store.
LARGE = """\
target Python { coordination: COORDINATION, keepalive: true }
preamble {=
import numpy as np
IMAGE = np.zeros(1_000_000, dtype=np.uint8)
IMAGE[1] = 255
=}
reactor Camera {
  output image
  output count
  state n = 0
  timer t(0, 20 ms)
  reaction(t) -> image, count {=
    self.n += 1
    image.set(IMAGE)
    count.set(self.n)
  =}
}
reactor Detector {
  input image
  input count
  reaction(image, count) {=
    assert image.value[1] == 255
    print("at", count.value, flush=True)
  =}
}
federated reactor {
  camera = new Camera()
  detector = new Detector()
  camera.image, camera.count -> detector.image, detector.count
}
"""


def of_bytes(size: int, every: str = "20 ms") -> str:
    """That federation with arrays of another size, at other times."""
    return LARGE.replace("1_000_000", str(size)).replace("20 ms", every)


# A federation that ends, and the same at every run.
COUNTING = """\
target Python { coordination: COORDINATION, timeout: 6 s }
preamble {=
import numpy as np
=}
reactor Camera {
  output image
  state n = 0
  timer t(0, 50 ms)
  reaction(t) -> image {=
    self.n += 1
    image.set(np.full(10_000, self.n, dtype=np.int64))
  =}
}
reactor Detector {
  input image
  output found
  reaction(image) -> found {= found.set(int(image.value.sum())) =}
}
reactor Planner {
  input found
  reaction(found) {= print(found.value, flush=True) =}
}
federated reactor {
  camera = new Camera()
  detector = new Detector()
  planner = new Planner()
  camera.image -> detector.image
  detector.found -> planner.found
}
"""


def start(
    bench: Bench, text: str, coordination: str = "centralized", *options: str
) -> subprocess.Popen[str]:
    """Start a federation that can be watched from now on."""
    return bench.start(text.replace("COORDINATION", coordination), *options)


def watch(bench: Bench, run: subprocess.Popen[str], *words: str) -> Any:
    """Start a command that watches the federation of a run."""
    return bench.call(*words, "--wait", "30", "--of", str(run.pid))


def stop(run: subprocess.Popen[str]) -> None:
    """Stop a federation in order."""
    run.send_signal(signal.SIGINT)
    assert finish(run).code == 130


def once(bench: Bench, run: subprocess.Popen[str], port: str, *options: str) -> Any:
    """Return the next message at a port."""
    outcome = finish(watch(bench, run, "echo", port, "--once", "--json", *options))
    assert (outcome.code, outcome.err) == (0, ""), outcome.err
    return json.loads(outcome.out)


@pytest.mark.parametrize("threads", [False, True], ids=["processes", "threads"])
@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_values_of_all_kinds_are_shown(bench: Bench, coordination: str, threads: bool) -> None:
    run = start(bench, VALUES, coordination, *(["--in-process"] if threads else []))
    values = [once(bench, run, f"source.outs[{at}]")["value"] for at in range(9)]
    assert values[0] == 42
    assert values[1] == "x" * 300
    assert values[2]["array"] == {
        "dtype": "float32",
        "shape": [3, 4],
        "first": [0, 1, 2, 3, 4, 5],
        "min": 0,
        "max": 11,
        "mean": 5.5,
        "nan": 0,
    }
    assert values[3]["array"]["shape"] == [100, 1000, 10]
    assert (values[3]["array"]["min"], values[3]["array"]["mean"]) == (7, 7.0)
    assert values[4]["a"] == [1, 2.5, None]
    assert values[4]["b"] == [True, {"bytes": 3}]
    assert values[4]["c"]["array"]["dtype"] == "int64"
    assert values[5] == {"pickle": "__main__.Opaque"}
    assert values[6] == [{"a fractions.Fraction": [1, 3]}]
    why = "Rust has no elements of the array's dtype <M8[D]"
    assert values[7] == {"at": {"an array": why}, "n": 1}
    assert values[8] == [[1.0, 2.0]]
    stop(run)


def test_an_input_shows_the_tags_of_its_receiver(bench: Bench) -> None:
    run = start(bench, VALUES)
    sent, received = once(bench, run, "source.outs[0]"), once(bench, run, "sink.inputs[0]")
    assert (sent["port"], received["port"]) == ("source.outs[0]", "sink.inputs[0]")
    assert sent["tag"]["time"] % 10_000_000 == 0
    assert received["tag"]["time"] % 10_000_000 == 1_000_000
    stop(run)


# One camera, whose image goes to both members of a bank, 10 ms later to one of them.
BANK = """\
target Python { keepalive: true }
reactor Camera {
  output image
  output count
  state n = 0
  timer t(0, 10 ms)
  reaction(t) -> image, count {=
    image.set(self.n)
    count.set(-self.n)
    self.n += 1
  =}
}
reactor Viewer {
  input image
  input count
  reaction(image, count) {= pass =}
}
federated reactor {
  camera = new Camera()
  viewer = new[2] Viewer()
  (camera.image)+ -> viewer.image
  (camera.count)+ -> viewer.count
}
"""


def test_several_ports_and_all_members_of_a_bank_are_shown(bench: Bench) -> None:
    run = start(bench, BANK)
    ports = ["viewer.image", "camera.count", "viewer[1].count"]
    outcome = finish(watch(bench, run, "echo", *ports, "--count", "40", "--json"))
    assert (outcome.code, outcome.err) == (0, "")
    values: dict[str, dict[int, int]] = {}
    for line in outcome.out.splitlines():
        message = json.loads(line)
        values.setdefault(message["port"], {})[message["tag"]["time"]] = message["value"]
    assert set(values) == {"viewer[0].image", "viewer[1].image", "camera.count", "viewer[1].count"}
    # Each is shown with all that it gets, as the others.
    for port, by_time in values.items():
        sign = -1 if port.endswith("count") else 1
        assert all(value == sign * time // 10_000_000 for time, value in by_time.items()), port
        assert len(by_time) >= 5
    outcome = finish(watch(bench, run, "echo", "viewer.image", "camera.nothing"))
    assert outcome.code == 1
    outcome.assert_one_error("camera has no port nothing")
    stop(run)


def test_text_is_cut_unless_it_is_wanted_whole(bench: Bench) -> None:
    run = start(bench, VALUES)
    outcome = finish(watch(bench, run, "echo", "source.outs[1]", "--once"))
    cut = rf'\(\d+ ns, 0\)  "{"x" * 200}"... \(300 characters\)\n'
    assert re.fullmatch(cut, outcome.out), outcome.out
    outcome = finish(watch(bench, run, "echo", "source.outs[1]", "--once", "--full"))
    assert re.fullmatch(rf'\(\d+ ns, 0\)  "{"x" * 300}"\n', outcome.out), outcome.out
    outcome = finish(watch(bench, run, "echo", "source.outs", "-n", "18"))
    ports = [line.split("  ")[1] for line in outcome.out.splitlines()]
    assert set(ports) == {f"source.outs[{at}]" for at in range(9)}
    stop(run)


def anonymous(pid: int) -> int:
    """How many bytes of its own, not shared with others, a process uses."""
    rollup = Path(f"/proc/{pid}/smaps_rollup").read_text()
    found = re.search(r"^Anonymous: +(\d+) kB", rollup, re.M)
    assert found, rollup
    return int(found[1]) * 1024


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_large_array_is_read_where_it_lies(bench: Bench, coordination: str) -> None:
    run = start(bench, of_bytes(50_000_000, every="200 ms"), coordination)
    echo = watch(bench, run, "echo", "camera.image")
    shown = hear(echo.stdout, "\n")
    assert "array(uint8 50000000, 0 to 255, mean 5.1e-6: 0, 255, 0, " in shown
    hear(echo.stdout, "\n")
    assert "memfd:hprm-store" in Path(f"/proc/{echo.pid}/maps").read_text()
    assert anonymous(echo.pid) < 20_000_000
    echo.send_signal(signal.SIGINT)
    assert finish(echo).code == 0
    stop(run)


def test_a_watcher_that_stands_still_stops_nothing_and_learns_what_it_missed(bench: Bench) -> None:
    # There is room for the camera's arrays, and not for many that a watcher does not release.
    text = of_bytes(20_000_000, every="40 ms").replace(
        "keepalive: true", 'keepalive: true, store-limit: "200 MB", store-full: error'
    )
    run = start(bench, text)
    echo = watch(bench, run, "echo", "camera.image")
    hear(echo.stdout, "\n")
    echo.send_signal(signal.SIGSTOP)
    before = hear_number(run.stdout)
    hear(run.stdout, f"at {before + 40}\n")
    echo.send_signal(signal.SIGCONT)
    assert re.search(r"\.\.\. \d+ messages missed\n", hear(echo.stdout, "missed\n"))
    echo.send_signal(signal.SIGINT)
    assert finish(echo).code == 0
    stop(run)


def test_a_killed_watcher_holds_nothing_any_more(bench: Bench) -> None:
    # If each left an object behind, the store would be full after ten.
    text = of_bytes(20_000_000, every="40 ms").replace(
        "keepalive: true", 'keepalive: true, store-limit: "180 MB", store-full: error'
    )
    run = start(bench, text)
    for _ in range(12):
        echo = watch(bench, run, "echo", "camera.image")
        hear(echo.stdout, "\n")
        echo.send_signal(signal.SIGSTOP)
        before = hear_number(run.stdout)
        hear(run.stdout, f"at {before + 2}\n")
        echo.kill()
        echo.communicate()
    assert "array(" in finish(watch(bench, run, "echo", "camera.image", "--once")).out
    stop(run)


@pytest.mark.parametrize("threads", [False, True], ids=["processes", "threads"])
@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_watched_federation_does_the_same(bench: Bench, coordination: str, threads: bool) -> None:
    options = ["--in-process"] if threads else []
    alone = start(bench, COUNTING, coordination, "--logical-trace", "alone.trace", *options)
    run = start(bench, COUNTING, coordination, "--logical-trace", "watched.trace", *options)
    hear(run.stdout, "\n")
    watchers = [
        watch(bench, run, *words)
        for words in (
            ["echo", "camera.image"],
            ["echo", "detector.image", "--json"],
            ["echo", "planner.found"],
            ["rate", "--window", "0.1"],
        )
    ]
    still, killed = watchers[0], watchers[2]
    for echo in watchers:
        hear(echo.stdout, "\n")
    still.send_signal(signal.SIGSTOP)
    killed.kill()
    assert finish(run).code == 0
    assert finish(alone).code == 0
    still.send_signal(signal.SIGCONT)
    for echo in watchers:
        outcome = finish(echo)
        assert outcome.code == (-signal.SIGKILL if echo is killed else 0), outcome.err
        assert echo is killed or "has ended\n" in outcome.err
    outcome = finish(bench.call("diff", "alone.trace", "watched.trace"))
    assert outcome.code == 0, outcome.out


def test_what_is_wrong_is_one_error(bench: Bench) -> None:
    run = start(bench, LARGE)
    for port, said, hint in [
        ("camera", "camera is a federate, and not one of its ports", "`camera.image`"),
        ("image", "image is no port of a federate", "as in camera.image"),
        ("camrea.image", "Main has no federate camrea", "did you mean `camera`?"),
        ("camera.imgae", "camera has no port imgae", "did you mean `image`?"),
        ("camera[1].image", "Main has no federate camera[1]", "camera"),
        ("detector.count[0]", "detector has no port count[0]", "count"),
    ]:
        for command in ("echo", "rate"):
            outcome = finish(watch(bench, run, command, port))
            assert outcome.code == 1, outcome.err
            outcome.assert_one_error(said, hint)
    stop(run)


def test_a_port_without_a_connection_to_another_federate_is_one_error(bench: Bench) -> None:
    text = """\
target Python { keepalive: true }
reactor A {
  output out
  output unread
  input unsent
  timer t(0, 10 ms)
  reaction(t) -> out, unread {= out.set(1) =}
  reaction(unsent) {= pass =}
}
reactor B {
  input inp
  reaction(inp) {= pass =}
}
federated reactor {
  a = new A()
  b = new B()
  a.out -> b.inp
}
"""
    run = start(bench, text)
    for port in ("a.unread", "a.unsent"):
        outcome = finish(watch(bench, run, "echo", port))
        assert outcome.code == 1
        outcome.assert_one_error(f"there is no connection to another federate at {port}")
    stop(run)


def test_which_federation_is_meant_must_be_clear(bench: Bench) -> None:
    outcome = finish(bench.call("echo", "camera.image", "--of", "NoSuchFederation"))
    assert outcome.code == 1
    outcome.assert_one_error("no federation NoSuchFederation of this user runs on this machine")
    # The name of a program is that of its file.
    (bench.folder / "Twice.lf").write_text(VALUES.replace("COORDINATION", "centralized"))
    both = [bench.call("run", "Twice.lf") for _ in range(2)]
    assert all(finish(watch(bench, run, "rate", "--once")).code == 0 for run in both)
    outcome = finish(bench.call("echo", "source.outs", "--of", "Twice"))
    assert outcome.code == 1
    numbers = [f"Twice, process {run.pid}: " for run in both]
    outcome.assert_one_error("several federations of Twice run", "--of ", *numbers)
    for run in both:
        stop(run)
    assert finish(bench.call("rate", "--of", str(both[0].pid))).code == 1


def test_two_federations_in_threads_are_told_apart(bench: Bench) -> None:
    runs = [start(bench, BANK, "centralized", "--in-process")]
    assert finish(watch(bench, runs[0], "rate", "--once")).code == 0
    runs.append(start(bench, LARGE, "centralized", "--in-process"))
    hear(runs[1].stdout, "at 2\n")
    names = [{"camera", "viewer__0", "viewer__1"}, {"camera", "detector"}]
    for run, federates in zip(runs, names, strict=True):
        outcome = finish(bench.call("top", "--once", "--json", str(run.pid)))
        assert {it["name"] for it in json.loads(outcome.out)["federates"]} == federates
    assert once(bench, runs[0], "camera.count")["value"] <= 0
    assert once(bench, runs[1], "camera.count")["value"] > 0
    for run in runs:
        stop(run)


def test_a_federation_that_stands_still_is_one_error(bench: Bench) -> None:
    run = start(bench, LARGE, "centralized", "--in-process")
    hear(run.stdout, "at 2\n")
    run.send_signal(signal.SIGSTOP)
    outcome = finish(bench.call("echo", "camera.image", "--of", str(run.pid)))
    assert outcome.code == 1
    outcome.assert_one_error("cannot be watched: it does not answer", "--wait SECONDS")
    run.send_signal(signal.SIGCONT)
    assert "array(" in finish(watch(bench, run, "echo", "camera.image", "--once")).out
    stop(run)


def test_a_program_in_one_process_has_nothing_to_watch(bench: Bench) -> None:
    text = "target Python { keepalive: true }\nmain reactor { reaction(startup) {= print(1) =} }\n"
    run = start(bench, text)
    hear(run.stdout, "1\n")
    outcome = finish(bench.call("echo", "a.b", "--of", str(run.pid)))
    assert outcome.code == 1
    outcome.assert_one_error(
        f"process {run.pid} belongs to no federation", "program in one process"
    )
    stop(run)


def test_federations_of_other_users_are_not_watched(bench: Bench) -> None:
    if os.geteuid() != 0:
        # A process of another user, and no federation.
        outcome = finish(bench.call("echo", "camera.image", "--of", "1"))
        assert outcome.code == 1
        outcome.assert_one_error("process 1 belongs to another user")
        return
    run = start(bench, LARGE)
    hear(run.stdout, "at 2\n")
    with tempfile.TemporaryDirectory() as folder:
        # Where the other user can execute it.
        os.chmod(folder, 0o755)
        copy = shutil.copy(HPRM, folder)
        for of, said in ("Main", "no federation"), (str(run.pid), "belongs to another user"):
            for command in (["echo", "camera.image"], ["rate"]):
                outcome = subprocess.run(
                    [copy, *command, "--of", of],
                    user=65534,
                    group=65534,
                    extra_groups=[],
                    capture_output=True,
                    text=True,
                    check=False,
                    cwd="/",
                    timeout=30,
                )
                assert (outcome.returncode, outcome.stdout) == (1, "")
                assert said in outcome.stderr
                assert outcome.stderr.count("error") == 1
    stop(run)


@pytest.mark.parametrize("threads", [False, True], ids=["processes", "threads"])
def test_rates_are_told_of_all_connections_or_of_one(bench: Bench, threads: bool) -> None:
    run = start(bench, LARGE, "centralized", *(["--in-process"] if threads else []))
    outcome = finish(watch(bench, run, "rate", "--once", "--json", "--window", "0.5"))
    assert (outcome.code, outcome.err) == (0, "")
    rows = {row["from"]: row for row in map(json.loads, outcome.out.splitlines())}
    assert set(rows) == {"camera.image", "camera.count"}
    image = rows["camera.image"]
    assert image["to"] == "detector.image"
    assert image["messages"] >= 2
    assert image["interval"]["min"] <= image["interval"]["mean"] <= image["interval"]["max"]
    if not threads:
        assert image["bytes"] // image["messages"] in range(1_000_000, 1_001_000)
    outcome = finish(watch(bench, run, "rate", "camera.count", "--once"))
    titles, row = outcome.out.splitlines()
    assert titles.split()[:3] == ["connection", "messages/s", "bytes/s"]
    assert row.startswith("camera.count -> detector.count ")
    stop(run)


def test_federates_that_are_started_by_hand_are_watched_over_tcp_too(bench: Bench) -> None:
    (bench.folder / "Main.lf").write_text(LARGE.replace("COORDINATION", "decentralized"))
    federation = bench.federation("tcp:127.0.0.1:0")
    federation.start("rti")
    for name in ("camera", "detector"):
        federation.start(name)
    camera = federation.members["camera"]
    hear(federation.members["detector"].stdout, "at 3\n")
    image = once(bench, camera, "detector.image")["value"]["array"]
    assert (image["shape"], image["max"]) == ([1_000_000], 255)
    federation.members["rti"].send_signal(signal.SIGINT)
    federation.finish()


def test_a_federate_that_does_not_answer_is_missing_with_a_warning(bench: Bench) -> None:
    text = COUNTING.replace("timeout: 6 s", "keepalive: true")
    run = start(bench, text.replace("int(image.value.sum())", '__import__("os").getpid()'))
    still = hear_number(run.stdout)
    os.kill(still, signal.SIGSTOP)
    outcome = finish(bench.call("rate", "--once", "--of", str(run.pid)))
    os.kill(still, signal.SIGCONT)
    assert outcome.code == 0 and "camera.image" in outcome.out
    assert "warning: federate detector cannot be watched" in outcome.err
    stop(run)


@pytest.mark.parametrize("command", ["echo", "rate"])
def test_an_error_is_an_object_if_objects_are_wanted(bench: Bench, command: str) -> None:
    outcome = finish(bench.call(command, "camera.image", "--json", "--of", "Nowhere"))
    assert (outcome.code, outcome.err) == (1, "")
    assert "Nowhere" in json.loads(outcome.out)["error"]["message"]
