"""The command ``hprm``: what it answers, and how it runs programs that end well."""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
import subprocess
import sys
import uuid
from collections.abc import Callable
from pathlib import Path

import pytest

Answer = subprocess.CompletedProcess[str]
Hprm = Callable[..., Answer]

PROGRAM = """\
target Python { timeout: 20 msec }
preamble {=
import sys
=}
main reactor {
  timer t(0, 10 msec)
  reaction(t) {=
    print("tick", *sys.argv[1:])
  =}
}
"""

FEDERATION = """\
target Python { coordination: centralized, timeout: 50 msec }
preamble {=
import sys
=}
reactor Source {
  output out
  timer t(0, 10 msec)
  state count = 0
  reaction(t) -> out {=
    self.count += 1
    out.set(self.count)
  =}
}
reactor Sink {
  input inp
  reaction(inp) {=
    print(inp.value, *sys.argv[1:])
    print("noted", file=sys.stderr)
  =}
}
federated reactor {
  source = new Source()
  sink = new Sink()
  source.out -> sink.inp
}
"""


def command() -> str:
    """The command that is installed beside this interpreter."""
    found = shutil.which("hprm", path=str(Path(sys.executable).parent))
    assert found is not None, "make build puts hprm beside python"
    return found


@pytest.fixture
def hprm(tmp_path: Path) -> Hprm:
    def run(*arguments: str, **environment: str) -> Answer:
        return subprocess.run(
            [command(), *arguments],
            cwd=tmp_path,
            env=os.environ | environment,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )

    (tmp_path / "Main.lf").write_text(PROGRAM)
    (tmp_path / "Fed.lf").write_text(FEDERATION)
    return run


def test_it_has_a_version_and_help(hprm: Hprm) -> None:
    assert hprm("--version").stdout.startswith("hprm ")
    for words in [["--help"], ["run", "--help"], ["federate", "--help"]]:
        answer = hprm(*words)
        assert answer.returncode == 0
        assert "Example" in answer.stdout


@pytest.mark.parametrize("words", [[], ["dance"], ["run"], ["check", "--loudly", "Main.lf"]])
def test_wrong_usage_has_exit_code_two(hprm: Hprm, words: list[str]) -> None:
    answer = hprm(*words)
    assert answer.returncode == 2
    assert "Usage:" in answer.stderr
    assert answer.stdout == ""


def test_the_doctor_finds_this_installation_well(hprm: Hprm) -> None:
    answer = hprm("doctor", "--json")
    findings = {line["subject"]: line for line in map(json.loads, answer.stdout.splitlines())}
    bad = [finding for finding in findings.values() if finding["health"] == "bad"]
    assert (answer.returncode, bad) == (0, [])
    assert str(Path(sys.executable).parent) in findings["python"]["text"]


def test_check_is_content_and_says_so(hprm: Hprm) -> None:
    answer = hprm("check", "Main.lf", "Fed.lf")
    assert (answer.returncode, answer.stderr) == (0, "")
    assert answer.stdout == "2 programs checked: no errors, no warnings\n"


def test_check_gives_json_to_programs(hprm: Hprm, tmp_path: Path) -> None:
    wrong = PROGRAM.replace("timer t(0, 10 msec)", "timer t(0, 10 parsec)")
    (tmp_path / "Wrong.lf").write_text(wrong)
    answer = hprm("check", "--json", "Main.lf", "Wrong.lf")
    assert (answer.returncode, answer.stderr) == (1, "")
    diagnostics = [json.loads(line) for line in answer.stdout.splitlines()]
    assert [diagnostic["severity"] for diagnostic in diagnostics] == ["error"]
    [diagnostic] = diagnostics
    assert "parsec" in diagnostic["message"]
    assert (diagnostic["at"]["file"], diagnostic["at"]["line"]) == ("Wrong.lf", 6)


