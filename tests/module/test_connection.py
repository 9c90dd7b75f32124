"""Waits on a connection, with a scripted central and a clock that runs only during waits."""

import pytest
from module.scripted_central import HELLO, ScriptedCentral, accept_all, scripted_connection

from tca_module.errors import CentralLost, FormatRefused, Refused, Timeout
from tca_module.link.connection import Connection
from tca_module.link.packet_line import SEND_WAIT, STEP
from tca_module.session.session import QUIET, UNBROKEN, Session
from tca_wire.messages.declarations import Goal
from tca_wire.packets import headers
from tca_wire.packets.headers import (
    PROTOCOL_VERSION,
    Answer,
    Await,
    Beat,
    Bye,
    Deliver,
    GiveUp,
    Hello,
    Recall,
    Recalled,
    Register,
    Reply,
    Send,
    ToCentral,
    ToModule,
    Unknown,
    Welcome,
)
from tca_wire.points import Moment, Point, TaskId
from tca_wire.vocabulary import Refusal

WALK = Goal("walk")


@pytest.mark.parametrize("is_present", [True, False])
def test_unanswered_hello_raises_central_lost(*, is_present: bool) -> None:
    central = ScriptedCentral(lambda _: [])
    central.is_present = is_present
    connection = Connection(central, Session(HELLO), patience=5.0, clock=lambda: central.now)
    with pytest.raises(
        CentralLost, match=r"central at ipc://scripted does not answer: start it with 'tca central'"
    ):
        connection.open()
    assert 105 <= central.now <= 106.5
    assert len(central.received) == 5 * is_present  # Hello, once a second


def test_unreadable_hello_is_reported_as_other_protocol_version() -> None:
    """An older central, whose Hello lacks the last field, cannot read this Hello. Its refusal has
    no number.
    """
    reason = "a header is no message to central: Expected `array` of at most length 8, got 9"
    central = ScriptedCentral(lambda _: [headers.Refused(0, Refusal.PROTOCOL, reason)])
    connection = Connection(central, Session(HELLO), clock=lambda: central.now)
    with pytest.raises(Refused) as found:
        connection.open()
    assert str(found.value) == (
        f"module 'legs' was refused: central speaks another protocol than this module's {PROTOCOL_VERSION}: "
        f"use one version of TCA for both (it says: {reason})"
    )


def test_message_is_declared_once() -> None:
    connection, central = scripted_connection()
    connection.declare(WALK)
    connection.declare(WALK)
    assert central.received == [Register(2, [WALK.format], [])]
    connection.declare(Goal("walk"))  # another declaration of this name may have another format
    assert len(central.received) == 2


def test_refused_format_is_declared_again() -> None:
    connection, central = scripted_connection(
        lambda header: (
            [headers.Refused(header.number, Refusal.FORMAT, "two formats")]
            if isinstance(header, Register)
            else accept_all(header)
        )
    )
    for _ in range(2):
        with pytest.raises(
            FormatRefused, match="declaring goal 'walk' was refused: two formats"
        ) as caught:
            connection.declare(WALK)
        assert (caught.value.refusal, caught.value.text) == (Refusal.FORMAT, "two formats")
    assert len(central.received) == 2


def test_wait_ends_at_its_timeout() -> None:
    connection, central = scripted_connection()
    central.beat()
    request = connection.request(Send(0, "stance", blocking=True), wants_answer=True)
    assert not connection.wait(request, 7.0, "query")
    assert 107 <= central.now <= 107.1
    connection.abandon(request)
    assert central.received == [Send(2, "stance", blocking=True), GiveUp(2, 3)]


def test_zero_timeout_wait_takes_arrived_answer() -> None:
    connection, central = scripted_connection()
    request = connection.request(Send(0, "stance"), wants_answer=True)
    assert not connection.wait(request, 0, "query")
    central.deliver(Beat())
    central.deliver(Answer(2))
    assert not connection.wait(request, 0, "query")
    assert connection.wait(request, 0, "query")
    assert central.now == 100.0


def test_unacknowledged_request_is_given_up() -> None:
    connection, central = scripted_connection()
    central.beat()
    with pytest.raises(
        Timeout, match=r"goal 'x' was not acknowledged within 30 s, though central is alive"
    ):
        connection.call(Send(0, "x"), "goal 'x'")
    central.packets.clear()
    central.deliver(Unknown())
    connection.post(Send(0, "position"), b"")
    central.received.clear()
    connection.post(Send(0, "position"), b"")
    assert central.received == [Send(0, "position")]  # the given-up goal is not repeated


