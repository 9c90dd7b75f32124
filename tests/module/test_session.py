"""The session alone. Tests hand it scripted headers, and compare the headers that it sends."""

import msgspec
import pytest
from module.scripted_session import (
    A_GOAL,
    HANDLES_WALK,
    HELLO,
    WALK,
    pop_headers,
    receive,
    send_requests,
    welcome,
)

from tca_central.core import Central
from tca_central.events import ConnectionId, ConnectionLost, RequestReceived, Transmit
from tca_module.session import given_up
from tca_module.session.request import Request
from tca_module.session.session import _ON, CONFIRM_EVERY, QUIET, Session
from tca_wire.packets import headers
from tca_wire.packets.changes import Observe
from tca_wire.packets.headers import (
    Accepted,
    Answer,
    Ask,
    AwaitPoint,
    Beat,
    Cancelled,
    Closing,
    Deliver,
    GetVariable,
    GiveUp,
    Inspect,
    Lock,
    Refused,
    Register,
    Release,
    Reply,
    Send,
    SetVariable,
    Suspended,
    Taken,
    ToCentral,
    Unknown,
    WaitUntilHandled,
)
from tca_wire.points import Moment, Point, TaskId
from tca_wire.vocabulary import Refusal

A_QUERY = Send(0, "stance")
A_WAIT = AwaitPoint(0, Point(TaskId(4), Moment.END_ACHIEVING))
STATUS, SWAP = Ask(0, "status"), SetVariable(0, "pose", swap=True)
FORGOTTEN = "central was restarted and has forgotten it"
TOO_LATE = Refused(2, Refusal.TOO_LATE, "no longer kept")


@pytest.fixture
def greeting() -> Session:
    return Session(HELLO)


@pytest.fixture
def session(greeting: Session) -> Session:
    """Return a session that central has welcomed."""
    greeting.send_due(0.0, 0.0)
    assert pop_headers(greeting) == [HELLO]
    receive(greeting, welcome())
    assert pop_headers(greeting) == []
    return greeting


def test_session_handles_every_header_of_central() -> None:
    for kind in headers.ToModule.__args__:
        assert kind in _ON


# --- Hello ----------------------------------------------------------------------------------------


def test_hello_is_repeated_every_second_until_welcome(greeting: Session) -> None:
    for now, expected in [(0.0, [HELLO]), (0.9, []), (1.0, [HELLO]), (1.5, []), (2.1, [HELLO])]:
        greeting.send_due(now, 0.0)
        assert pop_headers(greeting) == expected
    receive(greeting, welcome(), now=2.2)
    greeting.send_due(3.3, 0.0)
    assert pop_headers(greeting) == []
    assert (greeting.is_welcome, greeting.epoch, greeting.module) == (True, "one", "legs")


def test_only_hello_leaves_before_welcome(
    greeting: Session,
) -> None:
    greeting.request(A_GOAL)
    assert not greeting.post(Send(0, "position"))
    assert pop_headers(greeting) == []
    assert greeting.dropped == 1
    receive(greeting, welcome())
    assert pop_headers(greeting) == [Send(2, "walk")]
    receive(greeting, welcome())
    assert pop_headers(greeting) == []


def test_other_protocol_of_restarted_central_is_reported_once(
    session: Session,
) -> None:
    session.break_off()
    receive(session, *[Refused(1, Refusal.PROTOCOL, "use one version")] * 3)
    assert session.complaints == ["central refuses this module: use one version"]


# --- Requests and answers -------------------------------------------------------------------------


def test_answers_are_matched_to_requests_by_number(session: Session) -> None:
    walk, stance = session.request(A_GOAL), session.request(A_QUERY, wants_answer=True)
    assert pop_headers(session) == [Send(2, "walk"), Send(3, "stance")]
    receive(session, Accepted(3, 17))  # the acknowledgement is not the answer
    assert not stance.is_over
    session.receive(Answer(3), b"reply", 1.0)
    assert (walk.is_over, stance.is_over) == (False, True)
    assert stance.answers[-1] == (Answer(3), b"reply")
    receive(session, Accepted(2, 17))
    assert (walk.is_over, walk.accepted) == (True, 17)


def test_unsent_query_and_final_answer_end_their_requests(
    session: Session,
) -> None:
    not_sent, everybody = send_requests(
        session, Send(0, "where", if_handled=True), Send(0, "status")
    )
    receive(session, Accepted(2), Answer(3, more=True), Answer(3, more=True))
    assert (not_sent.is_over, not_sent.accepted, everybody.is_over) == (True, 0, False)
    receive(session, Answer(3))
    assert everybody.is_over
    assert [answer.more for answer, _ in everybody.answers] == [True, True, False]


