"""What a connection does when central is silent, has forgotten it, or was restarted."""

import pytest
from module.test_connection import connected, friendly

from tca_module.errors import CentralLost, Timeout
from tca_module.sending.task_ref import TaskRef
from tca_module.session.session import QUIET
from tca_wire.packets import headers
from tca_wire.packets.headers import Deliver, Hello, Register, Send, ToCentral, Unknown, Welcome
from tca_wire.points import ROOT, Moment, Point, TaskId


def test_a_silent_central_is_asked_and_then_given_up() -> None:
    connection, central = connected()
    request = connection.request(Send(0, "stance"), wants_answer=True)
    central.script = lambda _: []
    with pytest.raises(CentralLost):
        connection.wait(request, None, "query")
    assert 110 <= central.now <= 110.5
    questions = [header for header in central.heard if isinstance(header, Register)]
    assert len(questions) == 8  # from QUIET on, once a second
    assert QUIET == 2.5


def test_central_forgot_the_connection_while_it_waited() -> None:
    connection, central = connected()
    request = connection.request(Send(0, "stance", blocking=True), wants_answer=True)
    central.say(Unknown())
    assert not connection.wait(request, 0.5, "query")
    assert [type(header) for header in central.heard] == [Send, Hello, Send]


@pytest.mark.parametrize(
    ("asked", "advice"),
    [
        (Send(0, "stance"), "ask again"),
        (headers.WaitFor(0, Point(TaskId(2), Moment.END_ACHIEVING)), "send the task again"),
        (headers.Lock(0, "camera", origin=7), "begin anew"),
    ],
)
def test_what_was_lost_with_central_raises_and_says_what_to_do(asked: ToCentral, advice: str) -> None:
    connection, central = connected()
    request = connection.request(asked, wants_answer=True)
    central.script = lambda header: [Welcome(1, 1, "legs", "two")] if isinstance(header, Hello) else []
    central.say(Unknown())
    with pytest.raises(CentralLost, match=f"the answer is lost: central was restarted .*; {advice}$"):
        connection.wait(request, None, "the answer")


def test_a_new_central_is_not_asked_about_the_tasks_of_the_old_one() -> None:
    connection, central = connected()
    central.say(Unknown(), Welcome(1, 1, "legs", "two"))
    with pytest.raises(CentralLost, match="is lost: central was restarted and has forgotten its tree; begin anew"):
        connection.call(Send(0, "walk", parent=TaskId(3)), "goal 'walk'")
    assert connection.call(Send(0, "walk"), "goal 'walk'") == 17


def test_a_sender_that_never_waits_still_finds_central_again() -> None:
    connection, central = connected()
    connection.post(Send(0, "position"), b"")
    central.say(Unknown())
    for _ in range(3):
        connection.post(Send(0, "position"), b"")
    assert [type(header) for header in central.heard] == [Send, Hello, Send, Send]
    assert connection.session.dropped == 1


def test_a_lost_inform_is_said_once(caplog: pytest.LogCaptureFixture) -> None:
    connection, central = connected()
    central.is_there = False
    for _ in range(3):
        connection.post(Send(0, "position"), b"")
    assert connection.session.dropped == 3
    assert caplog.messages == ["central at ipc://scripted is not there: informs and broadcasts are lost"]


def test_central_comes_back_for_a_connection_that_serves() -> None:
    connection, central = connected()
    stop = []
    connection.handle_delivery = lambda delivery, _: stop.append(delivery)
    central.is_there = False

    def come_back() -> bool:
        if central.now > 200 and not central.is_there:
            central.is_there = True
            central.script = lambda header: [Unknown()] if isinstance(header, Register) else friendly(header)
            central.say(Deliver(8, "walk"), at=central.now + 5)
        return bool(stop)

    connection.serve(come_back)
    assert Hello in map(type, central.heard)


def test_the_question_for_all_tasks_names_no_task() -> None:
    connection, central = connected()
    central.script = lambda header: [] if isinstance(header, headers.Inspect) else friendly(header)
    everything = TaskRef(connection, "root", ROOT)
    with pytest.raises(Timeout, match=r"^the question for the tasks was not answered within 30 s, "):
        everything.descendants()
