"""The numbered requests of a session: making, sending, and finishing them."""

from collections import deque
from collections.abc import Callable
from typing import Any

import msgspec

from tca_module.session.joined_replies import Item
from tca_module.session.open_deliveries import OpenDeliveries
from tca_module.session.request import Request, check_fields
from tca_module.session.sent_tasks import TaskSends
from tca_wire.packets import headers
from tca_wire.packets.changes import ChangeState
from tca_wire.packets.large import LargeBody
from tca_wire.vocabulary import Refusal

_ENDED = headers.Send(0, "")  # replaces the header of a send that is over


class OpenRequests:
    """The part of a Session that makes numbered requests and finishes them."""

    def __init__(self, newest: int) -> None:
        """*newest*: the highest request number so far."""
        self._newest = newest
        self.requests: dict[int, Request] = {}  #: number -> open request, oldest first
        self.sends = TaskSends()  #: tasks that were sent without waiting
        self.open_deliveries = OpenDeliveries()  #: deliveries that are handled, or about to be
        self.outgoing: list[Item] = []
        #: functions that the connection's thread must call soon
        self.pending_calls: deque[Callable[[], None]] = deque()
        #: lines for the log, such as errors from central that belong to no request
        self.complaints: list[str] = []
        self._posted = 0  #: number of statements sent on this connection
        self.is_welcome = False  #: central has welcomed this connection
        self.refused: headers.Refused | None = None  #: central's refusal of this connection, if any
        self.epoch = ""

    def ask(self, header: Any, body: bytes, *, wants_answer: bool = True) -> Request:
        """Make a request whose fields have been checked."""
        request = Request(header, body, wants_answer=wants_answer)
        self._begin(request)
        return request

    def send(self, header: headers.Send | ChangeState, body: bytes, what: str) -> Request:
        """Send a task, or a change of a task's state, without waiting for central.

        *what* names the task or change. If central refuses it, ``sends`` retains the error.
        """
        check_fields(header)
        if isinstance(header, headers.Send):
            header = msgspec.structs.replace(header, quiet=True)
        request = Request(header, body, wants_answer=False)
        request.what, request.sender_name = what, self.open_deliveries.name_of(header.origin)
        self.sends.unacknowledged += 1
        self._begin(request)
        return request

    def _send(self, request: Request) -> None:
        request.was_sent, request.epoch = True, self.epoch
        request.statements_before, request.answers_seen = self._posted, 0
        self.outgoing.append((request.header, request.body))

    def _begin(self, request: Request) -> None:
        """Number a new request, and send it to central."""
        self._number(request)
        if self.is_welcome:
            self._send(request)
        elif self.refused is not None:
            self._refuse(request)

    def _number(self, request: Request) -> None:
        self._newest += 1
        request.header = msgspec.structs.replace(request.header, number=self._newest)
        self.requests[self._newest] = request

    def _refuse(self, request: Request) -> None:
        """End a request that central will not answer, unless the request redeclares something."""
        if request.on_over is None:
            request.refused = self.refused
            self.finish(request)

    def finish(self, request: Request, why_lost: str = "") -> None:
        """Finish a request, and notify its waiters. *why_lost*: how the request was lost, if so."""
        self.requests.pop(request.header.number, None)
        request.is_over = True
        request.why_lost = why_lost or request.why_lost
        if isinstance(request.body, LargeBody):
            request.body = b""  # frees its segment
        if request.what:
            self._finish_send(request)
        if request.on_over is not None:
            request.on_over(request)
        self._notify_waiters(request)

    def _finish_send(self, request: Request) -> None:
        """Finish a send that central has accepted or refused, or that is lost."""
        self.sends.unacknowledged -= 1
        origin = request.header.origin
        if request.why_lost:
            self.sends.lost.append(request)
        elif request.refused is None:
            # Free the memory: the program may hold the id, and so this request, for ever.
            request.header, request.body, request.after = _ENDED, b"", []
        elif request.refused.refusal is Refusal.TOO_LATE and isinstance(
            request.header, ChangeState
        ):
            self.complaints.append(request.why_failed)  # the sender could not avoid being late
        elif not origin or origin in self.open_deliveries:
            self.sends.add(request)
        else:  # the sending handler has returned, and counts as failed in central
            self.complaints.append(request.error_for_log)

    def _notify_waiters(self, request: Request) -> None:
        """Notify the waiters of a request that there is news of it."""
        self.pending_calls += [call for call in (request.notify, request.wake) if call is not None]
