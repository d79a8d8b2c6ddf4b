"""The token that threads of a script give to one another, and who holds a tag meanwhile."""

from __future__ import annotations

import signal
import threading
import time

import pytest

from hprm._hprm import Turn
from hprm.ros._turns import Turns


def test_a_token_is_there_or_not() -> None:
    turn = Turn()
    assert not turn.take(0)
    turn.give()
    turn.give()
    assert turn.take()
    assert not turn.take(0.001)


@pytest.mark.parametrize("timeout", [-1.0, float("nan"), float("inf")])
def test_a_time_that_is_none_is_an_error(timeout: float) -> None:
    with pytest.raises(ValueError):
        Turn().take(timeout)


def test_two_threads_take_turns() -> None:
    mine, theirs = Turn(), Turn()
    said: list[int] = []

    def other() -> None:
        for number in range(1000):
            assert theirs.take(10)
            said.append(2 * number + 1)
            mine.give()

    thread = threading.Thread(target=other)
    thread.start()
    for number in range(1000):
        said.append(2 * number)
        assert mine.take(10, theirs)
    thread.join()
    assert said == list(range(2000))


def test_a_signal_interrupts_the_main_thread_as_a_handler_says() -> None:
    class Alarm(Exception):
        pass

    said: list[str] = []

    def count(*_: object) -> None:
        said.append("signal")
        if len(said) == 3:
            raise Alarm

    before = signal.signal(signal.SIGALRM, count)
    signal.setitimer(signal.ITIMER_REAL, 0.02, 0.02)
    try:
        with pytest.raises(Alarm):
            Turn().take()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert said == ["signal"] * 3


def test_a_signal_that_interrupts_no_wait_is_noticed() -> None:
    # As one that comes just before the wait: here it comes to another thread, and Python calls
    # its handler in this one.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    turn, begun = Turn(), Turn()
    noticed = threading.Event()
    unnoticed: list[str] = []

    def interrupt() -> None:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
        begun.take(10)
        signal.pthread_kill(threading.get_ident(), signal.SIGINT)
        if not noticed.wait(10):
            unnoticed.append("signal")
            turn.give()

    try:
        threading.Thread(target=interrupt, daemon=True).start()
        with pytest.raises(KeyboardInterrupt):
            turn.take(giving=begun)
        assert unnoticed == []
    finally:
        noticed.set()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
        signal.signal(signal.SIGINT, before)


def test_a_federate_waits_for_each_thread_that_it_wakes() -> None:
    turns = Turns(10.0, 10.0, lambda *_: None)
    due, done = [False, False], []

    def script(number: int) -> None:
        while len(done) < 20:
            turns.block(lambda: due[number] or len(done) >= 20, lambda: None)
            if due[number]:
                due[number] = False
                assert turns.holds()
                done.append(number)
        turns.leave()

    threads = [threading.Thread(target=script, args=(it,)) for it in (0, 1)]
    for it in threads:
        it.start()
    until = time.monotonic() + 10
    while len(turns.blocked()) < 2 and time.monotonic() < until:
        time.sleep(0.001)
    for count in range(10):
        due[:] = [True, True]
        turns.settle()
        # All that was due has been done when it returns, in the order in which they have blocked.
        assert len(done) == 2 * count + 2
        assert due == [False, False]
    turns.end()
    for it in threads:
        it.join(10)
    assert sorted(done) == [0] * 10 + [1] * 10


def test_a_thread_that_does_not_come_back_loses_its_hold() -> None:
    lost: list[float] = []
    turns = Turns(0.1, 10.0, lambda _, patience: lost.append(patience))
    may_go = threading.Event()

    def script() -> None:
        turns.block(lambda: True, lambda: None)
        may_go.wait(10)
        assert not turns.holds()
        turns.leave()

    thread = threading.Thread(target=script)
    thread.start()
    until = time.monotonic() + 10
    while not turns.blocked() and time.monotonic() < until:
        time.sleep(0.001)
    turns.settle()
    assert lost == [0.1]
    may_go.set()
    thread.join(10)


def test_a_thread_that_has_ended_is_not_waited_for() -> None:
    turns = Turns(60.0, 60.0, lambda *_: None)
    thread = threading.Thread(target=lambda: turns.block(lambda: True, lambda: None))
    thread.start()
    until = time.monotonic() + 10
    while not turns.blocked() and time.monotonic() < until:
        time.sleep(0.001)
    begun = time.monotonic()
    turns.settle()
    assert time.monotonic() - begun < 30
    thread.join(10)


def test_a_thread_gets_at_the_same_tag_what_a_later_one_gives_it() -> None:
    turns = Turns(10.0, 10.0, lambda *_: None)
    due, done, looks = [False, False], [], [0, 0]

    def script(number: int) -> None:
        def is_due() -> bool:
            looks[number] += 1
            return due[number]

        while True:
            turns.block(is_due, lambda: None)
            if not due[number]:
                return
            due[number] = False
            done.append(number)
            if number == 1:
                due[0] = len(done) == 2

    threads = [threading.Thread(target=script, args=(it,), daemon=True) for it in (0, 1)]
    for count, it in enumerate(threads, 1):
        it.start()
        until = time.monotonic() + 10
        while len(turns.blocked()) < count and time.monotonic() < until:
            time.sleep(0.001)
    due[:] = [True, True]
    turns.settle()
    assert done == [0, 1, 0]
    # It is not asked again for what it has just looked itself: nothing has changed since.
    assert looks == [4, 3]
    turns.end()
    for it in threads:
        it.join(10)
