"""Large arrays travel without a copy where no code can notice, and behave as before everywhere."""

from __future__ import annotations

import ast
import sys

import numpy as np
import pytest
from conftest import Run
from processes import COORDINATIONS
from scenarios import EXPECTED, program

import hprm

SCENARIOS = """
@moved
def new(number):
    return full(number)

@moved
def computed(number):
    return np.ones(N) * number

@moved
def cleared_and_filled(number):
    array = np.zeros((N, 2))
    assert not array.any()
    array += number
    return array

@moved
def fortran(number):
    return np.full((N, 2), number, dtype=np.float32, order="F")

@moved
def structured(number):
    return np.full(N, number, dtype=[("x", "<f8"), ("y", "<f8")])

@moved
def read_only_already(number):
    array = full(number)
    array.flags.writeable = False
    return array

@moved
def another_shape(number):
    array = full(number)
    array.shape = (N // 10, 10)
    return array

@moved
def grown(number):
    array = full(number)
    array.resize(3 * N, refcheck=False)
    assert (array[:N] == number).all() and not array[N:].any()
    array[N:] = number
    return array

@moved
def shrunk(number):
    array = full(number)
    array.resize(N // 2, refcheck=False)
    return array

@moved
def viewed_before(number):
    array = full(0)
    view = array[::2]
    view[:] = number
    array[1::2] = number
    memoryview(array).release()
    array.T[0] = number
    return array

@moved
def loan(number):
    array = hprm.empty((N, 2), np.float32)
    array.fill(number)
    return array

@moved
def small_loan(number):
    array = hprm.empty(5_000)
    array.fill(number)
    return array

@copied
def small(number):
    return np.full(5_000, float(number))

@moved
def loan_like(number):
    array = hprm.empty_like(full(0))
    array[:] = number
    return array

@moved
def in_a_list(number):
    return [full(number), "and", full(number)]

@moved
def in_containers(number):
    return {"image": (full(number), [full(number)])}

@moved
def from_a_coroutine(number):
    async def work():
        await asyncio.sleep(0)
        return full(number)
    return asyncio.run(work())

@(copied if FREE_THREADED else moved)
def loan_in_a_thread(number):
    made = []
    def work():
        made.append(hprm.empty(N))
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    made[0][:] = number
    return made.pop()

@copied
def made_in_a_thread(number):
    made = []
    thread = threading.Thread(target=lambda: made.append(full(number)))
    thread.start()
    thread.join()
    return made.pop()

@copied
def kept(number):
    array = full(number)
    keep.append(array)
    return array

@copied
def kept_view(number):
    array = full(number)
    keep.append(array.view())
    return array

@copied
def kept_slice(number):
    array = full(number)
    keep.append(array[::2])
    return array

@copied
def kept_transpose(number):
    array = np.full((N, 2), float(number))
    keep.append(array.T)
    return array

@copied
def kept_strides(number):
    array = full(number)
    keep.append(np.lib.stride_tricks.as_strided(array, (10,), (8,)))
    return array

@copied
def kept_memoryview(number):
    array = full(number)
    keep.append(memoryview(array))
    return array

@copied
def kept_data(number):
    array = full(number)
    keep.append(array.data)
    return array

@copied
def kept_buffer(number):
    array = full(number)
    keep.append(np.frombuffer(array, dtype=np.float64))
    return array

@copied
def kept_pointer(number):
    array = full(number)
    pointer = array.ctypes.data_as(__import__("ctypes").POINTER(__import__("ctypes").c_double))
    keep.append(pointer)
    return array

@copied
def kept_ctypes(number):
    array = full(number)
    keep.append(np.ctypeslib.as_ctypes(array))
    return array

@copied
def kept_iterator(number):
    array = full(number)
    keep.append(array.flat)
    return array

@copied
def kept_weakly(number):
    array = full(number)
    keep.append(weakref.ref(array))
    return array

@copied
def kept_by_a_closure(number):
    array = full(number)
    keep.append(lambda: array)
    return array

@copied
def kept_by_a_generator(number):
    array = full(number)
    def numbers():
        yield array
        array[:] = -1
        yield
    generator = numbers()
    next(generator)
    keep.append(generator)
    return array

@copied
def kept_by_a_thread(number):
    array = full(number)
    go, done = threading.Event(), threading.Event()
    def work():
        go.wait()
        array[:] = -1
        done.set()
    threading.Thread(target=work, daemon=True).start()
    keep.append((go, done))
    return array

@copied
def in_a_kept_list(number):
    array = full(number)
    keep.append([array])
    return keep[-1]

@copied
def in_a_list_in_a_kept_dict(number):
    value = {"deep": [(full(number),)]}
    keep.append(value["deep"])
    return value

@copied
def twice_in_a_list(number):
    array = full(number)
    return [array, array]

@copied
def a_slice(number):
    return full(number)[1:]

@copied
def a_view(number):
    return full(number).view()

@copied
def a_transpose(number):
    return np.full((N, 2), float(number)).T

class Child(np.ndarray):
    pass

@copied
def of_a_subclass(number):
    array = Child((2, N))
    array[:] = number
    return array
"""


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_what_a_peer_sees_never_changes_whatever_the_sender_keeps(
    launch: Run, coordination: str
) -> None:
    outcome = launch(program(SCENARIOS, coordination))
    assert outcome.code == 0, outcome.err
    assert sorted(outcome.out.splitlines()) == EXPECTED


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_what_is_sent_is_what_an_array_is_at_the_end_of_its_tag(
    launch: Run, coordination: str
) -> None:
    """And what was published is read-only from then on, for readers in the same process, too."""
    outcome = launch(f"""\
        target Python {{ coordination: {coordination} }}
        preamble {{= import numpy as np =}}
        reactor Maker {{
          output out
          timer t(0, 1 msec)
          state count = 0
          reaction(t) -> out {{=
            out.set(np.full(100_000, -1))
            array = np.full(100_000, self.count)
            out.set(array)
            array[1] = self.count + 1000
            self.count += 1
          =}}
          reaction(t) -> out {{=
            out.value[2] = self.count + 1999
            if self.count == 50:
                request_stop()
          =}}
        }}
        reactor Late {{
          input inp
          state refused = 0
          reaction(inp) {{=
            array = inp.value
            for attempt in [
                lambda: array.__setitem__(0, 7),
                lambda: array.setflags(write=True),
                lambda: array.resize(5, refcheck=False),
                lambda: np.copyto(array, 0),
                lambda: array.view().setflags(write=True),
                lambda: memoryview(array).__setitem__(0, 7),
            ]:
                try:
                    attempt()
                except (ValueError, TypeError):
                    self.refused += 1
          =}}
          reaction(shutdown) {{= print(self.refused) =}}
        }}
        reactor Source {{
          output out
          maker = new Maker()
          late = new Late()
          maker.out -> out
          maker.out -> late.inp after 500 usec
          reaction(shutdown) {{=
            stats = lf.store_stats()
            print(stats["bytes_copied"], stats["objects_sealed"] >= 49, stats["segments"])
          =}}
        }}
        reactor Sink {{
          input inp
          state seen = {{= [] =}}
          reaction(inp) {{= self.seen.append(inp.value) =}}
          reaction(shutdown) {{=
            ok = [
                (array[:3] == [count, count + 1000, count + 2000]).all()
                and (array[3:] == count).all()
                for count, array in enumerate(self.seen)
            ]
            print(len(ok), all(ok))
          =}}
        }}
        federated reactor {{
          source = new Source()
          sink = new Sink()
          source.out -> sink.inp
        }}
        """)
    assert outcome.code == 0, outcome.err
    lines = sorted(outcome.out.splitlines())
    # The reader that is late misses what comes when all stop.
    assert lines[0] in ("[sink] 50 True", "[sink] 51 True")
    assert lines[1:] == ["[source] 0 True 3", f"[source] {6 * 49}"], lines


