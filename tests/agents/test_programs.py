"""Federates that `hprm run` starts on other machines do what they do on one."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import time
from pathlib import Path

import pytest
from machines import HPRM, PROGRAM, Machines, alone, finish, reactions

COORDINATIONS = ["centralized", "decentralized"]
ENDLESS = PROGRAM.replace("timeout: 200 msec", "timeout: 1000 sec")
AT = ["--at", "sink=robot2", "--fleet-key", "keys"]


def start(machines: Machines) -> None:
    """Starts agents that start programs; they make the file with the key."""
    machines.start_agents("--fleet-keys", "keys", "--allow-root")


def run(machines: Machines, program: str, *options: str) -> subprocess.Popen[str]:
    """Runs a program from the first machine."""
    (machines.folder / "Fed.lf").write_text(program)
    return machines.spawn("robot1", HPRM, "run", *options, "Fed.lf")


def left(machines: Machines) -> list[str]:
    """Processes that belong to programs of the test, and files of runs."""
    mark = f"HPRM_AGENT=unix:@{machines.address('robot')}".encode()
    found = []
    for process in Path("/proc").iterdir():
        try:
            command = (process / "cmdline").read_bytes().split(b"\0")
            is_mine = mark in (process / "environ").read_bytes()
        except OSError:
            continue
        if is_mine and not command[0].endswith(b"hprm-agent"):
            found.append(b" ".join(command).decode())
    return found + [str(path) for path in machines.folder.glob("cache-*/hprm/programs/runs/*")]


def nothing_is_left(machines: Machines) -> None:
    """Waits until nothing of the program is left."""
    until = time.monotonic() + 30
    while left(machines) and time.monotonic() < until:
        time.sleep(0.05)
    assert left(machines) == []


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_federates_on_another_machine_do_what_one_process_does(
    machines: Machines, coordination: str
) -> None:
    start(machines)
    options = ["--property", f"coordination={coordination}", "--logical-trace", "trace"]
    out, expected = alone(machines.folder, PROGRAM)
    said = "".join(f"[source] {line}\n" for line in out.splitlines())
    for at in (AT, ["--at", "source=robot2", *AT[2:]]):
        assert finish(run(machines, PROGRAM, *options, *at)) == (0, said, "")
        assert reactions([machines.folder / "trace"]) == expected
        nothing_is_left(machines)


def test_the_program_says_where_its_federates_run(machines: Machines) -> None:
    start(machines)
    program = PROGRAM.replace("source = new Source()", "source = new Source() at robot2")
    program = program.replace("print(len(", "import os; print(os.environ['HPRM_AGENT'], len(")
    code, out, err = finish(run(machines, program, *AT[2:]))
    assert (code, err) == (0, "")
    assert out.splitlines()[-1].split()[1] == f"unix:@{machines.address('robot2')}"


def test_modules_and_files_travel_and_those_that_are_there_do_not_again(machines: Machines) -> None:
    start(machines)
    (machines.folder / "lib").mkdir()
    (machines.folder / "lib" / "words.py").write_text("def word(): return 'from a module'\n")
    (machines.folder / "data.txt").write_text("from a file")
    program = """
target Python { files: ["data.txt"] }
preamble {=
import sys
import pathlib
sys.path.insert(0, str(pathlib.Path(__file__).parent))
from lib.words import word
=}
reactor Says { reaction(startup) {=
  print(word(), pathlib.Path(__file__).with_name("data.txt").read_text(), flush=True)
=} }
federated reactor { here = new Says()
  there = new Says() }
"""
    for _ in range(2):
        code, out, err = finish(run(machines, program, "--at", "there=robot2", *AT[2:]))
        assert (code, err) == (0, "")
        said = "from a module from a file"
        assert sorted(out.splitlines()) == [f"[here] {said}", f"[there] {said}"]
        kept = sorted((machines.folder / "cache-robot2/hprm/programs/files").iterdir())
        assert len(kept) == 3
    nothing_is_left(machines)


CAMERA = """\
#!/bin/sh
if [ -n "$HPRM_DESCRIBE" ]; then
  echo '{DECLARED}' > "$HPRM_DESCRIBE"
  exit 0
fi
echo "runs for $HPRM_AGENT in $0"
exit 9
"""


def test_executables_travel_and_end_as_elsewhere(machines: Machines) -> None:
    start(machines)
    at = [0, 1, 0, -1]
    out = {"name": "image", "at": at, "kind": "output", "width": None}
    effects = [{"name": "image", "at": at}]
    reaction = {"name": "shoots", "at": at, "triggers": ["startup"], "effects": effects}
    camera = {"name": "Camera", "at": at, "ports": [out], "reactions": [reaction]}
    declared = {"files": [{"path": "/a/camera", "text": ""}], "main": 0, "reactors": [camera]}
    (machines.folder / "bin").mkdir()
    path = machines.folder / "bin" / "camera"
    path.write_text(CAMERA.replace("{DECLARED}", json.dumps(declared)))
    path.chmod(0o755)
    program = """
