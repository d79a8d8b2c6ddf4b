"""Machines that reach one another only through a third one are one fleet."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest
import zenoh
from machines import AGENT, PLACES, PROGRAM, alone, finish, reactions, until
from networks import HUB, Fleet
from processes import hear
from tcp_ports import free_ports
from test_agents import COORDINATIONS, ENDLESS, LONG, certify, check, running
from test_programs import belongs, left, nothing_is_left, run

KINDS = ["enrolled", "certificates"]
MACHINES = [HUB, "robot1", "robot2"]
SUBNETS = [["robot1"], ["robot2"]]

#: By when all know that a router is gone, as `TOLD` of relayed links; and for processes to end.
TOLD = 24.0
MOMENT = 8.0


def start(fleet: Fleet, kind: str = "enrolled", *options: str) -> None:
    """Starts all agents, which belong together in one way or the other."""
    fleet.lay_out(SUBNETS)
    if kind == "enrolled":
        fleet.make_authority(HUB, "--router")
        assert fleet.enroll("robot1")[0] == fleet.enroll("robot2")[0] == 0
        own = {machine: list[str]() for machine in MACHINES}
    else:
        certify(fleet.folder, *MACHINES)
        own = {
            machine: [
                *("--tls-cert", f"{machine}.pem", "--tls-key", f"{machine}.key"),
                *("--tls-ca", "ca.pem", *(["--router"] if machine == HUB else [])),
            ]
            for machine in MACHINES
        }
    for machine in MACHINES:
        fleet.start(machine, *own[machine], *options)
    fleet.meet(*MACHINES)


def start_with_keys(fleet: Fleet) -> None:
    """The same, and they start programs."""
    start(fleet, "enrolled", "--fleet-keys", "keys", "--allow-root")


AT = ["--at", "sink=robot2", "--fleet-key", "keys"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_federation_through_a_router_does_what_one_process_does(
    fleet: Fleet, coordination: str, kind: str
) -> None:
    start(fleet, kind)
    assert fleet.through("robot1") == {HUB: None, "robot2": HUB}
    assert fleet.through("robot2") == {HUB: None, "robot1": HUB}
    assert fleet.through(HUB) == {"robot1": None, "robot2": None}
    clock = fleet.tell_machines("robot1")[2]["clock"]
    # All machines are this one, in truth.
    assert abs(clock["offset"]) <= clock["bound"] < 1_000_000_000
    options = ["--property", f"coordination={coordination}"]
    rti, federates = fleet.federation(PROGRAM, PLACES, *options)
    check(fleet, PROGRAM, coordination, rti, federates)


def test_without_namespaces_a_fleet_is_made_on_the_loopback_device(fleet: Fleet) -> None:
    fleet.lay_out(SUBNETS, with_namespaces=False)
    fleet.start(HUB, "--router")
    for machine in MACHINES[1:]:
        fleet.start(machine)
    fleet.meet(*MACHINES)
    assert fleet.through("robot1") == {HUB: None, "robot2": HUB}
    rti, federates = fleet.federation(PROGRAM, PLACES)
    check(fleet, PROGRAM, "centralized", rti, federates)


def test_an_agent_that_is_no_router_leads_nothing(fleet: Fleet) -> None:
    fleet.lay_out(SUBNETS, with_namespaces=False)
    for machine in MACHINES:
        fleet.start(machine)
    fleet.wait_for(HUB, MACHINES)
    for machine in MACHINES[1:]:
        fleet.wait_for(machine, [machine, HUB])


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_hprm_run_starts_federates_behind_a_router(fleet: Fleet, coordination: str) -> None:
    start_with_keys(fleet)
    out, expected = alone(fleet.folder, PROGRAM)
    said = "".join(f"[source] {line}\n" for line in out.splitlines())
    options = ["--property", f"coordination={coordination}", "--logical-trace", "trace"]
    assert finish(run(fleet, PROGRAM, *options, *AT)) == (0, said, "")
    assert reactions([fleet.folder / "trace"]) == expected
    nothing_is_left(fleet)


def test_a_large_array_crosses_a_router(fleet: Fleet) -> None:
    start(fleet)
    program = PROGRAM.replace("timer t(0, 20 msec)", "timer t(0, 60 msec)")
    program = program.replace("np.full(20_000", "np.full(2_000_000")
    program = program.replace("== 5:", "== 2:")
    rti, federates = fleet.federation(program, PLACES)
    out, expected = alone(fleet.folder, program)
    assert [finish(federate) for federate in federates] == [(0, out, ""), (0, "", ""), (0, "", "")]
    assert finish(rti)[0] == 0
    assert reactions(fleet.folder / name for name in PLACES) == expected


def test_a_federate_that_is_killed_is_told_through_a_router_at_once(fleet: Fleet) -> None:
    start(fleet)
    rti, federates = fleet.federation(ENDLESS, PLACES)
    running(federates[0])
    killed = time.monotonic()
    federates[1].kill()
    assert "sink__0" in finish(rti)[2]
    assert [finish(federates[at])[0] for at in (0, 2)] == [1, 1]
    assert time.monotonic() - killed < TOLD / 2


def test_a_router_that_is_started_again_loses_nothing(fleet: Fleet) -> None:
    start(fleet)
    rti, federates = fleet.federation(LONG, PLACES)
    read = running(federates[0])
    fleet.agents[HUB].kill()
    finish(fleet.agents[HUB])
    fleet.start(HUB)
    check(fleet, LONG, "centralized", rti, federates, read)


def seen(fleet: Fleet, word: str) -> bool:
    """Whether a process of the second machine has a word in its command line."""
    return any(
        belongs(path, fleet, "robot2", "federate")
        if word == "federate"
        else belongs(path, fleet, word, "starter")
        for path in Path("/proc").iterdir()
        if path.name.isdigit()
    )


#: Its sinks end slowly, so that there is an end in which something may happen.
SLOW_END = PROGRAM.replace(
    "  reaction(inp) -> answer",
    "  reaction(shutdown) {= import time; print('ending', flush=True); time.sleep(3) =}\n"
    "  reaction(inp) -> answer",
)


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("when", ["start", "steady", "end"])
def test_a_killed_router_ends_what_it_led_and_leaves_nothing(
    fleet: Fleet, when: str, coordination: str
) -> None:
    start_with_keys(fleet)
    program = SLOW_END if when == "end" else ENDLESS
    launcher = run(fleet, program, "--property", f"coordination={coordination}", *AT)
    assert launcher.stdout is not None
    if when == "start":
        until(lambda: seen(fleet, " starter "))
    else:
        word = {"steady": "running\n", "end": "ending\n"}[when]
        hear(launcher.stdout, word)
    killed = time.monotonic()
    fleet.agents.pop(HUB).kill()
    code, _, err = finish(launcher)
    # Before a federate is there, what stands for it says why it does not come.
    errors = [line for line in err.splitlines() if "error: " in line]
    assert (code, [line.startswith("error: ") for line in errors].count(True)) == (1, 1), err
    assert len(errors) == 1 or when == "start", err
    assert time.monotonic() - killed < TOLD + MOMENT
    nothing_is_left(fleet)
    assert time.monotonic() - killed < TOLD + 2 * MOMENT
    for machine in ("robot1", "robot2"):
        # They know soon that the others are gone, and say why links have ended.
        assert fleet.machines(machine) == [machine]
        agent = fleet.agents.pop(machine)
        agent.send_signal(signal.SIGINT)
        code, _, err = finish(agent)
        assert code == 0
        if when != "start":
            assert f"through {HUB} has ended: the other end has not answered for 20 s" in err
    assert not left(fleet)


def test_a_machine_is_a_router_only_if_the_authority_says_so(fleet: Fleet) -> None:
    fleet.make_authority("robot1")
    assert fleet.enroll("robot2")[0] == 0
    code, out, err = finish(fleet.spawn("robot2", AGENT, "--router"))
    assert (code, out, err.count("error: ")) == (1, "", 1)
    assert "robot2 was not invited as a router" in err
    assert "hprm agent invite robot2 --router" in err


ROOT = "hprm/agents/2"


def answers(session: zenoh.Session, key: str) -> list[str]:
    """What is answered to the question for a link to a listener that is not there."""
    payload = b'{"number": 5, "name": "nobody"}'
    asked = session.get(key, payload=payload, timeout=5, target=zenoh.QueryTarget.ALL)
    return [reply.ok.payload.to_string() for reply in asked if reply.ok is not None]


def agent_of(machine: str, session: zenoh.Session, what: str = "machines") -> str:
    """The agent of a machine, as it is named in keys, once a session is told of it."""
    found: list[str] = []

    def is_told() -> bool:
        told = session.liveliness().get(f"{ROOT}/{what}/{machine}/*")
        found[:] = [str(reply.ok.key_expr) for reply in told if reply.ok is not None]
        return bool(found)

    until(is_told)
    return "/".join(found[0].split("/")[-2:])


def on_loopback(fleet: Fleet) -> None:
    """Enrolled machines, all of which reach one another; the hub is a router."""
    fleet.lay_out(SUBNETS, with_namespaces=False)
    fleet.make_authority(HUB, "--router")
    # The first machine last, so that it has a roster with all of them.
    for machine in ("robot2", "robot1"):
        assert fleet.enroll(machine)[0] == 0


def test_a_router_says_nothing_in_the_name_of_a_machine_that_is_reached_without_it(
    fleet: Fleet,
) -> None:
    on_loopback(fleet)
    fleet.start("robot1")
    (port,) = free_ports(1)
    connect = ["--connect", f"127.0.0.1:{fleet.ports['robot1']}"]
    fleet.start_agent("robot2", "--listen", f"127.0.0.1:{port}", *connect)
    fleet.meet("robot1", "robot2")
    nobody = ["absent no process listens at agent:robot1/nobody\n"]
    with fleet.spy(HUB, f"127.0.0.1:{fleet.ports['robot1']}") as spy:
        here = agent_of("robot1", spy)
        fake = f"robot3/{1:016x}"
        # With keys that say that it was led, it speaks for machines that only it reaches...
        assert answers(spy, f"{ROOT}/by/{HUB}/open/{here}/{fake}") == nobody
        # ...and for no other, nor with the name of another router, nor as if nothing led it.
        known = f"robot2/{1:016x}"
        (told,) = answers(spy, f"{ROOT}/by/{HUB}/open/{here}/{known}")
        assert told == f"absent the agent of robot1 reaches robot2, and not through {HUB}\n"
        assert answers(spy, f"{ROOT}/by/robot2/open/{here}/{fake}") == []
        assert answers(spy, f"{ROOT}/open/{here}/{known}") == []
        assert answers(spy, f"{ROOT}/open/{here}/{fake}") == []
        # Links that it does not lead are not for it to read, or to write into.
        heard: list[str] = []
        subscribers = [
            spy.declare_subscriber(key, lambda sample: heard.append(str(sample.key_expr)))
            for key in (f"{ROOT}/links/**", f"{ROOT}/by/**", "**")
        ]
        rti, federates = fleet.federation(PROGRAM, PLACES)
        check(fleet, PROGRAM, "centralized", rti, federates)
        assert heard == []
        # The name of a machine that is there, it cannot take.
        mine = [
            spy.liveliness().declare_token(f"{ROOT}/machines/{fake}"),
            spy.liveliness().declare_token(f"{ROOT}/routes/{HUB}/robot4/{2:016x}"),
        ]
        until(lambda: fleet.machines("robot1") == ["robot1", "robot2", "robot4"])
        del subscribers, mine


def test_a_machine_that_is_no_router_leads_nothing_by_any_key(fleet: Fleet) -> None:
    on_loopback(fleet)
    fleet.start("robot1")
    with fleet.spy("robot2", f"127.0.0.1:{fleet.ports['robot1']}") as spy:
        here = agent_of("robot1", spy)
        fake = f"robot3/{1:016x}"
        for router in ("robot2", HUB):
            assert answers(spy, f"{ROOT}/by/{router}/open/{here}/{fake}") == []
        mine = [
            spy.liveliness().declare_token(f"{ROOT}/routes/{router}/robot4/{2:016x}")
            for router in ("robot2", HUB)
        ]
        mine.append(spy.liveliness().declare_token(f"{ROOT}/machines/robot2/{2:016x}"))
        until(lambda: fleet.machines("robot1") == ["robot1", "robot2"])
        time.sleep(2)
        assert fleet.machines("robot1") == ["robot1", "robot2"]
        del mine


def test_a_machine_sends_through_a_router_in_its_own_name_only(fleet: Fleet) -> None:
    on_loopback(fleet)
    for machine in (HUB, "robot1"):
        fleet.start(machine)
    fleet.meet(HUB, "robot1")
    nobody = ["absent no process listens at agent:robot1/nobody\n"]
    with fleet.spy("robot2", f"127.0.0.1:{fleet.ports[HUB]}") as spy:
        here = agent_of("robot1", spy, f"routes/{HUB}")
        own, fake = f"robot2/{1:016x}", f"robot3/{1:016x}"
        assert answers(spy, f"{ROOT}/to/{HUB}/open/{here}/{own}") == nobody
        assert answers(spy, f"{ROOT}/to/{HUB}/open/{here}/{fake}") == []
        # Nor does it receive what is led to others; what it says itself, its session receives.
        heard: list[str] = []
        subscribers = [
            spy.declare_subscriber(key, lambda sample: heard.append(str(sample.key_expr)))
            for key in (f"{ROOT}/to/**", f"{ROOT}/by/**", "**")
        ]
        spy.put(f"{ROOT}/to/{HUB}/links/{here}/{own}", b"no packet")
        time.sleep(1)
        assert [key for key in heard if not key.startswith(f"{ROOT}/to/{HUB}/")] == []
        del subscribers


def test_what_a_revoked_router_led_ends(fleet: Fleet) -> None:
    fleet.lay_out(SUBNETS)
    # The authority is elsewhere: what its agent tells the other one passes the router.
    fleet.make_authority("robot1")
    assert fleet.enroll(HUB, "--router")[0] == fleet.enroll("robot2")[0] == 0
    for machine in MACHINES:
        fleet.start(machine)
    fleet.meet(*MACHINES)
    rti, federates = fleet.federation(ENDLESS, PLACES)
    running(federates[0])
    assert finish(fleet.spawn("robot1", AGENT, "revoke", HUB))[0] == 0
    code, _, err = finish(fleet.agents.pop(HUB))
    assert code == 1 and f"the authority has taken {HUB} out of its machines" in err
    assert all(finish(process)[0] == 1 for process in [rti, *federates])
    agent = fleet.agents.pop("robot1")
    agent.terminate()
    assert f"{HUB} is no router any more, as the authority says" in finish(agent)[2]
