"""``hprm.run`` from scripts and notebooks: one process, federations, what has to be importable."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import termios
import textwrap
import time
from pathlib import Path

import nbclient
import nbformat
import pytest
from processes import ANOTHER_SIGNAL_S

from hprm import _launching

VISION = """
import sys
import hprm

class Camera(hprm.Reactor):
    image = hprm.Output(int)
    tick = hprm.Timer("10 ms")

    def __init__(self, first: int) -> None:
        self.count = first

    @hprm.reaction(tick, effects=[image])
    def capture(self) -> None:
        self.image.set(self.count)
        self.count += 1

class Detector(hprm.Reactor):
    image = hprm.Input(int)

    @hprm.reaction(image)
    def detect(self) -> None:
        print("saw", self.image.value, flush=True)

class Vision(hprm.{kind}, timeout="20 ms"):
    def __init__(self, first: int = 0) -> None:
        self.camera, self.detector = Camera(first), Detector()
        hprm.connect(self.camera.image, self.detector.image)
"""
FEDERATION = VISION.format(kind="Federation")
WHOLE = VISION.format(kind="Reactor")


def script(tmp_path: Path, text: str, *, code: int = 0) -> tuple[list[str], str]:
    """Run a script. Return the lines of its output, and its errors."""
    path = tmp_path / "vision.py"
    path.write_text(text)
    done = subprocess.run(
        [sys.executable, path.name], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == code, done.stderr
    return done.stdout.splitlines(), done.stderr


def test_a_program_runs_in_the_process_of_its_script(tmp_path: Path) -> None:
    text = WHOLE + "print('before', flush=True)\nhprm.run(Vision(7))\nprint('after')\n"
    out, err = script(tmp_path, text)
    assert out == ["before", "saw 7", "saw 8", "saw 9", "after"]
    assert not err


def test_it_runs_twice(tmp_path: Path) -> None:
    out, _ = script(tmp_path, WHOLE + "for first in (1, 5):\n    hprm.run(Vision(first))\n")
    assert out == ["saw 1", "saw 2", "saw 3", "saw 5", "saw 6", "saw 7"]


def test_the_federates_of_a_script_are_processes(tmp_path: Path) -> None:
    text = FEDERATION + (
        "if __name__ == '__main__':\n"
        "    print('main', flush=True)\n"
        "    hprm.run(Vision(first=4))\n"
        "    print('after')\n"
    )
    out, err = script(tmp_path, text)
    assert out == ["main", *(f"[detector] saw {n}" for n in (4, 5, 6)), "after"], err


def test_arguments_may_be_of_classes_of_the_script(tmp_path: Path) -> None:
    settings = "from dataclasses import dataclass\n\n@dataclass\nclass Settings:\n    first: int\n"
    text = settings + FEDERATION.replace("first: int = 0", "settings: Settings")
    text = text.replace("Camera(first), Detector()", "Camera(settings.first), Detector()")
    text += "if __name__ == '__main__':\n    hprm.run(Vision(Settings(5)))\n"
    assert script(tmp_path, text)[0] == [f"[detector] saw {n}" for n in (5, 6, 7)]


def test_a_federation_in_a_package_runs(tmp_path: Path) -> None:
    package = tmp_path / "robot"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "reactors.py").write_text(FEDERATION)
    (package / "program.py").write_text(
        "import hprm\nfrom .reactors import Camera, Detector\n\n"
        "class Robot(hprm.Federation, timeout='20 ms'):\n"
        "    def __init__(self) -> None:\n"
        "        self.camera, self.detector = Camera(2), Detector()\n"
        "        hprm.connect(self.camera.image, self.detector.image)\n\n"
        "if __name__ == '__main__':\n    hprm.run(Robot())\n"
    )
    hprm = str(Path(sys.executable).with_name("hprm"))
    for command in (
        [sys.executable, "-m", "robot.program"],
        [hprm, "run", "robot/program.py"],
        [hprm, "run", "--in-process", "robot/program.py"],
    ):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        assert done.stdout.splitlines() == [f"[detector] saw {n}" for n in (2, 3, 4)]


def test_programs_that_bodies_start_do_not_get_the_arguments(tmp_path: Path) -> None:
    (tmp_path / "other.py").write_text(
        "import hprm\nclass Other(hprm.Reactor):\n    @hprm.reaction(hprm.startup)\n"
        "    def begin(self):\n        print('other', flush=True)\n"
    )
    start = "import subprocess; subprocess.run([sys.executable, '-m', 'hprm', 'run', 'other.py'])"
    text = FEDERATION.replace('print("saw"', f'{start}; print("saw"')
    text += "if __name__ == '__main__':\n    hprm.run(Vision(4), timeout='0 s')\n"
    assert script(tmp_path, text)[0] == ["[detector] other", "[detector] saw 4"]


def test_without_a_guard_the_script_is_told_to_have_one(tmp_path: Path) -> None:
    out, err = script(tmp_path, FEDERATION + "hprm.run(Vision())\n", code=1)
    assert not out
    assert "hprm.run was called while" in err and "if __name__" in err


def test_a_federation_in_one_process(tmp_path: Path) -> None:
    text = FEDERATION + "hprm.run(Vision(), processes=False)\n"
    assert script(tmp_path, text)[0] == ["saw 0", "saw 1", "saw 2"]


def test_a_federation_in_a_function_cannot_be_imported(tmp_path: Path) -> None:
    inside = textwrap.indent(FEDERATION, "    ")
    text = f"def make():{inside}\n    return Vision\nimport hprm\nhprm.run(make()())\n"
    _, err = script(tmp_path, text, code=1)
    assert "processes that import it, and it is defined in a function" in err
    assert "processes=False" in err


def test_a_failure_ends_the_script_with_the_exit_code(tmp_path: Path) -> None:
    text = WHOLE.replace('print("saw"', 'raise ValueError("saw"') + "hprm.run(Vision())\n"
    out, err = script(tmp_path, text.replace(", flush=True", ""), code=1)
    assert not out
    assert "raised ValueError: ('saw', 0)" in err
    assert "vision.py:22" in err
    assert "_launching" not in err and "SystemExit" not in err


@pytest.mark.parametrize(
    ("right", "wrong", "code"),
    [
        ('Timer("10 ms")', 'Timer("10 foo")', "LF0403"),
        ('Timer("10 ms")', "Timer(lambda self: self.perid)", "LF1008"),
        ("hprm.connect(self.camera.image, ", "hprm.connect(self.detector.image, ", "LF0305"),
    ],
)
def test_a_mistake_is_shown_as_the_command_shows_it(
    tmp_path: Path, right: str, wrong: str, code: str
) -> None:
    text = WHOLE.replace(right, wrong) + 'if __name__ == "__main__":\n    hprm.run(Vision())\n'
    out, err = script(tmp_path, text, code=1)
    command = str(Path(sys.executable).with_name("hprm"))
    told = subprocess.run(
        [command, "run", "vision.py"], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert not out and err.startswith(f"error[{code}]: ")
    assert (err, 1) == (told.stderr, told.returncode)


@pytest.mark.parametrize("closed", [0, 1, 2])
def test_a_federation_runs_without_a_standard_stream(tmp_path: Path, closed: int) -> None:
    text = FEDERATION.replace("print(", "open('seen', 'a').write(f'{self.image.value} ') or print(")
    (tmp_path / "vision.py").write_text(
        text + "if __name__ == '__main__':\n    hprm.run(Vision())\n"
    )
    done = subprocess.run(
        ["/bin/sh", "-c", f"exec {sys.executable} vision.py {closed}>&-"],
        cwd=tmp_path,
        capture_output=True,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert (tmp_path / "seen").read_text() == "0 1 2 "


#: It has been declared although its command was asked to stop meanwhile.
DEAF = """
import os, signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
os.kill(os.getppid(), signal.SIGINT)
time.sleep(0.3)
"""


@pytest.mark.parametrize("command", ["run", "check", "diagram"])
def test_ctrl_c_while_a_program_is_declared_is_not_lost(tmp_path: Path, command: str) -> None:
    (tmp_path / "vision.py").write_text(DEAF + FEDERATION)
    done = subprocess.run(
        [str(Path(sys.executable).with_name("hprm")), command, "vision.py"],
        cwd=tmp_path,
        capture_output=True,
        timeout=60,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, b"", b"")


def test_ctrl_c_in_an_import_is_no_error_of_the_program(tmp_path: Path) -> None:
    text = (
        "import os, signal\n"
        "try:\n    os.kill(os.getpid(), signal.SIGINT)\n    [...] * 1\n"
        "except KeyboardInterrupt:\n    raise TypeError('expected a message argument') from None\n"
    )
    (tmp_path / "vision.py").write_text(text + WHOLE)
    done = subprocess.run(
        [str(Path(sys.executable).with_name("hprm")), "run", "vision.py"],
        cwd=tmp_path,
        capture_output=True,
        timeout=60,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, b"", b"")


def test_ctrl_c_before_the_command_runs_is_forwarded() -> None:
    def start() -> subprocess.Popen[bytes]:
        os.kill(os.getpid(), signal.SIGINT)
        return subprocess.Popen(["sleep", "60"])

    assert _launching._wait(start) == 130


def test_other_errors_are_shown_as_python_shows_them(tmp_path: Path) -> None:
    _, err = script(tmp_path, WHOLE + "hprm.run(1 / 0)\n", code=1)
    assert err.startswith("Traceback") and err.endswith("ZeroDivisionError: division by zero\n")
    hook = "import sys\nsys.excepthook = lambda *_: print('mine')\n"
    out, err = script(tmp_path, hook + WHOLE.replace('"10 ms"', '"10 foo"'), code=1)
    assert (out, err) == (["mine"], ""), "a hook that is there stays"


@pytest.mark.filterwarnings("ignore")
def test_cells_of_a_notebook_define_and_run_programs(tmp_path: Path) -> None:
    cells = [WHOLE, "hprm.run(Vision(first=3))", "hprm.run(Vision(first=6))"]
    cells.append(FEDERATION + "hprm.run(Vision(1), processes=False)")
    cells.append(
        "try:\n    hprm.run(Vision())\nexcept hprm.ProgramError as error:\n    print(error.message)"
    )
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(it) for it in cells])
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3").execute(cwd=str(tmp_path))
    printed = [
        "".join(it["text"] for it in cell["outputs"] if it["output_type"] == "stream")
        for cell in notebook.cells
    ]
    assert printed[1:4] == [
        "saw 3\nsaw 4\nsaw 5\n",
        "saw 6\nsaw 7\nsaw 8\n",
        "saw 1\nsaw 2\nsaw 3\n",
    ]
    assert "it is in no file" in printed[4]


def has_ended(pid: int) -> bool:
    """Whether a process has ended; its parent may not have waited for it yet."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return True
    return stat.rpartition(")")[2].split()[0] in "ZX"


