"""Services of central itself: lists of modules and handlers, shared variables, locks and
reservations.
"""

import logging
import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from module.real_central import SOON, until
from module.robot import ALARM, MOVE_LEG, POSITION, STANCE, TEMPERATURE, Arc, Footfall

from tca_module import (
    HANDLERS_CHANGED,
    MODULE_JOINED,
    MODULE_LEFT,
    Client,
    Command,
    Deadlock,
    Departure,
    FormatRefused,
    HandlerInfo,
    Inform,
    LockLost,
    MisuseError,
    Module,
    Outcome,
    Query,
    Refused,
    ResourceInfo,
    Task,
    TaskFailed,
    TcaError,
    Timeout,
    Variable,
    VariableNotSet,
    connect,
    module,
)
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import ModuleLeft, Received


@pytest.fixture
def walkers(central: LocalCentral) -> Module:
    legs = Module("legs", central, capacity=2)
    legs.handles(MOVE_LEG, pending=3, pool="both")(lambda _, leg: Footfall(leg, 0.0))
    legs.handles(TEMPERATURE, resource="thermometer")(lambda _: 36.6)
    return legs


class BackgroundModule:
    """A module that runs in the background. It may have to wait before it serves."""

    def __init__(self, started: Module) -> None:
        self.module, self.error = started, list[TcaError]()
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def _run(self) -> None:
        try:
            self.module.run()
        except TcaError as error:
            self.error.append(error)

    def stop(self) -> None:
        self.module.stop()
        self.thread.join(SOON)
        assert not self.thread.is_alive()


def test_modules_and_handlers_are_listed(walkers: Module, user: Client) -> None:
    with walkers.running():
        modules = {info.name: info for info in user.modules()}
        assert set(modules) == {"legs", "user"}
        assert modules["legs"].handles == ("move leg", "temperature")
        assert [(part.name, part.capacity) for part in modules["legs"].resources] == [
            ("legs", 2),
            ("thermometer", 1),
        ]
        assert modules["user"].resources == ()
        assert user.handlers(MOVE_LEG) == [HandlerInfo("legs", "legs", 2, "both", 3, 0)]
        assert user.handlers(STANCE) == []
        assert walkers.modules() == user.modules()
    assert user.handlers(MOVE_LEG) == []


def test_wait_until_handled_returns_when_handlers_exist(walkers: Module, user: Client) -> None:
    later = threading.Timer(0.1, lambda: started.append(BackgroundModule(walkers)))
    started: list[BackgroundModule] = []
    later.start()
    user.wait_until_handled(MOVE_LEG, TEMPERATURE, timeout=SOON)
    assert user.query(TEMPERATURE) == 36.6
    later.join()
    started[0].stop()
    user.wait_until_handled(timeout=SOON)  # nothing to wait for


def test_unhandled_messages_are_named_at_timeout(walkers: Module, user: Client) -> None:
    with walkers.running(), pytest.raises(Timeout) as late:
        user.wait_until_handled(MOVE_LEG, STANCE, ALARM, timeout=0.01)
    assert str(late.value) == (
        "not handled within 0.01 s: query 'stance', broadcast 'alarm'; start the module that handles them, see 'tca messages'"
    )


def test_module_serves_once_required_messages_are_handled(
    walkers: Module, central: LocalCentral, user: Client
) -> None:
    planner = Module("planner", central, requires=[TEMPERATURE, MOVE_LEG])
    planner.handles(STANCE)(lambda task, _: [int(task.query(TEMPERATURE))])
    started = BackgroundModule(planner)
    assert user.execute_if_handled(STANCE, 1.0) is None
    with walkers.running():
        user.wait_until_handled(STANCE, timeout=SOON)
        assert user.query(STANCE, 1.0, timeout=SOON) == [36]
    assert user.handlers(STANCE) != []  # the module continues to serve
    started.stop()
    assert started.error == []


def test_own_handler_satisfies_requirement(central: LocalCentral) -> None:
    planner = Module("planner", central, requires=(STANCE,))
    planner.handles(STANCE)(lambda _, radius: [int(radius)])
    with planner.running():
        assert planner.handlers(STANCE)[0].module == "planner"


