"""Processes that a body forks: what they read does not change, and no other process sees writes."""

from __future__ import annotations

import pytest
from conftest import Run
from processes import COORDINATIONS, Bench

PROGRAM = """\
target Python {{ coordination: {coordination}, timeout: 400 msec }}
preamble {{=
import multiprocessing, os
import numpy as np
N = 200_000
FORK = multiprocessing.get_context("fork")

def look(array, number, again):
    "What a child says, long after the tag: whether it still has the array that it was given."
    again.recv()
    print(number, "kept" if (array == number).all() else "changed", flush=True)
=}}
reactor Camera {{
  output image
  input echo
  timer t(0, 20 msec)
  state number = 0
  state children = {{= [] =}}
  reaction(t) -> image {{=
    image.set(np.full(N, self.number))
    self.number += 1
  =}}
  reaction(echo) {{= {in_camera} =}}
  reaction(shutdown) {{= {end} =}}
}}
reactor Saver {{
  input image
  state children = {{= [] =}}
  reaction(image) {{= {in_saver} =}}
  reaction(shutdown) {{= {end} =}}
}}
federated reactor {{
  camera = new Camera()
  saver = new Saver()
  camera.image -> saver.image
  camera.image -> camera.echo after 20 msec
}}
"""

START = """
    number = int(PORT.value[0])
    if number in (3, 6):
        end, again = FORK.Pipe()
        child = FORK.Process(target=look, args=(PORT.value, number, end))
        child.start()
        self.children.append((child, again))
"""

END = """
    for child, again in self.children:
        again.send(None)
        child.join()
"""


