"""Modules: running, sharing and taking over messages, coming back; and the LocalCentral of users' tests."""

import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import pytest
from module.real_central import SOON
from module.robot import MOVE_LEG, REST, STANCE, TEMPERATURE, Footfall

from tca_module import CentralLost, Client, FormatRefused, MisuseError, Module, QueryFailed, Task, Timeout, connect
from tca_module.testing import LocalCentral, LocalTransport
from tca_wire.journal.facts import HandlerAdded, ModuleLeft, Received, kind_of

pytestmark = pytest.mark.usefixtures("attentive")


class Busy:
    """A handler that is busy until it is released."""

    def __init__(self) -> None:
        self.started: queue.Queue[str] = queue.Queue()
        self.go = threading.Event()

    def __call__(self, task: Task) -> float:
        self.started.put(threading.current_thread().name)
        assert self.go.wait(SOON)
        return 36.6


def test_a_resource_handles_as_many_messages_as_its_capacity(central: LocalCentral, user: Client) -> None:
    busy = Busy()
    legs = Module("legs", central, capacity=2)
    legs.handles(TEMPERATURE)(busy)
    with legs.running():
        pending = [user.query_send(TEMPERATURE) for _ in range(3)]
        threads = {busy.started.get(timeout=SOON) for _ in range(2)}
        assert threads == {"legs 1", "legs 2"}
        assert busy.started.empty()
        busy.go.set()
        assert [one.receive(SOON) for one in pending] == [36.6] * 3


def test_methods_and_partial_functions_handle_and_stay_as_they_are(legs: Module, user: Client) -> None:
    class Body:
        def stance(self, task: Task, radius: float) -> list[int]:
            return [int(radius)]

    stance = Body().stance
    assert legs.handles(STANCE)(stance) is stance
    legs.handles(TEMPERATURE)(partial(lambda degrees, _: degrees, 36.6))
    with pytest.raises(MisuseError, match="module 'legs' handles 'stance' already, in test_methods_and_partial"):
        legs.handles(STANCE)(lambda _, _radius: [])
    with legs.running():
        assert user.query(STANCE, 7.0) == [7]
        assert user.query(TEMPERATURE) == 36.6


def test_a_module_sends_from_outside_of_its_handlers(legs: Module, central: LocalCentral) -> None:
    legs.handles(STANCE)(lambda _, _radius: [3])
    legs.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.0))
    with legs.running():
        assert legs.query(STANCE, 1.0) == [3]
        with legs.sequence():
            assert legs.command(MOVE_LEG, 1).result(SOON) == Footfall(1, 0.0)
    assert {fact.sender for fact in central.facts if isinstance(fact, Received)} == {"legs"}


def test_a_module_that_fails_at_its_start_does_not_begin(central: LocalCentral) -> None:
    safety = Module("safety", central)

    @safety.at_start
    def watch(_: Module) -> None:
        raise ValueError("nothing to watch")

    with pytest.raises(ValueError, match="nothing to watch"), safety.running():
        raise AssertionError
    assert [fact.module for fact in central.facts if isinstance(fact, ModuleLeft)] == ["safety"]


def test_a_module_leaves_with_goodbye(legs: Module, central: LocalCentral) -> None:
    legs.handles(REST)(lambda _: None)
    assert repr(legs) == "Module('legs')"
    with legs.running():
        assert not legs.stopping
    assert legs.stopping
    assert [fact.why for fact in central.facts if isinstance(fact, ModuleLeft)] == ["it said goodbye"]
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


def test_run_ends_when_it_is_told_to(legs: Module, user: Client) -> None:
    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with in_thread(legs.run) as ends:
        assert user.query(TEMPERATURE) == 36.6
        legs.stop()
    assert ends == [None]


def test_without_central_run_ends_the_program_with_one_line(legs: Module, central: LocalCentral) -> None:
    central.close()
    with pytest.raises(CentralLost) as lost:
        legs.run(patience=0.1)
    assert isinstance(lost.value, SystemExit)
    assert lost.value.code == str(lost.value)
    assert str(lost.value).startswith("module 'legs': central at local central 'local' does not answer: start it with")
    with pytest.raises(CentralLost, match=r"^module 'legs': central at "), legs.running(patience=0.1):
        pass


def test_run_may_end_when_central_is_lost(legs: Module, central: LocalCentral, user: Client) -> None:
    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with in_thread(partial(legs.run, patience=0.1, reconnect=False)) as ends:
        assert user.query(TEMPERATURE) == 36.6
        central.close()
    assert isinstance(ends[0], CentralLost)


