"""A module that ends: running handlers, its block, and the handlers that take over."""

import asyncio
import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from module.real_central import SOON, Gate, until
from module.robot import MOVE_LEG, REST, STANCE, STOP, TEMPERATURE, Footfall

from tca_module import (
    Client,
    MisuseError,
    Module,
    Outcome,
    QueryFailed,
    Task,
    TaskFailed,
    Timeout,
    connect,
)
from tca_module.testing import LocalCentral

pytestmark = pytest.mark.usefixtures("short_timeouts")


# --- Running handlers when a module ends ----------------------------------------------------------


class BlockError(Exception):
    """An error of the program beside the handlers."""


def test_module_end_fails_only_handler_that_checks_cancelled(legs: Module, user: Client) -> None:
    begun, gate = threading.Event(), Gate()
    legs.handles(REST, resource="head")(gate)

    @legs.handles(STOP)
    def stop(task: Task) -> None:
        begun.set()
        while not task.cancelled:
            pass

    with legs.running():
        stopping, resting = user.command(STOP), user.goal(REST, sequential=False)
        assert begun.wait(SOON)
        assert gate.begun.wait(SOON)
        gate.go_on.set()
    with pytest.raises(TaskFailed, match=r"module lost: its module ended while .*stop ran"):
        stopping.result(SOON)
    assert resting.wait(SOON) is Outcome.DONE


def test_module_end_cancels_coroutine_once(legs: Module, user: Client) -> None:
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


def test_block_error_is_logged_while_handler_is_awaited(
    legs: Module, user: Client, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The handler does not check ``cancelled``. So the module logs the error while it waits for the
    handler.
    """
    monkeypatch.setattr("tca_module.serving.slot._WARN_AFTER", 0.1)
    gate = Gate([])
    legs.handles(STANCE)(gate)

    class ReleasingHandler(logging.Handler):
        def emit(self, _: logging.LogRecord) -> None:
            gate.go_on.set()

    logging.getLogger("tca.legs").addHandler(releasing := ReleasingHandler())
    pending = user.query_send(STANCE, 1.0)

    def work() -> None:
        with legs.running():
            assert gate.begun.wait(SOON)
            raise BlockError("no map")

    with pytest.raises(BlockError):
        work()
    logging.getLogger("tca.legs").removeHandler(releasing)
    assert pending.receive(SOON) == []
    (text,) = caplog.messages
    assert text.startswith(
        "module 'legs' ends (BlockError: no map), and waits for its handler of 'stance' to return"
    )


# --- A stopped or failed module whose block still runs --------------------------------------------


ENDED = "module 'legs' ends and handles no more messages: "


class HandlerExit(BaseException):
    """An exception that no handler should raise."""


@pytest.fixture
def older(central: LocalCentral) -> Module:
    """Return a module that handled all messages before the legs joined."""
    older = Module("older", central)
    older.handles(STANCE)(lambda _, _radius: [0])
    older.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.0))
    return older


def stance_handlers(user: Client) -> list[str]:
    return [handler.module for handler in user.handlers(STANCE)]


def until_withdrawn(user: Client) -> None:
    until(lambda: "legs" not in stance_handlers(user), "the legs' handlers are gone")


@contextmanager
def ended_with(kind: type[BaseException], module: Module) -> Iterator[None]:
    """Run a module's block, which must end with an exception of this class."""
    with pytest.raises(kind), module.running():
        yield


def raiser(error: BaseException) -> Callable[[], Any]:
    def function() -> None:
        raise error

    return function


def test_older_handler_takes_over_from_stopped_module(
    legs: Module, older: Module, user: Client
) -> None:
    legs.handles(STANCE)(lambda _, _radius: [1])
    with older.running(), legs.running():
        assert user.query(STANCE, 1.0, timeout=SOON) == [1]
        legs.stop()
        assert legs.stopping
        until_withdrawn(user)
        assert stance_handlers(user) == ["older"]
        assert user.query(STANCE, 1.0, timeout=SOON) == [0]


def test_stopped_module_finishes_current_and_hands_over_queued(
    legs: Module, older: Module, user: Client
) -> None:
    gate = Gate(Footfall(1, 1.0))
    legs.handles(MOVE_LEG)(gate)
    legs.handles(STANCE)(lambda _, _radius: [1])
    with older.running(), legs.running():
        first = user.command(MOVE_LEG, 1, sequential=False)
        assert gate.begun.wait(SOON)
        second = user.command(MOVE_LEG, 2, sequential=False)
        legs.stop()
        assert second.result(SOON) == Footfall(2, 0.0)
        with pytest.raises(Timeout, match="its handler in legs returns"):
            first.wait(0.01)
        gate.go_on.set()
        assert first.result(SOON) == Footfall(1, 1.0)


def test_withdrawal_is_not_delayed_by_wait_in_block(
    legs: Module, older: Module, central: LocalCentral
) -> None:
    """The wait holds the connection over which the module must withdraw. This wait must not end."""

    @older.handles(TEMPERATURE)
    def temperature(_: Task) -> float:
        legs.stop()
        with connect("other", central) as other:
            until_withdrawn(other)
        return 36.6

    legs.handles(STANCE)(lambda _, _radius: [1])
    with older.running(), legs.running():
        assert legs.query(TEMPERATURE, timeout=SOON) == 36.6


def test_stopped_module_remains_client_in_its_block(
    legs: Module, older: Module, user: Client, central: LocalCentral
) -> None:
    legs.handles(STANCE)(lambda _, _radius: [1])
    with older.running():
        with legs.running():
            legs.stop()
            until_withdrawn(user)
            assert legs.command(MOVE_LEG, 1).result(SOON) == Footfall(1, 0.0)
            central.restart("afresh")
            assert legs.query(STANCE, 1.0, timeout=SOON) == [0]
            assert stance_handlers(user) == ["older"]
            with pytest.raises(
                MisuseError,
                match=r"module 'legs' is ending: leave its .* before you start it again",
            ):
                legs.run()
            with pytest.raises(MisuseError, match="comes too late"):
                legs.handles(STOP)
        with legs.running():
            assert user.query(STANCE, 1.0, timeout=SOON) == [1]


def test_stop_of_module_is_logged(
    legs: Module, user: Client, caplog: pytest.LogCaptureFixture
) -> None:
    legs.handles(STANCE)(lambda _, _radius: [1])
    with caplog.at_level(logging.INFO, "tca.legs"), legs.running():
        legs.stop()
        until_withdrawn(user)
    assert caplog.messages == ["module 'legs' has stopped and handles no more messages"]


@pytest.mark.parametrize(
    "error",
    [HandlerExit("tired"), KeyboardInterrupt(), GeneratorExit(), pytest.fail.Exception("x")],
)
def test_base_exception_in_handler_ends_module(
    legs: Module,
    older: Module,
    user: Client,
    caplog: pytest.LogCaptureFixture,
    error: BaseException,
) -> None:
    legs.handles(STANCE)(lambda _, _radius: raiser(error)())
    texts: list[str] = []

    def work() -> None:
        with legs.running():
            with pytest.raises(
                QueryFailed, match="module lost: its module was ended by "
            ) as failed:
                user.query(STANCE, 1.0, timeout=SOON)
            texts.append(failed.value.text)
            assert stance_handlers(user) == ["older"]  # at once
            assert user.query(STANCE, 1.0, timeout=SOON) == [0]
            (logged,) = [record for record in caplog.records if record.name == "tca.legs"]
            assert logged.getMessage() == ENDED + type(error).__name__
            assert logged.exc_info is not None
            assert logged.exc_info[1] is error

    with older.running(), pytest.raises(type(error)) as raised:
        work()
    assert raised.value is error
    assert type(error).__name__ in texts[0]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), HandlerExit("tired")])
