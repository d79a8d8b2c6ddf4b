"""Federations across two network namespaces: as across machines, with a link that may be bad.

They need namespaces that a user may make, and ``ip``, ``nsenter`` and ``unshare``. Where the kernel
does not allow that, or cannot make the link bad, the tests are skipped and say why.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import Spawn

BIN = Path(sys.executable).parent

PROGRAM = """\
target Python { timeout: 200 msec }
preamble {=
import numpy as np
=}
reactor Source {
  input[2] answers
  output out
  timer t(0, 20 msec)
  state count = 0
  state heard = []
  reaction(t) -> out {=
    self.count += 1
    out.set(np.full(20_000, self.count))
  =}
  reaction(answers) {=
    for answer in answers:
        if answer.is_present:
            self.heard.append(answer.value)
  =}
  reaction(shutdown) {= print(len(self.heard), sum(self.heard)) =}
}
reactor Sink(bank_index = 0) {
  input inp
  output answer
  reaction(inp) -> answer {= answer.set(int(inp.value[-1]) * 10 + self.bank_index) =}
}
federated reactor {
  source = new Source()
  sink = new[2] Sink()
  (source.out)+ -> sink.inp
  sink.answer -> source.answers after 30 msec
}
"""

# What becomes of packets on their way: nothing, or what `tc` makes of them.
LINKS = {
    "good": None,
    "delayed and lossy": "netem delay 5ms loss 1%",
    "narrow, and dropping what does not fit": "tbf rate 20mbit burst 8kb limit 24kb",
}


class Hosts:
    """Two network namespaces with a link between them, which end with this process."""

    def __init__(self) -> None:
        self.holders: list[subprocess.Popen[bytes]] = []
        here = self._hold("unshare", "-Urn")
        there = self._hold(*self._enter(here), "unshare", "-n")
        self.hosts = [here, there]
        self("here", "ip", "link", "add", "hprm0", "type", "veth", "peer", "name", "hprm1")
        self("here", "ip", "link", "set", "hprm1", "netns", str(there))
        for number, name in enumerate(["here", "there"]):
            self(name, "ip", "address", "add", f"10.77.0.{number + 1}/24", "dev", f"hprm{number}")
            self(name, "ip", "link", "set", f"hprm{number}", "up")
            self(name, "ip", "link", "set", "lo", "up")

    def _hold(self, *command: str) -> int:
        """Starts something that stays in its namespace as long as its input is open."""
        script = "echo; exec cat"
        holder = subprocess.Popen(
            [*command, "sh", "-c", script],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        self.holders.append(holder)
        assert holder.stdout is not None
        if holder.stdout.readline() != b"\n":
            _, err = holder.communicate()
            self.close()
            pytest.skip(f"{' '.join(command)}: {err.decode().strip()}")
        return holder.pid

    @staticmethod
    def _enter(pid: int) -> list[str]:
        return ["nsenter", "-t", str(pid), "-U", "-n", "--preserve-credentials"]

    def command(self, host: str, *arguments: str) -> list[str]:
        return [*self._enter(self.hosts[host == "there"]), *arguments]

    def __call__(self, host: str, *arguments: str) -> None:
        done = subprocess.run(self.command(host, *arguments), capture_output=True, text=True)
        if done.returncode != 0:
            self.close()
            pytest.skip(f"{' '.join(arguments)}: {done.stderr.strip()}")

    def close(self) -> None:
        for holder in reversed(self.holders):
            if holder.stdin is not None and not holder.stdin.closed:
                holder.communicate()


@pytest.fixture
def hosts() -> Iterator[Hosts]:
    for tool in ["ip", "nsenter", "tc", "unshare"]:
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is missing")
    hosts = Hosts()
    yield hosts
    hosts.close()


def reactions(*paths: Path) -> list[dict[str, object]]:
    """What reactions did, by tag and name."""
    lines = [json.loads(line) for path in paths for line in path.read_text().splitlines()]
    return sorted(
        (line for line in lines if "reaction" in line),
        key=lambda line: (line["tag"], line["reaction"]),
    )


#: What a federate says that is late.
LAGS = re.compile(r"warning: federate \w+ lags .*\n  hint: .*\n")

#: Where the federates of PROGRAM run.
PLACES = {"source": "here", "sink__0": "there", "sink__1": "there"}


def federation(
    hosts: Hosts, spawn: Spawn, places: dict[str, str], *options: str, traced: bool = False
) -> tuple[subprocess.Popen[str], list[subprocess.Popen[str]]]:
    """Starts the RTI of Fed.lf on the one host, and its federates where they belong."""
    hprm = str(BIN / "hprm")
    common = ["--federation-file", "secret", *options]
    listen = ["--listen", "10.77.0.1:0"]
    rti = spawn(*hosts.command("here", hprm, "rti", "Fed.lf", *listen, *common))
    assert rti.stdout is not None
    address = rti.stdout.readline().split()[-1]
    federates = []
    for name, place in places.items():
        trace = ["--logical-trace", name] if traced else []
        joining = ["--rti", address, *trace, *common]
        federates.append(spawn(*hosts.command(place, hprm, "federate", "Fed.lf", name, *joining)))
    return rti, federates


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("coordination", ["centralized", "decentralized"])
def test_a_federation_across_hosts_does_what_one_process_does(
    hosts: Hosts, spawn: Spawn, tmp_path: Path, coordination: str, link: str
) -> None:
    if (quality := LINKS[link]) is not None:
        for name, device in [("here", "hprm0"), ("there", "hprm1")]:
            hosts(name, "tc", "qdisc", "add", "dev", device, "root", *quality.split())
    (tmp_path / "Fed.lf").write_text(PROGRAM)
    alone = [sys.executable, "-m", "hprm", "run", "--logical-trace", "alone", "Fed.lf"]
    done = subprocess.run(alone, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr

    coordinated = ["--property", f"coordination={coordination}"]
    rti, federates = federation(hosts, spawn, PLACES, *coordinated, traced=True)
    outcomes = []
    for process in federates:
        out, err = process.communicate(timeout=90)
        # A narrow link that drops packets may make a federate late, which it says.
        outcomes.append((out, LAGS.sub("", err), process.returncode))
    assert outcomes == [(done.stdout, "", 0), ("", "", 0), ("", "", 0)]
    assert rti.communicate(timeout=60)[1] == ""
    assert rti.returncode == 0
    expected = reactions(tmp_path / "alone")
    assert len(expected) > 40
    assert reactions(*(tmp_path / name for name in PLACES)) == expected


def test_clocks_of_two_hosts_agree(hosts: Hosts, spawn: Spawn, tmp_path: Path) -> None:
    program = """\
