"""Senders send more than the handlers handle. Messages are dropped silently, refused, or wait for
room in the queue.
"""

import threading

import pytest
from module.real_central import SOON, Gate

from tca_central.order import dispatcher
from tca_module import Broadcast, Client, Inform, Module, Refused
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Dropped
from tca_wire.vocabulary import Refusal

POSE, ALARM = Inform("pose", int), Broadcast("alarm", int)


@pytest.fixture
def gate(monkeypatch: pytest.MonkeyPatch) -> Gate:
    """Return a handler that is busy with the first pose. Its queue has room for two more."""
    monkeypatch.setattr(dispatcher, "QUEUE_LIMIT", 2)
    return Gate()


def fill(user: Client, gate: Gate) -> None:
    user.inform(POSE, 0)
    assert gate.begun.wait(SOON)
    for number in (1, 2):
        user.inform(POSE, number, wait=0)


def test_overload_is_refused_when_sender_asks(
    central: LocalCentral, legs: Module, user: Client, gate: Gate
) -> None:
    legs.handles(POSE)(gate)
    legs.handles(ALARM)(gate)
    with legs.running():
        fill(user, gate)
        user.inform(POSE, 3)
        for refused in (
            lambda: user.inform(POSE, 4, wait=0),
            lambda: user.inform(POSE, 4, wait=0.05),
            lambda: user.execute_if_handled(POSE, 5),
            lambda: user.broadcast(ALARM, 6, wait=0),
        ):
            with pytest.raises(Refused, match="2 messages wait for legs") as error:
                refused()
            assert error.value.refusal is Refusal.OVERLOAD
        gate.go_on.set()
    assert len([fact for fact in central.facts if isinstance(fact, Dropped)]) == 1
    assert user.status()["dropped"] == 1


def test_sender_waits_until_queue_has_room(
    central: LocalCentral, legs: Module, user: Client, gate: Gate
) -> None:
    handled: list[int] = []

    @legs.handles(POSE)
    def pose(_: object, number: int) -> None:
        gate()
        handled.append(number)

    with legs.running():
        fill(user, gate)
        threading.Timer(0.1, gate.go_on.set).start()
        for number in range(3, 30):
            user.inform(POSE, number, wait=SOON)
        user.broadcast(ALARM, 1, wait=0)  # the alarm has no handler
    assert handled == sorted(handled)
    assert not [
        fact for fact in central.facts if isinstance(fact, Dropped) and fact.message == "pose"
    ]
