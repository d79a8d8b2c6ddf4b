"""Federations of Python and Rust: the executables are examples of the crate `hprm`."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import uuid
from pathlib import Path
from typing import Any

import pytest
from processes import COORDINATIONS, Bench, hear, rust_examples
from test_network import CERTIFICATES

ROOT = Path(__file__).parents[2]

MAIN = """\
target Python { timeout: 50 ms }

@executable("bin/camera")
reactor Camera {
  output image
  output number
}

reactor Detector {
  input image
  input number
  output found
  reaction(image, number) -> found {=
    pixels = image.value
    assert pixels.shape == (480, 640) and not pixels.flags.writeable
    label = f"cup {number.value}"
    found.set({"label": label, "boxes": [(1, 2), (3, 4)], "mean": float(pixels.mean())})
  =}
}

@executable("bin/controller")
reactor Controller {
  input found
  output command
}

reactor Motor {
  input command
  reaction(command) {= print(command.value, flush=True) =}
}

federated reactor {
  camera = new Camera()
  detector = new Detector()
  controller = new Controller()
  motor = new Motor()
  camera.image, camera.number -> detector.image, detector.number
  detector.found -> controller.found
  controller.command -> motor.command
}
"""

APP = """\
import hprm


class Camera(hprm.Reactor, executable="bin/camera"):
    image = hprm.Output()
    number = hprm.Output()


class Detector(hprm.Reactor):
    image = hprm.Input()
    number = hprm.Input()
    found = hprm.Output()

    @hprm.reaction(image, number, effects=[found])
    def detect(self):
        mean = float(self.image.value.mean())
        label = f"cup {self.number.value}"
        self.found.set({"label": label, "boxes": [(1, 2), (3, 4)], "mean": mean})


class Controller(hprm.Reactor, executable=["bin/controller"]):
    found = hprm.Input()
    command = hprm.Output()


class Motor(hprm.Reactor):
    command = hprm.Input()

    @hprm.reaction(command)
    def turn(self):
        print(self.command.value, flush=True)


class Vision(hprm.Federation, timeout="50 ms"):
    def __init__(self):
        self.camera = Camera()
        self.detector = Detector()
        self.controller = Controller()
        self.motor = Motor()
        hprm.connect(self.camera.image, self.detector.image)
        hprm.connect(self.camera.number, self.detector.number)
        hprm.connect(self.detector.found, self.controller.found)
        hprm.connect(self.controller.command, self.motor.command)