def test_waiting_module_names_requirements_and_can_be_stopped(
    central: LocalCentral,
    user: Client,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(module, "_WARN_AFTER", 0.0)
    monkeypatch.setattr(module, "CHECK_PERIOD", 0.01)
    with caplog.at_level(logging.WARNING):
        started = BackgroundModule(Module("planner", central, requires=[STANCE, MOVE_LEG]))
        until(lambda: caplog.records, "the wait is logged")
        awaited = {message["message"]: message["awaited_by"] for message in user.status("messages")}
        assert awaited == {"stance": ["planner"], "move leg": ["planner"]}
        started.stop()
    assert [record.message for record in caplog.records] == [
        "waits for handlers of 'stance', 'move leg', which it requires; see 'tca messages'"
    ]
    assert started.error == []
    assert [info.name for info in user.modules()] == ["user"]


def test_mutually_requiring_modules_are_warned_at_once(
    central: LocalCentral, user: Client, caplog: pytest.LogCaptureFixture
) -> None:
    """Each module would wait for the other for ever. A message that another module may still handle
    is not named.
    """
    legs, planner = (
        Module("legs", central, requires=[STANCE]),
        Module("planner", central, requires=[MOVE_LEG, ALARM]),
    )
    legs.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.5))
    planner.handles(STANCE)(lambda _, radius: [int(radius)])
    with caplog.at_level(logging.WARNING):
        started = [BackgroundModule(legs), BackgroundModule(planner)]
        until(lambda: len(caplog.records) == 2, "both waits are logged")
        for one in started:
            one.stop()
    assert {record.name for record in caplog.records} == {"tca.legs", "tca.planner"}
    for record in caplog.records:
        assert record.message.startswith("modules require each other: ")
        assert "'legs' waits for 'stance', which 'planner' will handle" in record.message
        assert "'planner' waits for 'move leg', which 'legs' will handle" in record.message


def test_requirement_wait_survives_central_restart(central: LocalCentral, walkers: Module) -> None:
    started = BackgroundModule(Module("planner", central, requires=[TEMPERATURE]))
    until(lambda: "temperature" in central.core.registry.messages, "planner waits for temperature")
    central.restart("second")
    with walkers.running():
        until(lambda: started.module._keep_alive, "planner serves")
        started.stop()
    assert started.error == []


@pytest.fixture
def notices(central: LocalCentral) -> Iterator["queue.SimpleQueue[Any]"]:
    """Yield the notices that a module gets. The module handles all of them."""
    notices: queue.SimpleQueue[Any] = queue.SimpleQueue()
    guard = Module("guard", central)
    guard.handles(MODULE_JOINED)(lambda _, who: notices.put(who.module))
    guard.handles(MODULE_LEFT)(lambda _, who: notices.put((who.module, who.why)))
    guard.handles(HANDLERS_CHANGED)(lambda _, what: notices.put((what.message, what.handlers)))
    with guard.running():
        yield notices


def test_notices_reach_listening_module(walkers: Module, notices: "queue.SimpleQueue[Any]") -> None:
    with walkers.running():
        pass
    assert {notices.get(timeout=SOON) for _ in range(6)} == {
        "legs",
        ("move leg", 1),
        ("temperature", 1),
        ("move leg", 0),
        ("temperature", 0),
        ("legs", "it said goodbye"),
    }


def test_shell_commands_cause_no_notices(
    central: LocalCentral, notices: "queue.SimpleQueue[Any]"
) -> None:
    """Otherwise each ``tca status`` would suspend a robot whose supervisor reacts to departures."""
    with connect("tca status", central) as first, connect("tca status", central):
        assert "tca status" in {one.name for one in first.modules()}
    with connect("operator panel", central):
        pass
    assert [notices.get(timeout=SOON) for _ in range(2)] == [
        "operator panel",
        ("operator panel", "it said goodbye"),
    ]
    assert (
        sum(
            isinstance(fact, ModuleLeft) and fact.module.startswith("tca status")
            for fact in central.facts
        )
        == 2
    )


def test_only_central_may_send_notices(user: Client) -> None:
    sender: Any = user
    with pytest.raises(
        MisuseError, match=r"broadcast\(\) takes messages of class Broadcast, not Notice\('tca: "
    ):
        sender.broadcast(MODULE_LEFT, Departure("legs", "a joke"))
    with pytest.raises(Refused, match="names that begin with 'tca: ' are central's own"):
        user.inform(Inform("tca: news", int), 5)
    with pytest.raises(FormatRefused, match="a inform here, a broadcast there"):
        user.inform(Inform("tca: module left", int), 5)
    user.inform(POSITION, POSITION.data.kind(1.0, 1))


# --- Shared variables -----------------------------------------------------------------------------


POSE = Variable("pose", Arc)
MODE = Variable("mode", str)


def test_newest_variable_value_is_visible_to_all(central: LocalCentral, user: Client) -> None:
    with connect("sensor", central) as sensor:
        sensor.set_variable(POSE, Arc(1.0, 1))
        sensor.set_variable(POSE, Arc(2.0, 2))
        sensor.set_variable(POSE, Arc(3.0, 3), wait=False)
        assert sensor.get_variable(POSE) == Arc(3.0, 3)
    assert user.get_variable(POSE) == Arc(3.0, 3)


