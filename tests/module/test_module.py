"""Modules: starting, running, sharing messages and reconnecting; and LocalCentral as users' tests
need it.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import pytest
from module.real_central import SOON, Gate
from module.robot import MOVE_LEG, REST, STANCE, TEMPERATURE, Footfall

from tca_module import (
    CentralLost,
    Client,
    FormatRefused,
    MisuseError,
    Module,
    MultiQuery,
    QueryFailed,
    Task,
    Timeout,
    connect,
)
from tca_module.testing import LocalCentral, LocalTransport
from tca_wire.journal.facts import HandlerAdded, ModuleLeft, Received, kind_of

pytestmark = pytest.mark.usefixtures("short_timeouts")


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


@pytest.mark.parametrize(
    ("error", "why"),
    [
        (RuntimeError("arm"), "it failed: RuntimeError: arm"),
        (SystemExit(3), "it failed: SystemExit: 3"),
        (SystemExit(0), "it said goodbye"),
        (KeyboardInterrupt(), "it said goodbye"),
    ],
)
def test_goodbye_of_a_crash_names_the_error(
    legs: Module, central: LocalCentral, error: BaseException, why: str
) -> None:
    legs.handles(REST)(lambda _: None)
    for block in (legs.running(), connect("user", central)):
        with pytest.raises(type(error)), block:
            raise error
    assert [fact.why for fact in central.facts if isinstance(fact, ModuleLeft)] == [why, why]


@contextmanager
def in_thread(function: Callable[[], object]) -> Iterator[list[BaseException | None]]:
    """Run a function beside the block. Yield a list that holds the function's error, or None, after
    the block.
    """
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
    central.submit = lambda *_: False  # type: ignore[method-assign]
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


class FullCentral(LocalCentral):
    """A central that accepts a limited number of connections."""

    room = 1

    def transport(self) -> LocalTransport:
        self.room -= 1
        if self.room < 0:
            raise OSError("no room")
        return super().transport()


def test_module_ends_when_slot_cannot_connect() -> None:
    with FullCentral() as central:
        legs = Module("legs", central)
        legs.handles(TEMPERATURE)(lambda _: 36.6)
        with pytest.raises(OSError, match="no room"), legs.running():
            pass
        assert not central.core.registry.connections


def test_module_ends_when_slot_thread_dies(
    legs: Module, central: LocalCentral, user: Client
) -> None:
    """The cause may be a bug of this library, or a full disk. It must not go unnoticed."""
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


def test_connection_break_ends_a_multi_query_at_once(legs: Module, central: LocalCentral) -> None:
    asked, busy = MultiQuery("asked", reply=float), Gate(36.6)
    legs.handles(asked)(busy)
    with legs.running(), connect("other", central) as other:
        replies = other.multi_query_send(asked, timeout=10 * SOON)
        busy.threads.get(timeout=SOON)
        central.cut("other")
        began = time.monotonic()
        with pytest.raises(CentralLost):
            next(replies)
        assert time.monotonic() < began + SOON
        busy.go_on.set()


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


# --- LocalCentral as users' tests need it ---------------------------------------------------------


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


def test_closed_local_central_leaves_no_thread() -> None:
    before = set(threading.enumerate())
    with LocalCentral() as central, connect("user", central) as user:
        user.goal(REST)
        assert set(threading.enumerate()) != before
    central.close()
    assert set(threading.enumerate()) <= before
