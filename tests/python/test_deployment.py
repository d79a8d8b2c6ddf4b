"""The commands of docs/howto/deployment.md, in another order than test_handbook_pages.py has."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
import uuid
from pathlib import Path

import pytest
from conftest import Spawn
from processes import Bench, finish, hear
from stories import blocks, commands
from tcp_ports import free_ports

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "deployment.md"
BLOCKS = [
    [command for command, _ in commands(block.source)]
    for block in blocks(PAGE)
    if block.kind == "console"
]
[PROGRAM] = [block.source for block in blocks(PAGE) if block.caption == "Main.lf"]
OUTPUT = "".join(f"{time} 600000\n" for time in range(0, 100_000_001, 20_000_000))


@pytest.fixture(scope="module")
def place() -> dict[str, str]:
    """What stands for the names and ports of the text, on this machine."""
    rti, federate = free_ports(2)
    return {
        "robot.local": "127.0.0.1",
        "15045": str(rti),
        "15046": str(federate),
        "unix:@robot": f"unix:@hprm-test-{uuid.uuid4().hex}",
    }


def here(line: str, place: dict[str, str]) -> list[str]:
    for name, what in place.items():
        line = line.replace(name, what)
    return shlex.split(line)


def make_certificates(place: dict[str, str], folder: Path) -> None:
    if shutil.which("openssl") is None:
        pytest.skip("openssl, which makes the certificates, is missing")
    for line in [line for block in BLOCKS for line in block if line.startswith("openssl ")]:
        subprocess.run(here(line, place), cwd=folder, check=True, capture_output=True)


[SECRET] = [block for block in BLOCKS if "rand -hex" in block[0]]
FEDERATIONS = [block for block in BLOCKS if block[0].startswith("hprm rti ")]


def test_the_text_has_commands() -> None:
    assert len(FEDERATIONS) == 6
    others = [block for block in BLOCKS if block not in [*FEDERATIONS, SECRET]]
    assert all(line.startswith("openssl ") for block in others for line in block)


def test_a_secret_that_is_made_as_it_is_written_is_one(tmp_path: Path) -> None:
    if shutil.which("openssl") is None:
        pytest.skip("openssl is missing")
    (tmp_path / "Main.lf").write_text(PROGRAM)
    subprocess.run(SECRET[0], shell=True, cwd=tmp_path, check=True)
    words = "federate Main.lf camera --rti unix:@hprm-nowhere --connect-timeout 0.1"
    done = subprocess.run(
        [Path(sys.executable).with_name("hprm"), *words.split(), "--federation-file", "secret"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert "error: no RTI at unix:@hprm-nowhere" in done.stderr


@pytest.mark.parametrize("block", FEDERATIONS, ids=lambda block: block[0][13:60])
def test_a_federation_runs_with_its_rti_last(
    spawn: Spawn, tmp_path: Path, place: dict[str, str], block: list[str]
) -> None:
    (tmp_path / "Main.lf").write_text(PROGRAM)
    if any("--tls-cert" in line for line in block):
        make_certificates(place, tmp_path)
    command = str(Path(sys.executable).with_name("hprm"))
    lines = [here(line, place) for line in block]
    started = {}
    for number in reversed(range(len(lines))):
        assert lines[number][0] == "hprm"
        started[number] = spawn(command, *lines[number][1:])
    outcomes = [started[number].communicate(timeout=60) for number in range(len(lines))]
    assert [started[number].returncode for number in started] == [0, 0, 0], outcomes
    rti, *federates = outcomes
    assert "the federation starts\n" in rti[0]
    assert [out for out, _ in federates] == ["", OUTPUT]
    waiting = ("waiting for the RTI at ", "waiting for the RTI, which makes the file secret")
    assert all(line.startswith(waiting) for _, err in outcomes for line in err.splitlines())


def test_a_federate_says_what_it_waits_for(bench: Bench) -> None:
    text = "target Python\nreactor A {}\nfederated reactor { a = new A() }\n"
    (bench.folder / "Main.lf").write_text(text)
    secret = ["--federation-file", "secret"]
    address = f"unix:@hprm-test-{uuid.uuid4().hex}"
    federate = bench.call("federate", "Main.lf", "a", "--rti", address, *secret)
    hear(federate.stderr, "waiting for the RTI, which makes the file secret\n")
    rti = bench.call("rti", "Main.lf", "--listen", address, *secret)
    assert [finish(rti).code, finish(federate).code] == [0, 0]


def test_a_federate_waits_for_the_secret_no_longer_than_for_the_rti(bench: Bench) -> None:
    text = "target Python\nreactor A {}\nfederated reactor { a = new A() }\n"
    (bench.folder / "Main.lf").write_text(text)
    options = ["--rti", "unix:@nobody", "--federation-file", "secret", "--connect-timeout", "0.1"]
    outcome = finish(bench.call("federate", "Main.lf", "a", *options))
    assert outcome.code == 1
    outcome.assert_one_error("error: cannot read secret: ", "`hprm rti --federation-file FILE`")


def test_a_federate_joins_where_the_program_has_its_rti(bench: Bench) -> None:
    (port,) = free_ports(1)
    place = f"127.0.0.1:{port}"
    text = "target Python\nreactor A {}\nfederated reactor at PLACE { a = new A() }\n"
    (bench.folder / "Main.lf").write_text(text.replace("PLACE", f"pi@{place}"))
    secret = ["--federation-file", "secret"]
    federate = bench.call("federate", "Main.lf", "a", *secret)
    rti = bench.call("rti", "Main.lf", "--listen", place, *secret)
    assert [finish(rti).code, finish(federate).code] == [0, 0]
    # Only the secret is not in the program.
    finish(bench.call("federate", "Main.lf", "a")).assert_one_error(
        "the secret of the federation is missing", "--federation-file FILE"
    )
    (bench.folder / "Main.lf").write_text(text.replace(" at PLACE", ""))
    for options in (secret, []):
        outcome = finish(bench.call("federate", "Main.lf", "a", *options))
        assert outcome.code != 0
        outcome.assert_one_error("find a federation" if options else "no federation", "--rti")
        assert "federated reactor at HOST:PORT" in outcome.err
