"""A module that ends tells its handlers, and waits for them: none of them can hang it unless it wants to."""

import asyncio
import contextlib
import logging
import queue
import threading
import time

import pytest
from module.gait_messages import MOVE_LEG, REST, STANCE, STOP, TEMPERATURE, Footfall

from tca_module import Client, Module, Outcome, Stopped, Task, TaskFailed, TaskKilled, connect
from tca_module.errors import NoCentral
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import HandlerRemoved

SOON = 5.0


class Wrong(Exception):
    """Something in the program beside the handlers."""


def test_a_handler_that_looks_is_told_and_has_failed(legs: Module, user: Client) -> None:
    begun = threading.Event()

    @legs.handles(STOP)
    def stop(task: Task) -> None:
        begun.set()
        while not task.cancelled:
            pass

    with legs.running():
        stopping = user.command(STOP)
        assert begun.wait(SOON)
    with pytest.raises(TaskFailed, match=r"module lost: its module ended while .*stop ran"):
        stopping.result(SOON)


def test_a_handler_that_neither_looks_nor_waits_just_finishes(legs: Module, user: Client) -> None:
    begun, go_on = threading.Event(), threading.Event()

    @legs.handles(STOP)
    def stop(_: Task) -> None:
        begun.set()
        assert go_on.wait(SOON)

    with legs.running():
        stopping = user.command(STOP)
        assert begun.wait(SOON)
        go_on.set()
    assert stopping.wait(SOON) is Outcome.DONE


def test_a_killed_handler_of_a_module_that_ends_was_killed(legs: Module, user: Client) -> None:
    begun = threading.Event()

    @legs.handles(STOP)
    def stop(task: Task) -> None:
        begun.set()
        while not task.cancelled:
            pass

    with legs.running():
        stopping = user.command(STOP)
        assert begun.wait(SOON)
        stopping.kill("enough")
    with pytest.raises(TaskKilled, match="enough"):
        stopping.result(SOON)


def test_who_waits_for_what_its_own_module_leaves_behind_does_not_wait_for_ever(
    legs: Module, central: LocalCentral, user: Client
) -> None:
    """The second move is queued when the module ends: nobody will make it."""
    moving, told = threading.Event(), queue.Queue[str]()

    @legs.handles(REST)
    def rest(task: Task) -> None:
        _, second = task.command(MOVE_LEG, 1), task.command(MOVE_LEG, 2)
        try:
            second.wait()
        except Stopped as error:
            told.put(str(error))
            assert task.cancelled
            task.query(TEMPERATURE, timeout=SOON)  # it may clean up, and wait for that
            raise

    @legs.handles(MOVE_LEG, resource="drives")
    def move_leg(_: Task, leg: int) -> Footfall:
        moving.set()
        while not any(isinstance(fact, HandlerRemoved) for fact in central.facts):
            time.sleep(0.001)
        return Footfall(leg, 0.0)

    with connect_thermometer(legs), legs.running():
        resting = user.goal(REST)
        assert moving.wait(SOON)
    assert "module 'legs' ends: the wait for end achieving" in told.get(timeout=SOON)
    with pytest.raises(TaskFailed, match="module lost"):
        resting.result(SOON)


def connect_thermometer(legs: Module) -> contextlib.AbstractContextManager[Module]:
    other = Module("thermometer", legs.central)
    other.handles(TEMPERATURE)(lambda _: 36.6)
    return other.running()


def test_a_coroutine_is_cancelled_once(legs: Module, user: Client) -> None:
    begun, cleaned = threading.Event(), threading.Event()

    @legs.handles(STOP)
    async def stop(task: Task) -> None:
        begun.set()
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(0)
            cleaned.set()
            assert task.cancelled

    with legs.running():
        stopping = user.command(STOP)
        assert begun.wait(SOON)
    assert cleaned.is_set()
    with pytest.raises(TaskFailed, match="module lost: its module ended while"):
        stopping.result(SOON)


def test_an_error_in_the_block_is_not_hidden_behind_a_handler(
    legs: Module, user: Client, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that does not look: what went wrong is said while it is waited for."""
    monkeypatch.setattr("tca_module.serving.slots._PATIENCE", 0.1)
    begun, go_on = threading.Event(), threading.Event()

    @legs.handles(STANCE)
    def stance(_: Task, _radius: float) -> list[int]:
        begun.set()
        assert go_on.wait(SOON)
        return []

    class Told(logging.Handler):
        def emit(self, _: logging.LogRecord) -> None:
            go_on.set()

    logging.getLogger("tca.legs").addHandler(told := Told())
    pending = user.query_send(STANCE, 1.0)

    def work() -> None:
        with legs.running():
            assert begun.wait(SOON)
            raise Wrong("no map")

    with pytest.raises(Wrong):
        work()
    logging.getLogger("tca.legs").removeHandler(told)
    assert pending.receive(SOON) == []
    (said,) = caplog.messages
    assert said.startswith("module 'legs' ends (Wrong: no map), and waits for its handler of 'stance' to return")


def test_without_central_nobody_reads_a_traceback(legs: Module, central: LocalCentral) -> None:
    central.close()
    with pytest.raises(NoCentral, match=r"^module 'legs': central at .* does not answer"), legs.running(patience=0.1):
        pass
    with pytest.raises(NoCentral, match=r"^central at local central 'local' does not answer: start it with") as lost:
        connect("user", central, patience=0.1)
    assert lost.value.code == str(lost.value)