BODIES = """\
target Python
import Lib from "Lib.lf"
preamble {=
  import os
  def broken(:
    pass
=}
reactor Child(p = {= 1 + =}) {
  input i
  state s = {= [1,
    2 3] =}
  method double(n) {= return 2 n =}
  method steps() {= yield 1 =}
  reaction(i) {=
    for n in self.steps():
      print(n)
    yield n
  =} deadline(1 ms) {= break =}
}
main reactor {
  timer t
  child = new Child(p = {= ] =})
  lib = new Lib()
  reaction(t) -> child.i {=
    double = lambda: (yield)
    def fine():
      yield 1
    # nothing else
  =}
  reaction(t) {= \u00e4\u00f6 = 1; return 1 +; =}
}
"""


def test_check_looks_into_bodies(hprm: Hprm, tmp_path: Path) -> None:
    (tmp_path / "Bodies.lf").write_text(BODIES)
    lib = "target Python\nreactor Lib { reaction(startup) {= if =} }\n"
    (tmp_path / "Lib.lf").write_text(lib)
    answer = hprm("check", "--json", "Main.lf", "Bodies.lf")
    assert (answer.returncode, answer.stderr) == (1, "")
    mistakes = [json.loads(line) for line in answer.stdout.splitlines()]
    assert {mistake["code"] for mistake in mistakes} == {"LF1001"}
    places = [(mistake["at"]["file"], mistake["at"]["line"]) for mistake in mistakes]
    lines = [5, 8, 11, 12, 17, 18, 22, 30]
    assert places == [("Bodies.lf", line) for line in lines] + [("Lib.lf", 2)]
    columns = [mistake["at"]["column"] for mistake in mistakes]
    assert (columns[4], columns[7]) == (5, 32)
    assert "never runs" in mistakes[4]["message"]
    text = hprm("check", "Bodies.lf")
    assert text.stdout == "1 program checked: 9 errors, no warnings\n"
    assert " --> Bodies.lf:5:14\n  |\n5 |   def broken(:\n" in text.stderr
    answer = hprm("check", "--no-bodies", "Bodies.lf")
    assert (answer.returncode, answer.stderr) == (0, "")


def test_check_takes_files_to_import(hprm: Hprm, tmp_path: Path) -> None:
    (tmp_path / "Lib.lf").write_text("target Python\nreactor Lib { reaction(startup) {= if =} }\n")
    answer = hprm("check", "Lib.lf")
    assert answer.returncode == 1
    assert answer.stdout == "1 program checked: 1 error, no warnings\n"
    assert " --> Lib.lf:2:" in answer.stderr
    (tmp_path / "Lib.lf").write_text(
        "target Python\nreactor Lib { reaction(startup) {= pass =} }\n"
    )
    assert hprm("check", "Lib.lf").stdout == "1 program checked: no errors, no warnings\n"
    assert hprm("run", "Lib.lf").returncode == 1


def test_check_gives_json_of_files_that_are_no_programs(hprm: Hprm, tmp_path: Path) -> None:
    (tmp_path / "Bytes.lf").write_bytes(b"target Python\n\xff")
    answer = hprm("check", "--json", "Bytes.lf", "Nowhere.lf", "Main.lf")
    assert (answer.returncode, answer.stderr) == (1, "")
    found = [json.loads(line) for line in answer.stdout.splitlines()]
    assert [error["at"]["file"] for error in found] == ["Bytes.lf", "Nowhere.lf"]
    assert {error["code"] for error in found} == {"LF0101"}
    assert "line 2 is not UTF-8 text" in found[0]["message"]


def test_colour_is_for_terminals(hprm: Hprm, tmp_path: Path) -> None:
    (tmp_path / "Wrong.lf").write_text("target Python\nmain reactor {")
    answer = hprm("check", "Wrong.lf", TERM="xterm-256color")
    assert answer.returncode == 1
    assert "\x1b" not in answer.stdout + answer.stderr


def test_a_program_is_run_with_its_arguments(hprm: Hprm) -> None:
    answer = hprm("run", "Main.lf", "--", "--rounds", "3")
    assert (answer.returncode, answer.stderr) == (0, "")
    assert answer.stdout == "tick --rounds 3\n" * 3