@pytest.fixture(autouse=True)
def forks_without_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python 3.12 and newer warn about a fork of any process with threads."""
    monkeypatch.setenv("PYTHONWARNINGS", "ignore:This process:DeprecationWarning")


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("forking", ["saver", "camera"])
def test_a_forked_process_keeps_the_array_that_it_has(
    launch: Run, forking: str, coordination: str
) -> None:
    bodies = {
        "in_saver": START.replace("PORT", "image") if forking == "saver" else "pass",
        "in_camera": START.replace("PORT", "echo") if forking == "camera" else "pass",
    }
    outcome = launch(PROGRAM.format(coordination=coordination, end=END, **bodies))
    assert outcome.code == 0, outcome.err
    assert sorted(outcome.out.splitlines()) == [f"[{forking}] 3 kept", f"[{forking}] 6 kept"]


# Arrays that NumPy has made in the store, in all that a forked process may do with them. A child
# says on its way out what is wrong, by its exit code and on the standard error stream.
TABLE = """\
target Python {{ coordination: decentralized }}
preamble {{=
import ctypes, multiprocessing, os, subprocess, sys, threading, traceback
import numpy as np
N = 100_000
# A process that C forks hangs if the GIL is not its thread's, or if another thread asks for it,
# which that process does not have.
LIBC = ctypes.PyDLL(None)
sys.setswitchinterval(100)

def made():
    "Arrays in the memory of the store, if this process has one; each is for another operation."
    return {{n: np.full(N, n) for n in range(1, 6)}}

def use(arrays):
    "Everything that NumPy asks of its memory."
    assert all((array == n).all() for n, array in arrays.items())
    arrays[1].resize(3 * N, refcheck=False)
    assert (arrays[1][:N] == 1).all() and not arrays[1][N:].any()
    arrays[2].resize(N // 2, refcheck=False)
    assert (arrays[2] == 2).all()
    arrays[3].resize(10, refcheck=False)
    assert (arrays[3] == 3).all()
    del arrays[4]
    arrays[5][:] = -5
    assert (arrays[5] == -5).all()
    del arrays[5]
    assert not np.zeros(N).any()

def look(arrays, generations):
    "Arrays from before the fork and from after it, here and in what is forked from here."
    for more in range(generations):
        assert waited(forked_by(os.fork if more else LIBC.fork, look, arrays, generations - 1)) == 0
        assert waited(forked_by(os.fork, use, made())) == 0
    new = made()
    use(arrays)
    use(new)
    use(made())

def look_at_copies(arrays, generations):
    "Arrays that were unpickled do not own their memory."
    look({{n: array.copy() for n, array in arrays.items()}}, generations)

def forked_by(fork, work, *arguments):
    pid = fork()
    if pid:
        return pid
    code = 1
    try:
        work(*arguments)
        code = 0
    except BaseException:
        os.write(2, traceback.format_exc().encode())
    finally:
        os._exit(code)

def waited(pid):
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])

def on_a_thread(work):
    codes = []
    thread = threading.Thread(target=lambda: codes.append(work()))
    thread.start()
    thread.join()
    return codes.pop()

def by_multiprocessing(method, arrays):
    work = look if method == "fork" else look_at_copies
    process = multiprocessing.get_context(method).Process(target=work, args=(arrays, 1))
    process.start()
    process.join()
    return process.exitcode

def by_subprocess(arrays):
    "Also then: what runs between the fork and the new program is a forked process."
    return subprocess.run(["true"], preexec_fn=lambda: look(arrays, 1)).returncode

WAYS = {{
    "os.fork": lambda arrays: waited(forked_by(os.fork, look, arrays, 2)),
    "C": lambda arrays: waited(forked_by(LIBC.fork, look, arrays, 2)),
    "os.fork on a thread": lambda arrays: on_a_thread(
        lambda: waited(forked_by(os.fork, look, arrays, 1))),
    "C on a thread": lambda arrays: on_a_thread(
        lambda: waited(forked_by(LIBC.fork, look, arrays, 1))),
    "fork": lambda arrays: by_multiprocessing("fork", arrays),
    "forkserver": lambda arrays: by_multiprocessing("forkserver", arrays),
    "subprocess": by_subprocess,
}}
=}}
reactor Source {{
  output out
  reaction(startup) -> out {{=
    arrays = made()
    print(WAYS[{way!r}](arrays))
    # Nothing of that is seen here, and all of it works here as well.
    assert all((array == n).all() for n, array in arrays.items())
    use(arrays | made())
    out.set(arrays[1])
    del arrays
  =}}
}}
reactor Sink {{
  input inp
  reaction(inp) {{= print(len(inp.value), inp.value.min(), lf.store_stats()["bytes_copied"]) =}}
}}
federated reactor {{ source = new Source()  sink = new Sink()  source.out -> sink.inp }}
"""

WAYS = ["os.fork", "C", "os.fork on a thread", "C on a thread", "fork", "forkserver", "subprocess"]


@pytest.mark.parametrize("way", WAYS)
def test_a_forked_process_may_do_with_arrays_what_it_likes(launch: Run, way: str) -> None:
    outcome = launch(TABLE.format(way=way))
    assert (outcome.code, outcome.err) == (0, ""), outcome.err
    assert sorted(outcome.out.splitlines()) == ["[sink] 100000 1 0", "[source] 0"]


SEEN = """\
target Python {{ coordination: {coordination}, timeout: 30 ms }}
preamble {{=
import ctypes, os
import numpy as np
=}}
reactor Source {{
  output out
  timer t(0, 10 ms)
  reaction(t) -> out {{=
    array = np.zeros(100_000)
    pid = ctypes.CDLL(None).fork()
    if pid == 0:
        array[:] = 666
        os._exit(0)
    os.waitpid(pid, 0)
    print("kept", array.max())
    out.set(array)
  =}}
}}
reactor Sink {{ input inp  reaction(inp) {{= print("received", inp.value.max()) =}} }}
federated reactor {{ source = new Source()  sink = new Sink()  source.out -> sink.inp }}
"""


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_what_a_process_writes_that_c_has_forked_is_not_received(
    launch: Run, coordination: str
) -> None:
    outcome = launch(SEEN.format(coordination=coordination))
    assert (outcome.code, outcome.err) == (0, "")
    assert sorted(outcome.out.splitlines()) == [
        *["[sink] received 0.0"] * 4,
        *["[source] kept 0.0"] * 4,
    ]


STORM = """\
target Python {{ coordination: decentralized }}
preamble {{=
import ctypes, os, signal, threading
import hprm
import numpy as np
LIBC = ctypes.CDLL(None)

def allocate(until):
    "Without an end, and each array is right."
    number = 0
    while not until.is_set():
        number += 1
        array = hprm.empty(20_000)
        array[:] = number
        assert (array == number).all()
        array.resize(40_000, refcheck=False)

def fork(how, times):
    for _ in range(times):
        pid = how()
        if pid == 0:
            os._exit(0)
        # Forked by C, it may wait for ever for the interpreter, which another thread has had.
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
=}}
reactor Source {{
  output out
  input back
  timer t(0, 1 ms)
  state sent = 0
  state until = {{= threading.Event() =}}
  state threads = {{= [] =}}
  reaction(startup) {{=
    self.threads += [threading.Thread(target=allocate, args=(self.until,)) for _ in range(2)]
    ways = (os.fork, LIBC.fork, LIBC.fork)
    self.threads += [threading.Thread(target=fork, args=(way, 40)) for way in ways]
    for thread in self.threads: thread.start()
    self.open = len(os.listdir("/proc/self/fd"))
  =}}
  reaction(t) -> out {{=
    self.sent += 1
    out.set(np.full(20_000, self.sent))
    if any(thread.is_alive() for thread in self.threads[2:]): return
    request_stop()
  =}}
  reaction(back) {{= assert (back.value == back.value[0]).all() =}}
  reaction(shutdown) {{=
    self.until.set()
    for thread in self.threads: thread.join()
    print(len(os.listdir("/proc/self/fd")) - self.open < 20)
  =}}
}}
reactor Sink {{
  input inp
  output out
  state last = 0
  reaction(inp) -> out {{=
    assert (inp.value == inp.value[0]).all() and inp.value[0] == self.last + 1
    self.last += 1
    out.set(inp.value)
  =}}
}}
federated reactor {{
  source = new Source()
  sink = new Sink()
  source.out -> sink.inp
  sink.out -> source.back after 1 ms
}}
"""


def test_threads_fork_and_allocate_while_arrays_are_sent(bench: Bench) -> None:
    outcome = bench.run(STORM.format())
    assert (outcome.code, outcome.out, outcome.err) == (0, "[source] True\n", "")


@pytest.mark.parametrize("fork", ["os.fork()", "ctypes.CDLL(None).fork()"])
def test_forks_leave_no_descriptor(launch: Run, fork: str) -> None:
    outcome = launch(f"""
        target Python {{ coordination: decentralized }}
        preamble {{=
          import ctypes, os
        =}}
        reactor Source {{
          output out
          reaction(startup) -> out {{=
            before = len(os.listdir("/proc/self/fd"))
            for _ in range(100):
                pid = {fork}
                if pid == 0:
                    os._exit(0)
                os.waitpid(pid, 0)
            print(len(os.listdir("/proc/self/fd")) - before)
            out.set(1)
          =}}
        }}
        reactor Sink {{ input inp  reaction(inp) {{= pass =}} }}
        federated reactor {{ source = new Source()  sink = new Sink()  source.out -> sink.inp }}
    """)
    assert (outcome.code, outcome.out, outcome.err) == (0, "[source] 0\n", "")


def test_a_child_that_closes_all_descriptors_keeps_what_it_has_received(launch: Run) -> None:
    bodies = {
        "in_camera": "pass",
        # As daemons do.
        "in_saver": START.replace("PORT", "image"),
    }
    text = PROGRAM.format(coordination="decentralized", end=END, **bodies)
    text = text.replace(
        "    again.recv()", "    os.closerange(again.fileno() + 1, 4096)\n    again.recv()"
    )
    outcome = launch(text)
    assert outcome.code == 0, outcome.err
    assert sorted(outcome.out.splitlines()) == ["[saver] 3 kept", "[saver] 6 kept"]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_process_that_is_forked_while_a_value_is_sent_is_no_federate(
    bench: Bench, coordination: str
) -> None:
    outcome = bench.run(f"""\