def test_base_exception_in_coroutine_ends_module(
    legs: Module, older: Module, user: Client, error: BaseException
) -> None:
    """The coroutine beside the failing one is cancelled. Its failure is "module lost", not the
    cancellation.
    """
    begun, cleaned = threading.Event(), threading.Event()

    @legs.handles(STANCE)
    async def stance(task: Task, radius: float) -> list[int]:
        if radius > 0:
            raise error
        begun.set()
        try:
            await task.query_send(STANCE, 1.0)
        finally:
            cleaned.set()
        return []

    with older.running(), ended_with(type(error), legs):
        pending = user.query_send(STANCE, 0.0)
        with pytest.raises(QueryFailed, match="module lost: its module"):
            pending.receive(SOON)
        assert begun.is_set()
        assert cleaned.wait(SOON)
        assert user.query(STANCE, 1.0, timeout=SOON) == [0]


def test_base_exception_in_callback_ends_module(
    legs: Module, older: Module, user: Client, caplog: pytest.LogCaptureFixture
) -> None:
    legs.handles(STANCE)(lambda _, _radius: [1])
    with older.running(), ended_with(KeyboardInterrupt, legs):
        assert user.query(STANCE, 1.0, timeout=SOON) == [1]
        legs.after(0.0, raiser(KeyboardInterrupt()))
        until_withdrawn(user)
        assert user.query(STANCE, 1.0, timeout=SOON) == [0]
    assert ENDED + "KeyboardInterrupt" in caplog.messages


@pytest.mark.parametrize("error", [KeyboardInterrupt(), pytest.fail.Exception("x")])
def test_base_exception_replaces_error_it_caused_in_block(
    legs: Module, user: Client, error: BaseException
) -> None:
    legs.handles(STOP)(lambda _: raiser(error)())
    with pytest.raises(type(error)) as raised, legs.running():
        user.command(STOP).result(SOON)
    assert raised.value is error
    assert isinstance(error.__cause__, TaskFailed)


def test_interrupt_of_block_precedes_earlier_module_end(legs: Module, user: Client) -> None:
    legs.handles(STOP)(lambda _: raiser(HandlerExit("tired"))())

    def work() -> None:
        with legs.running():
            assert user.command(STOP).wait(SOON) is Outcome.FAILED
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as raised:
        work()
    assert raised.value.__notes__ == ["module 'legs' had ended before: HandlerExit: tired"]


def run_cancelled_loop() -> None:
    async def main() -> None:
        sleeping = asyncio.ensure_future(asyncio.sleep(60))
        sleeping.cancel()
        await sleeping

    asyncio.run(main())


def test_cancelled_error_in_plain_handler_is_handler_error(
    legs: Module, user: Client, caplog: pytest.LogCaptureFixture
) -> None:
    @legs.handles(MOVE_LEG)
    def move_leg(_: Task, leg: int) -> Footfall:
        if not leg:
            run_cancelled_loop()
        return Footfall(leg, 0.0)

    with legs.running():
        with pytest.raises(
            TaskFailed, match=r"handler error: asyncio\.exceptions\.CancelledError"
        ) as failed:
            user.command(MOVE_LEG, 0).result(SOON)
        assert "in run_cancelled_loop" in failed.value.text
        assert "handler test_cancelled_error_in_plain_handler" in caplog.text
        assert user.command(MOVE_LEG, 1, sequential=False).result(SOON) == Footfall(1, 0.0)
