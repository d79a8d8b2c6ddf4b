"""Memory when owners and readers of large values are killed, at any moment, again and again.

A hub gets arrays from a source and keeps some, and sends arrays to a viewer, which keeps some. The
source and the viewer are killed in any order and started again. ``make test`` does that a few
times, ``make acceptance`` two hundred times.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
from processes import COORDINATIONS, Bench, Federation, finish, stores, until
from snippets import TELL

FULL = bool(os.environ.get("HPRM_ACCEPTANCE"))
KILLS = 200 if FULL else 6

SEGMENT = 16 << 20
"""The least that a store takes from the system at a time."""

SOURCE_WORDS, HUB_WORDS = 30_000, 50_000
"""Numbers in an array of either owner; 8 bytes each."""

KEPT_S = 0.2
"""How old an array may become that the hub keeps."""

FREE_WITHIN_S = 1.0
"""How soon everything that a federate has held or owned is free once it is killed."""

# The hub says how it is in a file, at each tag, and notes it in another one: the time, when the
# last array came, the bytes in its store, what it keeps, and how many segments of others it has
# mapped.
PROGRAM = (
    """\
target Python { coordination: COORDINATION }
preamble {=
import json, os, pathlib, time
import numpy as np
"""
    + TELL
    + """\
def say(name, **what):
    tell(f"{name}.json", json.dumps({"pid": os.getpid()} | what))
def is_whole(array):
    return not array.flags.writeable and bool((array == array[0]).all())
=}
reactor Source {
  output out
  timer t(0, 10 msec)
  state count = 0
  reaction(t) -> out {=
    self.count += 1
    out.set(np.full(SOURCE_WORDS, self.count))
    if self.count == 10: say("source")
  =}
}
reactor Hub {
  input inp
  output out
  output beat
  timer t(0, 10 msec)
  state count = 0
  state arrived = 0
  state arrived_at = 0.0
  state kept = {= [] =}
  state log = {= open("hub.log", "a", buffering=1) =}
  reaction(inp) {=
    self.arrived += 1
    self.arrived_at = time.monotonic()
    self.kept.append((self.arrived_at, int(inp.value[0]), inp.value))
  =}
  reaction(t) -> out, beat {=
    self.count += 1
    out.set(np.full(HUB_WORDS, self.count))
    beat.set(self.count)
    now, stats = time.monotonic(), lf.store_stats()
    kept = [it for it in self.kept if now - it[0] < KEPT_S][-20:]
    # The last look at an array tells whether anything has changed it.
    for _, number, array in self.kept[: len(self.kept) - len(kept)]:
        assert is_whole(array) and array[0] == number
    array, self.kept = None, kept
    say("hub", count=self.count, arrived=self.arrived, kept=len(self.kept), **stats)
    # Looking takes a while, so the hub looks only when there may be none.
    maps = "" if self.kept else pathlib.Path("/proc/self/maps").read_text()
    mapped = maps.count("memfd:hprm-store") - stats["segments"]
    numbers = (now, self.arrived_at, stats["bytes_in_use"], len(self.kept), mapped)
    print(*numbers, file=self.log)
    if pathlib.Path("stop").exists(): request_stop()
  =}
}
reactor Viewer {
  input inp
  state kept = {= [] =}
  reaction(inp) {=
    assert is_whole(inp.value)
    self.kept = [*self.kept[-15:], inp.value]
    if len(self.kept) == 16: say("viewer")
  =}
}
reactor Anchor {
  input image
  input beat
  reaction(image, beat) {= assert is_whole(image.value) =}
}
federated reactor {
  @transient
  source = new Source()
  @maxwait(20 msec)
  hub = new Hub()
  @transient
  viewer = new Viewer()
  anchor = new Anchor()
  source.out -> hub.inp
  hub.out -> viewer.inp
  hub.out -> anchor.image
  hub.beat -> anchor.beat
}
"""
)


@dataclass(frozen=True)
class Moment:
    """How the hub was at a tag."""

    at: float
    arrived_at: float
    in_use: int
    kept: int
    foreign: int

    @classmethod
    def of(cls, line: bytes) -> Moment:
        """What a line of its log says."""
        at, arrived_at, *numbers = line.split()
        return cls(float(at), float(arrived_at), *map(int, numbers))

    def is_free_of(self, name: str) -> bool:
        """Whether it holds nothing for the viewer, or nothing of the source."""
        if name == "viewer":
            return self.in_use <= 4 * HUB_WORDS * 8
        return (self.kept, self.foreign) == (0, 0)


class Stage:
    """The federation, and what its hub says of itself."""

    def __init__(self, bench: Bench, coordination: str) -> None:
        """Start all members, and wait until messages arrive everywhere."""
        self._folder = bench.folder
        self._log = bench.folder / "hub.log"
        text = PROGRAM.replace("COORDINATION", coordination)
        text = text.replace("SOURCE_WORDS", str(SOURCE_WORDS)).replace("HUB_WORDS", str(HUB_WORDS))
        text = text.replace("KEPT_S", str(KEPT_S))
        self.federation: Federation = bench.by_hand(text, "source", "viewer", "hub", "anchor")
        self.await_flow()

    def hub(self) -> dict[str, int]:
        """How the hub is."""
        file = self._folder / "hub.json"
        until(file.exists, "the hub is there")
        return json.loads(file.read_text())

    def await_flow(self) -> None:
        """Wait until the source sends, the viewer keeps, and the hub does both."""
        for name in ("source", "viewer"):
            until((self._folder / f"{name}.json").exists, f"the {name} is there")
        before = self.hub()
        until(lambda: self.hub()["arrived"] > before["arrived"], "the hub gets arrays")
        until(lambda: self.hub()["kept"] > 0, "the hub keeps arrays")

    def kill(self, name: str) -> None:
        """Kill a federate, and see that what it has held or owned is free within a second."""
        before, log = self.hub(), self._log.stat().st_size
        member = self.federation.members.pop(name)
        os.kill(member.pid, signal.SIGKILL)
        member.communicate()
        (self._folder / f"{name}.json").unlink(missing_ok=True)
        # By now the kernel has closed what it had.
        reaped = time.monotonic()
        until(lambda: self.hub()["count"] > before["count"] + 1, "the hub goes on")
        self._await_free(name, log, reaped)

    def _await_free(self, name: str, log: int, begin: float) -> None:
        """See that the hub is free soon after a time, by what it says in its log from a byte on."""
        moments: list[Moment] = []

        def is_known() -> bool:
            lines = self._log.read_bytes()[log:].splitlines(keepends=True)
            said = [Moment.of(line) for line in lines if line.endswith(b"\n")]
            end = begin + FREE_WITHIN_S
            if name == "source":
                # What was under way still comes, and the hub keeps it for a while.
                end = max([begin, *(moment.arrived_at for moment in said)]) + KEPT_S + FREE_WITHIN_S
            # A hub that is given no processor for a while has its own numbers a tag later.
            late = [moment for moment in said if moment.at > end][:2]
            moments[:] = [*(moment for moment in said if begin <= moment.at <= end), *late]
            return len(late) == 2 or any(moment.is_free_of(name) for moment in moments)

        until(is_known, "the hub goes on")
        assert any(moment.is_free_of(name) for moment in moments), moments

    def start(self, *names: str) -> None:
        """Start federates again."""
        for name in names:
            self.federation.start(name)
        self.await_flow()

    def measure(self) -> dict[str, int]:
        """What the hub takes of the machine."""
        hub = self.hub()
        pid = hub["pid"]
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
        [resident] = [line for line in lines if line.startswith("RssAnon:")]
        return {
            "anonymous": int(resident.split()[1]) * 1024,
            "mapped": hub["bytes_mapped"],
            "descriptors": sum("memfd:" not in link for link in descriptors(pid)),
        }


def descriptors(pid: int) -> list[str]:
    """What the descriptors of a process lead to."""
    links = []
    for entry in os.listdir(f"/proc/{pid}/fd"):
        # One that was closed meanwhile leads nowhere.
        with contextlib.suppress(FileNotFoundError):
            links.append(os.readlink(f"/proc/{pid}/fd/{entry}"))
    return links


def surroundings() -> list[set[str]]:
    """The names in folders where something might be left."""
    folders = ["/dev/shm", os.environ.get("XDG_RUNTIME_DIR", "/dev/shm")]
    return [set(os.listdir(folder)) for folder in folders if Path(folder).is_dir()]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_memory_is_where_it_began_after_any_number_of_kills(
    bench: Bench, coordination: str
) -> None:
    outside = surroundings()
    stage = Stage(bench, coordination)
    order = random.Random(7)
    begun = stage.measure()
    for at in range(KILLS):
        victims = order.choice([["source"], ["viewer"], ["source", "viewer"]])
        for victim in victims:
            stage.kill(victim)
        stage.start(*victims)
        if at == 1:
            # The first rounds warm up what is used again later.
            begun = stage.measure()
    # Members that have just joined have descriptors in transit for a moment.
    few = begun["descriptors"] + 4
    until(lambda: stage.measure()["descriptors"] <= few, "descriptors are closed")
    ended = stage.measure()
    # A reader that lags for a moment makes the store grow once, by a segment.
    assert ended["mapped"] <= begun["mapped"] + 2 * SEGMENT, (begun, ended)
    assert ended["descriptors"] <= begun["descriptors"] + 4, (begun, ended)
    assert ended["anonymous"] < begun["anonymous"] + 8_000_000, (begun, ended)

    (bench.folder / "stop").touch()
    for name, member in stage.federation.members.items():
        outcome = finish(member)
        assert outcome.code == 0 or name == "rti", (name, outcome.err)
    assert all(now <= before for now, before in zip(surroundings(), outside, strict=True))


# Every member prints its name and its count at each tick.
CHAIN = (
    """\