def test_unset_variable_raises_or_yields_default(user: Client) -> None:
    with pytest.raises(VariableNotSet) as unset:
        user.get_variable(MODE)
    assert (
        str(unset.value)
        == "variable 'mode' was never set: set it first, handle it to watch it, or give a default"
    )
    assert isinstance(unset.value, LookupError)
    assert user.get_variable(MODE, None) is None
    assert user.get_variable(MODE, "idle") == "idle"
    assert user.swap_variable(MODE, "walking") is None
    assert user.swap_variable(MODE, "idle", "?") == "walking"
    assert user.get_variable(MODE) == "idle"


@pytest.mark.usefixtures("short_timeouts")
def test_watcher_gets_missed_value_after_reconnect(central: LocalCentral, user: Client) -> None:
    view, seen = Module("view", central), queue.SimpleQueue[str]()
    view.handles(MODE)(lambda _, mode: seen.put(mode))
    with view.running():
        user.set_variable(MODE, "idle")
        assert seen.get(timeout=SOON) == "idle"
        central.cut("view")
        user.set_variable(MODE, "walking")
        while (mode := seen.get(timeout=SOON)) != "walking":
            assert mode == "idle"


def test_handler_sets_and_gets_variable(central: LocalCentral, user: Client) -> None:
    legs, done = Module("legs", central), threading.Event()

    @legs.handles(POSITION)
    def on_position(task: Task, position: Arc) -> None:
        task.set_variable(POSE, position)
        task.set_variable(MODE, f"at {task.get_variable(POSE).steps}")
        done.set()

    with legs.running():
        user.inform(POSITION, Arc(1.0, 7))
        assert done.wait(SOON)
        assert legs.get_variable(MODE) == "at 7"
    received = [fact for fact in central.facts if isinstance(fact, Received)]
    assert [(fact.message, fact.origin) for fact in received] == [
        ("position", 0),
        ("pose", 1),
        ("mode", 1),
    ]


# --- Locks and reservations, as modules use them --------------------------------------------------


MOVE = Command("move", int)
WHERE = Query("where", reply=int)
ASK = Query("ask", reply=int)


def test_locked_resource_starts_no_message(
    central: LocalCentral, legs: Module, user: Client
) -> None:
    moved: list[int] = []
    legs.handles(MOVE)(lambda _, number: moved.append(number))
    with legs.running(), connect("other", central) as other:
        with user.lock("legs", timeout=5):
            move = other.command(MOVE, 1)
            with pytest.raises(Timeout, match="not reached"):
                move.wait(timeout=0.1)
            assert [resource.locked_by for resource in resources(user)] == ["user"]
            with pytest.raises(Deadlock, match="legs, which user has locked"):
                user.command(MOVE, 2).result()
        move.result(timeout=5)
        assert [resource.locked_by for resource in resources(user)] == [""]


def resources(user: Client) -> list[ResourceInfo]:
    return [resource for module in user.modules() for resource in module.resources]


def test_reservation_admits_messages_of_its_module(
    central: LocalCentral, legs: Module, user: Client
) -> None:
    moved: list[int] = []
    legs.handles(MOVE)(lambda _, number: moved.append(number))
    with legs.running(), connect("other", central) as other:
        claim = user.reserve("legs", "legs")
        late = other.command(MOVE, 2)
        user.command(MOVE, 1).result(timeout=5)
        assert moved == [1]
        claim.release()
        claim.release()
        late.result(timeout=5)
        assert moved == [1, 2]


def test_handler_gets_answer_after_releasing_own_resource(
    central: LocalCentral, legs: Module, user: Client
) -> None:
    legs.handles(WHERE)(lambda *_: 7)

    @legs.handles(ASK)
    def ask(task: Task, _: None) -> int:
        with task.lock("legs", timeout=5):
            where = task.query_send(WHERE)
        return where.receive(timeout=5)

    with legs.running():
        assert user.query(ASK, timeout=10) == 7


def test_lock_timeout_names_lock_holder(central: LocalCentral, legs: Module, user: Client) -> None:
    legs.handles(MOVE)(lambda *_: None)
    with legs.running(), connect("other", central) as other:
        with user.lock("legs"):
            with pytest.raises(Timeout, match="legs, which user has locked"):
                other.lock("legs", timeout=0.05)
            with pytest.raises(Timeout, match="lock of resource 'legs' of 'legs'"):
                other.lock("legs", "legs", timeout=0)
            with pytest.raises(Refused, match="release it"):
                user.reserve("legs")
        with other.reserve("legs", timeout=0):
            pass


@pytest.mark.parametrize("in_block", [False, True])
def test_release_refused_in_other_thread_keeps_lock(
    central: LocalCentral, legs: Module, user: Client, in_block: bool
) -> None:
    legs.handles(MOVE)(lambda *_: None)
    refused: list[MisuseError] = []
    with legs.running(), connect("other", central) as other:
        claim = user.lock("legs", timeout=5)

        def release() -> None:
            try:
                if in_block:
                    with claim:
                        pass
                else:
                    claim.release()
            except MisuseError as error:
                refused.append(error)

        thread = threading.Thread(target=release)
        thread.start()
        thread.join()
        assert "belongs to thread " in str(refused[0])
        assert claim.held
        claim.release()
        other.lock("legs", timeout=5).release()