def test_delivery_is_handled_inside_wait() -> None:
    connection, central = scripted_connection()
    handled = []

    def handle(delivery: Deliver, _: bytes) -> None:
        handled.append(delivery.delivery)
        connection.reply(Reply(delivery.delivery), b"")
        central.deliver(Answer(2))

    connection.wait_loop.handle_delivery = handle
    request = connection.request(Send(0, "stance"), wants_answer=True)
    central.deliver(Deliver(8, "stance"))
    assert connection.wait(request, 1.0, "query")
    assert handled == [8]
    assert central.received[-1] == Reply(8)


def test_broken_packet_is_logged_and_skipped(caplog: pytest.LogCaptureFixture) -> None:
    connection, central = scripted_connection()
    request = connection.request(Send(0, "stance"), wants_answer=True)
    central.packets.append((0.0, b"nonsense"))
    central.deliver(Answer(2))
    assert connection.wait(request, 1.0, "query")
    assert "sent an invalid packet" in caplog.text


def test_next_central_gets_unsent_requests_but_not_sent_one() -> None:
    connection, central = scripted_connection()
    central.is_present = False
    requests = [
        connection.request(Send(0, f"{number}"), bytes(6 << 20), wants_answer=True)
        for number in range(3)
    ]
    central.is_present, central.room = True, 2
    assert not connection.wait(requests[2], 0.3, "query")
    assert [getattr(header, "message", "") for header in central.received] == [
        "",
        "0",
    ]  # Hello, and the first of the sends
    central.is_present, central.room = True, -1
    central.script = lambda header: (
        [Welcome(1, 1, "legs", "two")] if isinstance(header, Hello) else []
    )
    assert not connection.wait(requests[2], 0.3, "query")
    assert [getattr(header, "message", "") for header in central.received][2:] == ["", "1", "2"]
    assert requests[0].why_lost
    assert not requests[1].why_lost


def test_only_unsent_informs_count_as_dropped() -> None:
    connection, central = scripted_connection()
    central.room = 1
    session = connection.session
    for name in ("position", "stance"):
        session.post(Send(0, name), bytes(6 << 20))
    connection.post(Send(0, "speed"), b"")
    assert [header.message for header in central.received if isinstance(header, Send)] == [
        "position"
    ]
    assert session.dropped == 2


def test_interrupted_wait_gives_up_its_request() -> None:
    connection, central = scripted_connection()
    request = connection.request(Send(0, "stance"), wants_answer=True)

    def interrupt(_delivery: Deliver, _body: bytes) -> None:
        raise KeyboardInterrupt

    connection.wait_loop.handle_delivery = interrupt
    central.deliver(Deliver(8, "walk"))
    with pytest.raises(KeyboardInterrupt):
        connection.wait(request, None, "query")
    assert central.received == [Send(2, "stance"), Await(2), GiveUp(2, 3)]


# --- Prefetched messages --------------------------------------------------------------------------


class ScriptedSlot:
    """A slot whose first message is followed by *arrivals*. *durations* gives the seconds for each
    handled delivery.
    """

    def __init__(
        self,
        *arrivals: ToModule,
        durations: dict[int, float],
        is_nested: bool = False,
        ends_in: int = 0,
    ) -> None:
        self.connection, self.central = scripted_connection()
        self.begun: list[int] = []
        self.recall_answered: list[
            bool
        ] = []  #: for each begun delivery, whether the recall had been answered by then
        self.connection.wait_loop.handle_delivery = self.handle
        self.connection.session.open_deliveries.is_ending = lambda: ends_in in self.begun
        self.arrivals, self.durations, self.is_nested = arrivals, durations, is_nested

    def handle(self, delivery: Deliver, _: bytes) -> None:
        self.begun.append(delivery.delivery)
        self.recall_answered.append(
            any(isinstance(header, Recalled) for header in self.central.received)
        )
        if len(self.begun) == 1:
            for one in self.arrivals:
                self.central.deliver(one)
        self.central.now += self.durations.get(delivery.delivery, 0.0)
        self.connection.reply(Reply(delivery.delivery), b"")

    def serve(self) -> list[int]:
        """Handle all arrivals, and return the deliveries that were begun."""
        self.central.deliver(Deliver(8, "note"))
        self.connection.serve(
            lambda: self.central.now > 150.0, None if self.is_nested else lambda _: False
        )
        return self.begun


