"""Federations over TCP, started by hand, as across machines."""

from __future__ import annotations

import functools
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import Spawn

PROGRAM = """\
target Python {{ coordination: {coordination}, timeout: 50 msec }}
preamble {{=
import numpy as np
=}}
reactor Source {{
  output out
  timer t(0, 10 msec)
  state count = 0
  reaction(t) -> out {{=
    self.count += 1
    out.set(np.full(100_000, self.count))
  =}}
}}
reactor Sink {{
  input inp
  reaction(inp) {{= print(int(inp.value[-1])) =}}
}}
federated reactor {{
  source = new Source()
  sink = new[2] Sink()
  (source.out)+ -> sink.inp
}}
"""

FEDERATES = ["source", "sink__0", "sink__1"]
NUMBERS = "".join(f"{count}\n" for count in range(1, 7))

Start = Spawn


@pytest.fixture
def start(spawn: Spawn) -> Start:
    """Starts the command that is installed beside this interpreter."""
    command = shutil.which("hprm", path=str(Path(sys.executable).parent))
    assert command is not None, "make build puts hprm beside python"
    return functools.partial(spawn, command)


def listening(rti: subprocess.Popen[str]) -> str:
    assert rti.stdout is not None
    line = rti.stdout.readline()
    word, address = line.rsplit(maxsplit=1)
    assert word == "listening at", line
    return address


def finish(process: subprocess.Popen[str]) -> tuple[str, str, int]:
    out, err = process.communicate(timeout=60)
    return out, err, process.returncode


@pytest.mark.parametrize("coordination", ["centralized", "decentralized"])
def test_a_federation_over_tcp_with_its_secret_in_a_file(
    start: Start, tmp_path: Path, coordination: str
) -> None:
    (tmp_path / "Fed.lf").write_text(PROGRAM.format(coordination=coordination))
    secret = ["--federation-file", "secret"]
    rti = start("rti", "Fed.lf", "--listen", "0.0.0.0:0", *secret)
    port = listening(rti).rsplit(":", 1)[1]
    assert (tmp_path / "secret").stat().st_mode & 0o777 == 0o600
    address = f"127.0.0.1:{port}"
    federates = [start("federate", "Fed.lf", name, "--rti", address, *secret) for name in FEDERATES]
    assert [finish(federate) for federate in federates] == [
        ("", "", 0),
        (NUMBERS, "", 0),
        (NUMBERS, "", 0),
    ]
    out, err, code = finish(rti)
    assert (err, code) == ("", 0)
    assert "federation " + (tmp_path / "secret").read_text() not in out


@pytest.mark.parametrize("coordination", ["centralized", "decentralized"])
def test_some_federates_come_over_tcp_and_others_share_memory(
    start: Start, tmp_path: Path, coordination: str
) -> None:
    (tmp_path / "Fed.lf").write_text(PROGRAM.format(coordination=coordination))
    secret = ["--federation-file", "secret"]
    unix = f"unix:{tmp_path}/rti"
    rti = start("rti", "Fed.lf", "--listen", unix, "--listen", "127.0.0.1:0", *secret)
    assert listening(rti) == unix
    tcp = listening(rti)
    here = ["--advertise", "127.0.0.1"]
    federates = [
        start("federate", "Fed.lf", "source", "--rti", unix, *here, *secret),
        start("federate", "Fed.lf", "sink__0", "--rti", unix, *secret),
        start("federate", "Fed.lf", "sink__1", "--rti", tcp, *secret),
    ]
    outcomes = [finish(federate) for federate in federates]
    assert outcomes == [("", "", 0), (NUMBERS, "", 0), (NUMBERS, "", 0)]


