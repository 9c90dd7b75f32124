"""Modules: running, sharing and taking over messages, coming back, ending and being stopped; and
users' LocalCentral.
"""

import asyncio
import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from module.real_central import SOON, Gate, RealCentral, until
from module.robot import MOVE_LEG, REST, STANCE, STOP, TEMPERATURE, Footfall

from tca_module import (
    CentralLost,
    Client,
    FormatRefused,
    MisuseError,
    Module,
    Outcome,
    QueryFailed,
    Task,
    TaskFailed,
    Timeout,
    connect,
)
from tca_module.testing import LocalCentral, LocalTransport
from tca_wire.journal.facts import HandlerAdded, ModuleLeft, Received, kind_of

pytestmark = pytest.mark.usefixtures("attentive")


def test_resource_handles_up_to_its_capacity(central: LocalCentral, user: Client) -> None:
    busy = Gate(36.6)
    legs = Module("legs", central, capacity=2)
    legs.handles(TEMPERATURE)(busy)
    with legs.running():
        pending = [user.query_send(TEMPERATURE) for _ in range(3)]
        threads = {busy.threads.get(timeout=SOON) for _ in range(2)}
        assert threads == {"legs 1", "legs 2"}
        assert busy.threads.empty()
        busy.go_on.set()
        assert [one.receive(SOON) for one in pending] == [36.6] * 3


def test_handles_accepts_methods_and_partials_unchanged(legs: Module, user: Client) -> None:
    class Body:
        def stance(self, task: Task, radius: float) -> list[int]:
            return [int(radius)]

    stance = Body().stance
    assert legs.handles(STANCE)(stance) is stance
    legs.handles(TEMPERATURE)(partial(lambda degrees, _: degrees, 36.6))
    with pytest.raises(
        MisuseError, match="module 'legs' handles 'stance' already, in test_handles_accepts_methods"
    ):
        legs.handles(STANCE)(lambda _, _radius: [])
    with legs.running():
        assert user.query(STANCE, 7.0) == [7]
        assert user.query(TEMPERATURE) == 36.6


def test_module_sends_from_outside_its_handlers(legs: Module, central: LocalCentral) -> None:
    legs.handles(STANCE)(lambda _, _radius: [3])
    legs.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.0))
    with legs.running():
        assert legs.query(STANCE, 1.0) == [3]
        with legs.sequence():
            assert legs.command(MOVE_LEG, 1).result(SOON) == Footfall(1, 0.0)
    assert {fact.sender for fact in central.facts if isinstance(fact, Received)} == {"legs"}


def test_module_whose_start_function_fails_does_not_begin(central: LocalCentral) -> None:
    safety = Module("safety", central)

    @safety.at_start
    def watch(_: Module) -> None:
        raise ValueError("nothing to watch")

    with pytest.raises(ValueError, match="nothing to watch"), safety.running():
        raise AssertionError
    assert [fact.module for fact in central.facts if isinstance(fact, ModuleLeft)] == ["safety"]


def test_module_says_goodbye_when_it_ends(legs: Module, central: LocalCentral) -> None:
    legs.handles(REST)(lambda _: None)
    assert repr(legs) == "Module('legs')"
    with legs.running():
        assert not legs.stopping
    assert legs.stopping
    assert [fact.why for fact in central.facts if isinstance(fact, ModuleLeft)] == [
        "it said goodbye"
    ]
    assert not central.core.registry.connections


@contextmanager
def in_thread(function: Callable[[], object]) -> Iterator[list[BaseException | None]]:
    """Run a function beside the block; how it ended is in the list afterwards."""
    ends: list[BaseException | None] = []

    def run() -> None:
        try:
            function()
            ends.append(None)
        except BaseException as error:  # noqa: BLE001
            ends.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    yield ends
    thread.join(SOON)
    assert not thread.is_alive()


def test_stop_ends_run(legs: Module, user: Client) -> None:
    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with in_thread(legs.run) as ends:
        assert user.query(TEMPERATURE) == 36.6
        legs.stop()
    assert ends == [None]


