"""Federations of Python objects: who may join, what is killed, what a federate can state."""

from __future__ import annotations

import os
import signal

import pytest
from processes import Bench, finish, hear

import hprm

PROGRAM = """
import hprm


class Camera(hprm.Reactor):
    image = hprm.Output(bytes)
    t = hprm.Timer("20 ms")

    def __init__(self, size: int = 3) -> None:
        self.size = size

    @hprm.reaction(t, effects=[image])
    def capture(self) -> None:
        self.image.set(b"x" * self.size)


class Planner(hprm.Reactor):
    image = hprm.Input(bytes)

    def __init__(self) -> None:
        self.count = 0

    @hprm.reaction(image)
    def plan(self) -> None:
        self.count += 1

    @hprm.reaction(hprm.shutdown)
    def tell(self) -> None:
        print("got", self.count)


class Vision(hprm.Federation, timeout="100 ms"):
    def __init__(self, size: int = 3) -> None:
        self.camera = Camera(size)
        self.planner = Planner()
        hprm.connect(self.camera.image, self.planner.image)
"""

EDITS = [
    ("self.count += 1", "self.count += 2", "class Planner differs"),
    ('"20 ms"', '"50 ms"', "timer camera.t is (0, 50 ms) at federate planner"),
    ("def __init__(self, size: int = 3) -> None:\n        self.camera", None, "parameter size"),
    ("import hprm\n", "import hprm\nimport math\n", "module app.py differs"),
]


@pytest.mark.parametrize(("before", "after", "words"), EDITS, ids=[words for *_, words in EDITS])
def test_a_federate_with_another_program_is_refused(
    bench: Bench, before: str, after: str | None, words: str
) -> None:
    elsewhere = bench.folder / "elsewhere"
    elsewhere.mkdir()
    (bench.folder / "app.py").write_text(PROGRAM)
    text = PROGRAM if after is None else PROGRAM.replace(before, after, 1)
    (elsewhere / "app.py").write_text(text)
    federation = bench.federation()
    environment = {"HPRM_FEDERATION_ID": federation.id}
    address = ["--rti", federation.address]
    rti = bench.call("rti", "app.py", "--listen", federation.address, environment=environment)
    camera = bench.call("federate", "app.py", "camera", *address, environment=environment)
    stated = ["--property", "main.size=4"] if after is None else []
    other = ["federate", *stated, "elsewhere/app.py", "planner", *address]
    refused = finish(bench.call(*other, environment=environment))
    assert refused.code == 1
    refused.assert_one_error("the RTI refuses this federate: its program differs from ")
    assert words in refused.err
    # One that differs in comments and white space only is the same program.
    (elsewhere / "app.py").write_text(PROGRAM.replace("+= 1", "+=  1  # one"))
    planner = finish(bench.call(*[it for it in other if it not in stated], environment=environment))
    assert (planner.code, planner.out) == (0, "got 6\n"), planner.err
    assert [finish(it).code for it in (camera, rti)] == [0, 0]


@pytest.mark.parametrize("coordination", ["centralized", "decentralized"])
@pytest.mark.parametrize("victim", ["camera", "planner"])
def test_a_federate_that_is_killed_ends_the_federation(
    bench: Bench, victim: str, coordination: str
) -> None:
    text = PROGRAM.replace('timeout="100 ms"', f'coordination="{coordination}"')
    mark = f"open('{victim}.pid', 'w').write(f'{{__import__(\"os\").getpid()}}\\n')"
    method = {"camera": "def capture(self) -> None:", "planner": "def plan(self) -> None:"}[victim]
    (bench.folder / "app.py").write_text(text.replace(method, f"{method}\n        {mark}"))
    launched = bench.call("run", "app.py")
    os.kill(bench.pid(victim), signal.SIGKILL)
    outcome = finish(launched)
    assert outcome.code in (1, 137)
    assert f"federate {victim}" in outcome.err and "signal 9" in outcome.err


def test_a_transient_federate_joins_a_running_federation(bench: Bench) -> None:
    text = PROGRAM.replace(
        "self.planner = Planner()", "self.planner = hprm.federate(Planner(), transient=True)"
    )
    text = text.replace('timeout="100 ms"', 'timeout="60 s"')
    text = text.replace("self.count += 1", "self.count += 1\n        self.request_stop()")
    (bench.folder / "app.py").write_text(text)
    federation = bench.federation()
    environment = {"HPRM_FEDERATION_ID": federation.id}
    address = ["--rti", federation.address]
    rti = bench.call("rti", "app.py", "--listen", federation.address, environment=environment)
    camera = bench.call("federate", "app.py", "camera", *address, environment=environment)
    # What only a transient federate runs may be another version.
    (bench.folder / "app.py").write_text(text.replace('print("got"', 'print("now", "got"'))
    planner = finish(bench.call("federate", "app.py", "planner", *address, environment=environment))
    assert (planner.code, planner.out) == (0, "now got 1\n"), planner.err
    assert [finish(it).code for it in (camera, rti)] == [0, 0]


