"""The session alone: scripted headers in, headers out."""

import pytest

from tca_central.core import Central
from tca_central.events import ConnectionId, RequestReceived, Transmit
from tca_module.session.request import Request
from tca_module.session.session import HELLO_NUMBER, QUIET, Session
from tca_wire.packets import headers
from tca_wire.packets.headers import (
    PROTOCOL_VERSION,
    Accepted,
    Answer,
    Ask,
    AwaitPoint,
    Beat,
    Cancelled,
    Closing,
    Deliver,
    GiveUp,
    Hello,
    Inspect,
    Lock,
    Refused,
    Register,
    Release,
    Reply,
    Send,
    Suspended,
    Taken,
    ToCentral,
    ToModule,
    Unknown,
    Welcome,
)
from tca_wire.packets.parts import HandlerFormat, MessageFormat
from tca_wire.points import Moment, Point, TaskId
from tca_wire.vocabulary import MessageClass, Outcome, Refusal

HELLO = Hello(HELLO_NUMBER, PROTOCOL_VERSION, "legs", "run 1")
A_GOAL = Send(0, "walk")
A_QUERY = Send(0, "stance")
A_WAIT = AwaitPoint(0, Point(TaskId(4), Moment.END_ACHIEVING))
WALK = MessageFormat("walk", MessageClass.GOAL, "{}")
HANDLES_WALK = HandlerFormat("walk", "legs")


def said(session: Session) -> list[ToCentral]:
    """What the session has to say, which then has left."""
    outgoing = [header for header, _ in session.outgoing]
    session.outgoing.clear()
    return outgoing


def hear(session: Session, *heard: ToModule, now: float = 0.0) -> None:
    for header in heard:
        session.receive(header, b"", now)


def welcome(epoch: str = "one") -> Welcome:
    return Welcome(HELLO_NUMBER, 1, "legs", epoch)


@pytest.fixture
def greeting() -> Session:
    return Session(HELLO)


def welcomed(greeting: Session) -> Session:
    """A session that central has welcomed."""
    greeting.tend(0.0, 0.0)
    assert said(greeting) == [HELLO]
    hear(greeting, welcome())
    assert said(greeting) == []
    return greeting


@pytest.fixture
def session(greeting: Session) -> Session:
    return welcomed(greeting)


# --- Hello ----------------------------------------------------------------------------------------------------------


def test_hello_is_repeated_every_second_until_the_welcome(greeting: Session) -> None:
    for now, expected in [(0.0, [HELLO]), (0.9, []), (1.0, [HELLO]), (1.5, []), (2.1, [HELLO])]:
        greeting.tend(now, 0.0)
        assert said(greeting) == expected
    hear(greeting, welcome(), now=2.2)
    greeting.tend(3.3, 0.0)
    assert said(greeting) == []
    assert (greeting.is_welcome, greeting.epoch, greeting.module) == (True, "one", "legs")


def test_nothing_but_hello_leaves_before_the_welcome(greeting: Session) -> None:
    greeting.request(A_GOAL)
    assert not greeting.post(Send(0, "position"))
    assert said(greeting) == []
    assert greeting.dropped == 1
    hear(greeting, welcome())
    assert said(greeting) == [Send(2, "walk")]


def test_central_may_refuse_the_connection(greeting: Session) -> None:
    hear(greeting, Refused(HELLO_NUMBER, Refusal.PROTOCOL, "speak protocol 2"))
    assert greeting.refused is not None
    assert not greeting.is_welcome


def test_a_second_welcome_repeats_nothing(session: Session) -> None:
    session.request(A_GOAL)
    said(session)
    hear(session, welcome())
    assert said(session) == []


# --- requests and answers -------------------------------------------------------------------------------------------


def test_requests_are_numbered_and_answers_find_them(session: Session) -> None:
    walk, stance = session.request(A_GOAL), session.request(A_QUERY, wants_answer=True)
    assert said(session) == [Send(2, "walk"), Send(3, "stance")]
    session.receive(Answer(3), b"reply", 1.0)
    assert (walk.is_over, stance.is_over) == (False, True)
    assert stance.answers[-1] == (Answer(3), b"reply")
    hear(session, Accepted(2, 17))
    assert walk.is_over
    assert walk.accepted == 17