def test_refusal_ends_its_request_or_becomes_complaint(session: Session) -> None:
    walk = session.request(A_GOAL)
    receive(
        session,
        Refused(2, Refusal.CYCLE, "a circle"),
        Refused(0, Refusal.UNKNOWN, "no such message"),
    )
    assert walk.refused == Refused(2, Refusal.CYCLE, "a circle")
    assert session.complaints == ["central refused: no such message"]


def test_answer_to_abandoned_request_is_ignored(session: Session) -> None:
    (stance,) = send_requests(session, A_QUERY)
    given_up.abandon(session, stance)
    assert pop_headers(session) == [GiveUp(2, 3)]
    receive(session, Answer(2), Accepted(9), Answer(77))
    assert not stance.is_over
    given_up.abandon(session, stance)
    assert pop_headers(session) == []


# --- The connection breaks ------------------------------------------------------------------------


def test_unknown_triggers_hello_and_ordered_repetition(
    session: Session,
) -> None:
    done, walk, stance = (
        session.request(A_GOAL),
        session.request(A_GOAL),
        session.request(A_QUERY, wants_answer=True),
    )
    receive(session, Accepted(2, 5), Unknown(), Unknown())
    assert done.is_over
    assert pop_headers(session) == []
    session.send_due(0.1, 0.0)
    assert pop_headers(session) == [HELLO]
    later = session.request(A_GOAL)
    assert pop_headers(session) == []
    receive(session, welcome())
    assert pop_headers(session) == [Send(3, "walk"), Send(4, "stance"), Send(5, "walk")]
    receive(session, Accepted(3, 6), Accepted(4, 7), Answer(4), Accepted(5, 8))
    assert [request.is_over for request in (walk, stance, later)] == [True, True, True]


def test_declarations_precede_repeated_requests(session: Session) -> None:
    session.add_declared([WALK], [HANDLES_WALK])
    send_requests(session, A_GOAL, wants_answer=False)
    receive(session, Unknown(), welcome())
    # The number is 0: central would regard a request with a lower number than
    # one it has seen as answered.
    assert pop_headers(session) == [Register(0, [WALK], [HANDLES_WALK]), Send(2, "walk")]


def test_declaration_forgotten_by_central_is_repeated() -> None:
    central, session = Central("one"), Session(HELLO)
    session.send_due(0.0, 0.0)

    def talk(connection: bytes, *, is_heard: bool = True) -> None:
        """Give central all headers of the session. Its answers arrive unless the connection
        is broken.
        """
        while outgoing := session.pop_outgoing(float):
            for header, body in outgoing:
                for effect in central.handle(
                    RequestReceived(0.0, ConnectionId(connection), header, body)
                ):
                    if isinstance(effect, Transmit) and is_heard:
                        session.receive(effect.header, effect.body, 0.0)

    talk(b"first")
    declaring = session.request(Register(0, [WALK], [HANDLES_WALK]))
    talk(b"first", is_heard=False)
    central.handle(ConnectionLost(0.0, ConnectionId(b"first")))
    assert not central.registry.messages["walk"].handlers
    session.break_off()
    session.send_due(1.0, 1.0)
    talk(b"second")
    assert declaring.is_over
    assert declaring.refused is None
    assert [handler.module.name for handler in central.registry.messages["walk"].handlers] == [
        "legs"
    ]


@pytest.mark.parametrize("question", [A_WAIT, STATUS, GetVariable(0, "pose")])
def test_harmless_request_dropped_in_break_is_asked_again(
    session: Session, question: AwaitPoint
) -> None:
    (request,) = send_requests(session, question)
    receive(session, Unknown(), welcome())
    pop_headers(session)
    receive(session, TOO_LATE)
    assert not request.is_over
    assert pop_headers(session) == [msgspec.structs.replace(question, number=3)]
    receive(session, Answer(3))
    assert (request.is_over, request.why_lost) == (True, "")


@pytest.mark.parametrize("question", [A_QUERY, SWAP])
def test_unsafe_request_dropped_in_break_is_lost(session: Session, question: Send) -> None:
    (request,) = send_requests(session, question)
    receive(session, Unknown(), welcome(), TOO_LATE)
    assert request.why_lost == "the connection to central broke before the answer came"


def test_repeated_goal_that_is_too_late_is_refused(session: Session) -> None:
    (walk,) = send_requests(session, A_GOAL, wants_answer=False)
    receive(session, Unknown(), welcome(), TOO_LATE)
    assert walk.refused is not None


