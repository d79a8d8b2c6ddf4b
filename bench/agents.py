"""Compares links through agents with TCP, plain Zenoh and dora, between network namespaces.

    $ make bench-agents

Times are one way: from before a value is set to when the receiver's body, or the subscriber's
callback, has it. All processes are on one machine, so they share its monotonic clock. Agents and
sessions of Zenoh use TLS with the same certificates; TCP and dora are not encrypted. Contenders
take turns, `REPEATS` times.
"""

from __future__ import annotations

import json
import math
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# The tests of agents have the networks, and the comparison on one machine has dora.
sys.path[:0] = [str(ROOT / "tests" / folder) for folder in ("agents", "python")]
sys.path.append(str(ROOT / "bench" / "peers"))

import descendants  # noqa: E402
import environments  # noqa: E402
from machines import AGENT, HPRM  # noqa: E402
from networks import HUB, Fleet  # noqa: E402
from over_dora import Dora, timed  # noqa: E402

REPEATS = 5
#: Small messages of one turn, and large ones.
SMALL, LARGE = 200, 8
#: The receivers of large messages on one machine.
RECEIVERS = 4
BYTES = 50_000_000

PROGRAM = """\
target Python { coordination: decentralized, timeout: TIMEOUT }
preamble {=
import numpy as np, time
=}
reactor Source {
  output out
  timer t(100 msec, PERIOD)
  reaction(t) -> out {=
    value = np.empty(LENGTH)
    value[:] = 1
    value[0] = time.monotonic()
    out.set(value)
  =}
}
reactor Sink {
  input inp
  reaction(inp) {=
    now = time.monotonic()
    print("took", (now - inp.value[0]) * 1e6, flush=True)
  =}
}
federated reactor {
  source = new Source()
  @maxwait(forever)
  sink = new[COUNT] Sink()
  (source.out)+ -> sink.inp
}
"""

Took = list[float]