def test_accepted_is_not_the_answer_to_a_query(session: Session) -> None:
    stance = session.request(A_QUERY, wants_answer=True)
    hear(session, Accepted(2, 17))
    assert not stance.is_over


def test_a_multi_query_is_over_with_the_answer_without_more(session: Session) -> None:
    everybody = session.request(Send(0, "status"), wants_answer=True)
    hear(session, Answer(2, more=True), Answer(2, more=True))
    assert not everybody.is_over
    hear(session, Answer(2))
    assert everybody.is_over
    assert [answer.more for answer, _ in everybody.answers] == [True, True, False]


def test_a_refusal_ends_its_request_and_others_are_complaints(session: Session) -> None:
    walk = session.request(A_GOAL)
    hear(session, Refused(2, Refusal.CYCLE, "a circle"), Refused(0, Refusal.UNKNOWN, "no such message"))
    assert walk.refused == Refused(2, Refusal.CYCLE, "a circle")
    assert session.complaints == ["central refused: no such message"]


def test_an_answer_that_nobody_waits_for_is_ignored(session: Session) -> None:
    stance = session.request(A_QUERY, wants_answer=True)
    session.abandon(stance)
    assert said(session) == [Send(2, "stance"), GiveUp(2)]
    hear(session, Answer(2), Accepted(9), Answer(77))
    assert not stance.is_over
    session.abandon(stance)
    assert said(session) == []


# --- the connection breaks --------------------------------------------------------------------------------------------


def test_after_unknown_hello_is_said_and_what_is_not_acknowledged_is_repeated_in_order(session: Session) -> None:
    done, walk, stance = session.request(A_GOAL), session.request(A_GOAL), session.request(A_QUERY, wants_answer=True)
    hear(session, Accepted(2, 5), Unknown(), Unknown())
    assert done.is_over
    assert said(session) == []
    session.tend(0.1, 0.0)
    assert said(session) == [HELLO]
    later = session.request(A_GOAL)
    assert said(session) == []
    hear(session, welcome())
    assert said(session) == [Send(3, "walk"), Send(4, "stance"), Send(5, "walk")]
    hear(session, Accepted(3, 6), Accepted(4, 7), Answer(4), Accepted(5, 8))
    assert [request.is_over for request in (walk, stance, later)] == [True, True, True]


def test_messages_and_handlers_are_declared_again_before_what_uses_them(session: Session) -> None:
    session.declared([WALK], [HANDLES_WALK])
    session.request(A_GOAL)
    hear(session, Unknown())
    session.tend(0.1, 0.0)
    said(session)
    hear(session, welcome())
    # With number 0: central takes a request whose number is lower than one it has seen for answered.
    assert said(session) == [Register(0, [WALK], [HANDLES_WALK]), Send(2, "walk")]


def test_a_wait_that_central_dropped_with_the_connection_is_made_anew(session: Session) -> None:
    wait = session.request(A_WAIT, wants_answer=True)
    said(session)
    hear(session, Unknown(), welcome())
    said(session)
    hear(session, Refused(2, Refusal.TOO_LATE, "no longer kept"))
    assert not wait.is_over
    assert said(session) == [AwaitPoint(3, A_WAIT.point)]
    hear(session, Answer(3))
    assert wait.is_over


def test_a_query_that_central_dropped_with_the_connection_is_lost(session: Session) -> None:
    stance = session.request(A_QUERY, wants_answer=True)
    said(session)
    hear(session, Unknown(), welcome())
    hear(session, Refused(2, Refusal.TOO_LATE, "no longer kept"))
    assert stance.is_over
    assert "broke" in stance.lost


def test_a_goal_that_comes_too_late_is_refused_even_if_it_was_repeated(session: Session) -> None:
    walk = session.request(A_GOAL)
    hear(session, Unknown(), welcome(), Refused(2, Refusal.TOO_LATE, "task 5 has ended"))
    assert walk.refused is not None


def test_informs_that_did_not_leave_are_counted(session: Session) -> None:
    session.post(Send(0, "position"))
    session.request(A_GOAL)
    session.break_off()
    assert session.dropped == 1
    hear(session, welcome())
    assert said(session) == [Send(2, "walk")]


