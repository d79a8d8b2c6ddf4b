"""Watching a running federation from Python: `hprm.watch`."""

from __future__ import annotations

import contextlib
import gc
import os
import resource
import signal
import socket
import threading
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from processes import COORDINATIONS, Bench, finish, hear, hear_number, until
from test_echo import BANK, LARGE, VALUES, start, stop

import hprm
from hprm._hprm import Watch, WatchedMessage

# Values of classes that this process does not have.
CLASSES = """\
target Python { keepalive: true }
preamble {=
import collections, dataclasses, enum
@dataclasses.dataclass
class Pose:
    x: float
    name: str
Point = collections.namedtuple("Point", "x y")
class Light(enum.Enum):
    RED = 1
class Way(enum.Flag):
    IN = 1
    OUT = 2
VALUE = [Pose(0.5, "base"), Point(1, 2), Light.RED, Way.IN | Way.OUT]
=}
reactor Source {
  output out
  timer t(0, 10 ms)
  reaction(t) -> out {= out.set(VALUE) =}
}
reactor Sink {
  input inp
  reaction(inp) {= pass =}
}
federated reactor {
  source = new Source()
  sink = new Sink()
  source.out -> sink.inp
}
"""


def one(messages: Watch) -> WatchedMessage:
    """The next message, after which nothing is watched."""
    with messages:
        return next(messages)


@pytest.mark.parametrize("threads", [False, True], ids=["processes", "threads"])
@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_values_are_those_that_were_sent(bench: Bench, coordination: str, threads: bool) -> None:
    run = start(bench, VALUES, coordination, *(["--in-process"] if threads else []))

    def value(at: int) -> object:
        return one(hprm.watch(f"source.outs[{at}]", of=run.pid, wait="30 s")).value

    assert value(0) == 42
    assert value(1) == "x" * 300
    array = value(2)
    assert isinstance(array, np.ndarray)
    assert array.tolist() == np.arange(12.0).reshape(3, 4).tolist()
    assert array.dtype == np.float32
    assert not array.flags.writeable
    large = value(3)
    assert isinstance(large, np.ndarray)
    assert (large.shape, large.min(), large.max()) == ((100, 1000, 10), 7, 7)
    dictionary = value(4)
    assert isinstance(dictionary, dict)
    assert (dictionary["a"], dictionary["b"]) == ([1, 2.5, None], (True, b"raw"))
    assert str(value(6)) == "[Fraction(1, 3)]"
    assert value(8) == {1 + 2j}
    stop(run)


def test_a_message_says_where_and_when(bench: Bench) -> None:
    run = start(bench, VALUES)
    sent = one(hprm.watch("source.outs[0]", of=str(run.pid), wait="30 s"))
    assert sent.port == "source.outs[0]"
    assert sent.elapsed % 10_000_000 == 0
    assert sent.tag is not None
    assert sent.tag.microstep == 0
    assert (sent.missed, sent.size > 0) == (0, True)
    # By the same clock: it is sent when its tag has come, and soon after that.
    assert 0 <= sent.sent - sent.tag.time < 30_000_000_000
    assert "source.outs[0]" in repr(sent)
    got = one(hprm.watch("sink.inputs[0]", of=run.pid, wait="30 s"))
    assert got.port == "sink.inputs[0]"
    assert got.elapsed % 10_000_000 == 1_000_000
    assert got.tag is not None
    # The start of the federation is the same for both.
    assert got.tag.time - got.elapsed == sent.tag.time - sent.elapsed
    stop(run)


def test_without_ports_all_connections_are_watched(bench: Bench) -> None:
    run = start(bench, BANK)
    with hprm.watch(of=run.pid, wait="30 s") as messages:
        assert {it.port for it in islice(messages, 20)} == {"camera.image", "camera.count"}
    stop(run)


def test_a_pickle_is_read_only_if_that_is_asked_for(bench: Bench) -> None:
    run = start(bench, VALUES)
    message = one(hprm.watch("source.outs[5]", of=run.pid, wait="30 s"))
    with pytest.raises(hprm.WatchError, match="a pickle of __main__.Opaque") as raised:
        _ = message.value
    assert "pickles=True" in str(raised.value)
    # There is no such class here: it was looked for.
    message = one(hprm.watch("source.outs[5]", of=run.pid, wait="30 s", pickles=True))
    with pytest.raises(AttributeError, match="Opaque"):
        _ = message.value
    stop(run)