def test_run_without_central_raises_central_lost(legs: Module, central: LocalCentral) -> None:
    central.close()
    with pytest.raises(CentralLost) as lost:
        legs.run(patience=0.1)
    assert not isinstance(lost.value, SystemExit)
    assert str(lost.value).startswith(
        "module 'legs': central at local central 'local' does not answer: start it with"
    )
    with (
        pytest.raises(CentralLost, match=r"^module 'legs': central at "),
        legs.running(patience=0.1),
    ):
        pass


def test_run_without_reconnect_ends_when_central_is_lost(
    legs: Module, central: LocalCentral, user: Client
) -> None:
    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with in_thread(partial(legs.run, patience=0.1, reconnect=False)) as ends:
        assert user.query(TEMPERATURE) == 36.6
        central.close()
    assert isinstance(ends[0], CentralLost)


def test_module_that_cannot_begin_leaves_central(
    legs: Module, central: LocalCentral, user: Client
) -> None:
    user.query_send(TEMPERATURE)
    liar = Module("liar", central)
    liar.handles(type(TEMPERATURE)("temperature", int, reply=float))(lambda _, _data: 0.0)
    for _ in range(2):
        with pytest.raises(FormatRefused, match="two formats for message"), liar.running():
            pass
    assert [module["module"] for module in user.status("modules")] == ["user"]


class Full(LocalCentral):
    """A central to which only so many connections can be made."""

    room = 1

    def transport(self) -> LocalTransport:
        self.room -= 1
        if self.room < 0:
            raise OSError("no room")
        return super().transport()


def test_module_ends_when_slot_cannot_connect() -> None:
    with Full() as central:
        legs = Module("legs", central)
        legs.handles(TEMPERATURE)(lambda _: 36.6)
        with pytest.raises(OSError, match="no room"), legs.running():
            pass
        assert not central.core.registry.connections


def test_module_ends_when_slot_thread_dies(
    legs: Module, central: LocalCentral, user: Client
) -> None:
    """A bug of this library, or a full disk; it must not go unnoticed."""
    legs.handles(TEMPERATURE)(lambda _: 36.6)

    def break_one() -> None:
        slot = next(one for one in central.core.registry.connections.values() if one.resource)
        with central._lock:
            central._connections[slot.id].arrive("no bytes")  # type: ignore[arg-type]

    with in_thread(legs.run) as ends:
        assert user.query(TEMPERATURE) == 36.6
        break_one()
    assert isinstance(ends[0], TypeError)


def test_module_can_be_stopped_before_central_answers(legs: Module, central: LocalCentral) -> None:
    central.close()
    began = threading.Event()
    central.submit = lambda *_: began.set() or False  # type: ignore[method-assign,func-returns-value]
    with in_thread(legs.run) as ends:
        assert began.wait(SOON)
        legs.stop()
    assert ends == [None]


def test_module_reconnects_after_connections_break(
    legs: Module, central: LocalCentral, user: Client
) -> None:
    busy = Gate(36.6)
    legs.handles(TEMPERATURE)(busy)
    with legs.running():
        pending = user.query_send(TEMPERATURE)
        assert busy.threads.get(timeout=SOON)
        central.cut("legs")
        with pytest.raises(
            QueryFailed, match="module lost: module 'legs' was lost: its connection closed"
        ):
            pending.receive(SOON)
        busy.go_on.set()
        again = user.query_send(TEMPERATURE)
        with pytest.raises(Timeout):
            legs.query(STANCE, 1.0, timeout=0)  # connection 0 learns that it was cut
        assert again.receive(SOON) == 36.6
    assert [fact.message for fact in central.facts if isinstance(fact, HandlerAdded)] == [
        "temperature"
    ] * 2


