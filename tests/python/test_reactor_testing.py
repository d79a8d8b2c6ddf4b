"""``hprm.testing``: reactors in virtual time, their inputs and outputs as lists."""

from __future__ import annotations

import doctest
import pickle
import subprocess
import sys
import textwrap
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hprm
import hprm.testing


class Average(hprm.Reactor):
    """The mean of the last values, ten times a second."""

    sample = hprm.Input(float)
    mean = hprm.Output(float)
    tick = hprm.Timer("100 ms", offset="100 ms")

    def __init__(self, size: int = 3) -> None:
        self.size = size
        self.samples: list[float] = []

    @hprm.reaction(sample)
    def keep(self) -> None:
        self.samples = [*self.samples, self.sample.value][-self.size :]

    @hprm.reaction(tick, effects=[mean])
    def tell(self) -> None:
        if self.samples:
            self.mean.set(sum(self.samples) / len(self.samples))


def test_inputs_at_tags_and_outputs_with_times() -> None:
    samples = [("0 ms", 1.0), ("50 ms", 2.0), ("150 ms", 6.0), ("160 ms", 10.0)]
    result = hprm.testing.run(Average(), inputs={"sample": samples}, timeout="250 ms")
    assert result.outputs == {"mean": [(100_000_000, 1.5), (200_000_000, 6.0)]}
    assert len([line for line in result.trace if '"reaction":"Bench.Average.1"' in line]) == 4


def test_no_time_is_waited_for() -> None:
    begin = time.monotonic()
    result = hprm.testing.run(Average(), inputs={"sample": [("1 h", 1.0)]}, timeout="2 h")
    assert len(result.outputs["mean"]) == 36_001
    assert time.monotonic() - begin < 600


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=10), st.integers(1, 5))
def test_the_mean_is_within_the_last_values(values: list[float], size: int) -> None:
    samples = [(number * 10_000_000, value) for number, value in enumerate(values)]
    result = hprm.testing.run(Average(size), inputs={"sample": samples}, timeout="100 ms")
    [(_, mean)] = result.outputs["mean"]
    last = values[-size:]
    assert min(last) - 1e-6 <= mean <= max(last) + 1e-6


class Split(hprm.Reactor):
    """A multiport in, a multiport out."""

    into = hprm.Input(int, width=2)
    out = hprm.Output(int, width=2)

    @hprm.reaction(into, effects=[out])
    def swap(self) -> None:
        for left, right in zip(self.into, reversed(list(self.out)), strict=True):
            if left.is_present:
                right.set(left.value)


def test_values_of_multiports_are_lists() -> None:
    inputs = {"into": [(0, [1, 2]), ("1 ms", [3, None])]}
    result = hprm.testing.run(Split(), inputs=inputs, timeout="2 ms")
    assert result.outputs["out"] == [(0, [2, 1]), (1_000_000, [None, 3])]


class Federated(hprm.Federation, coordination="decentralized"):
    """A federation, whose federates run in one scheduler here."""

    def __init__(self, means: list[tuple[int, float]]) -> None:
        class Samples(hprm.Reactor):
            sample = hprm.Output(float)

            @hprm.reaction(hprm.startup, effects=[sample])
            def begin(self) -> None:
                self.sample.set(2.5)

        class Means(hprm.Reactor):
            mean = hprm.Input(float)

            @hprm.reaction(mean)
            def note(self) -> None:
                means.append((self.elapsed(), self.mean.value))

        self.samples = hprm.federate(Samples(), maxwait="1 s", host="robot")
        self.average = Average()
        self.means = Means()
        hprm.connect(self.samples.sample, self.average.sample)
        hprm.connect(self.average.mean, self.means.mean)


def test_a_federation_is_tested_in_one_process() -> None:
    means: list[tuple[int, float]] = []
    hprm.testing.run(Federated(means), timeout="200 ms")
    assert means == [(100_000_000, 2.5), (200_000_000, 2.5)]