def program(length: int, period: int, messages: int, receivers: int) -> str:
    """The federation, with values of that length in bytes, each so many milliseconds."""
    replaced = {
        "TIMEOUT": f"{100 + period * (messages - 1)} msec",
        "PERIOD": f"{period} msec",
        "LENGTH": str(length // 8),
        "COUNT": str(receivers),
    }
    text = PROGRAM
    for word, value in replaced.items():
        text = text.replace(word, value)
    return text


def main() -> None:
    """Measures, and prints a table."""
    if not Path(AGENT).exists():
        sys.exit(f"error: {AGENT} is missing\n  hint: make agent")
    # Nodes of dora are started by its daemons, and are to end with them.
    descendants.adopt_orphans()
    with tempfile.TemporaryDirectory() as folder:
        fleet = Fleet(Path(folder))
        try:
            measure(fleet)
        finally:
            fleet.close()
            descendants.end_all(1)


def measure(fleet: Fleet) -> None:
    """Measures all contenders in turns."""
    names = ["robot1", "robot2", "robot3"]
    fleet.lay_out([["robot1"], ["robot2", "robot3"]])
    if fleet.network is None:
        sys.exit("error: no network namespaces here")
    fleet.make_authority(HUB, "--router")
    for name in names:
        assert fleet.enroll(name)[0] == 0
    for machine in [HUB, *names]:
        fleet.start(machine)
    fleet.meet(HUB, *names)
    here = [HUB] * RECEIVERS
    dora = start_dora(fleet)
    small: dict[str, Callable[[], Took]] = {
        "agents": lambda: ours(fleet, program(64, 5, SMALL, 1), [HUB], "agents"),
        "TCP": lambda: ours(fleet, program(64, 5, SMALL, 1), [HUB], "TCP"),
        "Zenoh": lambda: zenoh(fleet, 64, 5, SMALL, 1),
    }
    large: dict[str, Callable[[], Took]] = {
        "agents, 1 receiver": lambda: ours(fleet, image(1), [HUB], "agents"),
        f"agents, {RECEIVERS} receivers": lambda: ours(fleet, image(RECEIVERS), here, "agents"),
        "agents, 2 machines behind a router": lambda: ours(
            fleet, image(2), ["robot2", "robot3"], "agents"
        ),
        "TCP, 1 receiver": lambda: ours(fleet, image(1), [HUB], "TCP"),
        f"TCP, {RECEIVERS} receivers": lambda: ours(fleet, image(RECEIVERS), here, "TCP"),
        "Zenoh, 1 receiver": lambda: zenoh(fleet, BYTES, 600, LARGE, 1),
        f"Zenoh, {RECEIVERS} receivers": lambda: zenoh(fleet, BYTES, 1500, LARGE, RECEIVERS),
    }
    if dora:
        small["dora"] = lambda: dora.measure(64, 5, SMALL)[1:]
        # It drops what it has no room for, so it gets more time.
        large["dora, 1 receiver"] = lambda: dora.measure(BYTES, 2000, LARGE)[1:]
    report(fleet, "64 B one way", small, "us", 1)
    report(fleet, "50 MB one way, to the last receiver", large, "ms", 1000)


def start_dora(fleet: Fleet) -> Dora | None:
    """Daemons of dora on robot1 and at the hub; none if dora cannot be had."""
    assert fleet.network is not None
    try:
        environments.prepare("dora")
    except environments.Unavailable as error:
        print(f"without dora: {error}", flush=True)
        return None
    source = ("robot1", fleet.network.addresses["robot1"])
    sink = (HUB, fleet.network.gates["robot1"])
    dora = Dora(fleet.spawn, environments.python_of("dora"), fleet.folder, source, sink)
    dora.start()
    return dora


def image(receivers: int) -> str:
    """The federation of large values, with time for each to arrive."""
    return program(BYTES, 600 if receivers < RECEIVERS else 1500, LARGE, receivers)


def report(
    fleet: Fleet, title: str, contenders: dict[str, Callable[[], Took]], unit: str, scale: float
) -> None:
    """Measures contenders in turns, and prints what they took."""
    medians: dict[str, Took] = {name: [] for name in contenders}
    crossed: dict[str, list[float]] = {name: [] for name in contenders}
    came = dict.fromkeys(contenders, 0)
    for _ in range(REPEATS):
        for name, run in contenders.items():
            before = sent(fleet)
            took = run()
            came[name] += len(took)
            medians[name].append(statistics.median(took) / scale if took else math.inf)
            crossed[name].append((sent(fleet) - before) / (LARGE * BYTES))
    print(f"{title} ({unit})")
    for name, each in medians.items():
        share = f"   sent {statistics.median(crossed[name]):.2f}x" if unit == "ms" else ""
        low, middle, high = min(each), statistics.median(each), max(each)
        lost = f"   {came[name]} came" if came[name] < max(came.values()) else ""
        print(f"  {name:<36}{middle:9.1f}  ({low:.1f} to {high:.1f}){share}{lost}")
    print(flush=True)


def sent(fleet: Fleet) -> int:
    """How many bytes the sender's machine has sent."""
    assert fleet.network is not None
    command = fleet.network.command("robot1", "cat", "/proc/net/dev")
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    (cable,) = (it.split() for it in done.stdout.splitlines() if it.strip().startswith("cable:"))
    return int(cable[9])


def ours(fleet: Fleet, text: str, receivers: list[str], by: str) -> Took:
    """What a federation takes whose sender is on robot1."""
    assert fleet.network is not None
    (fleet.folder / "Fed.lf").write_text(text)
    common = ["--federation-file", "secret"]
    gate = fleet.network.gates["robot1"]
    listen = "agent:robot1/rti" if by == "agents" else "tcp:0.0.0.0:7700"
    rti = fleet.spawn("robot1", HPRM, "rti", "Fed.lf", "--listen", listen, *common)
    assert rti.stdout is not None
    said = rti.stdout.readline().split()
    assert said, rti.communicate()
    address = said[-1]
    federates = []
    names = [f"sink__{number}" for number in range(len(receivers))]
    for name, machine in [("source", "robot1"), *zip(names, receivers, strict=True)]:
        where = address
        if by == "TCP":
            near = "127.0.0.1" if machine == "robot1" else fleet.network.addresses["robot1"]
            where = f"tcp:{near}:7700"
        host = {"robot1": fleet.network.addresses["robot1"], HUB: gate}.get(machine, "")
        advertise = ["--advertise", host] if by == "TCP" else []
        words = [HPRM, "federate", "Fed.lf", name, "--rti", where, *advertise, *common]
        federates.append(fleet.spawn(machine, *words))
    outcomes = [process.communicate(timeout=120) for process in [*federates, rti]]
    assert all(process.returncode == 0 for process in [*federates, rti]), outcomes
    return last([read(out) for out, _ in outcomes[1:-1]])


def read(out: str) -> Took:
    """What a receiver says."""
    return [float(line.split()[1]) for line in out.splitlines() if line.startswith("took ")]


def last(took: list[Took]) -> Took:
    """How long each message took to the last of all receivers. The first one warms up."""
    assert len({len(one) for one in took}) == 1
    return [max(each) for each in zip(*took, strict=True)][1:]


def zenoh(fleet: Fleet, length: int, period: int, messages: int, receivers: int) -> Took:
    """What a publisher of Zenoh on robot1, and subscribers at the hub take."""
    assert fleet.network is not None
    gate = fleet.network.gates["robot1"]
    sinks = []
    for number in range(receivers):
        config = settings(fleet, HUB, listen=f"tls/0.0.0.0:{7800 + number}")
        sinks.append(fleet.spawn(HUB, sys.executable, __file__, "sink", config, str(messages)))
    for sink in sinks:
        assert sink.stdout is not None
        assert sink.stdout.readline() == "listens\n"
    places = [f"tls/{gate}:{7800 + number}" for number in range(receivers)]
    config = settings(fleet, "robot1", connect=places)
    words = [str(it) for it in (length, period, messages, receivers)]
    source = fleet.spawn("robot1", sys.executable, __file__, "source", config, *words)
    outcomes = [process.communicate(timeout=120) for process in [source, *sinks]]
    assert all(process.returncode == 0 for process in [source, *sinks]), outcomes
    return last([read(out) for out, _ in outcomes[1:]])


def settings(fleet: Fleet, machine: str, listen: str = "", connect: list[str] | None = None) -> str:
    """The configuration of a session of Zenoh with the certificate of a machine."""
    whole = {
        "mode": "peer",
        "connect": {"endpoints": connect or []},
        "listen": {"endpoints": [listen] if listen else []},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"link": {"tls": fleet.tls(machine)}},
    }
    return json.dumps(whole)