def test_task_wait_survives_connection_break_and_query_is_lost(
    legs: Module, central: LocalCentral, user: Client
) -> None:
    legs.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.0))
    other = connect("other", central)
    move, pending = other.command(MOVE_LEG, 1), other.query_send(TEMPERATURE)
    with pytest.raises(Timeout):
        move.wait(0)
    central.cut("other")
    with legs.running():
        assert move.result(SOON) == Footfall(1, 0.0)
    with pytest.raises(
        CentralLost, match="query 'temperature' is lost: the connection to central broke"
    ):
        pending.receive(SOON)
    assert (
        len(
            [
                fact
                for fact in central.facts
                if isinstance(fact, Received) and fact.message == "move leg"
            ]
        )
        == 1
    )
    other.close()


# --- What users' tests rely on --------------------------------------------------------------------


def test_local_central_runs_given_check_after_each_event(
    central: LocalCentral, user: Client
) -> None:
    user.goal(REST)
    central.core.tree.tasks[1].held = 1
    with pytest.raises(AssertionError):
        user.goal(REST)
    central.core.tree.tasks[1].held = 0


def test_local_central_runs_no_check_by_default() -> None:
    with LocalCentral() as central, connect("user", central) as user:
        user.goal(REST)
        central.core.tree.tasks[1].held = 1
        user.goal(REST)


def test_local_central_exposes_its_journal(central: LocalCentral, user: Client) -> None:
    user.goal(REST)
    kinds = [kind_of(fact) for fact in central.facts]
    assert kinds == ["module joined", "format", "received", "queued"]
    assert [entry.number for entry in central.entries] == [1, 2, 3]
    assert all(entry.time >= 0 for entry in central.entries)


def test_closed_local_central_answers_no_client(central: LocalCentral, user: Client) -> None:
    central.close()
    with pytest.raises(CentralLost, match="central at local central 'local' does not answer"):
        connect("late", central, patience=0.05)


def test_closed_local_central_leaves_no_thread() -> None:
    before = set(threading.enumerate())
    with LocalCentral() as central, connect("user", central) as user:
        user.goal(REST)
        assert set(threading.enumerate()) != before
    central.close()
    assert set(threading.enumerate()) <= before


# --- A module that ends or was stopped ------------------------------------------------------------


class Wrong(Exception):
    """Something in the program beside the handlers."""


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
    """One that does not look: what went wrong is said while it is waited for."""
    monkeypatch.setattr("tca_module.serving.slot._PATIENCE", 0.1)
    gate = Gate([])
    legs.handles(STANCE)(gate)

    class Told(logging.Handler):
        def emit(self, _: logging.LogRecord) -> None:
            gate.go_on.set()

    logging.getLogger("tca.legs").addHandler(told := Told())
    pending = user.query_send(STANCE, 1.0)

    def work() -> None:
        with legs.running():
            assert gate.begun.wait(SOON)
            raise Wrong("no map")

    with pytest.raises(Wrong):
        work()
    logging.getLogger("tca.legs").removeHandler(told)
    assert pending.receive(SOON) == []
    (said,) = caplog.messages
    assert said.startswith(
        "module 'legs' ends (Wrong: no map), and waits for its handler of 'stance' to return"
    )


# --- A module that has stopped, or was ended by one of its threads, while its block goes on -------


ENDED = "module 'legs' ends, and handles nothing any more: "


class Own(BaseException):
    """What no handler should raise."""


@pytest.fixture
def older(central: LocalCentral) -> Module:
    """Who handled all before the legs came."""
    older = Module("older", central)
    older.handles(STANCE)(lambda _, _radius: [0])
    older.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.0))
    return older


def handled_by(user: Client) -> list[str]:
    return [handler.module for handler in user.handlers(STANCE)]


def until_withdrawn(user: Client) -> None:
    until(lambda: "legs" not in handled_by(user), "the legs' handlers are gone")


@contextmanager
def ended_by(kind: type[BaseException], module: Module) -> Iterator[None]:
    """A module's block, which is left by such an error."""
    with pytest.raises(kind), module.running():
        yield


def raises(error: BaseException) -> Callable[[], Any]:
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
        assert handled_by(user) == ["older"]
        assert user.query(STANCE, 1.0, timeout=SOON) == [0]