target Python
@executable("bin/camera")
reactor Camera { output image }
reactor Sees { input image
  reaction(image) {= =} }
federated reactor { camera = new Camera()
  sees = new Sees()
  camera.image -> sees.image }
"""
    code, said, err = finish(run(machines, program, "--at", "camera=robot2", *AT[2:]))
    assert (code, err.count("error: ")) == (9, 1), err
    assert "error: federate camera exited with code 9" in err
    address = machines.address("robot2")
    line = re.fullmatch(rf"\[camera\] runs for unix:@{address} in (.*)\n", said)
    assert line and f"{machines.folder}/cache-robot2/hprm/programs/runs/" in line[1], said
    nothing_is_left(machines)


@pytest.mark.parametrize(
    "body, code, said",
    [("raise ValueError('no')", 1, "ValueError: no"), ("import os; os._exit(7)", 7, "exit")],
)
def test_what_fails_elsewhere_is_told_here(
    machines: Machines, body: str, code: int, said: str
) -> None:
    start(machines)
    program = PROGRAM.replace("answer.set(int(", f"{body}; answer.set(int(")
    found, _, err = finish(run(machines, program, *AT))
    assert (found, err.count("error: ")) == (code, 1), err
    assert said in err
    nothing_is_left(machines)


@pytest.mark.parametrize("victim", ["launcher", "federate", "agent", "stand-in", "starter"])
def test_a_killed_process_leaves_nothing_on_any_machine(machines: Machines, victim: str) -> None:
    start(machines)
    launcher = run(machines, ENDLESS, *AT)
    assert launcher.stdout is not None
    assert launcher.stdout.readline() == "[source] running\n"
    words = {"federate": "robot2", "stand-in": "stand-in", "starter": " starter "}
    if victim == "launcher":
        launcher.kill()
    elif victim == "agent":
        machines.agents["robot2"].kill()
    else:
        pids = [
            int(path.name)
            for path in Path("/proc").iterdir()
            if path.name.isdigit() and belongs(path, machines, words[victim], victim)
        ]
        assert pids
        os.kill(pids[0], signal.SIGKILL)
    code, _, err = finish(launcher)
    assert code != 0
    if victim != "launcher":
        assert err.count("error: ") == 1, err
    if victim not in ("starter", "agent"):
        nothing_is_left(machines)
        return
    # The files of a killed starter are removed by the next one.
    until = time.monotonic() + 30
    while any("cache-" not in it for it in left(machines)) and time.monotonic() < until:
        time.sleep(0.05)
    assert [it for it in left(machines) if "cache-" not in it] == []


def belongs(process: Path, machines: Machines, word: str, victim: str) -> bool:
    """Whether a process is such a one of the program."""
    try:
        command = (process / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        environment = (process / "environ").read_bytes().decode()
    except OSError:
        return False
    if machines.address("robot") not in environment:
        return False
    if victim == "federate":
        return " federate " in command and f"cache-{word}" in command
    return word in command and "hprm" in command


def test_ctrl_c_stops_in_order(machines: Machines) -> None:
    start(machines)
    launcher = run(machines, ENDLESS, *AT)
    assert launcher.stdout is not None
    assert launcher.stdout.readline() == "[source] running\n"
    launcher.send_signal(signal.SIGINT)
    code, out, err = finish(launcher)
    assert code == 130, err
    assert out.startswith("[source] ")
    nothing_is_left(machines)


def test_what_cannot_be_started_is_told_before_anything_runs(machines: Machines) -> None:
    code, _, err = finish(run(machines, PROGRAM, "--at", "sink=robot2"))
    assert code != 0 and "needs a fleet key" in err and "--fleet-key" in err
    (machines.folder / "keys").touch(mode=0o600)
    (machines.folder / "keys").write_text("0" * 31 + "1")
    code, _, err = finish(run(machines, PROGRAM, *AT))
    assert code == 1 and "no agent runs on this machine" in err
    start(machines)
    for at, said in [
        (["--at", "sink=robot9"], "no agent has that name; there are: robot1, robot2"),
        (["--at", "sinc=robot2"], "no federate is called sinc"),
        (["--at", "sink"], "write FEDERATE=MACHINE"),
        (["--at", "sink=robot2", "--in-process"], "cannot be used with"),
    ]:
        code, out, err = finish(run(machines, PROGRAM, *at, "--fleet-key", "keys"))
        assert (code != 0, out) == (True, ""), err
        assert err.count("error: ") == 1 and said in err, err


def test_a_key_that_cannot_be_read_is_told_even_if_no_federate_needs_it(
    machines: Machines, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = "error: cannot read fleet keys in nowhere: No such file or directory\n"
    alone = "target Python\nmain reactor { reaction(startup) {= print(7) =} }\n"
    elsewhere = PROGRAM.replace("source = new Source()", "source = new Source() at robot2")
    for program in (PROGRAM, alone, elsewhere):
        code, out, err = finish(run(machines, program, "--fleet-key", "nowhere"))
        assert (code, out, err) == (1, "", said)
    # The environment says it for all programs, of which few need one.
    monkeypatch.setenv("HPRM_FLEET_KEY", "nowhere")
    assert finish(run(machines, elsewhere)) == (1, "", said)
    assert finish(run(machines, alone)) == (0, "7\n", "")
    assert finish(run(machines, PROGRAM))[0] == 0


def test_what_is_only_done_here_is_told_of_federates_elsewhere(machines: Machines) -> None:
    start(machines)
    program = PROGRAM.replace("source = new Source()", "source = new Source() at robot2")
    code, out, err = finish(run(machines, program, "--debug", "source", *AT[2:]))
    assert (code != 0, out, err.count("error: ")) == (True, "", 1), err
    assert "--debug: the federate source is to run on robot2, without a terminal" in err


def test_only_those_with_a_key_start_programs(machines: Machines) -> None:
    start(machines)
    other = machines.folder / "other"
    other.write_text("0123456789abcdef" * 2)
    other.chmod(0o600)
    at = ["--at", "sink=robot2", "--fleet-key", "other"]
    code, out, err = finish(run(machines, PROGRAM, *at))
    assert (code, out, err.count("error: ")) == (1, "", 1)
    assert "robot2 does not know the fleet key" in err
    # Once its line is in the file, it counts; without it, no more.
    keys = machines.folder / "keys"
    ours = keys.read_text()
    keys.write_text(ours + other.read_text() + " ada\n")
    assert finish(run(machines, PROGRAM, *at))[0] == 0
    keys.write_text(ours)
    code, _, err = finish(run(machines, PROGRAM, *at))
    assert code == 1 and "robot2 does not know the fleet key" in err
    other.chmod(0o644)
    code, _, err = finish(run(machines, PROGRAM, *at))
    assert code == 1 and "others can read the fleet keys" in err
    nothing_is_left(machines)


@pytest.mark.parametrize(
    "options, said",
    [([], "starts no programs: start it with --fleet-keys"), (["--fleet-keys", "keys"], "as root")],
)
def test_an_agent_starts_programs_only_if_it_was_told(
    machines: Machines, options: list[str], said: str
) -> None:
    if options and os.geteuid() != 0:
        pytest.skip("it is about root")
    machines.start_agents(*options)
    (machines.folder / "keys").touch(mode=0o600)
    (machines.folder / "keys").write_text("0" * 31 + "1")
    code, out, err = finish(run(machines, PROGRAM, *AT))
    assert (code, out, err.count("error: ")) == (1, "", 1)
    assert said in err, err


def test_a_machine_with_another_version_is_one_error(machines: Machines) -> None:
    known = [
        {"name": name, "is_here": name == "robot1", "about": ABOUT, "clock": None}
        for name in ("robot1", "robot2")
    ]
    challenge = bytes([0, 1]) + bytes(32)
    answers = {
        "machines": b"done robot1\n" + json.dumps(known).encode(),
        "connect": b"done robot2\n" + len(challenge).to_bytes(4, "little") + challenge,
    }
    (machines.folder / "keys").touch(mode=0o600)
    (machines.folder / "keys").write_text("0" * 31 + "1")
    with socket.socket(socket.AF_UNIX) as agent:
        agent.bind("\0" + machines.address("robot1"))
        agent.listen()
        launcher = run(machines, PROGRAM, *AT)
        for _ in answers:
            link, _ = agent.accept()
            machines.sockets.append(link)
            word = link.makefile().readline().split()[1]
            link.sendall(answers[word])
            if word == "machines":
                link.close()
        code, out, err = finish(launcher)
    assert (code, out, err.count("error: ")) == (1, "", 1), err
    assert "robot2 has another version of HPRM than this machine\n" in err
    assert "hint: install the same version on both" in err


ABOUT = {"version": "0", "addresses": [], "processors": 1, "memory": 1, "federations": []}
