"""What central itself answers: who is there, and shared variables."""

import logging
import queue
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from module.real_central import SOON, until
from module.robot import ALARM, MOVE_LEG, POSITION, STANCE, TEMPERATURE, Arc, Footfall

from tca_module import (
    HANDLERS_CHANGED,
    MODULE_JOINED,
    MODULE_LEFT,
    Client,
    Departure,
    FormatRefused,
    HandlerInfo,
    Inform,
    MisuseError,
    Module,
    Refused,
    Task,
    TcaError,
    Timeout,
    Variable,
    VariableNotSet,
    connect,
    module,
)
from tca_module.session.session import Session
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import ModuleLeft, Received
from tca_wire.packets import headers
from tca_wire.vocabulary import Refusal


@pytest.fixture
def legs(central: LocalCentral) -> Module:
    legs = Module("legs", central, capacity=2)
    legs.handles(MOVE_LEG, pending=3, pool="both")(lambda _, leg: Footfall(leg, 0.0))
    legs.handles(TEMPERATURE, resource="thermometer")(lambda _: 36.6)
    return legs


class Started:
    """A module that is run in the background, and may have to wait before it serves."""

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


def test_who_is_there_and_handles_what(legs: Module, user: Client) -> None:
    with legs.running():
        known = {info.name: info for info in user.modules()}
        assert set(known) == {"legs", "user"}
        assert known["legs"].handles == ("move leg", "temperature")
        assert [(part.name, part.capacity) for part in known["legs"].resources] == [("legs", 2), ("thermometer", 1)]
        assert known["user"].resources == ()
        assert user.handlers(MOVE_LEG) == [HandlerInfo("legs", "legs", 2, "both", 3, 0)]
        assert user.handlers(STANCE) == []
        assert legs.modules() == user.modules()
    assert user.handlers(MOVE_LEG) == []


def test_waiting_until_messages_are_handled(legs: Module, user: Client) -> None:
    later = threading.Timer(0.1, lambda: started.append(Started(legs)))
    started: list[Started] = []
    later.start()
    user.wait_until_handled(MOVE_LEG, TEMPERATURE, timeout=SOON)
    assert user.query(TEMPERATURE) == 36.6
    later.join()
    started[0].stop()
    user.wait_until_handled(timeout=SOON)  # for nothing


def test_what_is_not_handled_in_time_is_named(legs: Module, user: Client) -> None:
    with legs.running(), pytest.raises(Timeout) as late:
        user.wait_until_handled(MOVE_LEG, STANCE, ALARM, timeout=0.01)
    assert str(late.value) == (
        "not handled within 0.01 s: query 'stance', broadcast 'alarm'; start the module that does, see 'tca messages'"
    )


def test_a_module_serves_when_what_it_requires_is_handled(legs: Module, central: LocalCentral, user: Client) -> None:
    planner = Module("planner", central, requires=[TEMPERATURE, MOVE_LEG])
    planner.handles(STANCE)(lambda task, _: [int(task.query(TEMPERATURE))])
    started = Started(planner)
    assert user.execute_if_handled(STANCE, 1.0) is None
    with legs.running():
        user.wait_until_handled(STANCE, timeout=SOON)
        assert user.query(STANCE, 1.0, timeout=SOON) == [36]
    assert user.handlers(STANCE) != []  # it goes on serving
    started.stop()
    assert started.error == []


def test_what_a_module_handles_itself_it_need_not_wait_for(central: LocalCentral) -> None:
    planner = Module("planner", central, requires=(STANCE,))
    planner.handles(STANCE)(lambda _, radius: [int(radius)])
    with planner.running():
        assert planner.handlers(STANCE)[0].module == "planner"


def test_a_module_that_waits_can_be_stopped_and_says_what_it_waits_for(
    central: LocalCentral, user: Client, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(module, "_WARN_AFTER", 0.0)
    monkeypatch.setattr(module, "TEND_PERIOD", 0.01)
    with caplog.at_level(logging.WARNING):
        started = Started(Module("planner", central, requires=[STANCE, MOVE_LEG]))
        until(lambda: caplog.records, "it says so")
        awaited = {message["message"]: message["awaited_by"] for message in user.status("messages")}
        assert awaited == {"stance": ["planner"], "move leg": ["planner"]}
        started.stop()
    assert [record.message for record in caplog.records] == [
        "waits for handlers of 'stance', 'move leg', which it requires; see 'tca messages'"
    ]
    assert started.error == []
    assert [info.name for info in user.modules()] == ["user"]


def test_modules_that_require_each_other_are_told_at_once(
    central: LocalCentral, user: Client, caplog: pytest.LogCaptureFixture
) -> None:
    """Each would wait for the other for ever; one that another module still may handle is not named."""
    legs, planner = Module("legs", central, requires=[STANCE]), Module("planner", central, requires=[MOVE_LEG, ALARM])
    legs.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.5))
    planner.handles(STANCE)(lambda _, radius: [int(radius)])
    with caplog.at_level(logging.WARNING):
        started = [Started(legs), Started(planner)]
        until(lambda: len(caplog.records) == 2, "both say so")
        for one in started:
            one.stop()
    assert {record.name for record in caplog.records} == {"tca.legs", "tca.planner"}
    for record in caplog.records:
        assert record.message.startswith("modules require each other: ")
        assert "'legs' waits for 'stance', which 'planner' will handle" in record.message
        assert "'planner' waits for 'move leg', which 'legs' will handle" in record.message


