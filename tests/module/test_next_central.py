"""What was under way when central was restarted, and the next central gets: the session alone."""

import pytest
from module.test_session import A_GOAL, A_QUERY, HELLO, hear, said, welcome, welcomed

from tca_central.core import Central
from tca_central.events import ConnectionId, Received, Transmit
from tca_module.session.session import Session
from tca_wire.packets.headers import Ask, Inspect, Lock, Register, Reply, Send, Unknown
from tca_wire.packets.parts import HandlerFormat
from tca_wire.points import TaskId

SOMEBODY = ConnectionId(b"somebody")
STATUS, TASKS = Ask(0, "status"), Inspect(0, TaskId(0), "descendants")


@pytest.fixture
def session() -> Session:
    return welcomed(Session(HELLO))


def test_what_a_central_that_does_not_know_us_threw_away_no_other_has_got(session: Session) -> None:
    walk, stance = session.request(A_GOAL), session.request(A_QUERY, wants_answer=True)
    said(session)
    hear(session, Unknown(walk.header.number), Unknown(stance.header.number), welcome("two"))
    assert said(session) == [Send(2, "walk"), Send(3, "stance")]
    assert (walk.lost, stance.lost) == ("", "")


def test_it_is_said_again_to_the_same_central_too(session: Session) -> None:
    session.request(A_GOAL)
    said(session)
    hear(session, Unknown(2), welcome())
    assert said(session) == [Send(2, "walk")]


def test_what_was_said_twice_may_have_come_to_the_old_central(session: Session) -> None:
    walk = session.request(A_GOAL)
    said(session)
    hear(session, Unknown(), welcome())  # the line broke, and it is not known when
    assert said(session) == [Send(2, "walk")]
    hear(session, Unknown(2), welcome("two"))
    assert walk.lost == "central was restarted meanwhile and has forgotten it"


def test_unknown_that_names_no_request_tells_nothing_of_any(session: Session) -> None:
    walk = session.request(A_GOAL)
    said(session)
    hear(session, Unknown(), Unknown(77), welcome("two"))
    assert walk.lost


def test_what_names_a_task_of_the_old_central_is_lost_though_nobody_has_got_it(session: Session) -> None:
    below, lock = session.request(Send(0, "walk", parent=TaskId(3))), session.request(Lock(0, "legs", origin=3))
    said(session)
    hear(session, Unknown(2), Unknown(3), welcome("two"))
    assert below.lost
    assert lock.lost
    assert said(session) == []


def test_questions_that_change_nothing_are_asked_of_the_new_central(session: Session) -> None:
    asked = [session.request(each, wants_answer=True) for each in (STATUS, TASKS)]
    task = session.request(Inspect(0, TaskId(3), "self"), wants_answer=True)
    said(session)
    assert {request.epoch for request in asked} == {"one"}
    hear(session, Unknown(), welcome("two"))
    assert task.lost
    assert [type(header) for header in said(session)] == [Ask, Inspect]
    assert {request.epoch for request in asked} == {"two"}


def test_handlers_are_declared_by_what_renews_them_alone(session: Session) -> None:
    """Or they would come before what is attached."""
    request = session.request(Register(0, [], [HandlerFormat("walk", "legs")]))
    said(session)
    hear(session, Unknown(), welcome("two"))
    assert request.lost
    assert said(session) == []


def test_a_central_that_does_not_know_who_asks_says_what_it_has_not_done() -> None:
    core = Central("two")
    effects = [
        effect for header in (Send(7, "walk"), Reply(8)) for effect in core.handle(Received(0.0, SOMEBODY, header, b""))
    ]
    assert [effect.header for effect in effects if isinstance(effect, Transmit)] == [Unknown(7), Unknown(0)]
