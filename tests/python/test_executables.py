"""Programs that name executables: how they are found, asked and checked.

The executables are scripts; federations with executables in Rust are in test_mixed.py.
"""

from __future__ import annotations

import json
import subprocess
import sys
import textwrap
from pathlib import Path

import executables
import pytest
from conftest import Outcome
from executables import asked, document, port, reactor, write

COMMAND = str(Path(sys.executable).with_name("hprm"))

MAIN = """\
target Python { timeout: 10 ms }

@executable("bin/camera", "--fast")
reactor Camera {
  output image
}

reactor Detector {
  input image
  reaction(image) {= pass =}
}

federated reactor {
  camera = new Camera()
  detector = new Detector()
  camera.image -> detector.image
}
"""

APP = """\
import hprm


class Camera(hprm.Reactor, executable=["bin/camera", "--fast"]):
    image = hprm.Output()


class Detector(hprm.Reactor):
    image = hprm.Input()

    @hprm.reaction(image)
    def detect(self): ...


class Vision(hprm.Federation, timeout="10 ms"):
    def __init__(self):
        self.camera = Camera()
        self.detector = Detector()
        hprm.connect(self.camera.image, self.detector.image)
"""

CAMERA = reactor("Camera", [port("image")])


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    """A folder with a program in both languages, and the executable that they name."""
    (tmp_path / "Main.lf").write_text(MAIN)
    (tmp_path / "app.py").write_text(APP)
    (tmp_path / "bin").mkdir()
    return write(tmp_path / "bin" / "camera", document(CAMERA))