@pytest.mark.parametrize("coordination", ["centralized", "decentralized"])
def test_federates_speak_behind_their_names(hprm: Hprm, tmp_path: Path, coordination: str) -> None:
    (tmp_path / "Fed.lf").write_text(FEDERATION.replace("centralized", coordination))
    answer = hprm("run", "Fed.lf", "--", "--verbose")
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.splitlines() == [f"[sink] {count} --verbose" for count in range(1, 7)]
    assert answer.stderr.splitlines() == ["[sink] noted"] * 6


def test_a_host_elsewhere_is_not_passed_over(hprm: Hprm, tmp_path: Path) -> None:
    program = FEDERATION.replace("sink = new Sink()", "sink = new Sink() at 192.0.2.1:15045;")
    program = program.replace("source = new Source()", "source = new Source() at localhost;")
    (tmp_path / "Fed.lf").write_text(program)
    answer = hprm("run", "Fed.lf")
    assert (answer.returncode, answer.stdout) == (1, "")
    assert answer.stderr.count("error[LF0804]") == 1
    said = "federate `sink` is to run at `192.0.2.1:15045`, which is not this machine"
    assert said in answer.stderr
    assert hprm("check", "Fed.lf").stderr == ""
    # Where it is to run instead is said in words.
    for options in (["--at", "sink=localhost"], ["--in-process"]):
        answer = hprm("run", *options, "Fed.lf")
        assert (answer.returncode, answer.stderr.count("LF0804")) == (0, 0), answer.stderr
        assert "[sink] 6" in answer.stdout


def test_an_rti_elsewhere_is_started_here_with_a_warning(hprm: Hprm, tmp_path: Path) -> None:
    program = FEDERATION.replace("federated reactor", "federated reactor at rti.example")
    (tmp_path / "Fed.lf").write_text(program)
    answer = hprm("run", "Fed.lf")
    assert (answer.returncode, answer.stderr.count("warning[LF0805]")) == (0, 1), answer.stderr
    assert "the RTI is to run at `rti.example`" in answer.stderr


def test_a_property_of_the_command_line_outdoes_that_of_the_file(hprm: Hprm) -> None:
    answer = hprm("run", "--property", "timeout=30 ms", "Main.lf")
    assert (answer.returncode, answer.stdout) == (0, "tick\n" * 4), answer.stderr
    answer = hprm("run", "--property=timeout=20 ms", "--property=logging=warn", "Fed.lf")
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.splitlines() == [f"[sink] {count}" for count in range(1, 4)]
    answer = hprm("run", "--property", "timeout=soon", "Fed.lf")
    assert answer.returncode == 1
    assert "`timeout` must be a time" in answer.stderr