def test_what_is_stated_of_a_federate_reaches_the_runtime(bench: Bench) -> None:
    (bench.folder / "app.py").write_text(
        PROGRAM.replace("= Planner()", '= hprm.federate(Planner(), host="robot.example")')
    )
    outcome = finish(bench.call("run", "app.py"))
    # It runs elsewhere, and without a key no agent starts it there.
    assert outcome.code == 1
    assert "LF0804" in outcome.err
    assert "robot.example" in outcome.err and "app.py:" in outcome.err


def test_physical_connections_have_bounds() -> None:
    class Source(hprm.Reactor):
        out = hprm.Output(int)

        @hprm.reaction(hprm.startup, effects=[out])
        def begin(self) -> None:
            self.out.set(1)

    class Sink(hprm.Reactor):
        into = hprm.Input(int)

        def __init__(self) -> None:
            self.got: list[int] = []

        @hprm.reaction(into)
        def note(self) -> None:
            self.got.append(self.into.value)
            self.request_stop()

    class Main(hprm.Reactor, timeout="10 s"):
        def __init__(self) -> None:
            self.source, self.sink = Source(), Sink()
            hprm.connect(self.source.out, self.sink.into, physical=True, bound=(2, "drop"))

    main = Main()
    hprm.run(main)
    assert main.sink.got == [1]
    main = Main()
    main._hprm_.connections[0] = main._hprm_.connections[0]._replace(bound=(0, "drop"))  # type: ignore[attr-defined]
    with pytest.raises(hprm.ProgramError, match="bound"):
        hprm.check(main)


def test_each_reaction_gets_a_copy_of_a_mutable_input() -> None:
    class Source(hprm.Reactor):
        out = hprm.Output(list[int])

        @hprm.reaction(hprm.startup, effects=[out])
        def begin(self) -> None:
            self.out.set([1])

    class Sink(hprm.Reactor):
        into = hprm.Input(list[int], mutable=True)

        def __init__(self) -> None:
            self.got: list[list[int]] = []

        @hprm.reaction(into)
        def first(self) -> None:
            self.into.value.append(2)
            self.got.append(self.into.value)

        @hprm.reaction(into)
        def second(self) -> None:
            self.got.append(self.into.value)

    class Main(hprm.Reactor):
        def __init__(self) -> None:
            self.source, self.sink = Source(), Sink()
            hprm.connect(self.source.out, self.sink.into)

    main = Main()
    hprm.run(main)
    assert main.sink.got == [[1, 2], [1]]


def test_ctrl_c_ends_a_running_federation_in_order(bench: Bench) -> None:
    mark = "open('planner.pid', 'w').write(f'{__import__(\"os\").getpid()}\\n')"
    text = PROGRAM.replace("plan(self) -> None:", f"plan(self) -> None:\n        {mark}")
    (bench.folder / "app.py").write_text(text.replace(', timeout="100 ms"', ""))
    launched = bench.call("run", "app.py")
    bench.pid("planner")
    launched.send_signal(signal.SIGINT)
    outcome = finish(launched)
    assert outcome.code == 130
    assert "[planner] got" in outcome.out


def test_the_rti_says_what_it_waits_for_until_ctrl_c(bench: Bench) -> None:
    (bench.folder / "app.py").write_text(PROGRAM)
    federation = bench.federation()
    environment = {"HPRM_FEDERATION_ID": federation.id}
    rti = bench.call("rti", "app.py", "--listen", federation.address, environment=environment)
    assert "camera, planner" in hear(rti.stdout, "planner\n")
    rti.send_signal(signal.SIGINT)
    assert finish(rti).code == 130


def test_federates_that_are_threads_have_modules_of_their_own(bench: Bench) -> None:
    (bench.folder / "app.py").write_text(
        """
import hprm

seen = []

class Member(hprm.Reactor):
    @hprm.reaction(hprm.startup)
    def begin(self) -> None:
        seen.append(self.bank_index)

    @hprm.reaction(hprm.shutdown)
    def end(self) -> None:
        print(seen)

class Main(hprm.Federation, timeout="10 ms"):
    def __init__(self) -> None:
        self.members = [Member() for _ in range(3)]
"""
    )
    for options in ([], ["--in-process"]):
        outcome = finish(bench.call("run", *options, "app.py"))
        assert outcome.code == 0, outcome.err
        assert sorted(outcome.out.splitlines()) == [f"[members__{n}] [{n}]" for n in range(3)]