def test_arrays_that_are_kept_leave_room_for_those_that_are_sent(launch: Run) -> None:
    outcome = launch("""\
        target Python { coordination: decentralized, store-limit: "64 MB" }
        preamble {=
          import os
          import numpy as np
          MB = 1_000_000
        =}
        reactor Source {
          output out
          logical action next
          state weights = {= [] =}
          state count = 0
          reaction(startup, next) -> out, next {=
            # In all 70 of the 64 MB that the store has.
            self.weights.append(np.empty(7 * MB, np.uint8))
            out.set(np.full(MB, self.count, np.uint8))
            self.count += 1
            if self.count == 10:
                stats = lf.store_stats()
                half = 32 * MB
                print(stats["bytes_in_use"] < half + 3 * MB, stats["heap_fallbacks"] > 0)
                print(stats["inline_fallbacks"], sum(map(len, self.weights)) // MB)
                request_stop()
            else:
                next.schedule(0)
          =}
        }
        reactor Sink {
          input inp
          state total = 0
          reaction(inp) {= self.total += int(inp.value[-1]) =}
          reaction(shutdown) {= print(self.total) =}
        }
        federated reactor {
          source = new Source()
          sink = new Sink()
          source.out -> sink.inp
        }
        """)
    assert outcome.code == 0, outcome.err
    assert sorted(outcome.out.splitlines()) == [
        "[sink] 45",
        "[source] 0 70",
        "[source] True True",
    ]


