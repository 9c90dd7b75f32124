"""A reply that comes after the handler has returned (TCA: distributed responses; TDL: POSTPONE and
RESUME).
"""

import threading
from typing import Any, Generic, overload
from weakref import WeakMethod

from tca_module.errors import NIL, MisuseError, Stopped
from tca_module.link.connection import Connection
from tca_module.sending.handler_errors import failed
from tca_module.sending.task_requests import ReportingTask, ServerState
from tca_module.session.open_deliveries import current_delivery, working_on
from tca_wire.messages.declarations import Message, R
from tca_wire.messages.failures import FORGOTTEN, HANDLER_ERROR, MODULE_LOST
from tca_wire.packets.headers import Deliver, Fail, Reply
from tca_wire.text.measures import numbered


class LaterReply(ReportingTask, Generic[R]):
    """The reply that a handler owes: it returns this, and another thread or callback replies later.

    Keep it until you call ``reply`` or ``fail``, once, from any thread: until then its slot is
    taken. That is so for a killed task, too: look at ``cancelled``, stop the device, then reply.
    Nothing is owed any more when you have accepted a client's cancel. ``accept``, ``report`` and
    ``take`` come before the reply, and what clients ask for is in ``request``.

    A LaterReply that is dropped without an answer fails with "forgotten"; a killed task just ends.
    """

    def __init__(
        self,
        connection: Connection,
        message: Message[Any, R],
        delivery: Deliver,
        state: ServerState | None = None,
    ) -> None:
        """*state*: the task's, if it is one."""
        self._connection = connection
        self._message = message
        self._delivery = delivery
        self._state = state
        self._open_delivery = current_delivery()  # the handler's that owes it
        self._lock = threading.Lock()
        self._answer: tuple[Reply | Fail, bytes] | None = None
        self._has_returned = (
            False  # the handler; before it has, central must not take its thread for free
        )
        self._ended = ""  # why no answer is taken any more
        self._is_stopped = False  # a client's cancel was accepted
        if state is not None:
            state.on_stop = WeakMethod(
                self._stopped
            )  # nothing of the library's may keep this: see __del__

    def __del__(self) -> None:
        if (
            getattr(self, "_has_returned", False)
            and self.is_open
            and not self._connection.is_inherited
        ):
            self._connection.call_soon(self._forgotten)

    def __repr__(self) -> str:
        return (
            numbered(self._message.name, self._delivery.task)
            if self._delivery.task
            else f"'{self._message.name}'"
        )

    @property
    def cancelled(self) -> bool:
        """Whether the task has been killed and its reply is still owed: stop when that is safe,
        then reply.
        """
        self._connection.check_process()
        with working_on(
            self._open_delivery
        ):  # a restarted central may have given another delivery the same number
            return self.is_open and self._connection.session.open_deliveries.is_cancelled(
                self._delivery.delivery
            )

    @property
    def is_open(self) -> bool:
        """Whether the reply is still owed."""
        return self._answer is None and not self._ended

    def _served(self) -> ServerState:
        if self._state is None:
            raise MisuseError(f"{self} is no task of the tree: only goals and commands are")
        if self._ended:
            raise Stopped(f"{self} can't be reported on any more: {self._ended}")
        if self._answer is not None:
            raise MisuseError(
                f"{self} has been answered already: accept, report and take before that"
            )
        return self._state

    @overload
    def reply(self: "LaterReply[None]", value: None = None) -> None: ...
    @overload
    def reply(self, value: R) -> None: ...
    def reply(self, value: Any = None) -> None:
        """Complete the message with its reply or result. Raises BadData if *value* does not fit
        (the reply is still owed), MisuseError if it was given before, Stopped if the module has
        ended.
        """
        self._take(Reply(self._delivery.delivery), self._message.encode_reply(value))

    def fail(self, error: BaseException) -> None:
        """Complete the message with a failure: ``later.fail(COLLISION(contact))``. Raises what
        ``reply`` does.
        """
        if not isinstance(error, BaseException):
            msg = f"{self} can't fail with {error!r:.60}: give it FAILURE(data) of a declared Failure, or an exception"
            raise MisuseError(msg)
        self._take(*failed(self._delivery.delivery, error))

    def _take(self, header: Reply | Fail, body: bytes) -> None:
        self._connection.check_process()
        with self._lock:
            if self._ended:
                raise Stopped(f"{self} can't be answered any more: {self._ended}")
            if self._is_stopped:
                return
            if self._answer is not None:
                raise MisuseError(f"{self} has been answered already: reply() or fail() it once")
            self._answer = header, body
            if self._has_returned:
                self._connection.call_soon(self._send)

    def returned(self) -> None:
        """The handler has returned: replies may leave from now on."""
        with self._lock:
            self._has_returned = True
            if self._answer is not None:
                self._connection.call_soon(self._send)  # after what its thread has reported before

    def end(self, why: str) -> None:
        """Refuse replies from now on; the caller answers instead."""
        with self._lock:
            self._ended = self._ended or why

    def _stopped(self) -> None:
        """The task has ended as its client wanted: the reply is not owed any more."""
        if self.is_open:
            self._take(Reply(self._delivery.delivery), NIL)
            self._is_stopped = True

    def _forgotten(self) -> None:
        """It was dropped while its reply was owed. The connection's thread calls this."""
        if not self.is_open:
            return
        with working_on(self._open_delivery):
            is_killed = self._connection.session.open_deliveries.is_killed(self._delivery.delivery)
        self._answer = Reply(self._delivery.delivery), NIL
        if not is_killed:
            text = f"the LaterReply of {self} was dropped: keep it until you have called its reply() or fail()"
            self._connection.log.error("%s", text)
            self._answer = Fail(self._delivery.delivery, FORGOTTEN, text, [HANDLER_ERROR]), b""
        self._send()

    def module_ends(self) -> None:
        """The handler's thread ends: a reply still owed has failed."""
        self.end("its module has ended")
        failure = (
            Fail(self._delivery.delivery, MODULE_LOST, "its module ended before it was answered"),
            b"",
        )
        with working_on(self._open_delivery):
            self._connection.reply(*(self._answer or failure))  # says nothing if an answer was sent

    def _send(self) -> None:
        assert self._answer is not None
        with working_on(self._open_delivery):
            self._connection.reply(*self._answer)
