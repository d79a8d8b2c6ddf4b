"""Certificates of machines are renewed before they end; those that end are told of."""

from __future__ import annotations

import shutil
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
import zenoh
from certificates import authority_of, count, end, let_end, signed
from machines import (
    AGENT,
    HPRM,
    PLACES,
    PROGRAM,
    Machines,
    alone,
    finish,
    listens_at,
    reactions,
    until,
)
from tcp_ports import free_ports
from test_enrolment import enrolled, start

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is missing")

YEAR = timedelta(days=365)
LONG = PROGRAM.replace("timeout: 200 msec", "timeout: 20 sec")


def certificate(machines: Machines, machine: str) -> Path:
    """The certificate of a machine."""
    return machines.credentials(machine) / "machine.pem"


def left(machines: Machines, machine: str) -> timedelta:
    """How long the certificate of a machine is valid."""
    return end(certificate(machines, machine)) - datetime.now(timezone.utc)


def is_renewed(machines: Machines, machine: str) -> bool:
    """Whether the certificate of a machine is valid for a year, but for the time of a test."""
    return YEAR - timedelta(minutes=10) < left(machines, machine) <= YEAR


def renew(machines: Machines, *names: str) -> tuple[int, str, str]:
    """Renews certificates on the machine of the authority."""
    return finish(machines.spawn(machines.authority, AGENT, "renew", *names))


def stop(machines: Machines, machine: str) -> str:
    """Ends an agent in order. Returns what it has said on its standard error."""
    agent = machines.agents.pop(machine)
    agent.terminate()
    code, _, err = finish(agent)
    assert code == 0
    return err


def test_a_certificate_that_ends_is_renewed_while_a_federation_runs(machines: Machines) -> None:
    enrolled(machines, "robot2")
    ends = let_end(machines, "robot2", timedelta(seconds=20))
    start(machines, "robot1", "robot2")
    rti, federates = machines.federation(LONG, PLACES)
    assert federates[0].stdout is not None
    read = federates[0].stdout.readline()
    # The authority learns of the certificate from agents.
    known = machines.credentials("robot1") / "certificates.pem"
    until(lambda: known.exists() and count(known) == 2)
    code, out, err = renew(machines)
    assert (code, err) == (0, "") and ": robot1, robot2\n" in out, out
    until(lambda: is_renewed(machines, "robot2"))
    assert datetime.now(timezone.utc) < ends
    out, expected = alone(machines.folder, LONG)
    assert finish(federates[0], read) == (0, out, "")
    assert [finish(process)[0] for process in [rti, *federates[1:]]] == [0] * 3
    assert datetime.now(timezone.utc) > ends + timedelta(seconds=2)
    assert reactions(machines.folder / name for name in PLACES) == expected
    for machine in ("robot1", "robot2"):
        err = stop(machines, machine)
        assert f"the certificate of {machine} is renewed until" in err and "error" not in err


def test_a_machine_that_was_off_gets_its_certificate_from_any_other(machines: Machines) -> None:
    enrolled(machines, "robot2", "robot3")
    ends = let_end(machines, "robot2", timedelta(days=20))
    start(machines, "robot1", "robot2", "robot3")
    known = machines.credentials("robot1") / "certificates.pem"
    until(lambda: known.exists() and count(known) == 3)
    err = stop(machines, "robot2")
    assert f"warning: the certificate of robot2 ends on {ends:%Y-%m-%d}\n" in err
    assert "  hint: `hprm agent renew robot2` on the authority's machine" in err
    other = certificate(machines, "robot3").read_bytes()
    code, out, _ = renew(machines, "robot2")
    assert code == 0 and ": robot2\n" in out
    new = known.read_bytes()
    # The machine of the authority is off when it comes back.
    until(lambda: (machines.credentials("robot3") / "certificates.pem").read_bytes() == new)
    stop(machines, "robot1")
    (port,) = free_ports(1)
    connect = ["--connect", listens_at(machines.agents["robot3"])]
    machines.start_agent("robot2", "--listen", f"127.0.0.1:{port}", *connect)
    until(lambda: is_renewed(machines, "robot2"))
    assert certificate(machines, "robot2").stat().st_mode & 0o777 == 0o600
    machines.wait_for("robot2", ["robot2", "robot3"])
    # Those of the others are as before.
    assert certificate(machines, "robot3").read_bytes() == other


def test_the_agent_of_the_authority_renews_what_is_in_its_last_third(machines: Machines) -> None:
    enrolled(machines, "robot2", "robot3")
    let_end(machines, "robot2", timedelta(days=100))
    other = certificate(machines, "robot3").read_bytes()
    start(machines, "robot1", "robot2", "robot3")
    known = machines.credentials("robot1") / "certificates.pem"
    until(lambda: known.exists() and count(known) == 3)
    stop(machines, "robot1")
    assert not is_renewed(machines, "robot2")
    # It looks when it starts, and once a day.
    connect = ["--connect", listens_at(machines.agents["robot2"])]
    machines.start_agent("robot1", "--listen", "127.0.0.1:0", *connect)
    until(lambda: is_renewed(machines, "robot2"))
    assert certificate(machines, "robot3").read_bytes() == other
    assert ": robot2\n" in stop(machines, "robot1")