def test_closing_is_reported_and_begins_anew(session: Session) -> None:
    hear(session, Closing("SIGTERM"))
    assert session.complaints == ["central ends: SIGTERM"]
    session.tend(0.0, 0.0)
    assert said(session) == [HELLO]


# --- central was restarted ----------------------------------------------------------------------------------------------


def test_another_epoch_loses_what_was_asked_and_declares_everything_again(session: Session) -> None:
    session.declared([WALK], [HANDLES_WALK])
    stance = session.request(A_QUERY, wants_answer=True)
    said(session)
    hear(session, Deliver(8, "walk", TaskId(8)), Unknown(), welcome("two"))
    assert stance.is_over
    assert "restarted" in stance.lost
    assert not session.deliveries
    assert said(session) == [Register(0, [WALK], [HANDLES_WALK])]
    session.reply(Reply(8), b"")
    assert said(session) == []
    session.request(A_GOAL)
    assert said(session) == [Send(3, "walk")]


def test_what_never_left_is_asked_of_the_new_central_if_it_can_know_what_is_meant(session: Session) -> None:
    hear(session, Unknown())
    walk, below = session.request(A_GOAL), session.request(Send(0, "walk", parent=TaskId(3)))
    wait, question = session.request(A_WAIT, wants_answer=True), session.request(Ask(0, "status"), wants_answer=True)
    hear(session, welcome("two"))
    assert [bool(request.lost) for request in (walk, below, wait, question)] == [False, True, True, False]
    assert said(session) == [Send(2, "walk"), Ask(5, "status")]


def test_what_could_not_be_sent_never_left(session: Session) -> None:
    gone = session.request(A_GOAL)
    said(session)
    walk = session.request(A_GOAL)
    session.break_off()
    hear(session, welcome("two"))
    assert [bool(request.lost) for request in (gone, walk)] == [True, False]


# --- silence --------------------------------------------------------------------------------------------------------------


def test_after_a_silence_central_is_asked_for_a_word_every_second(session: Session) -> None:
    are_you_there = Register(0, [], [])
    hear(session, Beat(), now=10.0)
    asked = []
    for tenth in range(100, 150):
        session.tend(tenth / 10, 0.0)
        if said(session) == [are_you_there]:
            asked.append(tenth / 10)
    assert asked == [10 + QUIET, 11 + QUIET, 12 + QUIET]
    hear(session, Accepted(0), now=15.0)
    session.tend(15.1, 0.0)
    assert said(session) == []


def test_silence_counts_from_when_somebody_listens(session: Session) -> None:
    hear(session, Beat(), now=10.0)
    session.tend(100.0, since=99.0)  # a handler ran for 89 seconds and read nothing
    assert said(session) == []


# --- deliveries -----------------------------------------------------------------------------------------------------------


def test_deliveries_are_set_aside_and_replied_to_once(session: Session) -> None:
    session.receive(Deliver(8, "walk", TaskId(8)), b"data", 0.0)
    assert session.deliveries.popleft() == (Deliver(8, "walk", TaskId(8)), b"data")
    session.reply(Reply(8), b"")
    session.reply(Reply(8), b"")
    assert said(session) == [Reply(8)]


def test_a_reply_is_repeated_until_another_delivery_shows_that_it_came(session: Session) -> None:
    hear(session, Deliver(8, "walk"))
    session.reply(Reply(8), b"")
    said(session)
    hear(session, Unknown(), welcome())
    assert said(session) == [Reply(8)]
    hear(session, Beat(), Unknown(), welcome())  # the beat may have been sent before the reply came
    assert said(session) == [Reply(8)]
    hear(session, Deliver(9, "walk"), Unknown(), welcome())
    assert said(session) == []


def test_a_reply_waits_while_central_is_away(session: Session) -> None:
    hear(session, Deliver(8, "walk"), Unknown())
    session.reply(Reply(8), b"")
    assert said(session) == []
    hear(session, welcome())
    assert said(session) == [Reply(8)]


def test_a_killed_task_is_cancelled_until_it_is_replied_to(session: Session) -> None:
    hear(session, Deliver(8, "walk"))
    assert not session.open_deliveries.is_cancelled(8)
    hear(session, Cancelled(8), Cancelled(99))
    assert session.open_deliveries.is_cancelled(8)


