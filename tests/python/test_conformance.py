"""The conformance runner, on a small checkout that is made up here."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

RUN = Path(__file__).parents[1] / "conformance" / "run.py"

GOOD = "target Python\nmain reactor { reaction(startup) {= pass =} }\n"
PROGRAMS = {
    "Good.lf": GOOD,
    "Bad.lf": GOOD.replace("pass", "raise SystemExit(3)"),
    "Raises.lf": GOOD.replace("pass", "1 / 0"),
    "Refused.lf": GOOD.replace("startup", "nothing"),
    "Library.lf": 'target Python\n// main reactor\nreactor A { state s = "{= main reactor =}" }\n',
    "failing/Never.lf": GOOD.replace("pass", "raise SystemExit(3)"),
    "multiport/OneThread.lf": """
        target Python
        preamble {=
          order = []
        =}
        reactor A { reaction(startup) {= order.append("A") =} }
        reactor B { reaction(startup) {= order.append("B") =} deadline(100 s) {= exit(1) =} }
        main reactor {
          a = new A()  b = new B()
          reaction(shutdown) {= exit(order == ["A", "B"]) =}
        }
        """,
    "federated/Options.lf": """
        target Python { timeout: 1 ms, coordination-options: { advance-message-interval: 20 ms } }
        reactor A { reaction(startup) {= pass =} }
        federated reactor { a = new A() }
        """,
    "concurrent/Here.lf": GOOD.replace("pass", "open('written', 'w').close()"),
    "federated/Two.lf": """
        target Python { timeout: 1 ms }
        reactor A { reaction(startup) {= pass =} }
        federated reactor { a = new A()  b = new A() }
        """,
}


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    for name, text in PROGRAMS.items():
        path = tmp_path / "lf" / "test" / "Python" / "src" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "lf"


def conformance(checkout: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(RUN), str(checkout), *options]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def programs(path: Path) -> dict[tuple[str, bool], dict[str, Any]]:
    entries = json.loads(path.read_text())["programs"]
    return {(entry["path"], entry["single_threaded"]): entry for entry in entries}


def test_every_program_counts_by_its_exit_code(checkout: Path, tmp_path: Path) -> None:
    done = conformance(checkout, "--single-threaded", "--json", str(tmp_path / "results.json"))
    assert done.returncode == 1, done.stderr
    results = programs(tmp_path / "results.json")
    verdicts = {
        (path, threads): (entry["status"], entry["exit_code"])
        for (path, threads), entry in results.items()
    }
    once = {
        ("Good.lf", ("pass", 0)),
        ("Bad.lf", ("fail", 3)),
        ("Raises.lf", ("fail", 1)),
        ("Refused.lf", ("fail", 1)),
    }
    # Only with one thread does the reactor with a deadline go first.
    assert verdicts == {
        **{(path, threads): verdict for path, verdict in once for threads in (False, True)},
        ("multiport/OneThread.lf", False): ("fail", 1),
        ("multiport/OneThread.lf", True): ("pass", 0),
        ("concurrent/Here.lf", False): ("pass", 0),
        ("federated/Two.lf", False): ("pass", 0),
        ("federated/Options.lf", False): ("pass", 0),
    }
    assert results["federated/Two.lf", False]["federated"]
    refused = results["Refused.lf", False]
    assert refused["diagnostic"] and "(Refused.lf:2" in refused["reason"]
    assert "ZeroDivisionError" in results["Raises.lf", False]["reason"]
    assert not list(checkout.rglob("written"))
    assert "6 of 13 passed, 0 skipped" in done.stdout
    assert len(done.stderr.splitlines()) == 13
    assert results["federated/Options.lf", False]["without"] == ["coordination-options"]
    assert "  federated/Options.lf: coordination-options\n" in done.stdout


def test_programs_can_be_chosen(checkout: Path) -> None:
    for options, outcome in [
        (["--only", "Good"], (0, "1 of 1 passed")),
        (["--only", "*d.lf", "--folder", "src,federated"], (1, "1 of 3 passed")),
        (["--federated"], (0, "2 of 2 passed")),
        (["--no-federated", "--folder", "concurrent"], (0, "1 of 1 passed")),
    ]:
        done = conformance(checkout, *options)
        assert (done.returncode, outcome[1] in done.stdout) == (outcome[0], True), done.stdout


def test_a_program_that_does_not_end_is_ended_with_all_it_started(checkout: Path) -> None:
    slow = checkout / "test" / "Python" / "src" / "Slow.lf"
    note = checkout / "pid"
    slow.write_text(f"""
        target Python {{ keepalive: true }}
        main reactor {{ reaction(startup) {{=
          import subprocess
          child = subprocess.Popen(["cat"], stdin=subprocess.PIPE)
          with open({str(note)!r}, "w") as file: file.write(str(child.pid))
        =}} }}
    """)
    done = conformance(checkout, "--only", "Slow", "--timeout", "5")
    assert done.returncode == 1
    assert "still running after 5 s" in done.stdout
    child = Path("/proc", note.read_text(), "stat")
    assert not child.exists() or child.read_text().rpartition(")")[2].split()[0] == "Z"


def test_what_is_no_checkout_is_refused(tmp_path: Path, checkout: Path) -> None:
    done = conformance(tmp_path)
    assert done.returncode == 2
    assert "has no folder test/Python/src" in done.stderr
    assert "Lingua Franca" in done.stderr
    done = conformance(checkout, "--only", "Nothing")
    assert (done.returncode, "no program fits" in done.stderr) == (2, True)