@pytest.mark.parametrize("is_nested", [False, True])
def test_recalled_prefetched_message_is_not_begun(*, is_nested: bool) -> None:
    numbers = list(range(9, 20))
    arrivals = [Deliver(number, "note", ahead=number - 8) for number in numbers]
    slot = ScriptedSlot(
        *arrivals, Recall(numbers), durations=dict.fromkeys(numbers, 0.1), is_nested=is_nested
    )
    assert slot.serve() == [8]
    assert Recalled(numbers) in slot.central.received


def test_recall_is_answered_before_kept_message_is_handled() -> None:
    arrivals = [Deliver(number, "note", ahead=number - 8) for number in range(9, 12)]
    slot = ScriptedSlot(*arrivals, Recall([10, 11]), durations={9: 2.0})
    assert slot.serve() == [8, 9]
    assert slot.recall_answered == [False, True]


def test_prefetched_message_is_not_begun_when_module_ends() -> None:
    assert ScriptedSlot(
        Deliver(9, "note", ahead=1), Deliver(10, "note", ahead=2), durations={}, ends_in=9
    ).serve() == [8, 9]


@pytest.mark.parametrize("is_answered", [True, False])
def test_answer_counts_after_a_message_handled_late(*, is_answered: bool) -> None:
    """The wait's answer may depend on the message that was handled within the wait."""
    connection, central = scripted_connection()

    def script(header: ToCentral) -> list[ToModule]:
        if isinstance(header, Reply) and is_answered:
            central.deliver(Answer(request.header.number), at=central.now + 0.05)
        return accept_all(header)

    def handle(delivery: Deliver, _: bytes) -> None:
        central.now += 2.0
        connection.reply(Reply(delivery.delivery), b"")

    central.script, connection.wait_loop.handle_delivery = script, handle
    request = connection.request(Send(0, "stance"), wants_answer=True)
    central.deliver(Deliver(8, "note"))
    assert connection.wait(request, 0.5, "query") is is_answered
    assert central.now < 103


@pytest.mark.parametrize("is_nested", [False, True])
@pytest.mark.parametrize("is_forgotten", [False, True])
def test_pause_is_followed_by_probe_before_prefetched_message(
    *, is_forgotten: bool, is_nested: bool
) -> None:
    """In the pause, the line may have broken and come back."""
    arrivals = Deliver(9, "note", ahead=1), Deliver(10, "note", ahead=2)
    slot = ScriptedSlot(*arrivals, durations={9: 2 * UNBROKEN}, is_nested=is_nested)
    begun_when_asked: list[list[int]] = []

    def script(header: ToCentral) -> list[ToModule]:
        if isinstance(header, Register):
            begun_when_asked.append([*slot.begun])
            if is_forgotten and len(begun_when_asked) == 1:
                return [Unknown()]
        return accept_all(header)

    slot.central.script = script
    assert slot.serve() == ([8, 9] if is_forgotten else [8, 9, 10])
    assert begun_when_asked[0] == [8, 9]


# --- Central is gone ------------------------------------------------------------------------------


def test_silent_central_is_asked_then_given_up() -> None:
    connection, central = scripted_connection()
    request = connection.request(Send(0, "stance"), wants_answer=True)
    central.script = lambda _: []
    with pytest.raises(CentralLost):
        connection.wait(request, None, "query")
    assert 110 <= central.now <= 110.5
    questions = [header for header in central.received if isinstance(header, Register)]
    assert len(questions) == 8  # from QUIET on, once a second
    assert QUIET == 2.5


@pytest.mark.parametrize(
    ("asked", "advice"),
    [
        (Send(0, "stance"), "ask again"),
        (headers.AwaitPoint(0, Point(TaskId(2), Moment.END_ACHIEVING)), "send the task again"),
        (headers.Lock(0, "camera", origin=7), "start again"),
    ],
)
def test_request_lost_with_central_raises_with_advice(asked: ToCentral, advice: str) -> None:
    connection, central = scripted_connection()
    request = connection.request(asked, wants_answer=True)
    central.script = lambda header: (
        [Welcome(1, 1, "legs", "two")] if isinstance(header, Hello) else []
    )
    central.deliver(Unknown())
    with pytest.raises(
        CentralLost, match=f"the answer is lost: central was restarted .*; {advice}$"
    ):
        connection.wait(request, None, "the answer")