ENDLESS = """
import os
import hprm

class Endless(hprm.Reactor):
    tick = hprm.Timer("10 ms")

    @hprm.reaction(hprm.startup)
    def begin(self):
        print(os.getpid(), os.getppid(), flush=True)

    @hprm.reaction(tick)
    def go_on(self):
        pass

class Main(hprm.Federation):
    def __init__(self):
        self.endless = Endless()

if __name__ == "__main__":
    hprm.run(Main())
"""


def started(process: subprocess.Popen[str]) -> list[int]:
    """The processes of a script that runs that: of the federate, and of the command."""
    assert process.stdout is not None
    line = process.stdout.readline()
    pids = [int(it) for it in line.removeprefix("[endless] ").split()]
    assert len(pids) == 2
    return pids


def assert_ended(pids: list[int]) -> None:
    deadline = time.monotonic() + 60
    while not all(map(has_ended, pids)):
        assert time.monotonic() < deadline, "processes are left behind"
        time.sleep(0.01)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_signal_to_the_script_alone_ends_its_federates(tmp_path: Path, number: int) -> None:
    program = tmp_path / "program.py"
    program.write_text(ENDLESS)
    script = subprocess.Popen(
        [sys.executable, str(program)], stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    pids = started(script)
    script.send_signal(number)
    script.communicate(timeout=60)
    assert_ended(pids)


@pytest.mark.parametrize("way", ["ctrl-c", "kill"])
def test_a_script_in_the_foreground_is_interrupted_once(tmp_path: Path, way: str) -> None:
    program = tmp_path / "program.py"
    program.write_text(ENDLESS)
    ours, theirs = os.openpty()
    script = subprocess.Popen(
        [sys.executable, str(program)],
        stdin=theirs,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    )
    pids = started(script)
    if way == "kill":
        script.send_signal(signal.SIGINT)
    else:
        os.write(ours, b"\x03")
    _, err = script.communicate(timeout=60)
    for end in (ours, theirs):
        os.close(end)
    # It has stopped in order, and was not killed.
    assert (script.returncode, err) == (130, "")
    assert_ended(pids)


def test_a_script_is_never_ended_by_force(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text("""
import ctypes
import hprm

class Main(hprm.Reactor):
    @hprm.reaction(hprm.startup)
    def begin(self):
        print("begun", flush=True)
        # It holds the interpreter, for longer than `hprm run` would wait.
        ctypes.PyDLL(None).sleep(3)
        ctypes.PyDLL(None).sleep(3)

try:
    hprm.run(Main())
except (hprm.ProgramFailed, KeyboardInterrupt) as error:
    print("goes on after", type(error).__name__)
""")
    script = subprocess.Popen(
        [sys.executable, str(program)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert script.stdout is not None
    assert script.stdout.readline() == "begun\n"
    script.send_signal(signal.SIGTERM)
    time.sleep(ANOTHER_SIGNAL_S)
    script.send_signal(signal.SIGTERM)
    out, err = script.communicate(timeout=60)
    assert (script.returncode, out) == (0, "goes on after ProgramFailed\n"), err


@pytest.mark.parametrize("processes", [True, False])
def test_a_script_learns_what_has_failed(tmp_path: Path, processes: bool) -> None:
    program = tmp_path / "program.py"
    program.write_text(f"""
import hprm

class Camera(hprm.Reactor):
    @hprm.reaction(hprm.startup)
    def open(self):
        raise OSError("no device")

class Vision(hprm.Federation):
    def __init__(self):
        self.camera = Camera()

if __name__ == "__main__":
    try:
        hprm.run(Vision(), processes={processes})
    except hprm.ProgramFailed as error:
        print(error.code, error.kind, error.federate, error.reaction, error.tag, error.place)
        print(error, error.details is not None)
""")
    done = subprocess.run(
        [sys.executable, str(program)], capture_output=True, text=True, timeout=60, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.splitlines()
    federate = "camera" if processes else None
    assert first == f"1 reaction {federate} Vision.camera.open (0, 0) program.py:7"
    before = "federate camera: " if processes else ""
    assert second == f"{before}reaction Vision.camera.open raised OSError: no device True"
    # It is told as well.
    assert "raised OSError: no device" in done.stderr


@pytest.mark.parametrize("kind", ["Federation", "Reactor"])
def test_a_warning_of_a_script_is_told_once(tmp_path: Path, kind: str) -> None:
    text = VISION.format(kind=kind).replace("        hprm.connect", "        # hprm.connect")
    _, err = script(tmp_path, text + "if __name__ == '__main__':\n    hprm.run(Vision())\n")
    assert err.count("warning[LF0505]: nothing is connected to `detector.image`") == 1, err
