"""The session alone: its declarations after a restart of central, and its kills of tasks that were
given up.
"""

import pytest
from module.scripted_session import A_GOAL, HANDLES_WALK, HELLO, WALK, pop_headers, receive, welcome

from tca_module import Command, Inform, PointMonitor, Query
from tca_module.session import given_up
from tca_module.session.epoch_numbers import EpochNumber, with_epoch
from tca_module.session.lasting_attachments import LastingAttachment, LastingAttachments
from tca_module.session.redeclaration import LOGGED_AFTER, RETRY_AFTER
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
    """Return a session that has a handler, a wiretap 10 and an exception handler 11."""
    session = Session(HELLO)
    receive(session, welcome("one"))
    session.add_declared([WALK, CHECK], [HANDLES_WALK])
    for header, number in ((tap(), 10), (attach(), 11)):
        receive(session, Accepted(session.request(header).header.number, number))
    pop_headers(session)
    return session


def lasting_attachment(session: Session, header: Tap | Attach) -> LastingAttachment:
    found = session.attachments.find(header)
    assert found is not None
    return found


def known_number(session: Session, header: Tap | Attach) -> tuple[str, int]:
    number = lasting_attachment(session, header).number
    return number.epoch, int(number)


def restart(session: Session, epoch: str) -> list[object]:
    receive(session, Unknown(), welcome(epoch))
    return [*pop_headers(session)]


def test_handlers_are_declared_after_attachments_are_accepted(session: Session) -> None:
    assert restart(session, "two") == [Register(4, [WALK, CHECK], []), tap(5), attach(6)]
    receive(session, Accepted(4), Accepted(5, 1))
    assert pop_headers(session) == []
    receive(session, Accepted(6, 2))
    assert pop_headers(session) == [HANDLERS]
    assert known_number(session, tap()) == ("two", 1)
    assert known_number(session, attach()) == ("two", 2)
    assert session.complaints == [
        "central was restarted: exception handlers and wiretaps attached again: 2"
    ]


def test_readiness_is_declared_again_after_attachments(session: Session) -> None:
    session.add_declared([], [], is_ready=True)
    assert restart(session, "one") == [Register(0, [WALK, CHECK], [HANDLES_WALK], is_ready=True)]
    assert restart(session, "two") == [Register(4, [WALK, CHECK], []), tap(5), attach(6)]
    receive(session, Accepted(4), Accepted(5, 1), Accepted(6, 2))
    assert pop_headers(session) == [Register(0, [], [HANDLES_WALK], is_ready=True)]


def test_wiretap_until_end_of_forgotten_task_is_lost(
    session: Session,
) -> None:
    until = Point(TaskId(7), Moment.END_ACHIEVING)
    guard = Tap(
        0, Condition.WHILE_ACHIEVING, "check", "walk", watch=WatchOptions(period=1, until=until)
    )
    receive(session, Accepted(session.request(guard).header.number, 12))
    pop_headers(session)
    assert [type(header) for header in restart(session, "two")] == [Register, Tap, Attach]
    (complaint,) = session.complaints
    assert complaint.startswith(
        "the wiretap 'while achieving' of 'walk' with 'check' is lost: central was restarted"
    )
    assert complaint.endswith(
        "has forgotten its tree, so it can't watch until end achieving task 7"
    )
    receive(session, Accepted(5), Accepted(6, 1), Accepted(7, 2))
    assert pop_headers(session) == [HANDLERS]
    assert session.attachments.find(guard) is None


def test_repeated_hello_answered_by_new_central_shows_restart(
    session: Session,
) -> None:
    walk = session.request(A_GOAL)
    receive(session, Accepted(walk.header.number, 7))
    under = session.request(Send(0, "walk", parent=TaskId(7)))
    pop_headers(session)
    receive(session, welcome("two"))
    assert under.why_lost
    assert [type(header) for header in pop_headers(session)] == [Register, Tap, Attach]
    assert walk.accepted is not None
    assert (walk.accepted, walk.accepted.epoch) == (
        7,
        "one",
    )  # the number that the first central gave


