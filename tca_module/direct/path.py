"""A sender's path to one entrance.

The sender numbers its messages. The slot reports which messages it has begun (Begun, or an Answer).
The sender thus knows how many messages have not begun. If these are too many, it refuses more
queries and drops more informs.

After a break or a silence the sender greets again, and the slot says which messages have not
arrived. The sender repeats missing queries under the same numbers. Missing informs are lost. After
Closing, a slot begins nothing more. When a slot disconnects, the informs that it has not reported
as begun count as lost, because they may not have been handled.
"""

from collections import Counter
from collections.abc import Callable
from typing import Any, ClassVar, Protocol

from tca_module.errors import NIL
from tca_module.session.request import Request
from tca_module.sockets.transport import EventSource
from tca_wire.errors import ProtocolError
from tca_wire.messages.failures import MODULE_LOST
from tca_wire.packets import direct, headers
from tca_wire.packets.codec import pack_item
from tca_wire.packets.direct import Begun, Direct, Greet, Greeting
from tca_wire.packets.headers import PROTOCOL_VERSION, Answer, Refused
from tca_wire.packets.routes import Entrance
from tca_wire.vocabulary import Outcome, Refusal

# The most messages that are not begun, and the most bytes of their data. A message of any size is
# accepted if no other message is under way.
MOST_UNDER_WAY, MOST_BYTES = 1000, 64 << 20
REPEAT = 1.0  # seconds of silence after which a sender asks what has arrived and what has begun
LEAVE_WITHIN = 2.0  # seconds in which a slot that has left may still answer, or say Closing
PACKETS = 256  # packets read at a time


class LineSocket(EventSource, Protocol):
    """Carries packets to an entrance and back."""

    @property
    def is_connected(self) -> bool:
        """Whether the socket accepts a packet now."""

    def receive(self) -> bytes | None:
        """Return the next packet, or None."""

    def send(self, packet: bytes) -> bool:
        """Send a packet; return whether it left."""

    def close(self) -> None:
        """Close. Packets already sent still leave."""