# --- Locks and reservations that were taken away --------------------------------------------------


pytestmark = pytest.mark.usefixtures("short_timeouts")

SCAN = Command("scan")


class Scans:
    """Scans, for which the legs must stand still. Each scan waits in its lock block until it may
    continue.
    """

    def __init__(self, eyes: Module) -> None:
        self.held: list[bool] = []
        self._locked, self._go_on = threading.Event(), threading.Event()
        eyes.handles(SCAN)(self._scan)

    def _scan(self, task: Task) -> None:
        with task.lock("legs", timeout=SOON) as claim:
            self.held.append(claim.held)
            self._locked.set()
            assert self._go_on.wait(SOON)
            self.held.append(claim.held)
        self.held.append(claim.held)

    @contextmanager
    def under_way(self) -> Iterator[None]:
        """Run a block while a scan has locked the legs."""
        assert self._locked.wait(SOON)
        try:
            yield
        finally:
            self._go_on.set()


@pytest.fixture
def moving_legs(legs: Module) -> Iterator[None]:
    legs.handles(MOVE)(lambda *_: None)
    with legs.running():
        yield


def unlock_by_operator(central: LocalCentral) -> None:
    with connect("operator", central) as operator:
        assert operator.unlock("legs")


@pytest.mark.usefixtures("moving_legs")
def test_handler_fails_at_block_end_when_lock_was_taken_away(eyes: Module, user: Client) -> None:
    scans = Scans(eyes)
    with eyes.running():
        scan = user.command(SCAN)
        with scans.under_way():
            assert user.unlock("legs")
            assert user.command(MOVE, 1, sequential=False).wait(SOON) is Outcome.DONE
        with pytest.raises(
            TaskFailed, match=r"lock of resource 'legs' was lost .* unlocked by module 'user'"
        ) as raised:
            scan.result(SOON)
    assert raised.value.failure == "lock lost"
    assert scans.held == [True, False]


@pytest.mark.usefixtures("moving_legs")
def test_error_from_lock_block_is_not_replaced_by_lock_lost(
    eyes: Module, user: Client, central: LocalCentral
) -> None:
    @eyes.handles(SCAN)
    def scan(task: Task) -> None:
        with task.lock("legs"):
            unlock_by_operator(central)
            raise KeyError("dust")

    with eyes.running(), pytest.raises(TaskFailed, match="dust"):
        user.command(SCAN).result(SOON)


@pytest.mark.usefixtures("moving_legs")
def test_explicit_release_raises_lock_lost_once(
    eyes: Module, user: Client, central: LocalCentral
) -> None:
    @eyes.handles(SCAN)
    def scan(task: Task) -> None:
        claim = task.reserve("legs")
        unlock_by_operator(central)
        with pytest.raises(
            LockLost, match="the reservation of resource 'legs' was lost before it was released"
        ):
            claim.release()
        claim.release()

    with eyes.running():
        assert user.command(SCAN).wait(SOON) is Outcome.DONE


@pytest.mark.usefixtures("moving_legs")
def test_lock_is_lost_when_connection_breaks(user: Client, central: LocalCentral) -> None:
    """Central releases the locks of a lost module even if the module returns at once, because
    others may have used the resource.
    """
    with connect("other", central) as other:
        claim = other.lock("legs")
        central.cut("other")
        assert user.command(MOVE, 1).wait(SOON) is Outcome.DONE
        other.modules()
        assert not claim.held
        with pytest.raises(LockLost, match="the connection to central was lost"):
            claim.release()
        with (
            pytest.raises(LockLost, match="the connection to central was lost"),
            other.lock("legs"),
        ):
            central.cut("other")


def test_lock_is_lost_when_resource_module_leaves(user: Client, legs: Module) -> None:
    legs.handles(MOVE)(lambda *_: None)
    with legs.running():
        claim = user.lock("legs")
    assert not claim.held
    with pytest.raises(LockLost, match="module 'legs' left"), claim:
        pass


@pytest.mark.usefixtures("moving_legs")
def test_lock_is_lost_when_central_restarts(user: Client, central: LocalCentral) -> None:
    """A client learns of the loss with its next message, at the end of the block at the latest."""
    with (
        pytest.raises(LockLost, match="central was restarted and has forgotten it"),
        user.lock("legs"),
    ):
        central.restart("afresh")
    with connect("other", central) as other:
        other.wait_until_handled(MOVE, timeout=SOON)
        with other.lock("legs", timeout=SOON) as claim:
            assert claim.held