def test_a_wait_goes_on_after_a_restart_of_central(central: LocalCentral, legs: Module) -> None:
    started = Started(Module("planner", central, requires=[TEMPERATURE]))
    until(lambda: "temperature" in central.core.registry.messages, "it waits")
    central.restart("second")
    with legs.running():
        until(lambda: started.module._keep_alive, "it serves")
        started.stop()
    assert started.error == []


@pytest.fixture
def told(central: LocalCentral) -> Iterator["queue.SimpleQueue[Any]"]:
    """What a module is told that listens to all notices."""
    told: queue.SimpleQueue[Any] = queue.SimpleQueue()
    guard = Module("guard", central)
    guard.handles(MODULE_JOINED)(lambda _, who: told.put(who.module))
    guard.handles(MODULE_LEFT)(lambda _, who: told.put((who.module, who.why)))
    guard.handles(HANDLERS_CHANGED)(lambda _, what: told.put((what.message, what.handlers)))
    with guard.running():
        yield told


def test_who_listens_is_told(legs: Module, told: "queue.SimpleQueue[Any]") -> None:
    with legs.running():
        pass
    assert {told.get(timeout=SOON) for _ in range(6)} == {
        "legs", ("move leg", 1), ("temperature", 1), ("move leg", 0), ("temperature", 0), ("legs", "it said goodbye"),
    }  # fmt: skip


def test_commands_that_people_type_are_not_told_of(central: LocalCentral, told: "queue.SimpleQueue[Any]") -> None:
    """Who suspends the robot when a module leaves would do so for each ``tca status``."""
    with connect("tca status", central) as first, connect("tca status", central):
        assert "tca status" in {one.name for one in first.modules()}
    with connect("operator panel", central):
        pass
    assert [told.get(timeout=SOON) for _ in range(2)] == ["operator panel", ("operator panel", "it said goodbye")]
    assert sum(isinstance(fact, ModuleLeft) and fact.module.startswith("tca status") for fact in central.facts) == 2


def test_notices_are_central_s(user: Client) -> None:
    sender: Any = user
    with pytest.raises(MisuseError, match=r"broadcast\(\) takes messages of class Broadcast, not Notice\('tca: "):
        sender.broadcast(MODULE_LEFT, Departure("legs", "a joke"))
    with pytest.raises(Refused, match="names that begin with 'tca: ' are central's own"):
        user.inform(Inform("tca: news", int), 5)
    with pytest.raises(FormatRefused, match="a inform here, a broadcast there"):
        user.inform(Inform("tca: module left", int), 5)
    user.inform(POSITION, POSITION.data.kind(1.0, 1))


# --- Shared variables ------------------------------------------------------------------------------------------------


POSE = Variable("pose", Arc)
MODE = Variable("mode", str)


def test_the_newest_value_is_there_for_all(central: LocalCentral, user: Client) -> None:
    with connect("sensor", central) as sensor:
        sensor.set_variable(POSE, Arc(1.0, 1))
        sensor.set_variable(POSE, Arc(2.0, 2))
        sensor.set_variable(POSE, Arc(3.0, 3), wait=False)
        assert sensor.get_variable(POSE) == Arc(3.0, 3)
    assert user.get_variable(POSE) == Arc(3.0, 3)


def test_a_variable_that_was_never_set(user: Client) -> None:
    with pytest.raises(VariableNotSet) as unset:
        user.get_variable(MODE)
    assert str(unset.value) == "variable 'mode' was never set: set it first, watch it, or give a default"
    assert isinstance(unset.value, LookupError)
    assert user.get_variable(MODE, None) is None
    assert user.get_variable(MODE, "idle") == "idle"
    assert user.swap_variable(MODE, "walking") is None
    assert user.swap_variable(MODE, "idle", "?") == "walking"
    assert user.get_variable(MODE) == "idle"


@pytest.mark.usefixtures("attentive")
def test_a_watcher_learns_after_a_break_what_was_set_meanwhile(central: LocalCentral, user: Client) -> None:
    view, seen = Module("view", central), queue.SimpleQueue[str]()
    view.handles(MODE)(lambda _, mode: seen.put(mode))
    with view.running():
        user.set_variable(MODE, "idle")
        assert seen.get(timeout=SOON) == "idle"
        central.cut("view")
        user.set_variable(MODE, "walking")
        while (mode := seen.get(timeout=SOON)) != "walking":
            assert mode == "idle"


def test_a_handler_sets_and_gets(central: LocalCentral, user: Client) -> None:
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
    assert [(fact.message, fact.origin) for fact in received] == [("position", 0), ("pose", 1), ("mode", 1)]


def test_what_a_break_does_to_requests() -> None:
    session = Session(headers.Hello(0, headers.PROTOCOL_VERSION, "user", "run"))
    session.receive(headers.Welcome(1, 1, "user", "epoch"), b"", 0.0)
    got = session.request(headers.GetVariable(0, "pose"), wants_answer=True)
    swapped = session.request(headers.SetVariable(0, "pose", swap=True), b"1", wants_answer=True)
    session.outgoing.clear()  # they have left
    session.break_off()
    assert not session.post(headers.SetVariable(0, "pose"), b"1")
    assert session.dropped == 1
    session.receive(headers.Welcome(1, 1, "user", "epoch"), b"", 0.0)
    for number in (2, 3):
        session.receive(headers.Refused(number, Refusal.TOO_LATE, "long ago"), b"", 0.0)
    assert not got.is_over
    assert got.header.number == 4  # asked anew
    assert swapped.lost == "the connection to central broke before the answer came"