def test_objects_of_unknown_classes_are_namespaces(bench: Bench) -> None:
    run = start(bench, CLASSES)
    value = one(hprm.watch("source.out", of=run.pid, wait="30 s")).value
    assert value == [SimpleNamespace(x=0.5, name="base"), SimpleNamespace(x=1, y=2), "RED", 3]
    stop(run)


def held() -> list[str]:
    """The memory of this process that is the store of a federate."""
    lines = Path("/proc/self/maps").read_text().splitlines()
    return [line for line in lines if "memfd:hprm-store" in line]


def test_an_array_is_a_copy_and_a_message_holds_its_array_until_the_next(bench: Bench) -> None:
    images = "np.full(50_000_000, self.n % 256, np.uint8)"
    text = LARGE.replace("image.set(IMAGE)", f"image.set({images})")
    text = text.replace("assert image.value[1] == 255", "pass")
    run = start(bench, text)
    with hprm.watch("camera.image", of=run.pid, wait="30 s") as messages:
        kept = next(messages)
        assert held()
        # All are there, however many are kept.
        arrays = [it.value for it in islice(messages, 6)]
        assert len({int(it[0]) for it in arrays}) == 6
        with pytest.raises(hprm.WatchError, match="not held any more") as raised:
            _ = kept.value
        assert "before the next message" in str(raised.value)
        last = next(messages)
    # Nothing is watched any more, and the federate makes many images.
    hear(run.stdout, f"at {hear_number(run.stdout) + 30}\n")
    for array in (*arrays, last.value):
        assert (array == array[0]).all()
    assert last.value is last.value
    gc.collect()
    assert not held()
    stop(run)


def test_a_message_outlives_what_has_given_it(bench: Bench) -> None:
    run = start(bench, LARGE)
    message = next(hprm.watch("camera.image", of=run.pid, wait="30 s"))
    gc.collect()
    assert message.value[1] == 255
    stop(run)


def test_what_is_not_read_is_missed_and_counted(bench: Bench) -> None:
    run = start(bench, LARGE)
    with hprm.watch("camera.image", of=run.pid, wait="30 s") as messages:
        next(messages)
        hear(run.stdout, f"at {hear_number(run.stdout) + 20}\n")
        assert sum(it.missed for it in islice(messages, 5)) >= 15
    stop(run)


def test_the_end_of_the_federation_ends_the_iteration(bench: Bench) -> None:
    run = start(bench, BANK.replace("keepalive: true", "timeout: 5 s"))
    values = [it.value for it in hprm.watch("camera.image", of=run.pid, wait="30 s")]
    assert values == list(range(values[0], 501))
    assert finish(run).code == 0


def test_another_thread_may_end_it(bench: Bench) -> None:
    run = start(bench, BANK)
    messages = hprm.watch("camera.image", of=run.pid, wait="30 s")
    seen: list[int] = []
    reader = threading.Thread(target=lambda: seen.extend(it.value for it in messages))
    reader.start()
    until(lambda: len(seen) > 3, "messages have come")
    messages.close()
    reader.join(30)
    assert not reader.is_alive()
    assert list(messages) == []
    stop(run)


