"""``hprm.testing``: reactors in virtual time, their inputs and outputs as lists."""

from __future__ import annotations

import doctest
import pickle
import subprocess
import sys
import textwrap
import time
from pathlib import Path

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
    assert len([line for line in result.trace if '"reaction":"Bench.reactor.1"' in line]) == 4


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
                assert run_reactor(Hello(), timeout="1 s").outputs["word"] == []
            """
        )
    )
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_it.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "1 failed, 1 passed" in done.stdout
    assert done.stdout.count("logical trace of Hello") == 1
    assert '"reaction":"Bench.reactor.1"' in done.stdout