def test_a_failing_reaction_is_an_exception(capfd: pytest.CaptureFixture[str]) -> None:
    class Fails(hprm.Reactor):
        @hprm.reaction(hprm.startup)
        def fail(self) -> None:
            raise ValueError("no device")

    with pytest.raises(hprm.ProgramFailed) as raised:
        hprm.testing.run(Fails())
    failed = raised.value
    assert (failed.code, failed.kind, failed.tag) == (1, "reaction", (0, 0))
    assert failed.message == str(failed)
    assert failed.message.endswith("raised ValueError: no device")
    assert failed.reaction is not None
    assert failed.reaction.endswith(".fail")
    assert failed.federate is None
    assert Path(__file__).name in failed.place
    assert failed.details is not None
    assert "ValueError: no device" in failed.details
    again = pickle.loads(pickle.dumps(failed))
    assert (again.code, again.message, again.place) == (1, failed.message, failed.place)
    assert "raised ValueError: no device" in capfd.readouterr().err


def test_wrong_inputs_are_refused() -> None:
    with pytest.raises(
        ValueError, match="Average has no input or physical action simple; it has: sample"
    ):
        hprm.testing.run(Average(), inputs={"simple": []})
    with pytest.raises(ValueError, match="the input sample has two values at 0 ms"):
        hprm.testing.run(Average(), inputs={"sample": [(0, 1.0), ("0 ms", 2.0)]})


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ([("sample", 0, 1.0)], "`inputs` is a dictionary, and this is a list: write inputs={"),
        ({3: [(0, 1.0)]}, "`inputs` has names, and 3 is none: write inputs={"),
        ({"sample": 3.0}, "the input sample takes a list of times with values, and 3.0 is none"),
        ({"sample": {0: 1.0}}, "the input sample takes a list of times with values, and {0: 1.0}"),
        ({"sample": "ab"}, "the input sample takes a list of times with values, and 'ab' is none"),
        ({"sample": (0, 1.0)}, "its entry 0 is no time with a value: write inputs={"),
        ({"sample": [1.0, 2.0]}, "its entry 1.0 is no time with a value: write inputs={"),
        ({"sample": [("0 ms", 1.0, 2.0)]}, "its entry ('0 ms', 1.0, 2.0) is no time with a value"),
        ({"sample": ["ab"]}, "its entry 'ab' is no time with a value: write inputs={"),
    ],
)
def test_inputs_of_another_shape_are_refused(inputs: Any, message: str) -> None:
    with pytest.raises(TypeError) as raised:
        hprm.testing.run(Average(), inputs=inputs)
    assert message in str(raised.value)
    name = "sample" if isinstance(inputs, dict) and "sample" in inputs else "NAME"
    form = f'write inputs={{"{name}": [("0 ms", VALUE), ("10 ms", VALUE)]}}'
    assert str(raised.value).endswith(form)


def test_inputs_may_be_anything_that_gives_times_with_values() -> None:
    for sample in (iter([[0, 1.0]]), {0: 1.0}.items(), zip([0], [1.0], strict=True)):
        result = hprm.testing.run(Average(), inputs={"sample": sample}, timeout="100 ms")
        assert result.outputs == {"mean": [(100_000_000, 1.0)]}


def test_an_event_after_the_end_is_refused() -> None:
    inputs = {"sample": [("100 ms", 1.0), (100_000_001, 2.0)]}
    with pytest.raises(ValueError, match="after the timeout of the test") as raised:
        hprm.testing.run(Average(), inputs=inputs, timeout="100 ms")
    assert str(raised.value) == (
        "the event of the input sample at 100000001 ns comes after the timeout of the test, 100 ms:"
        " state a later timeout=..."
    )
    with pytest.raises(ValueError, match="at 20 s comes after the timeout of the test, 10 s"):
        hprm.testing.run(Average(), inputs={"sample": [("20 s", 1.0)]})
    last = {"sample": [("100 ms", 1.0)]}
    result = hprm.testing.run(Average(), inputs=last, timeout="100 ms")
    assert result.outputs == {"mean": [(100_000_000, 1.0)]}


