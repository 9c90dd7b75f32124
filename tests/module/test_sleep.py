"""A handler sleeps on a clock that the test steps. A kill ends the sleep, and the clock does not
drift.
"""

import threading

import pytest

from tca_module import Client, Command, Module, Outcome, Task
from tca_module.testing import LocalCentral

WORK, OTHER = Command("work"), Command("other")
STEPPED = True  # the tests step the clock of central


@pytest.fixture
def legs(central: LocalCentral) -> Module:
    return Module("legs", central, capacity=2)


def test_handler_sleeps_on_stepped_clock(central: LocalCentral, user: Client, legs: Module) -> None:
    slept: list[float] = []

    @legs.handles(WORK)
    def work(task: Task) -> None:
        task.sleep(1.5)
        slept.append(task.time())
        task.sleep_until(4)
        slept.append(task.time())
        task.sleep_until(3)  # in the past
        slept.append(task.time())

    with legs.running():
        work_sent = user.command(WORK)
        central.advance(1)
        assert slept == []
        central.advance(10)
        assert slept == [1.5, 4.0, 4.0]
        assert work_sent.wait() is Outcome.DONE


def test_arriving_message_ends_no_sleep(central: LocalCentral, user: Client, legs: Module) -> None:
    @legs.handles(WORK)
    @legs.handles(OTHER)
    def work(task: Task) -> None:
        task.sleep(2)

    with legs.running():
        first = user.command(WORK)
        central.advance(1)
        second = user.command(OTHER, sequential=False)
        central.advance(1.5)
        assert first.wait(0) is Outcome.DONE
        assert second.info() is not None
        central.advance(0.5)
        assert second.wait(0) is Outcome.DONE


def test_sleep_until_past_time_still_notices_kill(
    central: LocalCentral, user: Client, legs: Module
) -> None:
    turns: list[float] = []
    begun, killed = threading.Event(), threading.Event()

    @legs.handles(WORK)
    def work(task: Task) -> None:
        while True:
            turns.append(task.time())
            begun.set()
            killed.wait(5)
            task.sleep_until(-1)

    with legs.running():
        sent = user.command(WORK)
        assert sent.id
        assert begun.wait(5)
        sent.kill()
        killed.set()
        central.until_quiet()
        assert turns == [0]


def test_wait_until_checks_when_other_thread_wakes_it(
    central: LocalCentral, user: Client, legs: Module
) -> None:
    has_come, tasks = threading.Event(), list[Task]()

    @legs.handles(WORK)
    def work(task: Task) -> None:
        tasks.append(task)
        assert not task.wait_until(has_come.is_set, timeout=1)
        assert task.wait_until(has_come.is_set)

    with legs.running():
        sent = user.command(WORK)
        central.advance(5)
        has_come.set()
        tasks[0].wake()
        assert sent.wait(5) is Outcome.DONE
    tasks[0].wake()  # has no effect later


def test_shielded_sleep_is_not_cut_short_by_kill(
    central: LocalCentral, user: Client, legs: Module
) -> None:
    cleaned: list[float] = []

    @legs.handles(WORK)
    def work(task: Task) -> None:
        with task.shielded():
            task.sleep(2)
            cleaned.append(task.time())
        task.sleep(2)
        cleaned.append(task.time())

    with legs.running():
        sent = user.command(WORK)
        central.advance(1)
        sent.kill()
        central.advance(5)
        assert cleaned == [2.0]