target Python { coordination: COORDINATION }
preamble {=
import os, pathlib
import numpy as np
"""
    + TELL
    + """\
=}
reactor Sender {
  output out
  timer t(0, 2 msec)
  state count = 0
  reaction(t) -> out {=
    self.count += 1
    out.set(np.full(20_000, self.count))
    tell("sender.now", f"{os.getpid()} {self.count}")
  =}
}
reactor Receiver {
  input inp
  state kept = {= [] =}
  reaction(inp) {=
    self.kept = [*self.kept[-9:], inp.value]
    tell("receiver.now", f"{os.getpid()} {int(inp.value[0])}")
  =}
}
federated reactor {
  sender = new Sender()
  receiver = new Receiver()
  sender.out -> receiver.inp
}
"""
)


def progress(file: Path, tick: int) -> int:
    """Wait until a member has come to a tick, and return its process."""
    until(lambda: file.exists() and int(file.read_text().split()[1]) >= tick, f"tick {tick}")
    return int(file.read_text().split()[0])


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_nothing_is_left_whichever_process_is_killed_whenever(
    bench: Bench, coordination: str
) -> None:
    outside, held = surroundings(), stores()
    order = random.Random(coordination)
    for _ in range(KILLS // 2):
        for file in bench.folder.glob("*.now"):
            file.unlink()
        process = bench.start(CHAIN.replace("COORDINATION", coordination))
        victim, tick = order.choice(["sender", "receiver", "command"]), order.randrange(1, 40)
        watched = bench.folder / ("sender.now" if victim == "command" else f"{victim}.now")
        member = progress(watched, tick)
        pid = process.pid if victim == "command" else member
        os.kill(pid, signal.SIGKILL)
        outcome = finish(process)
        if victim == "command":
            assert outcome.code == -signal.SIGKILL
        else:
            assert outcome.code == 1
            outcome.assert_one_error(f"error: federate {victim} was killed by signal 9 (SIGKILL)")
        ended = time.monotonic()
        until(lambda: not bench.left(), "no process is left")
        assert time.monotonic() - ended < FREE_WITHIN_S
        until(lambda: stores() <= held, "no memory is left")
    assert all(now <= before for now, before in zip(surroundings(), outside, strict=True))