def test_unsent_statements_are_counted(session: Session) -> None:
    session.post(Send(0, "position"))
    session.post(SetVariable(0, "pose"))
    session.request(A_GOAL)
    session.break_off()
    assert session.dropped == 2
    assert not session.post(SetVariable(0, "pose"))
    assert session.dropped == 3
    receive(session, welcome())
    assert pop_headers(session) == [Send(2, "walk")]


def test_answer_confirms_earlier_statements(session: Session) -> None:
    session.post(Send(0, "position"))
    send_requests(session, STATUS)
    session.post(SetVariable(0, "pose"))
    assert session.unconfirmed == 2
    receive(session, Answer(2))
    assert session.unconfirmed == 1
    receive(session, Unknown())
    assert (session.dropped, session.doubtful, session.unconfirmed) == (1, 0, 0)


def test_sent_statement_is_doubtful_after_break(session: Session) -> None:
    session.post(Send(0, "position"))
    pop_headers(session)
    session.post(Send(0, "position"))
    receive(session, Unknown())
    assert (session.dropped, session.doubtful, session.lost) == (1, 1, 2)


def test_confirmation_is_requested_during_long_sending(session: Session) -> None:
    for _ in range(3 * CONFIRM_EVERY):
        session.post(Send(0, "position"))
    questions = [header for header in pop_headers(session) if isinstance(header, Register)]
    assert questions == [Register(2, [], [])]
    receive(session, Accepted(2))
    assert session.unconfirmed == 2 * CONFIRM_EVERY
    session.post(Send(0, "position"))
    assert pop_headers(session)[-1] == Register(3, [], [])


def test_reply_is_settled_by_later_answer(session: Session) -> None:
    receive(session, Deliver(7, "walk"))
    session.reply(Reply(7), b"")
    assert not session.is_confirmed
    session.confirm()
    receive(session, Accepted(2))
    assert session.is_confirmed


def test_closing_is_reported_and_followed_by_hello(session: Session) -> None:
    receive(session, Closing("SIGTERM"))
    assert session.complaints == ["central ends: SIGTERM"]
    session.send_due(0.0, 0.0)
    assert pop_headers(session) == [HELLO]


# --- Silence --------------------------------------------------------------------------------------


def test_silent_central_is_asked_every_second(session: Session) -> None:
    receive(session, Beat(), now=10.0)
    session.send_due(100.0, since=99.0)  # a handler ran for 89 seconds and read nothing
    assert pop_headers(session) == []
    times = []
    for tenth in range(100, 150):
        session.send_due(tenth / 10, 0.0)
        if pop_headers(session) == [Register(0, [], [])]:
            times.append(tenth / 10)
    assert times == [10 + QUIET, 11 + QUIET, 12 + QUIET]
    receive(session, Accepted(0), now=15.0)
    session.send_due(15.1, 0.0)
    assert pop_headers(session) == []


# --- Deliveries -----------------------------------------------------------------------------------


def test_delivery_is_queued_and_replied_to_once(session: Session) -> None:
    session.receive(Deliver(8, "walk", TaskId(8)), b"data", 0.0)
    assert session.deliveries.popleft() == (Deliver(8, "walk", TaskId(8)), b"data")
    session.reply(Reply(8), b"")
    session.reply(Reply(8), b"")
    assert pop_headers(session) == [Reply(8)]


def test_reply_is_repeated_until_next_delivery_confirms_it(session: Session) -> None:
    receive(session, Deliver(8, "walk"), Unknown())
    session.reply(Reply(8), b"")
    assert pop_headers(session) == []  # the reply waits while central is away
    receive(session, welcome())
    assert pop_headers(session) == [Reply(8)]
    receive(
        session, Beat(), Unknown(), welcome()
    )  # the beat may have been sent before the reply arrived
    assert pop_headers(session) == [Reply(8)]
    receive(session, Deliver(9, "walk"), Unknown(), welcome())
    assert pop_headers(session) == []


def test_repeated_delivery_is_handled_once(session: Session) -> None:
    deliver = Deliver(7, "walk", TaskId(7))
    receive(session, deliver, deliver)
    assert len(session.deliveries) == 1
    session.deliveries.clear()
    session.reply(Reply(7), b"\xc0")
    pop_headers(session)
    receive(session, deliver)
    assert not session.deliveries
    assert pop_headers(session) == [Reply(7)], (
        "a reply may be lost when central's computer loses power"
    )