def call(folder: Path, *arguments: str) -> Outcome:
    done = subprocess.run(
        [COMMAND, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    return Outcome(done.returncode, done.stdout, done.stderr)


PROGRAMS = pytest.mark.parametrize("program", ["Main.lf", "app.py"])


@PROGRAMS
def test_a_program_with_an_executable_is_checked_with_it(
    camera: Path, tmp_path: Path, program: str
) -> None:
    done = call(tmp_path, "check", program)
    assert (done.code, done.err) == (0, ""), done.err
    assert asked(camera) >= 1


@PROGRAMS
def test_the_path_is_relative_to_the_file(camera: Path, tmp_path: Path, program: str) -> None:
    (tmp_path / "elsewhere").mkdir()
    done = call(tmp_path / "elsewhere", "check", f"../{program}")
    assert done.code == 0, done.err


@PROGRAMS
def test_ports_that_differ_are_an_error_that_names_both_ends(
    camera: Path, tmp_path: Path, program: str
) -> None:
    write(camera, document(reactor("Camera", [port("image", width=3)])))
    done = call(tmp_path, "check", program)
    assert done.code == 1
    assert (
        f"error[LF1103]: the executable {camera} declares output `image[3]`,"
        f" and Camera in {program}:4 has output `image`"
    ) in done.err


@PROGRAMS
@pytest.mark.parametrize("command", ["check", "run", "rti --listen 127.0.0.1:0"])
def test_a_missing_executable_is_one_error_of_every_command(
    camera: Path, tmp_path: Path, program: str, command: str
) -> None:
    camera.unlink()
    done = call(tmp_path, *command.split(), program)
    assert done.code == 1
    assert done.err.count("error") == 1, done.err
    assert f"error[LF1102]: there is no executable {camera}" in done.err
    assert "has it been built?" in done.err


WRONG = {
    "exit 3": "has exited with 3 when it was asked what it declares",
    "exit 0": "has ended without saying what it declares",
    'echo nonsense > "$HPRM_DESCRIBE"': "cannot be read: expected ident",
    "kill -9 $$": "was killed by signal 9",
}


@pytest.mark.parametrize("text", WRONG)
def test_an_executable_that_does_not_declare_itself_is_one_error(
    camera: Path, tmp_path: Path, text: str
) -> None:
    camera.write_text(f"#!/bin/sh\n{text}\n")
    done = call(tmp_path, "check", "Main.lf")
    assert done.code == 1
    assert done.err.count("error[LF1102]") == 1, done.err
    assert WRONG[text] in done.err


def test_a_file_that_is_not_executable_is_told_so(camera: Path, tmp_path: Path) -> None:
    camera.chmod(0o644)
    done = call(tmp_path, "check", "Main.lf")
    assert f"error[LF1102]: {camera} is not executable" in done.err


def test_an_executable_that_declares_a_federation_is_refused(camera: Path, tmp_path: Path) -> None:
    lone = reactor("Inner", [])
    child = {"name": "inner", "at": executables.AT, "members": [1]}
    main = {"name": "Camera", "at": executables.AT, "federated": True, "children": [child]}
    write(camera, document(main, lone))
    done = call(tmp_path, "check", "Main.lf")
    assert f"the executable {camera} declares a federation of its own" in done.err


def test_an_executable_that_is_a_program_of_its_own_is_refused(
    camera: Path, tmp_path: Path
) -> None:
    write(camera, document(reactor("Camera", [port("image")]), executable="program"))
    done = call(tmp_path, "check", "Main.lf")
    assert f"the executable {camera} declares a program of its own" in done.err


def test_a_cycle_through_an_executable_is_found_with_names(camera: Path, tmp_path: Path) -> None:
    ports = [port("image"), port("rate", "input")]
    camera_reactor = reactor("Camera", ports)
    camera_reactor["reactions"][0]["triggers"] = [{"name": "rate", "at": executables.AT}]
    write(camera, document(camera_reactor))
    text = MAIN.replace("output image\n", "output image\n  input rate\n")
    text = text.replace("  input image\n", "  input image\n  output rate\n")
    text = text.replace("reaction(image) {= pass =}", "reaction(image) -> rate {= rate.set(1) =}")
    text = text.replace(
        "camera.image -> detector.image",
        "camera.image -> detector.image\ndetector.rate -> camera.rate",
    )
    (tmp_path / "Main.lf").write_text(text)
    done = call(tmp_path, "check", "Main.lf")
    assert done.code == 1
    assert "error[LF0503]" in done.err
    assert "Main.camera.1 -> Main.detector.1" in done.err


@PROGRAMS
def test_the_findings_are_json_too(camera: Path, tmp_path: Path, program: str) -> None:
    write(camera, document(reactor("Camera", [port("depth")])))
    done = call(tmp_path, "check", "--json", program)
    codes = [json.loads(line)["code"] for line in done.out.splitlines()]
    assert codes == ["LF1103", "LF1103"]


@PROGRAMS
def test_an_executable_cannot_run_in_the_process_of_others(
    camera: Path, tmp_path: Path, program: str
) -> None:
    done = call(tmp_path, "run", "--in-process", program)
    assert done.code != 0
    assert done.err.count("error") == 1, done.err
    assert "the federate camera is an executable, and cannot run in this process" in done.err


@PROGRAMS
def test_an_executable_is_asked_once_for_a_run_and_all_its_federates(
    camera: Path, tmp_path: Path, program: str
) -> None:
    write(camera, document(CAMERA), "exit 9")
    done = call(tmp_path, "run", program)
    assert done.code != 0
    assert "federate camera" in done.err, done.err
    assert asked(camera) == 1


def test_an_executable_is_asked_once_by_a_check(camera: Path, tmp_path: Path) -> None:
    write(camera, document(CAMERA))
    done = call(tmp_path, "check", "Main.lf", "app.py")
    assert done.code == 0, done.err
    assert asked(camera) == 1


PYTHON_MISTAKES = {
    'executable=""': "`executable` is a list of texts",
    "executable=3": "`executable` is a path, or a list of a path and arguments, not 3",
    "executable=[]": "`executable` is a path, or a list of a path and arguments, not []",
    "executeable='x'": "did you mean `executable`?",
}


@pytest.mark.parametrize("stated", PYTHON_MISTAKES)
def test_a_wrong_keyword_in_python_is_told(camera: Path, tmp_path: Path, stated: str) -> None:
    (tmp_path / "app.py").write_text(APP.replace('executable=["bin/camera", "--fast"]', stated))
    done = call(tmp_path, "check", "app.py")
    assert done.code == 1
    assert PYTHON_MISTAKES[stated] in done.err, done.err


def test_an_executable_in_python_has_ports_only(camera: Path, tmp_path: Path) -> None:
    text = textwrap.dedent("""\
        image = hprm.Output()

            def __init__(self):
                self.inner = Detector()

            @hprm.reaction(hprm.startup, effects=[image])
            def start(self): ...
    """)
    app = APP.replace("image = hprm.Output()\n", text)
    (tmp_path / "app.py").write_text(app)
    done = call(tmp_path, "check", "app.py")
    assert done.code == 1
    assert "a contained reactor cannot be declared here" in done.err
    assert "a reaction cannot be declared here" in done.err


def test_a_class_in_another_file_may_be_inherited(camera: Path, tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    app, _, rest = APP.partition("class Detector")
    (tmp_path / "cameras.py").write_text(app)
    rest = rest.replace("Camera()", "Front()")
    text = (
        "import sys\nsys.path.insert(0, '..')\nimport hprm\nfrom cameras import Camera\n\n"
        "class Front(Camera): ...\n\nclass Detector"
    )
    (tmp_path / "sub" / "app.py").write_text(text + rest)
    done = call(tmp_path / "sub", "check", "app.py")
    assert done.code == 0, done.err