def test_output_need_not_be_text(hprm: Hprm, tmp_path: Path) -> None:
    body = r'sys.stdout.buffer.write(b"\xff\xfe no end"); sys.stdout.flush()'
    program = FEDERATION.replace('print("noted", file=sys.stderr)', body)
    (tmp_path / "Fed.lf").write_text(program)
    done = subprocess.run(
        [command(), "run", "Fed.lf"], cwd=tmp_path, capture_output=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(b"[sink] 1\n[sink] \xff\xfe no end2\n")
    assert done.stdout.endswith(b"\xff\xfe no end\n")


def by_hand(folder: Path, text: str) -> list[subprocess.Popen[str]]:
    """Start the RTI of a federation, its sink and its source."""
    (folder / "Fed.lf").write_text(text)
    address = f"unix:@hprm-test-{uuid.uuid4().hex}"

    def start(*arguments: str, **environment: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [command(), *arguments],
            cwd=folder,
            env=os.environ | environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    rti = start("rti", "Fed.lf", "--listen", address)
    assert rti.stdout is not None
    assert rti.stdout.readline() == f"listening at {address}\n"
    word, federation = rti.stdout.readline().split()
    assert (word, len(federation)) == ("federation", 32)
    return [rti] + [
        start("federate", "Fed.lf", name, "--rti", address, HPRM_FEDERATION_ID=federation)
        for name in ["sink", "source"]
    ]


ENDLESS = """\
target Python
reactor Source {
  output out
  timer t(0, 10 ms)
  reaction(t) -> out {= out.set(1) =}
}
reactor Sink {
  input inp
  reaction(inp) {= print("here", flush=True) =}
}
federated reactor {
  source = new Source()
  sink = new Sink()
  source.out -> sink.inp
}
"""


def test_a_federate_that_ends_because_of_another_says_so(tmp_path: Path) -> None:
    rti, sink, source = by_hand(tmp_path, ENDLESS)
    assert sink.stdout is not None
    assert sink.stdout.readline() == "here\n"
    source.kill()
    _, err = sink.communicate(timeout=60)
    reason = "error: the process of federate source ended before its last tag"
    assert (sink.returncode, err) == (1, f"{reason}, so all end\n")
    _, err = rti.communicate(timeout=60)
    assert (rti.returncode, err) == (1, f"{reason}\n")
    source.communicate(timeout=60)


def test_a_federation_is_started_by_hand(tmp_path: Path) -> None:
    rti, *federates = by_hand(tmp_path, FEDERATION)
    outcomes = [(*process.communicate(timeout=60), process.returncode) for process in federates]
    numbers = "".join(f"{count}\n" for count in range(1, 7))
    assert outcomes == [(numbers, "noted\n" * 6, 0), ("", "", 0)]
    out, err = rti.communicate(timeout=60)
    assert (rti.returncode, err) == (0, "")
    assert sorted(out.splitlines()) == [
        "federate sink joined",
        "federate source joined",
        "the federation starts",
    ]


def test_an_rti_is_open_to_the_network_only_with_a_secret(hprm: Hprm) -> None:
    answer = hprm("rti", "Fed.lf", "--listen", "0.0.0.0:0")
    assert answer.returncode == 1
    assert "no secret" in answer.stderr
    assert "hint: " in answer.stderr
    assert "--federation-file" in answer.stderr


def test_an_address_that_cannot_be_used_says_why_and_what_to_do(hprm: Hprm, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, socket.socket(socket.AF_UNIX) as left:
        left.bind(str(tmp_path / "left"))
        port = taken.getsockname()[1]
        for address, reason, cure in (
            (f"tcp:127.0.0.1:{port}", "Address already in use", "`ss -ltnxp` names it"),
            (f"unix:{tmp_path}/left", "Address already in use", "remove it then"),
        ):
            answer = hprm("rti", "Fed.lf", "--listen", address)
            assert answer.returncode == 1
            assert f"error: the RTI cannot listen at {address}: {reason}" in answer.stderr
            assert re.search(f"hint: .*{re.escape(cure)}", answer.stderr), answer.stderr
            assert answer.stderr.count("error: ") == 1
        # An address of documentation, which no machine has.
        secret = tmp_path / "secret"
        secret.write_text("0123456789abcdef0123456789abcdef")
        secret.chmod(0o600)
        words = ["--listen", "192.0.2.1:0", "--federation-file", str(secret)]
        answer = hprm("rti", "Fed.lf", *words)
        assert "Cannot assign requested address" in answer.stderr
        assert "`ip address` lists" in answer.stderr


PARAMETERS = """\
target Python { timeout: 1 sec, fast: true }
main reactor(rate = 2, period = 500 msec, frame_size = "vga", loud = false) {
  timer t(0, period)
  reaction(t) {= print(lf.time.logical_elapsed(), self.rate, self.frame_size, self.loud) =}
}
"""


def test_parameters_of_the_main_reactor_are_options(hprm: Hprm, tmp_path: Path) -> None:
    (tmp_path / "Main.lf").write_text(PARAMETERS)
    answer = hprm("run", "--loud", "true", "Main.lf", "--rate=30", "--period", "1", "sec")
    assert (answer.returncode, answer.stderr) == (0, "")
    assert answer.stdout == "0 30 vga True\n1000000000 30 vga True\n"
    answer = hprm("run", "Main.lf", "--timeout", "0", "sec", "--frame-size", "a b")
    assert answer.stdout == "0 2 a b False\n", answer.stderr


def test_parameters_reach_every_federate(hprm: Hprm, tmp_path: Path) -> None:
    text = FEDERATION.replace("reactor Source {", "reactor Source(first = 0) {")
    text = text.replace("state count = 0", "state count = first").replace("50 msec", "0 msec")
    text = text.replace("federated reactor {", "federated reactor(first = 7) {")
    (tmp_path / "Fed.lf").write_text(text.replace("new Source()", "new Source(first = first)"))
    for words in [[], ["--in-process"]]:
        answer = hprm("run", *words, "Fed.lf", "--first", "40", "x", "--", "--last")
        assert answer.returncode == 0, answer.stderr
        assert "41 x --last" in answer.stdout
    answer = hprm("verify", "--runs", "3", "Fed.lf", "--first", "40")
    assert answer.returncode == 0, answer.stdout + answer.stderr


def test_the_help_of_a_program_shows_its_parameters(hprm: Hprm, tmp_path: Path) -> None:
    (tmp_path / "Main.lf").write_text(PARAMETERS)
    answer = hprm("run", "Main.lf", "--help")
    assert answer.returncode == 0
    assert "Parameters of the program:" in answer.stdout
    assert "--period <TIME>" in answer.stdout
    assert "[default: 500 ms]" in answer.stdout
    assert "Parameters of the program" not in hprm("run", "--help").stdout


def test_a_wrong_value_of_a_parameter_is_a_diagnostic(hprm: Hprm, tmp_path: Path) -> None:
    (tmp_path / "Main.lf").write_text(PARAMETERS)
    answer = hprm("run", "Main.lf", "--period", "soon")
    assert (answer.returncode, answer.stdout) == (1, "")
    assert "the parameter `period` must be a time, such as `10 ms`" in answer.stderr
    assert "--> --period soon\n" in answer.stderr
    assert "Main.lf:2" in answer.stderr


@pytest.mark.parametrize("words", [["run", "Main.lf", "--in-proces"], ["verify", "Main.lf", "-z"]])
def test_a_mistyped_option_is_an_error_behind_the_file_too(hprm: Hprm, words: list[str]) -> None:
    answer = hprm(*words)
    assert (answer.returncode, answer.stdout) == (2, "")
    assert f"unexpected argument '{words[-1]}' found" in answer.stderr


def test_options_work_behind_the_file(hprm: Hprm, tmp_path: Path) -> None:
    answer = hprm("run", "Main.lf", "--logical-trace", "x.trace", "-o", "0", "msec")
    assert (answer.returncode, answer.stdout) == (0, "tick\n"), answer.stderr
    assert (tmp_path / "x.trace").exists()


def test_a_program_may_start_at_a_round_time(hprm: Hprm, tmp_path: Path) -> None:
    body = "print(lf.time.start() % 250_000_000)"
    main = f"target Python\nmain reactor {{ reaction(startup) {{= {body} =}} }}\n"
    (tmp_path / "Round.lf").write_text(main)
    assert hprm("run", "Round.lf", "-m", "250", "msec").stdout == "0\n"
    federated = "target Python\nreactor R { reaction(startup) {= BODY =} }\n".replace("BODY", body)
    (tmp_path / "Round.lf").write_text(federated + "federated reactor { r = new R() }\n")
    answer = hprm("run", "--start-time-multiple", "250 ms", "Round.lf")
    assert answer.stdout.strip().endswith("0"), answer.stderr


def test_the_document_has_the_short_options_of_lingua_franca(hprm: Hprm) -> None:
    document = Path(__file__).resolve().parents[2] / "docs" / "reference" / "command-line.md"
    text = document.read_text()
    options = re.findall(r"`(-\w)`, `(--[\w-]+)", text)
    assert len(options) == 5
    for short, long in options:
        assert f"{short}, {long} <" in hprm("run", "--help").stdout