def test_variable_of_forgotten_handler_is_not_set(session: Session) -> None:
    receive(session, Unknown())
    mine, handlers = (
        SetVariable(0, "level", origin) for origin in (0, with_epoch(8, "one", "'walk'"))
    )
    kept, lost = session.request(mine), session.request(handlers)
    receive(session, welcome("two"))
    assert not kept.why_lost
    assert (lost.why_lost, lost.forgotten_subject) == (
        "central was restarted and has forgotten its tree",
        "'walk'",
    )


def test_earlier_request_follows_reattachment(session: Session) -> None:
    receive(session, Unknown())
    walk = session.request(A_GOAL)
    receive(session, welcome("two"))
    assert [type(header) for header in pop_headers(session)] == [Register, Tap, Attach, Send]
    receive(session, Accepted(walk.header.number, 5))
    assert walk.accepted == 5


def test_break_repeats_unanswered_attachments_and_holds_handlers(
    session: Session,
) -> None:
    restart(session, "two")
    receive(session, Accepted(5, 1))
    assert restart(session, "two") == [
        Register(0, [WALK, CHECK], []),
        Register(4, [WALK, CHECK], []),
        attach(6),
    ]
    receive(session, Accepted(4), Accepted(6, 2))
    assert pop_headers(session) == [HANDLERS]


def test_second_restart_repeats_all_attachments(session: Session) -> None:
    restart(session, "two")
    receive(session, Accepted(4), Accepted(5, 1))
    assert restart(session, "three") == [Register(7, [WALK, CHECK], []), tap(8), attach(9)]
    receive(session, Accepted(7), Accepted(8, 3), Accepted(9, 4))
    assert pop_headers(session) == [HANDLERS]
    assert known_number(session, tap()) == ("three", 3)


def test_attachment_removed_during_reattachment_is_removed(session: Session) -> None:
    restart(session, "two")
    session.attachments.forget(lasting_attachment(session, tap()), "two")
    receive(session, Accepted(4), Accepted(5, 1), Accepted(6, 2))
    assert pop_headers(session) == [Remove(7, 1), HANDLERS]


def test_removal_by_stale_connection_is_carried_out(
    session: Session,
) -> None:
    slot = Session(Hello(1, PROTOCOL_VERSION, "legs", "run 1", connection=1), session.attachments)
    restart(session, "two")
    receive(session, Accepted(4), Accepted(5, 1), Accepted(6, 2))
    pop_headers(session)
    slot.attachments.forget(lasting_attachment(session, tap()), "one")
    session.send_due(0.0, 0.0)
    session.send_due(0.1, 0.0)
    assert pop_headers(session) == [Remove(7, 1)]


def test_first_connection_reattaches_for_all(session: Session) -> None:
    slot = Session(Hello(1, PROTOCOL_VERSION, "legs", "run 1", connection=1), session.attachments)
    receive(slot, welcome("one"))
    receive(
        slot,
        Accepted(slot.request(Tap(0, Condition.AFTER_HANDLED, "check", "walk")).header.number, 12),
    )
    pop_headers(slot)
    assert restart(slot, "two") == []
    assert [type(header) for header in restart(session, "two")] == [Register, Tap, Attach, Tap]


def test_refused_attachment_is_retried(session: Session) -> None:
    restart(session, "two")
    receive(
        session, Accepted(4), Accepted(5, 1), Refused(6, Refusal.OVERLOAD, "there are 1000 already")
    )
    assert pop_headers(session) == []
    assert (
        "refuses the exception handler 'recover' of all 'walk': there are 1000 already"
        in session.complaints[0]
    )
    for now, expected in [
        (1.0, []),
        (1.0 + RETRY_AFTER / 2, []),
        (1.0 + RETRY_AFTER, [Register(7, [WALK, CHECK], []), attach(8)]),
    ]:
        session.heard = now
        session.send_due(now, now)
        assert pop_headers(session) == expected
    receive(session, Accepted(7), Refused(8, Refusal.OVERLOAD, "there are 1000 already"))
    for session.heard in (2.0 + RETRY_AFTER, 2.0 + 2 * RETRY_AFTER):
        session.send_due(session.heard, session.heard)
    assert pop_headers(session) == [Register(9, [WALK, CHECK], []), attach(10)]
    assert len(session.complaints) == 1
    receive(session, Accepted(9), Accepted(10, 2))
    assert pop_headers(session) == [HANDLERS]


