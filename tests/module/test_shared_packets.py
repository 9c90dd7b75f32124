"""Sends that wait for nothing share packets while the line is busy. Here time stands still."""

import threading

from module.scripted_central import ScriptedCentral, scripted_connection

from tca_module.link.connection import Connection
from tca_module.link.packet_line import SENT_AT_ONCE
from tca_wire.packets.headers import Await, Reply, Send, SetVariable, Unknown
from tca_wire.points import ROOT

NOTE, BODY = Send(0, "note"), b"\xc0"
_LONG = 1000.0  # seconds after which another thread would send


def busy_connection() -> tuple[Connection, ScriptedCentral]:
    """Return a connection that has just sent some informs, of which its central knows the last."""
    connection, central = scripted_connection()
    central.hold_seconds = _LONG
    for _ in range(SENT_AT_ONCE):
        connection.post(NOTE, BODY)
    del central.sizes[1:], central.received[1:]
    return connection, central


def names(central: ScriptedCentral) -> list[str]:
    return [getattr(one, "message", type(one).__name__) for one in central.received]


def test_first_informs_leave_at_once_and_others_wait() -> None:
    connection, central = busy_connection()
    for _ in range(3):
        connection.post(NOTE, BODY)
    assert central.sizes == [1]
    connection.flush()
    assert central.sizes == [1, 3]


def test_inform_leaves_at_once_after_a_pause() -> None:
    connection, central = scripted_connection()
    central.hold_seconds = 2.0
    for _ in range(2):
        connection.post(NOTE, BODY)
        central.now += 2.0
    assert central.sizes == [1, 1]


def test_packet_leaves_when_it_has_64_informs() -> None:
    connection, central = busy_connection()
    for _ in range(65):
        connection.post(NOTE, BODY)
    assert central.sizes == [1, 64]


def test_packet_leaves_when_its_bodies_are_large() -> None:
    connection, central = busy_connection()
    for _ in range(3):
        connection.post(NOTE, bytes(8 << 10))
    assert central.sizes == [1, 2]


def test_full_packet_has_arrivals_processed() -> None:
    connection, central = busy_connection()
    central.deliver(Unknown())
    for _ in range(64):
        connection.post(NOTE, BODY)
    # The connection broke when the first informs were on their way, and 64 had not left.
    session = connection.session
    assert (session.doubtful, session.dropped, session.unconfirmed) == (SENT_AT_ONCE, 64, 0)


def test_all_that_a_sender_does_keeps_its_order() -> None:
    connection, central = busy_connection()
    connection.post(Send(0, "first"), BODY)
    connection.send_task(Send(0, "walk", ROOT), BODY, "walk")
    connection.request(Send(0, "asked"), BODY, wants_answer=True)
    connection.post(SetVariable(0, "pose"), BODY)
    connection.post(Send(0, "last"), BODY)
    assert central.sizes == [1]
    connection.session.open_deliveries.add(7, is_suspended=False)
    connection.reply(Reply(7), BODY)
    expected = ["note", "first", "walk", "asked", "SetVariable", "last", "Reply"]
    assert [name.replace("pose", "SetVariable") for name in names(central)] == expected
    assert central.sizes == [1, 6]


def test_waiting_sends_what_waits() -> None:
    connection, central = busy_connection()
    asked = connection.request(Send(0, "asked"), BODY, wants_answer=True)
    connection.post(NOTE, BODY)
    assert not connection.wait(asked, 0.5, "the question")
    assert [type(one) for one in central.received[:4]] == [Send, Send, Send, Await]
    assert central.sizes[:2] == [1, 3]


def test_waiting_messages_count_as_unconfirmed() -> None:
    connection, central = busy_connection()
    connection.post(NOTE, BODY)
    assert connection.session.unconfirmed == SENT_AT_ONCE + 1
    connection.close()
    assert connection.missing == 0
    assert names(central)[:2] == ["note", "note"]


def test_thread_that_serves_holds_nothing_back() -> None:
    connection, central = busy_connection()

    def condition() -> bool:
        connection.post(NOTE, BODY)
        return True

    connection.wait_loop.until(condition, 0)
    assert central.sizes == [1, 1]


def test_user_functions_in_a_wait_let_others_send() -> None:
    connection, central = busy_connection()

    def callback() -> None:
        connection.post(NOTE, BODY)
        connection.post(NOTE, BODY)
        assert central.sizes == [1]

    connection.wait_loop.callbacks.append(callback)
    connection.process_pending()
    connection.flush()
    assert central.sizes == [1, 2]


def test_waiting_informs_outlast_a_central_that_is_busy() -> None:
    connection, central = busy_connection()
    for _ in range(3):
        connection.post(NOTE, BODY)
    central.room = 0
    connection.catch_up()
    central.is_present, central.room = True, -1
    connection.catch_up()
    assert central.sizes == [1, 3]
    assert connection.session.dropped == 0


def test_other_thread_sends_what_waits_and_wakes_the_loop() -> None:
    connection, central = busy_connection()
    connection.post(NOTE, BODY)
    assert connection.line.send_held()
    assert central.sizes == [1, 1]
    assert central.woken  # ZeroMQ's file may not show any more what has arrived


def test_other_thread_does_not_wait_for_a_connection_in_use() -> None:
    connection, central = busy_connection()
    connection.post(NOTE, BODY)
    sent = []
    with connection.locked():
        other = threading.Thread(target=lambda: sent.append(connection.line.send_held()))
        other.start()
        other.join()
    assert (sent, central.sizes) == ([False], [1])