def test_sender_that_never_waits_reconnects() -> None:
    connection, central = scripted_connection()
    connection.post(Send(0, "position"), b"")
    central.deliver(Unknown())
    for _ in range(3):
        connection.post(Send(0, "position"), b"")
    assert [type(header) for header in central.received] == [Send, Hello, Send, Send]
    assert connection.session.dropped == 1


def test_lost_informs_are_warned_of_once(caplog: pytest.LogCaptureFixture) -> None:
    connection, central = scripted_connection()
    central.is_present = False
    for _ in range(3):
        connection.post(Send(0, "position"), b"")
    assert connection.session.dropped == 3
    assert caplog.messages == [
        "central at ipc://scripted is not there: informs and broadcasts are lost"
    ]


def test_serving_connection_reconnects_when_central_returns() -> None:
    connection, central = scripted_connection()
    stop = []
    connection.wait_loop.handle_delivery = lambda delivery, _: stop.append(delivery)
    central.is_present = False

    def restart_central() -> bool:
        if central.now > 200 and not central.is_present:
            central.is_present = True
            central.script = lambda header: (
                [Unknown()] if isinstance(header, Register) else accept_all(header)
            )
            central.deliver(Deliver(8, "walk"), at=central.now + 5)
        return bool(stop)

    connection.serve(restart_central)
    assert Hello in map(type, central.received)


def test_hello_is_repeated_soon_after_unsent_packet() -> None:
    connection, central = scripted_connection()
    request = connection.request(Send(0, "stance", blocking=True), wants_answer=True)
    connection.session.post(Bye())
    central.is_present = False
    back_at = central.now + SEND_WAIT  # the connection tries to send for that long

    def restore_central() -> bool:
        central.is_present = central.now >= back_at
        return False

    assert not connection.wait(request, SEND_WAIT + 2 * STEP, "query 'stance'", restore_central)
    assert Hello in map(type, central.received)


# --- Silence --------------------------------------------------------------------------------------


@pytest.mark.parametrize("timeout", [0.0, 0.1, 0.2, 1.0, 5.0])
def test_wait_ends_at_timeout_when_central_is_dead(timeout: float) -> None:
    """Neither the unsent request nor the unsent give-up of it delays the end of the wait."""
    connection, central = scripted_connection()
    central.is_present = False
    for _ in range(3):
        began = central.now
        request = connection.request(Send(0, "stance"), wants_answer=True, is_awaited=True)
        assert not connection.wait(request, timeout, "query 'stance'")
        assert connection.why_silent.startswith("central at ipc://scripted has said nothing for ")
        connection.abandon(request)
        assert central.now == pytest.approx(began + timeout)


def test_answering_central_is_not_silent() -> None:
    connection, central = scripted_connection()
    assert not connection.why_silent
    central.script = lambda _: []
    central.now += QUIET
    connection.keep_alive(central.now - QUIET)
    central.now += STEP
    assert connection.why_silent.startswith("central at ipc://scripted has said nothing for 2.7 s")
    central.deliver(Beat())
    connection.keep_alive(central.now)
    assert not connection.why_silent
    central.now += QUIET  # it has answered the last probe, and the next one is not sent yet
    assert not connection.why_silent


def test_timeout_names_silence_of_central() -> None:
    connection, central = scripted_connection()
    central.script = lambda _: []
    central.deliver(Beat(), at=central.now + 6.0)  # the network is back
    with pytest.raises(
        Timeout, match=r"not acknowledged within 7 s, central was silent for 6\.0 s of it"
    ):
        connection.call(Register(0, []), "the declaration", within=7.0)
    central.beat()
    with pytest.raises(Timeout, match="alive: it is overloaded"):
        connection.call(Register(0, []), "the declaration", within=7.0)


def test_idle_central_is_asked_before_it_counts_as_silent() -> None:
    """Central sends few heartbeats to connections that wait for nothing."""
    connection, central = scripted_connection()
    central.script = lambda _: []
    central.now += 20.0
    request = connection.request(Send(0, "stance"), wants_answer=True)
    assert not connection.why_silent
    assert not connection.wait(request, 0.3, "query")
    assert connection.why_silent.startswith("central at ipc://scripted has said nothing for 20.3 s")