def test_killed_or_forgotten_task_is_cancelled_not_suspended(
    session: Session,
) -> None:
    """A handler may pause while its task is suspended. Without this rule it would never return."""
    deliveries = session.open_deliveries
    receive(session, Deliver(7, "walk", TaskId(7)), Deliver(8, "walk"), Suspended(7, True))
    assert (deliveries.is_suspended(7), deliveries.is_cancelled(7)) == (True, False)
    receive(session, Cancelled(7), Cancelled(99))
    assert (deliveries.is_suspended(7), deliveries.is_cancelled(7)) == (False, True)
    assert not deliveries.is_cancelled(8)
    receive(session, Unknown(), welcome("two"))
    assert deliveries.is_cancelled(8)


# --- Locks ----------------------------------------------------------------------------------------


def granted_lock(session: Session) -> Request:
    """Return a lock that central has granted."""
    (lock,) = send_requests(session, Lock(0, "legs"))
    receive(session, Answer(lock.header.number))
    return lock


def test_lock_is_lost_when_taken_or_central_restarts(
    session: Session,
) -> None:
    lock, other = granted_lock(session), granted_lock(session)
    receive(session, Taken(lock.header.number, "unlocked"), Taken(99, "never heard of"))
    assert (lock.why_lock_lost, other.why_lock_lost) == ("unlocked", "")
    receive(session, Unknown(), welcome("two"))
    assert other.why_lock_lost == "central was restarted and has forgotten it"


def test_lock_taken_before_its_answer_is_lost(
    session: Session,
) -> None:
    (lock,) = send_requests(session, Lock(0, "legs"))
    session.break_off()
    receive(
        session,
        welcome(),
        Taken(lock.header.number, "its module has gone"),
        Answer(lock.header.number),
    )
    assert lock.is_over
    assert lock.why_lock_lost == "its module has gone"


def test_forgotten_lock_request_is_repeated(session: Session) -> None:
    (lock,) = send_requests(session, Lock(0, "legs"))
    session.break_off()
    receive(session, welcome(), Taken(2, "its module has gone"), TOO_LATE)
    receive(session, Answer(lock.header.number))
    assert (lock.is_over, lock.why_lock_lost) == (True, "")


def test_abandoned_release_is_repeated_after_break(
    session: Session,
) -> None:
    release = session.request(Release(0, granted_lock(session).header.number))
    given_up.abandon(session, release)
    pop_headers(session)
    receive(session, Unknown(), welcome())
    assert pop_headers(session) == [release.header]
    receive(session, Accepted(release.header.number, 7), Unknown(), welcome())
    assert pop_headers(session) == []


@pytest.mark.parametrize(
    "asked_for", [Lock(0, "legs"), A_QUERY, A_WAIT, Observe(0), WaitUntilHandled(0, ["walk"])]
)
def test_give_up_is_repeated_until_answered(session: Session, asked_for: ToCentral) -> None:
    (early,) = send_requests(session, asked_for)
    given_up.abandon(session, early)  # the give-up is lost with the connection
    receive(session, Unknown())
    given_up.abandon(session, session.request(asked_for, wants_answer=True))  # was never sent
    receive(session, welcome())
    assert pop_headers(session) == [GiveUp(2, 3)]
    receive(session, Answer(3))
    (late,) = send_requests(session, asked_for)
    session.break_off()
    given_up.abandon(session, late)
    for _ in range(2):
        receive(session, welcome())
        assert pop_headers(session) == [GiveUp(5, 6)]
        session.break_off()


def test_old_observation_is_given_up_after_break(session: Session) -> None:
    send_requests(session, Observe(0))
    receive(session, Unknown(), welcome())
    assert pop_headers(session) == [GiveUp(2, 3), Observe(4)]
    receive(session, Unknown(), welcome())  # before the give-up has arrived
    assert pop_headers(session) == [GiveUp(2, 3), GiveUp(4, 5), Observe(6)]


def test_give_up_is_repeated_when_its_answer_is_abandoned(session: Session) -> None:
    (lock,) = send_requests(session, Lock(0, "legs"))
    why = given_up.abandon_asking_why(session, lock)
    assert why is not None
    given_up.abandon(session, why)
    receive(session, Unknown(), welcome())
    assert pop_headers(session) == [GiveUp(2, 3)]


# --- The next central after a restart -------------------------------------------------------------


def test_new_epoch_loses_requests_and_repeats_declarations(session: Session) -> None:
    session.add_declared([WALK], [HANDLES_WALK])
    (stance,) = send_requests(session, A_QUERY)
    receive(session, Deliver(8, "walk", TaskId(8)), Unknown(), welcome("two"))
    assert (stance.is_over, stance.why_lost) == (True, FORGOTTEN)
    assert not session.deliveries
    assert pop_headers(session) == [Register(0, [WALK], [HANDLES_WALK])]
    session.reply(Reply(8), b"")
    assert pop_headers(session) == []
    session.request(A_GOAL)
    assert pop_headers(session) == [Send(3, "walk")]


