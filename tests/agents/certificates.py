"""Certificates for tests, which end whenever a test likes; openssl signs as an authority does."""

from __future__ import annotations

import re
import subprocess
from datetime import datetime, timedelta, timezone
from pathlib import Path

from machines import Machines

CONFIGURATION = """\
[ca]
default_ca = authority
[authority]
database = database
new_certs_dir = .
default_md = sha256
rand_serial = yes
unique_subject = no
policy = any
x509_extensions = machine
[any]
commonName = supplied
[machine]
basicConstraints = critical, CA:FALSE
keyUsage = critical, digitalSignature
extendedKeyUsage = serverAuth, clientAuth
[req]
distinguished_name = name
[name]
"""


def openssl(folder: Path, *words: str) -> str:
    """Runs openssl in a folder. Returns what it prints."""
    command = ["openssl", *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def subject(certificate: Path) -> str:
    """The name in a certificate."""
    said = openssl(certificate.parent, "x509", "-in", certificate.name, "-noout", "-subject")
    return said.rpartition("=")[2].strip()


def end(certificate: Path) -> datetime:
    """When a certificate ends."""
    said = openssl(certificate.parent, "x509", "-in", certificate.name, "-noout", "-enddate")
    moment = datetime.strptime(said.strip().partition("=")[2], "%b %d %H:%M:%S %Y %Z")
    return moment.replace(tzinfo=timezone.utc)


def authority_of(machines: Machines, machine: str) -> Path:
    """The folder of the authority of a machine's user."""
    return machines.credentials(machine).with_name("authority")


def signed(machines: Machines, machine: str, ends: timedelta, authority: Path, key: Path) -> str:
    """A certificate for a machine and a key that ends so long from now, signed by an authority."""
    folder = machines.folder / "signing"
    folder.mkdir(exist_ok=True)
    (folder / "openssl.cnf").write_text(CONFIGURATION)
    (folder / "database").write_text("")
    name = subject(machines.credentials(machine) / "machine.pem")
    request = ["-new", "-key", str(key), "-subj", f"/CN={name}", "-out", "request.pem"]
    openssl(folder, "req", *request, "-config", "openssl.cnf")
    now = datetime.now(timezone.utc)
    begin = min(now, now + ends) - timedelta(days=1)
    moments = [f"{moment:%Y%m%d%H%M%SZ}" for moment in (begin, now + ends)]
    by = ["-cert", str(authority / "authority.pem"), "-keyfile", str(authority / "authority.key")]
    words = ["-batch", "-notext", "-config", "openssl.cnf", "-in", "request.pem", *by]
    times = ["-startdate", moments[0], "-enddate", moments[1]]
    openssl(folder, "ca", *words, *times, "-out", "signed.pem")
    return (folder / "signed.pem").read_text()


def let_end(machines: Machines, machine: str, ends: timedelta) -> datetime:
    """Gives a machine a certificate that ends so long from now; the authority forgets others."""
    authority, files = authority_of(machines, machines.authority), machines.credentials(machine)
    text = signed(machines, machine, ends, authority, files / "machine.key")
    (authority / "certificates.pem").unlink(missing_ok=True)
    (files / "machine.pem").write_text(text)
    return end(files / "machine.pem")


def count(certificates: Path) -> int:
    """How many certificates are in a file."""
    return len(re.findall("BEGIN CERTIFICATE", certificates.read_text()))