"""

FOUND = "[controller] found cup {} at [(1, 2), (3, 4)], mean 0.5"
COMMANDED = (
    "[motor] {{'text': 'turn to the cup {}', 'speeds': [0.5, 1.5], 'limits': {{'safe': True}},"
    " 'mask': None}}"
)


@pytest.fixture(scope="module")
def examples() -> Path:
    """The folder of the executables."""
    return rust_examples()


@pytest.fixture
def folder(tmp_path: Path, examples: Path) -> Path:
    """A folder with a program in both languages, and the executables that they name."""
    (tmp_path / "bin").symlink_to(examples)
    (tmp_path / "Main.lf").write_text(MAIN)
    (tmp_path / "app.py").write_text(APP)
    return tmp_path


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("program", ["Main.lf", "app.py"])
def test_values_of_every_kind_travel_between_the_languages(
    folder: Path, bench: Bench, program: str, coordination: str
) -> None:
    process = bench.call("run", "--property", f"coordination={coordination}", program)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    lines = out.splitlines()
    for number in range(1, 7):
        assert FOUND.format(number) in lines
        assert COMMANDED.format(number) in lines


def test_a_value_of_another_type_is_an_error_that_names_both_ends(
    folder: Path, bench: Bench
) -> None:
    wrong = MAIN.replace("float(pixels.mean())", "'much'")
    (folder / "Main.lf").write_text(wrong)
    process = bench.call("run", "Main.lf")
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert len(re.findall("^error", err, re.MULTILINE)) == 1, err
    assert "Main.controller.found expects controller::Found" in err
    assert "Main.detector.found has sent something else" in err
    assert "expected f64, found the str 'much'" in err


@pytest.mark.parametrize("federate", ["camera", "detector", "controller", "motor"])
def test_a_federate_that_is_killed_ends_the_federation(
    folder: Path, bench: Bench, federate: str
) -> None:
    (folder / "Main.lf").write_text(MAIN.replace("timeout: 50 ms", ""))
    process = bench.call("run", "Main.lf")
    assert process.stdout is not None
    while "[motor]" not in process.stdout.readline():
        pass
    killed = [pid for pid in bench.left() if is_process_of(federate, pid)]
    assert len(killed) == 1, killed
    os.kill(killed[0], signal.SIGKILL)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert f"error: federate {federate} was killed by signal 9 (SIGKILL)" in err
    assert len(re.findall("^error", err, re.MULTILINE)) == 1, err


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_connections_of_executables_are_watched(
    folder: Path, bench: Bench, coordination: str
) -> None:
    (folder / "Main.lf").write_text(MAIN.replace("timeout: 50 ms", ""))
    process = bench.call("run", "--property", f"coordination={coordination}", "Main.lf")
    values = {}
    for port in ("camera.image", "controller.found", "controller.command"):
        options = ["--once", "--json", "--wait", "30", "--of", str(process.pid)]
        echo = bench.call("echo", port, *options)
        out, err = echo.communicate(timeout=60)
        assert echo.returncode == 0, err
        values[port] = json.loads(out)["value"]
    assert values["camera.image"]["array"]["shape"] == [480, 640]
    assert values["controller.found"]["boxes"] == [[1, 2], [3, 4]]
    assert values["controller.command"]["text"].startswith("turn to the cup ")
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)


def is_process_of(federate: str, pid: int) -> bool:
    """Return whether a process is that of a federate: an executable, or an interpreter."""
    words = Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
    return words[0].endswith(f"/{federate}") or (federate in words and "federate" in words)


def test_an_executable_gets_no_terminal_and_is_no_thread(folder: Path, bench: Bench) -> None:
    for options, said in [
        (["--debug", "camera"], "--debug: the federate camera is an executable"),
        (["--in-process"], "the federate camera is an executable, and cannot run in this process"),
    ]:
        process = bench.call("run", *options, "Main.lf")
        _, err = process.communicate(timeout=60)
        assert process.returncode != 0
        assert said in err


@pytest.mark.parametrize("program", ["Main.lf", "bin/federation"])
def test_runs_of_executables_are_verified_as_processes(
    folder: Path, bench: Bench, program: str
) -> None:
    process = bench.call("verify", "--runs", "3", program)
    out, err = process.communicate(timeout=100)
    assert process.returncode == 0, err
    assert "3 runs did the same" in out


def test_an_executable_that_is_a_federation_is_run_and_checked(folder: Path, bench: Bench) -> None:
    process = bench.call("run", "bin/federation")
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert "[detector] 100000000 0.5" in out
    process = bench.call("check", "bin/federation")
    out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (0, "")
    process = bench.call("run", "bin/camera")
    _, err = process.communicate(timeout=60)
    assert process.returncode != 0
    assert "bin/camera declares no federation" in err
    process = bench.call("check", "bin/camera")
    assert (process.communicate(timeout=60)[1], process.returncode) == ("", 0)


@pytest.mark.parametrize("program", ["Main.lf", "app.py"])
def test_federates_are_started_one_by_one(folder: Path, bench: Bench, program: str) -> None:
    address, secret = f"unix:@hprm-test-{uuid.uuid4().hex}", uuid.uuid4().hex
    common = ["--federation", secret]
    rti = bench.call("rti", "--listen", address, *common, program)
    names = ["camera", "detector", "controller", "motor"]
    federates = [bench.call("federate", program, it, "--rti", address, *common) for it in names]
    outs = [process.communicate(timeout=60) for process in federates]
    assert [process.returncode for process in federates] == [0, 0, 0, 0], outs
    assert "found cup 6" in outs[2][0]
    rti.communicate(timeout=60)
    assert rti.returncode == 0


def test_the_programs_of_the_document_run(folder: Path, bench: Bench) -> None:
    text = (ROOT / "docs" / "howto" / "mixed.md").read_text()
    for language, name in [("lf", "Main.lf"), ("python", "app.py")]:
        (program,) = re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
        (folder / name).write_text(program)
        process = bench.call("run", name)
        out, err = process.communicate(timeout=60)
        assert process.returncode == 0, err
        assert out.splitlines() == [f"[detector] {number} 0.5" for number in range(1, 7)]


# Python on both sides of an executable, or executables one after the other.
BRIGHTEN = """\
@executable("bin/camera")
reactor Camera {
  output image
  output number
}

@executable("bin/brighten")
reactor Brighten {
  input image
  input gain
  output bright
  output mean
}

reactor Source {
  output image
  output gain
  timer t(0, 10 ms)
  state n = 0
  reaction(t) -> image, gain {=
    # In shared memory, or in the message; and a bare integer for a float.
    image.set(numpy.full((480, 640) if self.n % 2 == 0 else (2, 3), 0.25))
    self.n += 1
    gain.set(self.n)
  =}
}

reactor Sink {
  input bright
  input[2] mean
  reaction(bright, mean) {=
    image = bright.value
    means = [it.value for it in mean if it.is_present]
    print(image.shape, image.min(), image.max(), means, image.flags.writeable, flush=True)
  =}
}
"""


def target(properties: str) -> str:
    """Return the beginning of a program."""
    return f"target Python {{ {properties} }}\npreamble {{= import numpy, os =}}\n"


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_arrays_and_bare_numbers_go_from_python_to_rust(
    folder: Path, bench: Bench, coordination: str
) -> None:
    main = """
