"""Threads that bodies start and that die: the program fails with them."""

from __future__ import annotations

from typing import Any

import pytest

CAMERA = """
target Python {{ timeout: 5 sec }}
preamble {{=
  import threading
  {preamble}
  def read_frames(frame):
      for number in range(3):
          frame.schedule(0, number)
      {last}
=}}
reactor Camera {{
  physical action frame
  reaction(startup) -> frame {{=
    threading.Thread(target=read_frames, args=(frame,), name="reader").start()
  =}}
  reaction(frame) {{= =}}
}}
{kind} reactor {{
  a = new Camera()
}}
"""


def camera(last: str, preamble: str = "pass", kind: str = "main") -> str:
    return CAMERA.format(last=last, preamble=preamble, kind=kind)


@pytest.mark.parametrize("kind", ["main", "federated"])
def test_a_thread_that_dies_ends_the_program(run: Any, launch: Any, kind: str) -> None:
    start = launch if kind == "federated" else run
    outcome = start(camera("raise ValueError('no camera')", kind=kind))
    assert outcome.code == 1
    federate = "federate a: " if kind == "federated" else ""
    title = f"error: {federate}thread reader raised ValueError: no camera"
    assert outcome.err.startswith(title), outcome.err
    assert outcome.err.count("error:") == 1
    assert "Program.lf:9" in outcome.err
    assert "threading.py" not in outcome.err


def test_a_thread_may_end_itself(run: Any) -> None:
    text = camera("frame.schedule(0, None); lf.request_stop(); sys.exit(3)")
    outcome = run(text)
    assert (outcome.code, outcome.err) == (0, "")


def test_a_program_may_decide_itself(run: Any) -> None:
    hook = "threading.excepthook = lambda args: print('it was', args.exc_value) or request_stop()"
    outcome = run(camera("raise ValueError('no camera')", hook))
    assert (outcome.code, outcome.out, outcome.err) == (0, "it was no camera\n", "")


def test_a_thread_that_dies_after_the_end_is_a_failure_too(run: Any) -> None:
    last = "lf.request_stop(); over.wait(); raise ValueError('too late')"
    text = camera(last, "over = threading.Event()")
    text = text.replace(
        "  reaction(frame)", "  reaction(shutdown) {= over.set() =}\n  reaction(frame)"
    )
    outcome = run(text)
    assert outcome.code == 1
    assert "thread reader raised ValueError: too late" in outcome.err


def test_a_forked_process_has_threads_of_its_own(run: Any) -> None:
    body = """
    child = os.fork()
    if child == 0:
        thread = threading.Thread(target=lambda: 1 / 0)
        thread.start()
        thread.join()
        os._exit(7)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    """
    outcome = run(
        "target Python\npreamble {= import threading =}\n"
        f"main reactor {{ reaction(startup) {{={body}=}} }}"
    )
    assert (outcome.code, outcome.out) == (0, "7\n")
