"""The session alone: what is said after a restart of central, and what is called back."""

import pytest
from module.test_session import A_GOAL, HANDLES_WALK, HELLO, WALK, hear, said, welcome

from tca_module import Command, Inform, PointMonitor, Query
from tca_module.session import given_up
from tca_module.session.epoch_numbers import EpochNumber, with_epoch
from tca_module.session.lasting_attachments import LastingAttachment, LastingAttachments
from tca_module.session.redeclaration import AGAIN, PATIENCE
from tca_module.session.session import Session
from tca_wire.packets.headers import (
    PROTOCOL_VERSION,
    Accepted,
    Answer,
    Attach,
    GiveUp,
    Hello,
    Kill,
    Refused,
    Register,
    Remove,
    Send,
    SetVariable,
    Tap,
    Unknown,
    Welcome,
)
from tca_wire.packets.headers import WaitUntilHandled as Wait
from tca_wire.packets.parts import Attachment, MessageFormat, WatchOptions
from tca_wire.points import ROOT, Moment, Point, TaskId
from tca_wire.vocabulary import Condition, MessageClass, Refusal

CHECK = MessageFormat("check", MessageClass.COMMAND, "{}")
HANDLERS = Register(0, [], [HANDLES_WALK])


def tap(number: int = 0) -> Tap:
    return Tap(number, Condition.BEFORE_HANDLING, "check", "walk")


def attach(number: int = 0) -> Attach:
    return Attach(number, Attachment("slip", "recover", 0), ROOT, "walk")


@pytest.fixture
def session() -> Session:
    """A session that has a handler, a wiretap 10 and an exception handler 11."""
    session = Session(HELLO)
    hear(session, welcome("one"))
    session.add_declared([WALK, CHECK], [HANDLES_WALK])
    for header, number in ((tap(), 10), (attach(), 11)):
        hear(session, Accepted(session.request(header).header.number, number))
    said(session)
    return session


def standing(session: Session, header: Tap | Attach) -> LastingAttachment:
    found = session.attachments.find(header)
    assert found is not None
    return found


def known_as(session: Session, header: Tap | Attach) -> tuple[str, int]:
    number = standing(session, header).number
    return number.epoch, int(number)


def restart(session: Session, epoch: str) -> list[object]:
    hear(session, Unknown(), welcome(epoch))
    return [*said(session)]


def test_handlers_come_after_all_that_was_attached_is_accepted(session: Session) -> None:
    assert restart(session, "two") == [Register(4, [WALK, CHECK], []), tap(5), attach(6)]
    hear(session, Accepted(4), Accepted(5, 1))
    assert said(session) == []
    hear(session, Accepted(6, 2))
    assert said(session) == [HANDLERS]
    assert known_as(session, tap()) == ("two", 1)
    assert known_as(session, attach()) == ("two", 2)
    assert session.complaints == [
        "central was restarted: exception handlers and wiretaps attached again: 2"
    ]


def test_central_is_told_again_that_all_is_attached(session: Session) -> None:
    session.add_declared([], [], is_ready=True)
    assert restart(session, "one") == [Register(0, [WALK, CHECK], [HANDLES_WALK], is_ready=True)]
    assert restart(session, "two") == [Register(4, [WALK, CHECK], []), tap(5), attach(6)]
    hear(session, Accepted(4), Accepted(5, 1), Accepted(6, 2))
    assert said(session) == [Register(0, [], [HANDLES_WALK], is_ready=True)]


def test_what_was_to_watch_until_a_forgotten_task_ends_is_not_attached_anew(
    session: Session,
) -> None:
    until = Point(TaskId(7), Moment.END_ACHIEVING)
    guard = Tap(
        0, Condition.WHILE_ACHIEVING, "check", "walk", watch=WatchOptions(period=1, until=until)
    )
    hear(session, Accepted(session.request(guard).header.number, 12))
    said(session)
    assert [type(header) for header in restart(session, "two")] == [Register, Tap, Attach]
    (complaint,) = session.complaints
    assert complaint.startswith(
        "the wiretap 'while achieving' of 'walk' with 'check' is lost: central was restarted"
    )
    assert complaint.endswith(
        "has forgotten its tree, so it can't watch until end achieving task 7"
    )
    hear(session, Accepted(5), Accepted(6, 1), Accepted(7, 2))
    assert said(session) == [HANDLERS]
    assert session.attachments.find(guard) is None


