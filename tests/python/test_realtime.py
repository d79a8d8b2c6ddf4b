"""Real-time priorities: what a federate gets that asks for them, or the error if it gets none."""

from __future__ import annotations

import ctypes
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

HPRM = Path(sys.executable).with_name("hprm")
LIBC = ctypes.CDLL(None)
PR_CAPBSET_DROP = 24

PROGRAM = """
target Python {{ {properties} }}
preamble {{=
  import os
  def treatment():
      locked = next(line for line in open("/proc/self/status") if line.startswith("VmLck"))
      policy, priority = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
      print(policy == os.SCHED_FIFO, priority, int(locked.split()[1]) > 0, os.sched_getaffinity(0))
=}}
reactor R {{ reaction(startup) {{= treatment() =}} }}
federated reactor {{ a = new R()  b = new R() }}
"""


def run(
    tmp_path: Path, *options: str, properties: str = "", limits: bool = False
) -> subprocess.CompletedProcess[str]:
    """Run two federates that say how they are treated; with ``limits``, without the right to it."""
    program = tmp_path / "Treatment.lf"
    program.write_text(PROGRAM.format(properties=properties))

    def forbid() -> None:
        resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, 0))
        # Root would not care, but for what it may do only by its capabilities.
        for capability in range(64):
            LIBC.prctl(PR_CAPBSET_DROP, capability, 0, 0, 0)

    return subprocess.run(
        [HPRM, "run", *options, program],
        capture_output=True,
        text=True,
        timeout=60,
        preexec_fn=forbid if limits else None,
    )


def may_be_realtime() -> bool:
    """Whether the system gives this process what the tests ask for."""
    pid = os.fork()
    if pid == 0:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
        except OSError:
            os._exit(1)
        soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
        os._exit(0 if os.geteuid() == 0 or soft == resource.RLIM_INFINITY else 1)
    return os.waitpid(pid, 0)[1] == 0


@pytest.fixture
def cpus() -> list[int]:
    """The processors that this process may use."""
    return sorted(os.sched_getaffinity(0))


def test_a_federate_gets_priorities_or_an_error_that_says_why_not(tmp_path: Path) -> None:
    ended = run(tmp_path, "--realtime=7")
    if may_be_realtime():
        assert ended.returncode == 0, ended.stderr
        lines = sorted(ended.stdout.splitlines())
        assert [line.split()[:4] for line in lines] == [
            ["[a]", "True", "7", "True"],
            ["[b]", "True", "7", "True"],
        ]
    else:
        assert ended.returncode == 1
        assert ended.stderr.startswith("error: ") and "  hint: " in ended.stderr


def test_processors_are_given_in_the_order_of_the_program(tmp_path: Path, cpus: list[int]) -> None:
    first, last = cpus[0], cpus[-1]
    ended = run(tmp_path, properties=f"cpus: [{first}, {last}]")
    assert ended.returncode == 0, ended.stderr
    assert sorted(ended.stdout.splitlines()) == [
        f"[a] False 0 False {{{first}}}",
        f"[b] False 0 False {{{last}}}",
    ]


def test_a_processor_that_is_not_there_is_named_once(tmp_path: Path) -> None:
    ended = run(tmp_path, "--cpus", "0,4000")
    assert ended.returncode == 1
    assert ended.stderr.splitlines()[0] == "error: this process may not run on processor 4000"
    assert len(ended.stderr.splitlines()) == 2, ended.stderr


def test_a_federate_without_permission_says_what_the_system_wants(tmp_path: Path) -> None:
    ended = run(tmp_path, "--realtime", limits=True)
    assert ended.returncode == 1
    assert ended.stderr.startswith("error: real-time treatment needs memory that is locked")
    assert "ulimit -l unlimited" in ended.stderr