def test_a_task_that_central_has_forgotten_is_cancelled(session: Session) -> None:
    hear(session, Deliver(8, "walk"), Unknown(), welcome("two"))
    assert session.open_deliveries.is_cancelled(8)


def test_every_message_of_central_has_its_row() -> None:
    for kind in headers.ToModule.__args__:
        assert kind in Session._ON


def test_a_question_is_asked_again_like_a_wait(session: Session) -> None:
    asked = session.request(Ask(0, "status"), wants_answer=True)
    said(session)
    hear(session, Unknown(), welcome(), Refused(2, Refusal.TOO_LATE, ""), Answer(3, Outcome.DONE))
    assert asked.is_over
    assert not asked.lost


def test_a_delivery_that_is_repeated_is_handled_once(session: Session) -> None:
    deliver = headers.Deliver(7, "walk", TaskId(7))
    hear(session, deliver, deliver)
    assert len(session.deliveries) == 1
    session.deliveries.clear()
    session.reply(headers.Reply(7), b"\xc0")
    hear(session, deliver)
    assert not session.deliveries


def test_a_suspended_task_that_is_killed_is_to_end(session: Session) -> None:
    """Or a handler that holds as long as its task is suspended would never return."""
    hear(session, Deliver(7, "walk", TaskId(7)), Suspended(7, True))
    assert session.open_deliveries.is_suspended(7)
    hear(session, Cancelled(7))
    assert not session.open_deliveries.is_suspended(7)


def test_a_central_that_was_restarted_and_speaks_another_protocol_is_complained_of_once() -> None:
    session = Session(HELLO)
    session.receive(Welcome(1, PROTOCOL_VERSION, "legs", "first"), b"", 0.0)
    session.break_off()
    for _ in range(3):
        session.receive(Refused(1, Refusal.PROTOCOL, "use one version"), b"", 0.0)
    assert session.complaints == ["central was restarted, and refuses this module: use one version"]


# --- locks -----------------------------------------------------------------------------------------------------------


def granted(session: Session) -> Request:
    """A lock that the session has got."""
    lock = session.request(Lock(0, "legs"), wants_answer=True)
    hear(session, Answer(lock.header.number))
    said(session)
    return lock


def test_a_lock_that_is_taken_away_is_known_by_its_number(session: Session) -> None:
    lock, other = granted(session), granted(session)
    hear(session, Taken(lock.header.number, "unlocked"), Taken(99, "never heard of"))
    assert (lock.taken, other.taken) == ("unlocked", "")


def test_a_restarted_central_has_forgotten_what_was_locked(session: Session) -> None:
    lock = granted(session)
    hear(session, Unknown(), welcome("two"))
    assert lock.taken == "central was restarted and has forgotten it"


def test_a_lock_is_released_also_where_the_connection_breaks_and_nobody_waits(session: Session) -> None:
    lock = granted(session)
    release = session.request(Release(0, lock.header.number))
    session.abandon(release)
    said(session)
    hear(session, Unknown(), welcome())
    assert said(session) == [release.header]
    hear(session, Accepted(release.header.number, 7))
    hear(session, Unknown(), welcome())
    assert said(session) == []


# --- what the next central gets --------------------------------------------------------------------------------------


SOMEBODY = ConnectionId(b"somebody")
STATUS, TASKS = Ask(0, "status"), Inspect(0, TaskId(0), "descendants")


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
    questions = STATUS, TASKS, headers.WaitUntilHandled(0, ["walk"]), headers.GetVariable(0, "pose")
    asked = [session.request(each, wants_answer=True) for each in questions]
    others = Inspect(0, TaskId(3), "self"), headers.SetVariable(0, "pose", swap=True)
    lost = [session.request(each, wants_answer=True) for each in others]
    said(session)
    assert {request.epoch for request in asked} == {"one"}
    hear(session, Unknown(), welcome("two"))
    assert all(request.lost for request in lost)
    assert [type(header) for header in said(session)] == [type(each) for each in questions]
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
        effect
        for header in (Send(7, "walk"), Reply(8))
        for effect in core.handle(RequestReceived(0.0, SOMEBODY, header, b""))
    ]
    assert [effect.header for effect in effects if isinstance(effect, Transmit)] == [Unknown(7), Unknown(0)]