def test_a_second_hello_that_only_the_next_central_heard_tells_of_the_restart(
    session: Session,
) -> None:
    walk = session.request(A_GOAL)
    hear(session, Accepted(walk.header.number, 7))
    under = session.request(Send(0, "walk", parent=TaskId(7)))
    said(session)
    hear(session, welcome("two"))
    assert under.lost
    assert [type(header) for header in said(session)] == [Register, Tap, Attach]
    assert walk.accepted is not None
    assert (walk.accepted, walk.accepted.epoch) == (
        7,
        "one",
    )  # its own, whatever is heard before it is looked at


def test_a_variable_of_a_forgotten_handler_is_not_set_for_another(session: Session) -> None:
    hear(session, Unknown())
    mine, handlers = (
        SetVariable(0, "level", origin) for origin in (0, with_epoch(8, "one", "'walk'"))
    )
    kept, lost = session.request(mine), session.request(handlers)
    hear(session, welcome("two"))
    assert not kept.lost
    assert (lost.lost, lost.forgotten_subject) == (
        "central was restarted and has forgotten its tree",
        "'walk'",
    )


def test_what_was_asked_before_comes_after_it(session: Session) -> None:
    hear(session, Unknown())
    walk = session.request(A_GOAL)
    hear(session, welcome("two"))
    assert [type(header) for header in said(session)] == [Register, Tap, Attach, Send]
    hear(session, Accepted(walk.header.number, 5))
    assert walk.accepted == 5


def test_a_break_repeats_what_is_not_answered_and_still_holds_the_handlers_back(
    session: Session,
) -> None:
    restart(session, "two")
    hear(session, Accepted(5, 1))
    assert restart(session, "two") == [
        Register(0, [WALK, CHECK], []),
        Register(4, [WALK, CHECK], []),
        attach(6),
    ]
    hear(session, Accepted(4), Accepted(6, 2))
    assert said(session) == [HANDLERS]


def test_a_second_restart_begins_from_the_start(session: Session) -> None:
    restart(session, "two")
    hear(session, Accepted(4), Accepted(5, 1))
    assert restart(session, "three") == [Register(7, [WALK, CHECK], []), tap(8), attach(9)]
    hear(session, Accepted(7), Accepted(8, 3), Accepted(9, 4))
    assert said(session) == [HANDLERS]
    assert known_as(session, tap()) == ("three", 3)


def test_what_is_removed_while_it_is_attached_anew_is_taken_away_again(session: Session) -> None:
    restart(session, "two")
    session.attachments.forget(standing(session, tap()), "two")
    hear(session, Accepted(4), Accepted(5, 1), Accepted(6, 2))
    assert said(session) == [Remove(7, 1), HANDLERS]


def test_what_a_connection_removes_that_has_not_heard_of_the_restart_is_taken_away(
    session: Session,
) -> None:
    slot = Session(Hello(1, PROTOCOL_VERSION, "legs", "run 1", connection=1), session.attachments)
    restart(session, "two")
    hear(session, Accepted(4), Accepted(5, 1), Accepted(6, 2))
    said(session)
    slot.attachments.forget(standing(session, tap()), "one")
    session.send_due(0.0, 0.0)
    session.send_due(0.1, 0.0)
    assert said(session) == [Remove(7, 1)]


def test_the_first_connection_attaches_for_all(session: Session) -> None:
    slot = Session(Hello(1, PROTOCOL_VERSION, "legs", "run 1", connection=1), session.attachments)
    hear(slot, welcome("one"))
    hear(
        slot,
        Accepted(slot.request(Tap(0, Condition.AFTER_HANDLED, "check", "walk")).header.number, 12),
    )
    said(slot)
    assert restart(slot, "two") == []
    assert [type(header) for header in restart(session, "two")] == [Register, Tap, Attach, Tap]


def test_what_is_refused_is_tried_again_with_all_after_it(session: Session) -> None:
    restart(session, "two")
    hear(
        session, Accepted(4), Accepted(5, 1), Refused(6, Refusal.OVERLOAD, "there are 1000 already")
    )
    assert said(session) == []
    assert (
        "refuses the exception handler 'recover' of all 'walk': there are 1000 already"
        in session.complaints[0]
    )
    for now, expected in [
        (1.0, []),
        (1.0 + AGAIN / 2, []),
        (1.0 + AGAIN, [Register(7, [WALK, CHECK], []), attach(8)]),
    ]:
        session.heard = now
        session.send_due(now, now)
        assert said(session) == expected
    hear(session, Accepted(7), Refused(8, Refusal.OVERLOAD, "there are 1000 already"))
    for session.heard in (2.0 + AGAIN, 2.0 + 2 * AGAIN):
        session.send_due(session.heard, session.heard)
    assert said(session) == [Register(9, [WALK, CHECK], []), attach(10)]
    assert len(session.complaints) == 1
    hear(session, Accepted(9), Accepted(10, 2))
    assert said(session) == [HANDLERS]