def test_requirements_are_awaited_after_reattachment(session: Session) -> None:
    session.redeclaration.required = ["check"]
    restart(session, "two")
    receive(session, Accepted(4), Accepted(5, 1), Accepted(6, 2))
    assert pop_headers(session) == [Wait(7, ["check"])]
    for now in (1.0, 1.0 + LOGGED_AFTER, 2.0 + LOGGED_AFTER):
        session.heard = now
        session.send_due(now, now)
    assert session.complaints == [
        "waits for handlers of 'check', which it requires; see 'tca messages'"
    ]
    receive(session, Answer(7))
    assert pop_headers(session) == [HANDLERS]


def test_leaving_module_reattaches_nothing(session: Session) -> None:
    session.forget_handlers()
    assert restart(session, "two") == [Register(0, [WALK, CHECK], [])]


def test_repeated_wiretap_keeps_place_repeated_handler_is_newest() -> None:
    attachments, other = LastingAttachments(), Attach(0, Attachment("", "recover", 0), ROOT)
    given: list[Tap | Attach] = [tap(), attach(), other, tap(), attach()]
    for number, header in enumerate(given):
        attachments.add(header, {}, EpochNumber(number, "one"))
    assert [one.header for one in attachments.unknown_to("two")] == [tap(), other, attach()]
    assert [one.number for one in attachments.unknown_to("two")] == [3, 2, 4]
    assert attachments.unknown_to("one") == []


# --- A task that is given up before central has accepted it is killed -----------------------------


REST, SAY, IS_FREE = Command("rest"), Inform("say", str), Query("is the way free", reply=bool)
LOOK = PointMonitor("look", condition=IS_FREE)
A_REST = Send(0, "rest")


def kill_of_request(number: int, request: int) -> Kill:
    return Kill(number, TaskId(-request), "its sender has given up waiting for its id")


@pytest.fixture
def user_session() -> Session:
    """Return a session that has declared a command, an inform and a monitor."""
    session = Session(Hello(1, PROTOCOL_VERSION, "user", "run"))
    receive(session, Welcome(1, 1, "user", "one"))
    session.add_declared([REST.format, SAY.format, LOOK.format], [])
    pop_headers(session)
    return session


def test_given_up_task_is_killed_by_request_number(user_session: Session) -> None:
    given_up.abandon(user_session, user_session.request(A_REST))
    assert pop_headers(user_session) == [Send(2, "rest"), kill_of_request(3, 2)]
    receive(user_session, Accepted(2, 17), Accepted(3, 17))
    receive(user_session, Unknown(), Welcome(1, 1, "user", "one"))
    assert pop_headers(user_session) == [Register(0, [REST.format, SAY.format, LOOK.format], [])]


def test_break_repeats_kill_but_not_given_up_task(user_session: Session) -> None:
    """If the session repeated the task, too, it would start only to be killed."""
    rest = user_session.request(A_REST)
    receive(user_session, Unknown())
    given_up.abandon(user_session, rest)
    receive(user_session, Welcome(1, 1, "user", "one"))
    assert pop_headers(user_session)[1:] == [kill_of_request(3, 2)]
    receive(user_session, Unknown(), Welcome(1, 1, "user", "one"))
    assert pop_headers(user_session)[1:] == [kill_of_request(3, 2)]


def test_restarted_central_is_sent_no_kill(user_session: Session) -> None:
    given_up.abandon(user_session, user_session.request(A_REST))
    receive(user_session, Unknown(), Welcome(1, 1, "user", "two"))
    assert pop_headers(user_session) == [Register(0, [REST.format, SAY.format, LOOK.format], [])]


def test_given_up_monitor_is_killed_and_non_tasks_are_not(user_session: Session) -> None:
    given_up.abandon(user_session, user_session.request(Send(0, "look")))
    assert pop_headers(user_session) == [Send(2, "look"), kill_of_request(3, 2)]
    for header in (
        Send(0, "say", if_handled=True),
        Send(0, "rest", when_killed=True),
        Register(0, []),
    ):
        given_up.abandon(user_session, user_session.request(header))
    assert not [header for header in pop_headers(user_session) if isinstance(header, Kill)]
    given_up.abandon(user_session, user_session.request(A_REST, wants_answer=True))
    assert isinstance(pop_headers(user_session)[-1], GiveUp)
