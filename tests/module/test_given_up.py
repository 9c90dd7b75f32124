"""A task that is given up before central has said that it was taken is called back: nobody would know it."""

from typing import Any

import pytest

from tca_module import Command, Inform, PointMonitor, Query
from tca_module.session.session import Session
from tca_wire.packets.headers import (
    PROTOCOL_VERSION,
    Accepted,
    GiveUp,
    Hello,
    Kill,
    Register,
    Send,
    ToModule,
    Unknown,
    Welcome,
)
from tca_wire.points import ROOT

REST, SAY, IS_FREE = Command("rest"), Inform("say", str), Query("is the way free", reply=bool)
LOOK = PointMonitor("look", condition=IS_FREE)
A_REST = Send(0, "rest")


def hear(session: Session, *said: ToModule) -> None:
    for header in said:
        session.receive(header, b"", 1.0)


def said(session: Session) -> list[Any]:
    headers, session.outgoing = [header for header, _ in session.outgoing], []
    return headers


def callback(number: int, request: int) -> Kill:
    return Kill(number, ROOT, "its sender has given it up, and does not know it", request=request)


@pytest.fixture
def session() -> Session:
    """One that has declared a command and an inform."""
    session = Session(Hello(1, PROTOCOL_VERSION, "user", "run"))
    hear(session, Welcome(1, 1, "user", "one"))
    session.declared([REST.format, SAY.format, LOOK.format], [])
    said(session)
    return session


def test_a_task_is_killed_by_its_request(session: Session) -> None:
    session.abandon(session.request(A_REST))
    assert said(session) == [Send(2, "rest"), callback(3, 2)]
    hear(session, Accepted(2, 17), Accepted(3, 17))
    hear(session, Unknown(), Welcome(1, 1, "user", "one"))
    assert said(session) == [Register(0, [REST.format, SAY.format, LOOK.format], [])]


def test_after_a_break_that_is_repeated_and_the_task_is_not(session: Session) -> None:
    """Else the task would begin only to learn whether it had."""
    rest = session.request(A_REST)
    hear(session, Unknown())
    session.abandon(rest)
    hear(session, Welcome(1, 1, "user", "one"))
    assert said(session)[1:] == [callback(3, 2)]
    hear(session, Unknown(), Welcome(1, 1, "user", "one"))
    assert said(session)[1:] == [callback(3, 2)]


def test_a_central_that_was_restarted_has_nothing_to_call_back(session: Session) -> None:
    session.abandon(session.request(A_REST))
    hear(session, Unknown(), Welcome(1, 1, "user", "two"))
    assert said(session) == [Register(0, [REST.format, SAY.format, LOOK.format], [])]


def test_monitors_are_called_back_and_what_is_no_task_is_not(session: Session) -> None:
    session.abandon(session.request(Send(0, "look")))
    assert said(session) == [Send(2, "look"), callback(3, 2)]
    for header in (Send(0, "say", if_handled=True), Send(0, "rest", when_killed=True), Register(0, [])):
        session.abandon(session.request(header))
    assert not [header for header in said(session) if isinstance(header, Kill)]
    session.abandon(session.request(A_REST, wants_answer=True))
    assert isinstance(said(session)[-1], GiveUp)
