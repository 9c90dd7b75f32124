"""When timers are due, on a clock of the test's own."""

import math

import pytest

from tca_module.serving.callbacks import Timers


@pytest.fixture
def timers() -> Timers[str]:
    return Timers()


def test_nothing_is_ever_due(timers: Timers[str]) -> None:
    assert timers.next() == math.inf
    assert timers.take_due(1e9) == []
    assert not timers.was_done("unknown", 1.0)


def test_what_is_due_once(timers: Timers[str]) -> None:
    timers.once("ring", 5.0)
    assert timers.next() == 5.0
    assert timers.take_due(4.9) == []
    assert timers.take_due(5.0) == ["ring"]
    assert timers.take_due(6.0) == []
    assert not timers.was_done("ring", 6.0)
    assert timers.next() == math.inf


def test_the_order_is_that_of_the_times_then_of_arrival(timers: Timers[str]) -> None:
    for name, at in (("late", 3.0), ("early", 1.0), ("early too", 1.0)):
        timers.once(name, at)
    assert timers.take_due(9.0) == ["early", "early too", "late"]


def test_a_period_does_not_drift(timers: Timers[str]) -> None:
    timers.every("beat", 0.1, 100.0)
    for turn in range(1, 10_001):
        due = timers.next()
        assert due == pytest.approx(100.0 + turn * 0.1, abs=1e-9)
        assert timers.take_due(due + 0.03) == ["beat"]  # always a little late
        assert timers.was_done("beat", due + 0.04)


def test_what_was_missed_is_left_out(timers: Timers[str]) -> None:
    """After a stall there is one call, and the next is at a multiple of the period again."""
    timers.every("beat", 1.0, 0.0)
    assert timers.take_due(7.3) == ["beat"]
    assert timers.was_done("beat", 7.4)
    assert timers.take_due(7.9) == []
    assert timers.next() == 8.0


def test_a_call_that_takes_longer_than_its_period_skips(timers: Timers[str]) -> None:
    timers.every("beat", 1.0, 0.0)
    assert timers.take_due(1.0) == ["beat"]
    assert timers.next() == math.inf
    timers.was_done("beat", 3.5)
    assert timers.next() == 4.0


def test_a_call_that_ends_when_the_next_is_due_does_not_come_twice(timers: Timers[str]) -> None:
    timers.every("beat", 0.1, 0.0)
    times = []
    for _ in range(1000):
        times.append(timers.next())
        timers.take_due(times[-1])
        timers.was_done("beat", times[-1])
    assert len(set(times)) == 1000


def test_what_was_removed_is_not_due(timers: Timers[str]) -> None:
    timers.every("beat", 1.0, 0.0)
    timers.once("ring", 2.0)
    timers.remove("beat")
    timers.remove("unknown")
    assert timers.next() == 2.0
    assert timers.take_due(9.0) == ["ring"]
    timers.remove("ring")
    assert not timers.was_done("ring", 9.0)


def test_removing_from_within_ends_a_period(timers: Timers[str]) -> None:
    timers.every("beat", 1.0, 0.0)
    timers.take_due(1.0)
    timers.remove("beat")
    assert not timers.was_done("beat", 1.0)
