"""Shared variables: set, got, exchanged and watched."""

import queue
import threading

import pytest
from module.gait_messages import POSITION, Arc

from tca_module import Client, Module, Task, Variable, VariableNotSet, connect
from tca_module.session.session import Session
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Received
from tca_wire.packets import headers
from tca_wire.vocabulary import Refusal

SOON = 5.0

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
