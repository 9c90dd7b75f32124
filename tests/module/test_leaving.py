"""A module that ends tells its handlers, and waits for them: none of them can hang it unless it wants to."""

import asyncio
import logging
import threading

import pytest
from module.gait_messages import STANCE, STOP

from tca_module import Client, Module, Outcome, Task, TaskFailed

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
    monkeypatch.setattr("tca_module.serving.slot._PATIENCE", 0.1)
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