federated reactor {
  source = new Source()
  filter = new Brighten()
  sink = new Sink()
  source.image, source.gain -> filter.image, filter.gain
  filter.bright, filter.mean -> sink.bright, sink.mean
}
"""
    text = target(f"timeout: 20 ms, coordination: {coordination}") + BRIGHTEN + main
    outcome = bench.run(text)
    assert outcome.code == 0, outcome.err
    assert outcome.out.splitlines() == [
        "[sink] (480, 640) 0.25 0.25 [0.25] False",
        "[sink] (2, 3) 0.5 0.5 [0.5] False",
        "[sink] (480, 640) 0.75 0.75 [0.75] False",
    ]


MIXER = """\
@executable("bin/mixer")
reactor Mixer {
  input[3] voices
  output[2] mixed
}

reactor Voices {
  output[3] voices
  timer t(0, 1 ms)
  state n = 0
  reaction(t) -> voices {=
    self.n += 1
    # The second amplifier hears nothing at every other tag.
    for index in range(3 if self.n % 2 else 2):
        voices[index].set(self.n)
  =}
}

reactor Listener {
  input[2] mixed
  reaction(mixed) {= print([(it.value if it.is_present else None) for it in mixed], flush=True) =}
}

federated reactor {
  voices = new Voices()
  mixer = new Mixer()
  listener = new Listener()
  voices.voices -> mixer.voices
  mixer.mixed -> listener.mixed
}
"""


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_reactions_in_rust_name_single_channels_and_members(
    folder: Path, bench: Bench, coordination: str
) -> None:
    outcome = bench.run(target(f"timeout: 3 ms, coordination: {coordination}") + MIXER)
    assert outcome.code == 0, outcome.err
    assert outcome.out.splitlines() == [
        "[listener] [1, 110]",
        "[listener] [2, None]",
        "[listener] [3, 330]",
        "[listener] [4, None]",
    ]


CHAIN = """
federated reactor {
  camera = new Camera()
  filter = new[2] Brighten()
  sink = new Sink()
  camera.image, filter.bright -> filter.image, sink.bright
  filter.mean -> sink.mean
}
"""


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_bank_of_executables_is_a_chain_of_processes(
    folder: Path, bench: Bench, coordination: str
) -> None:
    text = target(f"timeout: 10 ms, coordination: {coordination}") + BRIGHTEN + CHAIN
    outcome = bench.run(text)
    assert outcome.code == 0, outcome.err
    assert outcome.out.splitlines() == ["[sink] (480, 640) 2.0 2.0 [1.0, 2.0] False"] * 2


def test_a_transient_executable_comes_goes_and_comes_back(folder: Path, bench: Bench) -> None:
    main = """
reactor Viewer {
  input number
  state starts = 0
  reaction(number) {=
    print(number.value, flush=True)
    self.starts += number.value == 1
    if self.starts == 2: request_stop()
  =}
}