def publish(config: str, length: int, period: int, messages: int, receivers: int) -> None:
    """A publisher of Zenoh."""
    from zenoh import Config, CongestionControl, open

    session = open(Config.from_json5(config))
    publisher = session.declare_publisher("bench", congestion_control=CongestionControl.BLOCK)
    while len(session.info.peers_zid()) < receivers:
        time.sleep(0.01)
    time.sleep(0.5)
    for value in timed(length, period, messages):
        publisher.put(value.tobytes())
    time.sleep(0.5)
    session.close()


def subscribe(config: str, messages: int) -> None:
    """A subscriber of Zenoh."""
    import struct
    import threading

    from zenoh import Config, Sample, open

    took: Took = []
    done = threading.Event()

    def take(sample: Sample) -> None:
        (at,) = struct.unpack("d", sample.payload.to_bytes()[:8])
        took.append((time.monotonic() - at) * 1e6)
        if len(took) == messages:
            done.set()

    session = open(Config.from_json5(config))
    subscriber = session.declare_subscriber("bench", take)
    print("listens", flush=True)
    done.wait(100)
    print("\n".join(f"took {one}" for one in took), flush=True)
    subscriber.undeclare()
    session.close()


if __name__ == "__main__":
    if sys.argv[1:2] == ["source"]:
        publish(sys.argv[2], *map(int, sys.argv[3:]))
    elif sys.argv[1:2] == ["sink"]:
        subscribe(sys.argv[2], int(sys.argv[3]))
    else:
        main()