target Python {{ coordination: {coordination} }}
preamble {{=
import os, signal
class Value:
    def __reduce__(self):
        pid = os.fork()
        if pid:
            print("sending", os.waitpid(pid, 0)[1], flush=True)
        return Value, ()
def fork(*_):
    pid = os.fork()
    if pid:
        print("handling", os.waitpid(pid, 0)[1], flush=True)
=}}
reactor Source {{
  output out
  logical action next(10 ms)
  reaction(startup) -> out, next {{=
    out.set(Value())
    signal.signal(signal.SIGUSR1, fork)
    next.schedule(0)
  =}}
  reaction(next) {{= os.kill(os.getpid(), signal.SIGUSR1) =}}
}}
reactor Sink {{ input inp  reaction(inp) {{= print(type(inp.value).__name__) =}} }}
federated reactor {{ source = new Source()  sink = new Sink()  source.out -> sink.inp }}
""")
    assert (outcome.code, outcome.err) == (0, "")
    said = ["[sink] Value", "[source] handling 0", "[source] sending 0"]
    assert sorted(outcome.out.splitlines()) == said


CHILD = """\
target Python {{ timeout: 0 ms }}
preamble {{= import os, sys =}}
reactor Parent {{
  reaction(startup) {{=
    pid = os.fork()
    if pid == 0:
        {end}
    status = os.waitpid(pid, 0)[1]
    print("code", os.waitstatus_to_exitcode(status), flush=True)
  =}}
}}
{kind} reactor {{ parent = new Parent() }}
"""


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("main", []),
        ("main", ["--workers", "2"]),
        ("federated", []),
        ("federated", ["--in-process"]),
    ],
)
@pytest.mark.parametrize(
    ("end", "code", "said"),
    [
        ("1 / 0", 1, "ZeroDivisionError: division by zero\n"),
        ("sys.exit(-1)", 255, ""),
        ("sys.exit('enough')", 1, "enough\n"),
        ("sys.exit()", 0, ""),
    ],
)
def test_a_forked_process_ends_as_python_ends_one(
    bench: Bench, kind: str, options: list[str], end: str, code: int, said: str
) -> None:
    outcome = bench.run(CHILD.format(kind=kind, end=end), "--json", *options)
    assert outcome.code == 0, outcome.err
    assert f"code {code}\n" in outcome.out
    # What it writes is no report of a failure of the program.
    assert '{"kind"' not in outcome.err and outcome.errors == []
    assert "AssertionError" not in outcome.err
    if said.startswith("Zero"):
        assert "Traceback (most recent call last):" in outcome.err
    assert outcome.err.endswith(said)
    assert bool(outcome.err) == bool(said)