def test_new_central_gets_unsent_requests_that_name_no_task(
    session: Session,
) -> None:
    (gone,) = send_requests(session, A_GOAL, wants_answer=False)
    unsent = session.request(A_GOAL)
    receive(session, Unknown())
    walk, below = session.request(A_GOAL), session.request(Send(0, "walk", parent=TaskId(3)))
    wait, question = (
        session.request(A_WAIT, wants_answer=True),
        session.request(STATUS, wants_answer=True),
    )
    receive(session, welcome("two"))
    lost = [bool(request.why_lost) for request in (gone, unsent, walk, below, wait, question)]
    assert lost == [True, False, False, True, True, False]
    assert pop_headers(session) == [Send(3, "walk"), Send(4, "walk"), Ask(7, "status")]


@pytest.mark.parametrize("epoch", ["one", "two"])
def test_request_discarded_by_central_is_sent_again(session: Session, epoch: str) -> None:
    walk, stance = send_requests(session, A_GOAL, A_QUERY)
    receive(session, Unknown(walk.header.number), Unknown(stance.header.number), welcome(epoch))
    assert pop_headers(session) == [Send(2, "walk"), Send(3, "stance")]
    assert (walk.why_lost, stance.why_lost) == ("", "")


def test_repeated_request_is_lost_with_old_central(session: Session) -> None:
    (walk,) = send_requests(session, A_GOAL, wants_answer=False)
    receive(session, Unknown(), welcome())  # the line broke at an unknown time
    assert pop_headers(session) == [Send(2, "walk")]
    receive(session, Unknown(2), welcome("two"))
    assert walk.why_lost == FORGOTTEN


def test_unknown_without_request_number_saves_no_request(session: Session) -> None:
    (walk,) = send_requests(session, A_GOAL, wants_answer=False)
    receive(session, Unknown(), Unknown(77), welcome("two"))
    assert walk.why_lost


def test_discarded_request_naming_old_task_is_lost(
    session: Session,
) -> None:
    below, lock = send_requests(
        session, Send(0, "walk", parent=TaskId(3)), Lock(0, "legs", origin=3)
    )
    receive(session, Unknown(2), Unknown(3), welcome("two"))
    assert below.why_lost
    assert lock.why_lost
    assert pop_headers(session) == []


def test_read_only_questions_go_to_new_central(session: Session) -> None:
    questions = (
        STATUS,
        Inspect(0, TaskId(0), "descendants"),
        WaitUntilHandled(0, ["walk"]),
        GetVariable(0, "pose"),
    )
    kept, lost = (
        send_requests(session, *questions),
        send_requests(session, Inspect(0, TaskId(3), "self"), SWAP),
    )
    assert {request.epoch for request in kept} == {"one"}
    receive(session, Unknown(), welcome("two"))
    assert all(request.why_lost for request in lost)
    assert [type(header) for header in pop_headers(session)] == [type(each) for each in questions]
    assert {request.epoch for request in kept} == {"two"}


def test_pending_handler_registration_is_left_to_redeclaration(session: Session) -> None:
    """A repeated registration would declare the handlers before the attachments."""
    (request,) = send_requests(session, Register(0, [], [HANDLES_WALK]), wants_answer=False)
    receive(session, Unknown(), welcome("two"))
    assert request.why_lost
    assert pop_headers(session) == []


def test_central_names_request_of_unknown_connection() -> None:
    core, stranger = Central("two"), ConnectionId(b"somebody")
    events = [RequestReceived(0.0, stranger, header, b"") for header in (Send(7, "walk"), Reply(8))]
    effects = [effect for event in events for effect in core.handle(event)]
    assert [effect.header for effect in effects if isinstance(effect, Transmit)] == [
        Unknown(7),
        Unknown(0),
    ]


def test_held_replies_are_sent_singly_after_break(session: Session) -> None:
    for delivery in (5, 6):
        receive(session, Deliver(delivery, "note", ahead=1))
        session.held_replies.begin(delivery, 1.0)
        assert session.reply(Reply(delivery), b"", 2.0)
    session.break_off()
    assert not session.held_replies.ended
    receive(session, welcome())
    assert session.pop_outgoing(lambda: 3.0) == [(Reply(5), b""), (Reply(6), b"")]
