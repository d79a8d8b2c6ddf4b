"""Federations of Python and Rust: the executables are examples of the crate `hprm`."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import uuid
from pathlib import Path

import pytest
from processes import COORDINATIONS, Bench

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
    names = [word for it in ("camera", "controller", "federation") for word in ("--example", it)]
    built = ["cargo", "build", "--quiet", "--offline", "-p", "hprm", *names]
    subprocess.run(built, cwd=ROOT, check=True, timeout=600)
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    return target / "debug" / "examples"


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