def test_nothing_changes_outside_of_reactions(launch: Run) -> None:
    outcome = launch("""\
        target Python { coordination: decentralized }
        preamble {=
          import contextvars, threading
          import numpy as np
          try:
              from numpy._core.multiarray import get_handler_name
          except ImportError:
              from numpy.core.multiarray import get_handler_name
          seen = {"preamble": get_handler_name()}
          def look(where):
              seen[where] = get_handler_name()
        =}
        reactor Source {
          output out
          state made = {= look("state") =}
          reaction(startup) -> out {=
            look("reaction")
            thread = threading.Thread(target=look, args=("thread",))
            thread.start()
            thread.join()
            contextvars.copy_context().run(look, "copied context")
            contextvars.Context().run(look, "new context")
            seen["small"] = get_handler_name(np.ones(3))
            out.set(seen)
          =}
        }
        reactor Sink {
          input inp
          reaction(inp) {=
            look("reaction")
            print(inp.value)
            print(seen)
          =}
        }
        federated reactor {
          source = new Source()
          sink = new Sink()
          source.out -> sink.inp
        }
        """)
    assert outcome.code == 0, outcome.err
    sink, *lines = [line.removeprefix("[sink] ") for line in outcome.out.splitlines()]
    heap, ours = "default_allocator", "hprm"
    assert ast.literal_eval(sink) == {
        "preamble": heap,
        "state": heap,
        "reaction": ours,
        # A thread has the context of the one that starts it, if the interpreter says so.
        "thread": ours if getattr(sys.flags, "thread_inherit_context", False) else heap,
        "copied context": ours,
        "new context": heap,
        "small": ours,
    }
    # A program that sends nothing publishes nothing.
    assert [ast.literal_eval(line) for line in lines] == [{"preamble": heap, "reaction": heap}]


def test_without_a_federation_arrays_are_numpy_s(run: Run) -> None:
    outcome = run("""\
        target Python
        preamble {=
          import hprm
          import numpy as np
        =}
        main reactor {
          reaction(startup) {=
            array = hprm.empty((3, 4), dtype=np.int16, order="F")
            array[:] = 7
            print(array.sum(), array.flags.f_contiguous, hprm.empty_like(array).shape)
          =}
        }
        """)
    assert (outcome.code, outcome.out) == (0, "84 True (3, 4)\n"), outcome.err
    assert hprm.empty(5).dtype == np.float64
    prototype = np.ones(3).view(type("Child", (np.ndarray,), {}))
    like = hprm.empty_like(prototype, dtype=np.uint8, shape=(70_000, 2))
    assert (type(like), like.dtype, like.shape) == (np.ndarray, np.uint8, (70_000, 2))