class Sensor(hprm.Reactor):
    """What events of two actions come to."""

    now = hprm.PhysicalAction(int)
    later = hprm.PhysicalAction(int, min_delay="5 ms")
    seen = hprm.Output(bool)

    @hprm.reaction(now, later, effects=[seen])
    def tell(self) -> None:
        self.seen.set(self.now.is_present)


def test_an_event_of_an_action_comes_by_the_end_or_is_refused() -> None:
    last = {"now": [(9_999_999, 1)], "later": [("5 ms", 1)]}
    result = hprm.testing.run(Sensor, inputs=last, timeout="10 ms")
    assert result.outputs["seen"] == [(9_999_999, True), (10_000_000, False)]
    # It would come a microstep after the last tag.
    with pytest.raises(ValueError, match="the event of the action now at 10 ms comes after"):
        hprm.testing.run(Sensor, inputs={"now": [("10 ms", 1)]}, timeout="10 ms")
    with pytest.raises(ValueError, match="later at 6 ms comes with its `min_delay` after the time"):
        hprm.testing.run(Sensor, inputs={"later": [("6 ms", 1)]}, timeout="10 ms")


def test_a_class_is_tested_as_a_reactor_of_it() -> None:
    result = hprm.testing.run(Average, inputs={"sample": [(0, 1.0)]}, timeout="100 ms")
    assert result.outputs == {"mean": [(100_000_000, 1.0)]}
    for wrong, kind in ((3, "an int"), (int, "an int"), (None, "a NoneType")):
        with pytest.raises(TypeError, match=f"hprm.testing.run takes a hprm.Reactor, not {kind}"):
            hprm.testing.run(wrong)  # type: ignore[arg-type]


class Counts(hprm.Reactor):
    """What a value adds to, in a reactor inside, which a reaction names by a function."""

    class Adds(hprm.Reactor):
        more = hprm.Input(int)
        sum = hprm.Output(int)

        def __init__(self) -> None:
            self.total = 0

        @hprm.reaction(more, effects=[sum])
        def add(self) -> None:
            self.total += self.more.value
            self.sum.set(self.total)

    number = hprm.Input(int)
    sum = hprm.Output(int)

    def __init__(self) -> None:
        self.adds = self.Adds()
        self.seen: list[int] = []
        self.number >> self.adds.more

    @hprm.reaction(lambda self: self.adds.sum, effects=[sum])
    def tell(self) -> None:
        self.seen.append(self.adds.sum.value)
        self.sum.set(self.adds.sum.value)


def test_one_reactor_runs_several_times_and_keeps_its_state() -> None:
    counts = Counts()
    for total in (1, 2, 3):
        result = hprm.testing.run(counts, inputs={"number": [(0, 1)]})
        assert result.outputs == {"sum": [(0, total)]}
    assert counts.seen == [1, 2, 3]


def test_one_reactor_runs_again_after_a_failure(capfd: pytest.CaptureFixture[str]) -> None:
    late = Late()
    with pytest.raises(hprm.ProgramError, match="gives no port"):
        hprm.testing.run(late)
    late.port = late.adds.sum
    hprm.testing.run(late)
    counts = Counts()
    with pytest.raises(ValueError, match="no input"):
        hprm.testing.run(counts, inputs={"wrong": []})
    counts.adds.total = None  # type: ignore[assignment]
    with pytest.raises(hprm.ProgramFailed, match=r"reaction Bench\.Counts\.adds\.add raised TypeE"):
        hprm.testing.run(counts, inputs={"number": [(0, 1)]})
    capfd.readouterr()
    counts.adds.total = 0
    assert hprm.testing.run(counts, inputs={"number": [(0, 4)]}).outputs == {"sum": [(0, 4)]}


class Late(hprm.Reactor):
    """What knows the port that its reaction names only after its constructor is done."""

    def __init__(self) -> None:
        self.adds = Counts.Adds()
        self.port: object = [3]

    @hprm.reaction(lambda self: self.port)
    def note(self) -> None:
        """Do nothing."""