def test_a_federate_that_cannot_be_reached_from_elsewhere_says_what_to_do(
    start: Start, tmp_path: Path
) -> None:
    (tmp_path / "Fed.lf").write_text(PROGRAM.format(coordination="decentralized"))
    secret = ["--federation-file", "secret"]
    unix = f"unix:{tmp_path}/rti"
    rti = start("rti", "Fed.lf", "--listen", unix, "--listen", "127.0.0.1:0", *secret)
    assert listening(rti) == unix
    tcp = listening(rti)
    addresses = {"source": tcp, "sink__0": unix, "sink__1": unix}
    federates = [
        start("federate", "Fed.lf", name, "--rti", address, *secret)
        for name, address in addresses.items()
    ]
    errors = "".join(finish(federate)[1] for federate in federates)
    assert "hprm federate --advertise HOST" in errors
    assert finish(rti)[2] == 1


OPENSSL = shutil.which("openssl")


@pytest.mark.skipif(OPENSSL is None, reason="openssl, which makes the certificates, is missing")
@pytest.mark.parametrize("coordination", ["centralized", "decentralized"])
def test_an_encrypted_federation(start: Start, tmp_path: Path, coordination: str) -> None:
    tls = f"comm-type: TLS, coordination: {coordination}"
    program = PROGRAM.format(coordination=coordination)
    (tmp_path / "Fed.lf").write_text(program.replace(f"coordination: {coordination}", tls))
    for line in CERTIFICATES:
        subprocess.run(["openssl", *line.split()], cwd=tmp_path, check=True, capture_output=True)
    options = ["--federation-file", "secret"]
    refused = start("rti", "Fed.lf", "--listen", "127.0.0.1:0", *options)
    assert "--tls-cert" in finish(refused)[1]
    options += ["--tls-cert", "robot.pem", "--tls-key", "robot.key", "--tls-ca", "ca.pem"]
    rti = start("rti", "Fed.lf", "--listen", "127.0.0.1:0", *options)
    address = listening(rti)
    federates = [
        start("federate", "Fed.lf", name, "--rti", address, *options) for name in FEDERATES
    ]
    assert [finish(federate) for federate in federates] == [
        ("", "", 0),
        (NUMBERS, "", 0),
        (NUMBERS, "", 0),
    ]
    assert finish(rti)[1:] == ("", 0)


# As in docs/howto/deployment.md.
CERTIFICATES = [
    "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 365"
    " -subj /CN=federation -keyout ca.key -out ca.pem",
    "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 365"
    " -subj /CN=robot -addext subjectAltName=DNS:robot -addext basicConstraints=CA:FALSE"
    " -CA ca.pem -CAkey ca.key -keyout robot.key -out robot.pem",
]


def test_a_secret_that_others_can_read_is_refused(start: Start, tmp_path: Path) -> None:
    (tmp_path / "Fed.lf").write_text(PROGRAM.format(coordination="centralized"))
    (tmp_path / "secret").write_text("0123456789abcdef0123456789abcdef\n")
    (tmp_path / "secret").chmod(0o644)
    for command in [["rti", "Fed.lf", "--listen"], ["federate", "Fed.lf", "source", "--rti"]]:
        _, err, code = finish(start(*command, "127.0.0.1:0", "--federation-file", "secret"))
        assert code == 1
        assert "others can read the secret in secret" in err
        assert "hint: chmod 600 secret" in err


def test_a_federate_that_waits_in_vain_says_so(start: Start, tmp_path: Path) -> None:
    (tmp_path / "Fed.lf").write_text(PROGRAM.format(coordination="centralized"))
    where = ["--rti", f"unix:{tmp_path}/nobody", "--connect-timeout", "0.1"]
    secret = "0123456789abcdef0123456789abcdef"
    federate = start("federate", "Fed.lf", "source", *where, HPRM_FEDERATION_ID=secret)
    out, err, code = finish(federate)
    assert (out, code) == ("", 1)
    waiting, error, hint = err.splitlines()
    assert waiting.startswith(f"waiting for the RTI at unix:{tmp_path}/nobody: ")
    assert error.startswith(f"error: no RTI at unix:{tmp_path}/nobody: ")
    assert "hprm rti" in hint