def test_older_direct_handler_takes_over_from_stopped_module(tmp_path: Path) -> None:
    with RealCentral(f"ipc://{tmp_path}/central.sock") as central:
        older, legs = Module("older", central.address), Module("legs", central.address)
        older.handles(STANCE, direct=True)(lambda _, _radius: [0])
        legs.handles(STANCE, direct=True)(lambda _, _radius: [1])
        with older.running(), legs.running(), connect("user", central.address) as user:
            assert user.query(STANCE, 1.0, timeout=SOON) == [1]
            legs.stop()
            until_withdrawn(user)
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
    """It has the connection to itself, over which central is to be told; and it is not ended."""

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
            assert handled_by(user) == ["older"]
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
    assert caplog.messages == ["module 'legs' has stopped, and handles nothing any more"]


@pytest.mark.parametrize(
    "error", [Own("tired"), KeyboardInterrupt(), GeneratorExit(), pytest.fail.Exception("x")]
)
def test_base_exception_in_handler_ends_module(
    legs: Module,
    older: Module,
    user: Client,
    caplog: pytest.LogCaptureFixture,
    error: BaseException,
) -> None:
    legs.handles(STANCE)(lambda _, _radius: raises(error)())
    said: list[str] = []

    def work() -> None:
        with legs.running():
            with pytest.raises(
                QueryFailed, match="module lost: its module was ended by "
            ) as failed:
                user.query(STANCE, 1.0, timeout=SOON)
            said.append(failed.value.text)
            assert handled_by(user) == ["older"]  # at once
            assert user.query(STANCE, 1.0, timeout=SOON) == [0]
            (logged,) = [record for record in caplog.records if record.name == "tca.legs"]
            assert logged.getMessage() == ENDED + type(error).__name__
            assert logged.exc_info is not None
            assert logged.exc_info[1] is error

    with older.running(), pytest.raises(type(error)) as raised:
        work()
    assert raised.value is error
    assert type(error).__name__ in said[0]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), Own("tired")])
def test_base_exception_in_coroutine_ends_module(
    legs: Module, older: Module, user: Client, error: BaseException
) -> None:
    """Those beside it are told, and have failed with the module, not with what cancelled them."""
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

    with older.running(), ended_by(type(error), legs):
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
    with older.running(), ended_by(KeyboardInterrupt, legs):
        assert user.query(STANCE, 1.0, timeout=SOON) == [1]
        legs.after(0.0, raises(KeyboardInterrupt()))
        until_withdrawn(user)
        assert user.query(STANCE, 1.0, timeout=SOON) == [0]
    assert ENDED + "KeyboardInterrupt" in caplog.messages


@pytest.mark.parametrize("error", [KeyboardInterrupt(), pytest.fail.Exception("x")])
def test_base_exception_replaces_error_it_caused_in_block(
    legs: Module, user: Client, error: BaseException
) -> None:
    legs.handles(STOP)(lambda _: raises(error)())
    with pytest.raises(type(error)) as raised, legs.running():
        user.command(STOP).result(SOON)
    assert raised.value is error
    assert isinstance(error.__cause__, TaskFailed)


def test_interrupt_of_block_precedes_earlier_module_end(legs: Module, user: Client) -> None:
    legs.handles(STOP)(lambda _: raises(Own("tired"))())

    def work() -> None:
        with legs.running():
            assert user.command(STOP).wait(SOON) is Outcome.FAILED
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as raised:
        work()
    assert raised.value.__notes__ == ["module 'legs' had ended before: Own: tired"]


def runs_something_that_is_cancelled() -> None:
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
            runs_something_that_is_cancelled()
        return Footfall(leg, 0.0)

    with legs.running():
        with pytest.raises(
            TaskFailed, match=r"handler error: asyncio\.exceptions\.CancelledError"
        ) as failed:
            user.command(MOVE_LEG, 0).result(SOON)
        assert "in runs_something_that_is_cancelled" in failed.value.text
        assert "handler test_cancelled_error_in_plain_handler" in caplog.text
        assert user.command(MOVE_LEG, 1, sequential=False).result(SOON) == Footfall(1, 0.0)
