"""Sending whatever the class of a message is, and only if somebody handles it."""

from typing import Any

import pytest
from module.gait_messages import ALARM, HEALTH, MOVE_LEG, POSITION, REST, STANCE, TEMPERATURE, WALK, Arc, Footfall

from tca_module import Client, Module, Outcome, SentTask
from tca_module.session.session import Session
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Received
from tca_wire.packets import headers

SOON = 5.0


@pytest.fixture
def legs(central: LocalCentral) -> Module:
    """Handles a message of each class."""
    legs, told = Module("legs", central), list[Any]()
    legs.handles(REST)(lambda _: None)
    legs.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.5))
    legs.handles(STANCE)(lambda _, radius: [int(radius)])
    legs.handles(HEALTH)(lambda _: "well")
    legs.handles(POSITION)(lambda _, arc: told.append(arc))
    legs.handles(ALARM)(lambda _, text: told.append(text))
    return legs


@pytest.mark.parametrize("call", ["execute", "execute_if_handled"])
def test_each_class_is_sent_in_its_way(legs: Module, user: Client, call: str) -> None:
    with legs.running():
        execute: Any = getattr(user, call)
        goal, command = execute(REST), execute(MOVE_LEG, 3)
        assert isinstance(goal, SentTask)
        assert goal.wait(SOON) is Outcome.DONE
        assert command.result(SOON) == Footfall(3, 0.5)
        assert execute(STANCE, 4.0) == [4]
        assert execute(HEALTH) == ["well"]
        was_sent = None if call == "execute" else True
        assert execute(POSITION, Arc(1.0, 2)) is was_sent
        assert execute(ALARM, "stop") is was_sent


def test_what_nobody_handles_is_not_sent(user: Client, central: LocalCentral) -> None:
    assert user.execute_if_handled(WALK, Arc(1.0, 2)) is None
    assert user.execute_if_handled(MOVE_LEG, 1) is None
    assert user.execute_if_handled(TEMPERATURE) is None
    assert user.execute_if_handled(HEALTH) is None
    assert user.execute_if_handled(POSITION, Arc(1.0, 2)) is False
    assert user.execute_if_handled(ALARM, "stop") is False
    assert [fact for fact in central.facts if isinstance(fact, Received)] == []
    assert user.goal(REST).id == 1  # the order of siblings knows nothing of them


def test_a_repeated_query_that_is_open_has_its_answer_to_come() -> None:
    session = Session(headers.Hello(0, headers.PROTOCOL_VERSION, "user", "run"))
    session.receive(headers.Welcome(1, 1, "user", "epoch"), b"", 0.0)
    open_query = session.request(headers.Send(0, "where"), wants_answer=True)
    not_sent = session.request(headers.Send(0, "where", if_handled=True), wants_answer=True)
    session.receive(headers.Accepted(2, 7), b"", 0.0)
    session.receive(headers.Accepted(3), b"", 0.0)
    assert (open_query.is_over, open_query.accepted) == (False, None)
    assert (not_sent.is_over, not_sent.accepted) == (True, 0)