SCRIPT = """\
import sys
import hprm
try:
    messages = hprm.watch("camera.image", of=sys.argv[1], wait="30 s")
    print("watches", flush=True)
    if len(sys.argv) > 2:
        hprm.watch("camera.image", of="None", wait="30 s")
    for message in messages:
        print("message", flush=True)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@pytest.mark.parametrize("waits", [(), ("waits",)], ids=["for messages", "for a federation"])
def test_ctrl_c_ends_a_wait(bench: Bench, waits: tuple[str, ...]) -> None:
    run = start(bench, BANK.replace("timer t(0, 10 ms)", "timer t(0, 1 hour)"))
    watcher = bench.python("-c", SCRIPT, str(run.pid), *waits)
    hear(watcher.stdout, "watches\n")
    until(lambda: Path(f"/proc/{watcher.pid}/stat").read_text().split()[2] == "S", "it waits")
    watcher.send_signal(signal.SIGINT)
    # The message of the first tag may come before it watches, or after.
    assert finish(watcher).out.removeprefix("message\n") == "interrupted\n"
    stop(run)


def test_what_is_wrong_is_one_error(bench: Bench) -> None:
    with pytest.raises(hprm.WatchError) as raised:
        hprm.watch("camera.image", of="NoSuchFederation")
    message = "no federation NoSuchFederation of this user runs on this machine"
    assert raised.value.message == message
    assert raised.value.hint is not None
    run = start(bench, LARGE)
    for port, said in [
        ("camera", "camera is a federate, and not one of its ports"),
        ("camrea.image", "Main has no federate camrea"),
        ("camera.imgae", "camera has no port imgae"),
    ]:
        with pytest.raises(hprm.WatchError, match=said):
            hprm.watch("camera.image", port, of=run.pid, wait="30 s")
    both = [run, start(bench, LARGE)]
    hear(both[1].stdout, "at 1\n")
    with pytest.raises(hprm.WatchError, match="several federations of Main run") as raised:
        hprm.watch("camera.image", of="Main")
    assert "of=" in str(raised.value)
    for process in both:
        stop(process)


@pytest.mark.parametrize(
    ("arguments", "options", "error"),
    [
        ((7,), {}, TypeError),
        (("camera.image",), {"wait": "soon"}, ValueError),
        (("camera.image",), {"wait": -1}, ValueError),
        (("camera.image",), {"wait": 0.5}, TypeError),
    ],
)
def test_arguments_of_a_wrong_kind_are_refused(
    arguments: tuple[str, ...], options: dict[str, str], error: type[Exception]
) -> None:
    with pytest.raises(error):
        hprm.watch(*arguments, **options)  # type: ignore[arg-type]


QUIET = """\
target Python { keepalive: true }
preamble {=
import os, pathlib
=}
reactor Source {
  output out
  timer t(0, 200 ms)
  reaction(startup) {= pathlib.Path("source.pid").write_text(f"{os.getpid()}\\n") =}
  reaction(t) -> out {= out.set(1) =}
}
reactor Sink {
  input inp
  reaction(inp) {= pass =}
}
federated reactor {
  source = new Source()
  sink = new Sink()
  source.out -> sink.inp
}
"""


def watch_socket(pid: int) -> str:
    """Where a federate listens for watchers."""
    inodes = set()
    for path in Path(f"/proc/{pid}/fd").iterdir():
        # It may close one meanwhile.
        with contextlib.suppress(FileNotFoundError):
            inodes.add(os.readlink(path))
    for line in Path("/proc/net/unix").read_text().splitlines():
        fields = line.split()
        if fields[-1].startswith("@hprm-watch-") and f"socket:[{fields[6]}]" in inodes:
            return fields[-1][1:]
    raise LookupError("it does not listen")


def processor_time(pid: int) -> float:
    """For how many seconds a process has used a processor."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def test_a_federate_without_descriptors_lets_watchers_wait(bench: Bench) -> None:
    run = start(bench, QUIET)
    assert one(hprm.watch("source.out", of=run.pid, wait="30 s")).value == 1
    pid = bench.pid("source")
    limit = resource.prlimit(pid, resource.RLIMIT_NOFILE)
    used = max(int(path.name) for path in Path(f"/proc/{pid}/fd").iterdir())
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (used + 1, limit[1]))
    with contextlib.ExitStack() as waiting:
        # The first ones get what is free in between.
        for _ in range(8):
            one_more = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            waiting.enter_context(one_more).connect("\0" + watch_socket(pid))
        until(lambda: len(list(Path(f"/proc/{pid}/fd").iterdir())) == used + 1, "no file is left")
        before = processor_time(pid)
        threading.Event().wait(1)
        assert processor_time(pid) - before < 0.5
    resource.prlimit(pid, resource.RLIMIT_NOFILE, limit)
    assert one(hprm.watch("source.out", of=run.pid, wait="30 s")).value == 1
    stop(run)