class DirectPath:
    """The path to one entrance.

    *end* is called with a request that is over, *hand_over* with a request to be sent through
    central. *lose* is called with the name of a message, the number of lost informs, and the
    reason: "" if too many messages were under way.
    """

    def __init__(
        self,
        entrance: Entrance,
        socket: LineSocket,
        session: str,
        module: str,
        *,
        end: Callable[[Request], None],
        hand_over: Callable[[Request], None],
        lose: Callable[[str, int, str], None],
    ) -> None:
        self.entrance = entrance
        self.socket = socket
        self.complaints: list[str] = []  #: lines for the log
        self.requests: dict[int, Request] = {}  #: number -> unanswered query
        self.is_over = False  #: nothing can be sent any more
        self.must_ask = False  #: whether to greet soon: the slot then says what has arrived
        self._is_open = False  #: the slot has answered the last greeting
        self._is_first = True  #: the slot has answered no greeting yet
        self._session = session
        self._module = module
        self._end, self._hand_over, self._lose = end, hand_over, lose
        self._newest = 0
        #: messages that may not have begun: number -> name ("" for a query) and size
        self._under_way: dict[int, tuple[str, int]] = {}
        self._bytes = 0
        self._arrived = 0  #: the highest number that the slot has reported since ``confirm``
        self._asked_at = float("-inf")  #: when the slot was last sent a query or greeting
        #: set when the slot has disconnected: the time at which its queries fail, and the reason
        self._gives_up_at: tuple[float, str] | None = None

    @property
    def is_usable(self) -> bool:
        """Whether messages can be sent on this path now."""
        return self._is_open and not self.is_over and self._gives_up_at is None

    @property
    def is_needed(self) -> bool:
        """Whether the slot may still report on messages that were sent."""
        return bool(self.requests) or bool(self._under_way and not self.is_over)

    @property
    def is_restless(self) -> bool:
        """Whether ``send_due`` may have something to do although no packet arrives."""
        return not self.is_over and (
            self._gives_up_at is not None or self.is_needed or not self._is_open
        )

    @property
    def unconfirmed(self) -> int:
        """The number of informs that may not have arrived, without those that count as lost."""
        under_way = {} if self.is_over else self._under_way
        return sum(
            bool(inform) for number, (inform, _) in under_way.items() if number > self._arrived
        )

    def confirm(self) -> None:
        """Ask the slot which messages have arrived, and ignore its earlier reports."""
        self.receive()
        self._arrived = 0
        self.must_ask = self.unconfirmed > 0

    def send_query(self, request: Request, now: float) -> bool:
        """Send a query; return False if it must go through central.

        If too many messages are under way, the query is refused.
        """
        if self._is_full(len(request.body)):
            number, message = len(self._under_way), request.header.message
            text = f"{number} direct messages wait for the handler of '{message}': try later"
            request.refused = Refused(0, Refusal.OVERLOAD, text)
            self._end(request)
            return True
        if not self._send(request.header, request.body, inform=""):
            return False
        self.requests[self._newest] = request
        request.path, request.path_number = self, self._newest
        self._asked_at = now
        return True

    def send_inform(self, header: headers.Send, body: bytes) -> bool:
        """Send an inform; return False if it must go through central.

        If too many messages are under way, the inform is lost.
        """
        if self._is_full(len(body)):
            self._lose(header.message, 1, "")
            return True
        return self._send(header, body, inform=header.message)

    def abandon(self, request: Request) -> None:
        """Give up a query: its answer is no longer wanted."""
        if self.requests.pop(request.path_number, None) is not None and self._is_open:
            self.socket.send(pack_item(headers.GiveUp(request.path_number)))

    def _is_full(self, size: int) -> bool:
        return len(self._under_way) >= MOST_UNDER_WAY or bool(
            self._under_way and self._bytes + size > MOST_BYTES
        )

    def _send(self, header: headers.Send, body: bytes, *, inform: str) -> bool:
        direct_header = Direct(self._newest + 1, header.message, header.origin)
        if not self.socket.send(pack_item(direct_header, body)):
            self._is_open, self._asked_at = False, float("-inf")
            return False
        self._newest += 1
        self._under_way[self._newest] = inform, len(body)
        self._bytes += len(body)
        return True

    def send_due(self, now: float) -> None:
        """Greet the slot when a greeting is due; end the path of a slot that has disconnected."""
        is_waiting = self.requests or self._under_way or not self._is_open
        if self._gives_up_at is not None and now >= self._gives_up_at[0]:
            for request in self._close_and_pop_requests():
                request.answers.append(
                    (Answer(0, Outcome.FAILED, MODULE_LOST, self._gives_up_at[1]), NIL)
                )
                self._end(request)
            self._lose_informs([*self._under_way], self._gives_up_at[1])
        if self.is_over or not (self.must_ask or (is_waiting and now - self._asked_at >= REPEAT)):
            return
        if self.socket.is_connected:
            self.must_ask = False
            self._asked_at = now
            key, session, module = self.entrance.key, self._session, self._module
            greet = Greet(PROTOCOL_VERSION, key, session, module, self._newest, self._is_first)
            self.socket.send(pack_item(greet))

    def on_disconnected(self, text: str, now: float, *, lost: bool) -> None:
        """End the path at once if the slot was *lost*.

        Otherwise the slot has left and may still answer: the path ends ``LEAVE_WITHIN`` later.
        """
        self.receive()
        self._gives_up_at = now + (0 if lost else LEAVE_WITHIN), text
        self.send_due(now)

    def lose_all(self, why: str) -> None:
        """End all queries with an error, because their outcome is unknown."""
        for request in self._close_and_pop_requests():
            request.why_lost = why
            self._end(request)

    def _close_and_pop_requests(self) -> list[Request]:
        """Close the path. Returns its unanswered queries, which the caller ends."""
        self.is_over = True
        requests = list(self.requests.values())
        self.requests.clear()
        return requests

    def receive(self) -> None:
        """Process arrived packets."""
        for _ in range(PACKETS):
            packet = self.socket.receive()
            if packet is None:
                return
            try:
                for header, body in direct.unpack_from_entrance(packet):
                    self._ON[type(header)](self, header, body)
            except ProtocolError as error:
                self.complaints.append(f"{self.entrance.endpoint} sent an invalid packet: {error}")

    def _on_answer(self, header: Answer, body: bytes) -> None:
        self._mark_begun(header.number)
        if (request := self.requests.pop(header.number, None)) is not None:
            request.answers.append((header, body))
            self._end(request)

    def _on_begun(self, header: Begun, _: bytes) -> None:
        for number in [number for number in self._under_way if number <= header.number]:
            self._mark_begun(number)

    def _on_unknown(self, _header: headers.Unknown, _: bytes) -> None:
        self._is_open, self._asked_at = False, float("-inf")

    def _on_closing(self, _header: headers.Closing, _: bytes) -> None:
        for request in self._close_and_pop_requests():
            self._hand_over(request)
        self._lose_informs([*self._under_way], "their handler has left")

    def _lose_informs(self, numbers: list[int], why: str) -> None:
        """Report the informs with these numbers as possibly not handled; ignore queries."""
        lost = Counter(self._under_way[number][0] for number in numbers)
        for number in numbers:
            self._mark_begun(number)
        for inform, number in lost.items():
            if inform:
                self._lose(inform, number, why)

    def _mark_begun(self, number: int) -> None:
        _, size = self._under_way.pop(number, ("", 0))
        self._bytes -= size

    def _on_refused(self, header: Refused, _: bytes) -> None:
        self._mark_begun(header.number)
        if (request := self.requests.pop(header.number, None)) is not None:
            request.refused = header
            self._end(request)
            return
        self.complaints.append(f"{self.entrance.endpoint} refused: {header.text}")
        if not header.number:  # without a number, the slot refuses everything from this sender
            self.lose_all(self.complaints[-1])
            why = "their handler accepts nothing from here any more"
            self._lose_informs([*self._under_way], why)

    def _on_greeting(self, header: Greeting, _body: bytes) -> None:
        self._is_open, self._is_first = True, False
        missing, waits = frozenset(header.missing), frozenset(header.open)
        self._arrived = header.newest
        lost = [one for one in self._under_way if one in missing and one not in self.requests]
        self._lose_informs(lost, "the line to their handler broke")
        for number, request in list(self.requests.items()):
            if number > header.newest or number in waits:
                continue
            if number in missing:
                again = Direct(number, request.header.message, request.header.origin)
                self.socket.send(pack_item(again, request.body))
            else:
                del self.requests[number]
                self._mark_begun(number)
                request.why_lost = "the line to the module broke before the answer came"
                self._end(request)

    _ON: ClassVar[dict[type, Callable[["DirectPath", Any, bytes], None]]] = {
        Greeting: _on_greeting,
        Begun: _on_begun,
        Answer: _on_answer,
        Refused: _on_refused,
        headers.Unknown: _on_unknown,
        headers.Closing: _on_closing,
    }
    """One handler per type of header from a slot."""