def test_what_is_no_certificate_of_this_machine_is_refused(
    machines: Machines, tmp_path_factory: pytest.TempPathFactory
) -> None:
    enrolled(machines, "robot2", "robot3")
    ends = let_end(machines, "robot2", timedelta(days=200))
    start(machines, "robot1", "robot2")
    files = machines.credentials("robot2")
    until(lambda: (files / "certificates.pem").exists())
    foreign = Machines(tmp_path_factory.mktemp("foreign"))
    try:
        foreign.make_authority("robot1")
        key = files / "machine.key"
        other = foreign.credentials("robot1") / "machine.key"
        mine = authority_of(machines, "robot1")
        forged = signed(machines, "robot2", YEAR, authority_of(foreign, "robot1"), key)
        texts = {
            "of another authority": forged,
            "for another key": signed(machines, "robot2", YEAR, mine, other),
            "older": signed(machines, "robot2", timedelta(days=100), mine, key),
            "of another machine": certificate(machines, "robot1").read_text(),
            "none": "what is no certificate",
        }
    finally:
        foreign.close()
    draft = files / "draft"
    for text in texts.values():
        draft.write_text(text)
        draft.rename(files / "certificates.pem")
        # What is right takes its place.
        until(lambda: count(files / "certificates.pem") == 2)
    # From another machine, the same.
    with machines.spy("robot3", listens_at(machines.agents["robot1"])) as spy:
        asked: list[str] = []

        def answer(query: zenoh.Query) -> None:
            for text in texts.values():
                query.reply(query.key_expr, text)
            asked.append(str(query.parameters))

        root, me = "hprm/agents/2", f"robot3/{7:016x}"
        queryable = spy.declare_queryable(f"{root}/certificates/{me}", answer)
        token = spy.liveliness().declare_token(f"{root}/machines/{me}")
        until(lambda: len(asked) >= 2)
        del queryable, token
    for machine in ("robot1", "robot2"):
        assert count(machines.credentials(machine) / "certificates.pem") == 2
    assert end(files / "machine.pem") == ends
    machines.wait_for("robot2", ["robot2", "robot1"])
    err = stop(machines, "robot2")
    assert "the authority has not signed the certificate of robot2 that is there" in err
    assert err.count("error: ") == 1
    # Nothing of that has hurt.
    code, _, _ = renew(machines, "robot2")
    assert code == 0


def test_an_agent_with_a_certificate_that_has_ended_says_so(machines: Machines) -> None:
    enrolled(machines, "robot2")
    ends = let_end(machines, "robot2", timedelta(days=-3))
    code, out, err = finish(machines.spawn("robot2", AGENT))
    assert (code, out, err.count("error: ")) == (1, "", 1)
    assert f"error: the certificate of robot2 has ended on {ends:%Y-%m-%d}, so no other" in err
    assert "hint: `hprm agent renew robot2` on the authority's machine" in err
    # So does one with a certificate of its own.
    folder = machines.credentials("robot2")
    names = {"cert": "machine.pem", "key": "machine.key", "ca": "authority.pem"}
    tls = [word for what, name in names.items() for word in (f"--tls-{what}", str(folder / name))]
    code, _, err = finish(machines.spawn("robot1", AGENT, "--name", "robot9", *tls))
    assert code == 1 and "error: the certificate of robot9 has ended" in err
    assert "put it in the place of that of --tls-cert" in err
    # As the authority does not know it, it says so; a copy of the certificate is enough.
    code, out, err = renew(machines, "robot2")
    assert (code, out) == (1, "")
    assert "not renewed, because their certificates are not known here: robot2" in err
    authority, files = authority_of(machines, "robot1"), machines.credentials("robot2")
    shutil.copy(files / "machine.pem", authority / "certificates.pem")
    code, out, err = renew(machines, "robot2")
    assert (code, err) == (0, "") and out.startswith("renewed until ")
    # By hand, as the hint says.
    shutil.copy(authority / "certificates.pem", files)
    start(machines, "robot1", "robot2")
    assert is_renewed(machines, "robot2")


def test_renewing_names_machines_that_there_are(machines: Machines) -> None:
    code, out, err = renew(machines)
    assert (code, out) == (1, "") and "error: this user has no authority" in err
    enrolled(machines, "robot2")
    before = certificate(machines, "robot1").read_bytes()
    code, out, err = renew(machines, "robot1", "robot3")
    assert (code, out) == (1, "")
    assert err == "error: no machine has the name robot3; there are: robot1, robot2\n"
    assert certificate(machines, "robot1").read_bytes() == before
    assert finish(machines.spawn("robot1", AGENT, "revoke", "robot2"))[0] == 0
    code, out, err = renew(machines)
    assert (code, err) == (0, "") and ": robot1\n" in out
    known = authority_of(machines, "robot1") / "certificates.pem"
    assert count(known) == 1


def test_machines_are_listed_with_the_ends_of_their_certificates(machines: Machines) -> None:
    enrolled(machines, "robot2")
    ends = let_end(machines, "robot2", timedelta(days=9, minutes=5))
    start(machines, "robot1", "robot2")
    told = {
        one["name"]: one["about"]["certificate_ends"] for one in machines.tell_machines("robot1")
    }
    first = end(certificate(machines, "robot1"))
    assert told == {"robot1": first.timestamp(), "robot2": ends.timestamp()}
    code, out, err = finish(machines.spawn("robot1", HPRM, "machines"))
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert [line.split("  ")[-1].strip() for line in lines] == [
        "certificate",
        "-",
        "ends in 9 days",
    ]