FORK = """\
target Python { coordination: decentralized }
preamble {=
import multiprocessing, os
import numpy as np
N = 100_000

def of_a_child(work):
    "What a child says, which is the number of things that are wrong."
    pid = os.fork()
    if pid == 0:
        os._exit(work())
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
=}
reactor Source {
  output out
  logical action next(1 msec)
  state kept = {= None =}
  state sent = {= None =}
  state count = 0
  state wrong = 0
  reaction(startup, next) -> out, next {=
    array = np.full(N, self.count)
    self.kept = np.full(N, self.count + 500)
    def child():
        wrong = int((array != self.count).any()) + int((self.kept != self.count + 500).any())
        array[:] = -1
        self.kept[:] = -2
        self.kept = None
        scratch = np.full(N, -3)
        wrong += int((array != -1).any()) + int((scratch != -3).any())
        return wrong
    self.wrong += of_a_child(child)
    # A child that lives on, while its parent goes on with the memory.
    again, said = os.pipe(), os.pipe()
    if os.fork() == 0:
        os.close(again[1])
        os.read(again[0], 1)
        ok = (array == self.count).all() and (self.kept == self.count + 500).all()
        os.write(said[1], b"y" if ok else b"n")
        os._exit(0)
    os.close(again[0])
    self.wrong += int((array != self.count).any())
    out.set(array)
    del array, child
    self.kept[:] = 9
    self.kept = None
    for _ in range(5):
        np.full(N, -4)
    os.close(again[1])
    self.wrong += os.read(said[0], 1) != b"y"
    os.wait()
    os.close(said[0])
    os.close(said[1])
    self.count += 1
    if self.count < 10:
        next.schedule(0)
    else:
        context = multiprocessing.get_context("fork")
        with context.Pool(2) as pool:
            self.wrong += sum(pool.map(np.max, [np.zeros(N)] * 4)) != 0
        print(self.wrong, lf.store_stats()["bytes_copied"])
        request_stop()
  =}
}
reactor Sink {
  input inp
  state seen = {= [] =}
  reaction(inp) {= self.seen.append(inp.value) =}
  reaction(shutdown) {=
    print([count for count, array in enumerate(self.seen) if (array != count).any()])
  =}
}
federated reactor {
  source = new Source()
  sink = new Sink()
  source.out -> sink.inp
}
"""


def test_a_forked_process_has_arrays_of_its_own(launch: Run) -> None:
    outcome = launch(FORK)
    assert outcome.code == 0, outcome.err
    assert sorted(outcome.out.splitlines()) == ["[sink] []", "[source] 0 0"]


def test_arrays_may_outlive_the_program(launch: Run) -> None:
    outcome = launch("""\
        target Python { coordination: decentralized }
        preamble {=
          import atexit, threading
          import numpy as np
          kept = []
          def late():
              kept.append(kept[0] * 2)
              for array in kept:
                  array[:] += 1
              print(kept[0][0], kept[1][0], kept[0].copy().sum())
              kept.clear()
          def wait(array):
              threading.Event().wait()
        =}
        reactor Source {
          output out
          reaction(startup) -> out {=
            kept.append(np.zeros(100_000))
            array = np.ones(50_000)
            work = threading.Thread(target=wait, args=(array,), daemon=True)
            work.start()
            atexit.register(late)
            out.set(np.ones(100_000))
          =}
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
        """)
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out == "[source] 1.0 1.0 100000.0\n"


def test_threads_make_and_drop_arrays_in_the_store_meanwhile(launch: Run) -> None:
    outcome = launch("""\
        target Python { coordination: decentralized }
        preamble {=
          import contextvars, queue, threading
          import numpy as np
          N = 20_000
          over, wrong, handed = threading.Event(), [], queue.SimpleQueue()
          def work(number):
              rounds = 0
              while not over.is_set() or rounds < 50:
                  array = np.full(N + rounds % 7, number)
                  other = array * 2
                  if (array != number).any() or (other != 2 * number).any():
                      wrong.append(number)
                  # Some are dropped by another thread, some are sent.
                  handed.put(array)
                  rounds += 1
        =}
        reactor Source {
          output out
          logical action next(1 msec)
          state threads = {= [] =}
          state count = 0
          reaction(startup, next) -> out, next {=
            if self.count == 0:
                for number in range(3):
                    run = contextvars.copy_context().run
                    thread = threading.Thread(target=run, args=(work, number))
                    thread.start()
                    self.threads.append(thread)
            latest = handed.get()
            while not handed.empty():
                latest = handed.get()
            out.set(latest)
            del latest
            self.count += 1
            if self.count == 50:
                over.set()
                for thread in self.threads:
                    thread.join()
                print(wrong, lf.store_stats()["bytes_copied"])
                request_stop()
            else:
                next.schedule(0)
          =}
        }
        reactor Sink {
          input inp
          state seen = {= [] =}
          reaction(inp) {= self.seen.append((inp.value, int(inp.value[0]))) =}
          reaction(shutdown) {=
            print(len(self.seen), [n for array, n in self.seen if (array != n).any()])
          =}
        }
        federated reactor {
          source = new Source()
          sink = new Sink()
          source.out -> sink.inp
        }
        """)
    assert outcome.code == 0, outcome.err
    source, sink = sorted(outcome.out.splitlines(), reverse=True)
    assert sink == "[sink] 50 []"
    assert source.startswith("[source] [] "), source