federated reactor {
  @transient
  camera = new Camera()
  viewer = new Viewer()
  camera.number -> viewer.number
}
"""
    federation = bench.by_hand(target("keepalive: true") + BRIGHTEN + main, "viewer")
    federation.await_joined("viewer")
    federation.start("camera")
    hear(federation.members["viewer"].stdout, "3\n")
    camera = federation.members["camera"]
    camera.kill()
    camera.communicate(timeout=60)
    federation.start("camera")
    outcomes = federation.finish()
    # That one was killed is told at the end, and disturbs no other federate.
    assert {name: outcome.code for name, outcome in outcomes.items()} == {
        "rti": 1,
        "viewer": 0,
        "camera": 0,
    }, outcomes
    assert "error: the process of federate camera ended before its last tag" in outcomes["rti"].err


@pytest.mark.skipif(not shutil.which("openssl"), reason="openssl makes the certificates")
@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_executables_join_over_tls_by_hand(folder: Path, bench: Bench, coordination: str) -> None:
    for line in CERTIFICATES:
        subprocess.run(["openssl", *line.split()], cwd=folder, check=True, capture_output=True)
    tls = ["--tls-cert", "robot.pem", "--tls-key", "robot.key", "--tls-ca", "ca.pem"]
    properties = f"timeout: 10 ms, comm-type: TLS, coordination: {coordination}"
    main = CHAIN.replace("new Camera()", "new Camera() at camera.local")
    (folder / "Main.lf").write_text(target(properties) + BRIGHTEN + main)
    federation = bench.federation("127.0.0.1:0")
    federation.start("rti", *tls)
    names = ["camera", "filter__0", "filter__1", "sink"]
    for name in names:
        federation.start(name, *tls)
    outcomes = federation.finish()
    assert {outcome.code for outcome in outcomes.values()} == {0}, outcomes
    seen = outcomes["sink"].out.splitlines()
    assert seen == ["(480, 640) 2.0 2.0 [1.0, 2.0] False"] * 2


def test_a_value_has_one_digest_in_both_languages(folder: Path, bench: Bench) -> None:
    """What the one end sets, in a logical trace, is what the other end reads."""
    process = bench.call("run", "--logical-trace", "trace", "Main.lf")
    _, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    steps = [json.loads(line) for line in (folder / "trace").read_text().splitlines()[1:-1]]
    sets, reads = values(steps, "sets", "port"), values(steps, "reads", "from")
    compared = [
        ("Main.camera.image", "Main.detector.image"),
        ("Main.camera.number", "Main.detector.number"),
        ("Main.detector.found", "Main.controller.found"),
        ("Main.controller.command", "Main.motor.command"),
    ]
    for sender, receiver in compared:
        assert len(sets[sender]) == 6, sets
        assert sets[sender] == reads[receiver], (sender, receiver)
        assert not any(value.get("opaque") for value in sets[sender])


def values(steps: list[dict[str, Any]], what: str, name: str) -> dict[str, list[dict[str, Any]]]:
    """Return the values in a trace without their texts, by port."""
    found: dict[str, list[dict[str, Any]]] = {}
    for step in steps:
        for it in step.get(what, []):
            value = {key: part for key, part in it["value"].items() if key != "text"}
            found.setdefault(it[name], []).append(value)
    return found


def test_programs_that_bodies_start_learn_nothing_of_executables(
    folder: Path, bench: Bench
) -> None:
    main = """
reactor Viewer {
  input number
  reaction(number) {=
    print([it for it in os.environ if it.startswith("HPRM_DESCRI")])
    request_stop()
  =}
}

federated reactor {
  camera = new Camera()
  viewer = new Viewer()
  camera.number -> viewer.number
}
"""
    outcome = bench.run(target("") + BRIGHTEN + main)
    assert outcome.code == 0, outcome.err
    # Some more may come before the stop.
    assert set(outcome.out.splitlines()) == {"[viewer] []"}


NUMBERS = """
reactor Viewer {
  input number
  reaction(number) {= print(number.value) =}
}

federated reactor {
  camera = new Camera()
  viewer = new Viewer()
  camera.number -> viewer.number
}
"""


def wrap(path: Path, script: str) -> None:
    """Write a script that becomes an executable."""
    path.parent.mkdir(exist_ok=True)
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)


def test_an_executable_is_found_on_the_path_and_gets_its_arguments_and_the_folder(
    folder: Path, bench: Bench, examples: Path
) -> None:
    noted = '[ -n "$HPRM_DESCRIBE" ] || echo "$PWD $*" > "$0.noted"'
    wrap(folder / "tools" / "some-camera", f'{noted}; exec "{examples}/camera"')
    text = BRIGHTEN.replace('"bin/camera"', '"some-camera", "--mode", "two words"')
    program = folder / "programs" / "Main.lf"
    program.parent.mkdir()
    program.write_text(target("timeout: 10 ms") + text + NUMBERS)
    program.with_name("bin").symlink_to(examples)
    path = f"{folder / 'tools'}:{os.environ['PATH']}"
    process = bench.call("run", "programs/Main.lf", environment={"PATH": path})
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (0, "[viewer] 1\n[viewer] 2\n"), err
    noted = (folder / "tools" / "some-camera.noted").read_text()
    assert noted == f"{folder} --mode two words\n"
    process = bench.call("run", "programs/Main.lf")
    _, err = process.communicate(timeout=60)
    assert process.returncode != 0
    assert "then on PATH" in err


def test_an_executable_that_declares_something_else_when_it_runs_refuses_to_join(
    folder: Path, bench: Bench, examples: Path
) -> None:
    other = f'[ -n "$HPRM_DESCRIBE" ] || exec "{examples}/controller"; exec "{examples}/camera"'
    wrap(folder / "tools" / "camera", other)
    text = BRIGHTEN.replace("bin/camera", "tools/camera")
    outcome = bench.run(target("timeout: 10 ms") + text + NUMBERS)
    assert outcome.code == 1
    said = "this executable assembles another program than it has declared to its launcher"
    assert f"error: federate camera: {said}" in outcome.err
    assert "is not in the program of the launcher" in outcome.err


def test_an_executable_that_is_a_federation_needs_no_interpreter(
    folder: Path, bench: Bench
) -> None:
    process = bench.call("run", "bin/federation", environment={"HPRM_PYTHON": "/nowhere/python"})
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert "[detector] 100000000 0.5" in out