def test_a_program_runs_several_times_also_if_reactions_name_ports_inside() -> None:
    class Main(hprm.Reactor, timeout="1 ms", fast=True):
        def __init__(self) -> None:
            self.counts = Counts.Adds()
            self.seen: list[int] = []

        @hprm.reaction(hprm.startup, effects=[lambda self: self.counts.more])
        def begin(self) -> None:
            self.counts.more.set(1)

        @hprm.reaction(lambda self: self.counts.sum)
        def note(self) -> None:
            self.seen.append(self.counts.sum.value)

    main = Main()
    for _ in range(2):
        hprm.run(main)
        hprm.testing.run(main)
    assert main.seen == [1, 2, 3, 4]


def test_a_contained_reactor_is_not_tested_alone() -> None:
    counts = Counts()
    with pytest.raises(hprm.ProgramError, match="this Adds is contained in Counts, so it cannot"):
        hprm.testing.run(counts.adds)
    assert hprm.testing.run(counts, inputs={"number": [(0, 1)]}).outputs == {"sum": [(0, 1)]}


@pytest.mark.parametrize("name", ["feeder", "tag", "_Hidden", "reactor"])
def test_a_class_of_any_name_is_tested(name: str) -> None:
    tested = type(name, (Average,), {})
    result = hprm.testing.run(tested(), inputs={"sample": [(0, 1.0)]}, timeout="100 ms")
    assert result.outputs == {"mean": [(100_000_000, 1.0)]}
    assert any('"reaction":"Bench.reactor.1"' in line for line in result.trace)


def test_the_example_in_the_documentation() -> None:
    assert doctest.testmod(hprm.testing).failed == 0


class Asks(hprm.Reactor):
    """A body that awaits, and one that starts what outlives its tag."""

    ask = hprm.Input(int)
    told = hprm.Output(str)
    answer = hprm.PhysicalAction(int)

    @hprm.reaction(ask, effects=[told, answer])
    async def begin(self) -> None:
        import asyncio

        await asyncio.sleep(0)
        self.told.set(f"asked {self.ask.value}")
        hprm.background(self.think(self.ask.value), self.answer)

    async def think(self, number: int) -> int:
        return number + 1

    @hprm.reaction(answer, effects=[told])
    def end(self) -> None:
        self.told.set(f"answer {self.answer.value}")
        self.request_stop()


def test_a_body_may_await_and_start_what_outlives_its_tag() -> None:
    # Its program runs with the clock, since what a task schedules comes from outside.
    class Main(hprm.Reactor, timeout="10 s"):
        def __init__(self) -> None:
            self.asks = Asks()
            self.told: list[str] = []

        @hprm.reaction(hprm.startup, effects=[lambda self: self.asks.ask])
        def start(self) -> None:
            self.asks.ask.set(1)

        @hprm.reaction(lambda self: self.asks.told)
        def note(self) -> None:
            self.told.append(self.asks.told.value)

    main = Main()
    hprm.run(main)
    assert main.told == ["asked 1", "answer 2"]


def test_a_task_that_is_left_behind_is_an_error(capfd: pytest.CaptureFixture[str]) -> None:
    class Leaves(hprm.Reactor):
        @hprm.reaction(hprm.startup)
        async def leave_it(self) -> None:
            import asyncio

            self.task = asyncio.create_task(asyncio.sleep(60))

    with pytest.raises(hprm.ProgramFailed):
        hprm.testing.run(Leaves())
    assert "sleep was not done at the end of the reaction" in capfd.readouterr().err


def test_a_failed_test_shows_the_logical_trace(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(
        textwrap.dedent(
            """
            import hprm

            class Hello(hprm.Reactor):
                word = hprm.Output(str)

                @hprm.reaction(hprm.startup, effects=[word])
                def greet(self) -> None:
                    self.word.set("hello")

            def test_right(run_reactor):
                assert run_reactor(Hello()).outputs["word"] == [(0, "hello")]

            def test_wrong(run_reactor):
                assert run_reactor(Hello, timeout="1 s").outputs["word"] == []
            """
        )
    )
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_it.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "1 failed, 1 passed" in done.stdout
    assert done.stdout.count("logical trace of Hello") == 1
    assert '"reaction":"Bench.Hello.1"' in done.stdout
