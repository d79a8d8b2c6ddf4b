"""Processes that bodies start with ``multiprocessing``, by each of its start methods."""

from __future__ import annotations

import os
import signal

import pytest
from conftest import Run
from processes import COORDINATIONS, Bench

#: What a program defines, and a body that has other processes use it.
PREAMBLE = """
    import multiprocessing, os
    from concurrent.futures import ProcessPoolExecutor

    class Point:
        def __init__(self, x, y):
            self.x, self.y = x, y

    def doubled(point):
        return Point(2 * point.x, 2 * point.y)

    def answer(queue, point):
        queue.put((os.getpid(), doubled(point), __name__))
"""
BODY = """
    context = multiprocessing.get_context("METHOD")
    queue = context.Queue()
    process = context.Process(target=answer, args=(queue, Point(1, 2)))
    process.start()
    pid, point, name = queue.get(timeout=50)
    process.join()
    print("one", pid == process.pid, process.exitcode, isinstance(point, Point), point.x, name)
    with ProcessPoolExecutor(2, mp_context=context) as executor:
        points = list(executor.map(doubled, [Point(n, 0) for n in range(4)]))
    print("many", [point.x for point in points if isinstance(point, Point)])
"""
SAID = ["one True 0 True 2 __mp_main__", "many [0, 2, 4, 6]"]


@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_a_body_starts_processes_that_know_what_preambles_define(run: Run, method: str) -> None:
    outcome = run(
        f"""
        target Python
        preamble {{={PREAMBLE}=}}
        main reactor {{ reaction(startup) {{={BODY.replace("METHOD", method)}=}} }}
        """
    )
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.splitlines() == SAID


def test_a_federate_starts_processes_too(launch: Run) -> None:
    outcome = launch(
        """
        target Python
        import A from "lib.lf"
        reactor B { input i reaction(i) {= print("B", i.value) =} }
        federated reactor { a = new A() b = new B() a.o -> b.i }
        """,
        lib_dot_lf=f"""
        target Python
        preamble {{={PREAMBLE}=}}
        reactor A {{
            output o
            reaction(startup) -> o {{={BODY.replace("METHOD", "spawn")}    o.set(doubled(point).x)
            =}}
        }}
        """,
    )
    assert (outcome.code, outcome.err) == (0, "")
    assert sorted(outcome.out.splitlines()) == sorted(
        [f"[a] {line}" for line in SAID] + ["[b] B 4"]
    )


def test_the_program_is_found_again_from_another_folder(run: Run) -> None:
    outcome = run(
        """
        target Python
        preamble {=
            import os
            def folder(queue): queue.put(lf.source_directory())
        =}
        main reactor {
            reaction(startup) {=
                sys.argv[0] = "something else"
                os.chdir("/")
                import multiprocessing
                context = multiprocessing.get_context("spawn")
                queue = context.SimpleQueue()
                process = context.Process(target=folder, args=(queue,))
                process.start()
                process.join()
                print(process.exitcode, queue.get() == lf.source_directory())
            =}
        }
        """
    )
    assert (outcome.code, outcome.out, outcome.err) == (0, "0 True\n", "")


def test_such_a_process_has_no_runtime_to_ask(run: Run) -> None:
    outcome = run(
        """
        target Python
        preamble {=
            import multiprocessing
            def now(queue):
                try:
                    lf.time.logical()
                except RuntimeError as error:
                    queue.put(str(error))
        =}
        main reactor {
            reaction(startup) {=
                context = multiprocessing.get_context("spawn")
                queue = context.Queue()
                process = context.Process(target=now, args=(queue,))
                process.start()
                print(queue.get(timeout=50))
                process.join()
            =}
        }
        """
    )
    assert (outcome.code, outcome.err) == (0, "")
    assert "lf knows of times and tags only where reactions run" in outcome.out


@pytest.mark.parametrize("fork", ["os.fork()", "ctypes.CDLL(None).fork()"])
@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_forked_process_does_not_hide_that_its_parent_is_dead(
    bench: Bench, coordination: str, fork: str
) -> None:
    text = f"""
target Python {{ coordination: {coordination} }}
preamble {{=
  import ctypes, os, pathlib, time
=}}
reactor Source {{
  output out
  timer t(0, 10 ms)
  state forks = True
  reaction(t) -> out {{=
    out.set(1)
    if self.forks:
        self.forks = False
        if {fork} == 0:
            while not pathlib.Path("go").exists():
                time.sleep(0.01)
            os._exit(0)
        pathlib.Path("source.pid").write_text(f"{{os.getpid()}}\\n")
  =}}
}}
reactor Sink {{ input inp  reaction(inp) {{= pass =}} }}
federated reactor {{ source = new Source()  sink = new Sink()  source.out -> sink.inp }}
"""
    federation = bench.by_hand(text, "source", "sink")
    os.kill(bench.pid("source"), signal.SIGKILL)
    # The forked process continues, and what it has inherited keeps no other process from ending.
    for outcome in federation.finish("rti", "sink").values():
        assert outcome.code == 1
        assert "source ended before its last tag" in outcome.err
    (bench.folder / "go").touch()


@pytest.mark.parametrize("kind", ["main", "federated"])
def test_what_a_forked_process_asks_of_the_program_is_refused(launch: Run, kind: str) -> None:
    outcome = launch(
        f"""
        target Python
        preamble {{=
            import multiprocessing
            def ask(tell, *requests):
                for request in requests:
                    try:
                        request()
                    except RuntimeError as error:
                        tell.put(str(error))
        =}}
        reactor Part {{
          output out
          physical action came
          logical action next
          reaction(startup) -> out, came, next {{=
            context = multiprocessing.get_context("fork")
            told = context.Queue()
            requests = [
                lambda: out.set(1), came.schedule, next.schedule, lf.request_stop, lf.stop,
                lambda: self.update_deadline(MSEC(1)),
            ]
            child = context.Process(target=ask, args=(told, *requests))
            child.start()
            child.join()
            for _ in requests:
                print("forked by a body" in told.get(timeout=50))
            lf.request_stop()
          =}}
        }}
        {kind} reactor {{ part = new Part() }}
        """
    )
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.split().count("True") == 6