def test_a_module_that_cannot_begin_cleans_up(legs: Module, central: LocalCentral, user: Client) -> None:
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


def test_a_module_ends_when_one_of_its_threads_cannot_begin() -> None:
    with Full() as central:
        legs = Module("legs", central)
        legs.handles(TEMPERATURE)(lambda _: 36.6)
        with pytest.raises(OSError, match="no room"), legs.running():
            pass
        assert not central.core.registry.connections


def test_a_module_ends_when_one_of_its_threads_does(legs: Module, central: LocalCentral, user: Client) -> None:
    """A bug of this library, or a full disk; it must not go unnoticed."""
    legs.handles(TEMPERATURE)(lambda _: 36.6)

    def break_one() -> None:
        slot = next(one for one in central.core.registry.connections.values() if one.resource)
        central._connections[slot.id].incoming.put("no bytes")  # type: ignore[arg-type]

    with in_thread(legs.run) as ends:
        assert user.query(TEMPERATURE) == 36.6
        break_one()
    assert isinstance(ends[0], TypeError)


def test_a_module_can_be_stopped_before_central_is_there(legs: Module, central: LocalCentral) -> None:
    central.close()
    began = threading.Event()
    central.take = lambda *_: began.set() or False  # type: ignore[method-assign,func-returns-value]
    with in_thread(legs.run) as ends:
        assert began.wait(SOON)
        legs.stop()
    assert ends == [None]


def test_a_module_comes_back_after_its_connections_broke(legs: Module, central: LocalCentral, user: Client) -> None:
    busy = Busy()
    legs.handles(TEMPERATURE)(busy)
    with legs.running():
        pending = user.query_send(TEMPERATURE)
        assert busy.started.get(timeout=SOON)
        central.cut("legs")
        with pytest.raises(QueryFailed, match="module lost: module 'legs' was lost: its connection closed"):
            pending.receive(SOON)
        busy.go.set()
        again = user.query_send(TEMPERATURE)
        with pytest.raises(Timeout):
            legs.query(STANCE, 1.0, timeout=0)  # connection 0 learns that it was cut
        assert again.receive(SOON) == 36.6
    assert [fact.message for fact in central.facts if isinstance(fact, HandlerAdded)] == ["temperature"] * 2


def test_a_wait_outlives_a_broken_connection(legs: Module, central: LocalCentral, user: Client) -> None:
    legs.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.0))
    other = connect("other", central)
    move, pending = other.command(MOVE_LEG, 1), other.query_send(TEMPERATURE)
    with pytest.raises(Timeout):
        move.wait(0)
    central.cut("other")
    with legs.running():
        assert move.result(SOON) == Footfall(1, 0.0)
    with pytest.raises(CentralLost, match="query 'temperature' is lost: the connection to central broke"):
        pending.receive(SOON)
    assert len([fact for fact in central.facts if isinstance(fact, Received) and fact.message == "move leg"]) == 1
    other.close()


# --- What users' tests rely on ---------------------------------------------------------------------------------------


def test_the_invariants_of_central_are_checked_after_every_event_where_that_is_wanted(
    central: LocalCentral, user: Client
) -> None:
    user.goal(REST)
    central.core.tree.tasks[1].held = 1
    with pytest.raises(AssertionError):
        user.goal(REST)
    central.core.tree.tasks[1].held = 0


def test_checks_are_only_made_for_those_who_want_them() -> None:
    with LocalCentral() as central, connect("user", central) as user:
        user.goal(REST)
        central.core.tree.tasks[1].held = 1
        user.goal(REST)


def test_the_journal_is_there_to_be_looked_at(central: LocalCentral, user: Client) -> None:
    user.goal(REST)
    kinds = [kind_of(fact) for fact in central.facts]
    assert kinds == ["module joined", "format", "received", "queued"]
    assert [entry.number for entry in central.entries] == [1, 2, 3]
    assert all(entry.time >= 0 for entry in central.entries)


def test_a_closed_central_answers_nobody(central: LocalCentral, user: Client) -> None:
    central.close()
    with pytest.raises(CentralLost, match="central at local central 'local' does not answer"):
        connect("late", central, patience=0.05)


def test_a_closed_central_leaves_no_thread_behind() -> None:
    before = set(threading.enumerate())
    with LocalCentral() as central, connect("user", central) as user:
        user.goal(REST)
        assert set(threading.enumerate()) != before
    central.close()
    assert set(threading.enumerate()) <= before