target Python { timeout: 100 msec, clock-sync: MODE, clock-sync-options: { test-offset: 100 s } }
preamble {= import time =}
reactor Watch {
  reaction(startup) {= print(abs(lf.time.physical() - time.time_ns()) < SEC(5)) =}
}
federated reactor {
  a = new Watch()
  b = new Watch()
}
"""
    for mode in ["init", "on"]:
        (tmp_path / "Fed.lf").write_text(program.replace("MODE", mode))
        rti, federates = federation(hosts, spawn, {"a": "here", "b": "there"})
        outcomes = [(*process.communicate(timeout=60), process.returncode) for process in federates]
        assert outcomes == [("True\n", "", 0)] * 2
        assert rti.communicate(timeout=60)[1] == ""


def test_a_process_that_is_cut_off_is_noticed(hosts: Hosts, spawn: Spawn, tmp_path: Path) -> None:
    program = PROGRAM.replace("timeout: 200 msec", "timeout: 100 s")
    program = program.replace("self.count += 1", 'self.count += 1; print("tick")')
    (tmp_path / "Fed.lf").write_text(program)
    rti, federates = federation(hosts, spawn, PLACES)
    assert federates[0].stdout is not None
    assert federates[0].stdout.readline() == "tick\n"
    hosts("here", "ip", "link", "set", "hprm0", "down")
    # No process can reach the other side any more, where no process has ended.
    outcomes = [(process.communicate(timeout=60)[1], process.returncode) for process in federates]
    assert [code for _, code in outcomes] == [1, 1, 1]
    for words, _ in outcomes[1:]:
        assert "the link to the RTI is lost" in words or "a link is broken" in words
    assert "the process of federate sink__" in rti.communicate(timeout=60)[1]
    assert rti.returncode == 1