def test_what_is_required_is_waited_for_when_all_is_attached(session: Session) -> None:
    session.redeclaration.required = ["check"]
    restart(session, "two")
    hear(session, Accepted(4), Accepted(5, 1), Accepted(6, 2))
    assert said(session) == [Wait(7, ["check"])]
    for now in (1.0, 1.0 + PATIENCE, 2.0 + PATIENCE):
        session.heard = now
        session.send_due(now, now)
    assert session.complaints == [
        "waits for handlers of 'check', which it requires; see 'tca messages'"
    ]
    hear(session, Answer(7))
    assert said(session) == [HANDLERS]


def test_who_leaves_attaches_nothing_anew(session: Session) -> None:
    session.forget_handlers()
    assert restart(session, "two") == [Register(0, [WALK, CHECK], [])]


def test_the_same_wiretap_keeps_its_place_and_an_exception_handler_becomes_the_newest() -> None:
    attachments, other = LastingAttachments(), Attach(0, Attachment("", "recover", 0), ROOT)
    given: list[Tap | Attach] = [tap(), attach(), other, tap(), attach()]
    for number, header in enumerate(given):
        attachments.add(header, {}, EpochNumber(number, "one"))
    assert [one.header for one in attachments.unknown_to("two")] == [tap(), other, attach()]
    assert [one.number for one in attachments.unknown_to("two")] == [3, 2, 4]
    assert attachments.unknown_to("one") == []


# --- A task that is given up before central has said that it was taken is called back -------------


REST, SAY, IS_FREE = Command("rest"), Inform("say", str), Query("is the way free", reply=bool)
LOOK = PointMonitor("look", condition=IS_FREE)
A_REST = Send(0, "rest")


def callback(number: int, request: int) -> Kill:
    return Kill(number, TaskId(-request), "its sender has given up waiting for its id")


@pytest.fixture
def declared() -> Session:
    """One that has declared a command and an inform."""
    session = Session(Hello(1, PROTOCOL_VERSION, "user", "run"))
    hear(session, Welcome(1, 1, "user", "one"))
    session.add_declared([REST.format, SAY.format, LOOK.format], [])
    said(session)
    return session


def test_a_task_is_killed_by_its_request(declared: Session) -> None:
    given_up.abandon(declared, declared.request(A_REST))
    assert said(declared) == [Send(2, "rest"), callback(3, 2)]
    hear(declared, Accepted(2, 17), Accepted(3, 17))
    hear(declared, Unknown(), Welcome(1, 1, "user", "one"))
    assert said(declared) == [Register(0, [REST.format, SAY.format, LOOK.format], [])]


def test_after_a_break_that_is_repeated_and_the_task_is_not(declared: Session) -> None:
    """Else the task would begin only to learn whether it had."""
    rest = declared.request(A_REST)
    hear(declared, Unknown())
    given_up.abandon(declared, rest)
    hear(declared, Welcome(1, 1, "user", "one"))
    assert said(declared)[1:] == [callback(3, 2)]
    hear(declared, Unknown(), Welcome(1, 1, "user", "one"))
    assert said(declared)[1:] == [callback(3, 2)]


def test_a_central_that_was_restarted_has_nothing_to_call_back(declared: Session) -> None:
    given_up.abandon(declared, declared.request(A_REST))
    hear(declared, Unknown(), Welcome(1, 1, "user", "two"))
    assert said(declared) == [Register(0, [REST.format, SAY.format, LOOK.format], [])]


def test_monitors_are_called_back_and_what_is_no_task_is_not(declared: Session) -> None:
    given_up.abandon(declared, declared.request(Send(0, "look")))
    assert said(declared) == [Send(2, "look"), callback(3, 2)]
    for header in (
        Send(0, "say", if_handled=True),
        Send(0, "rest", when_killed=True),
        Register(0, []),
    ):
        given_up.abandon(declared, declared.request(header))
    assert not [header for header in said(declared) if isinstance(header, Kill)]
    given_up.abandon(declared, declared.request(A_REST, wants_answer=True))
    assert isinstance(said(declared)[-1], GiveUp)
