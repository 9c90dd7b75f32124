"""A reply that is sent after the handler has returned.

TCA calls such replies distributed responses; TDL has POSTPONE and RESUME.
"""

import threading
from typing import Any, Generic, overload
from weakref import WeakMethod

from tca_module.errors import NIL, MisuseError, Stopped
from tca_module.link.connection import Connection
from tca_module.sending.handler_errors import failure_of
from tca_module.sending.task_requests import ReportingTask, ServerState
from tca_module.session.open_deliveries import current_delivery, working_on
from tca_wire.messages.declarations import Message, R
from tca_wire.messages.failures import FORGOTTEN, HANDLER_ERROR, MODULE_LOST
from tca_wire.packets.headers import Deliver, Fail, Postpone, Reply
from tca_wire.text.measures import numbered


class LaterReply(ReportingTask, Generic[R]):
    """The reply that a handler owes: the handler returns this, and another thread replies later.

    Keep a reference to the LaterReply until you call ``reply`` or ``fail``. Call one of them once,
    from any thread. Until then the handler's slot handles only tasks below its own, even if the
    task is killed; with ``frees_slot`` it handles any message. When ``cancelled`` is true, stop the
    device, then reply. After you have accepted a client's cancel,
    no reply is owed. ``accept``, ``report`` and ``take`` must come before the reply. ``request`` is
    the oldest open request of a client.

    If a LaterReply is dropped without a reply, its message fails with "forgotten". If the task was
    killed, the task just ends.

    Example::

        @arm.handles(MOVE)
        def move(task: Task, angle: float) -> LaterReply[float]:
            later = task.reply_later()
            motor.start(angle, on_stop=lambda: later.reply(motor.angle))
            return later
    """

    def __init__(
        self,
        connection: Connection,
        message: Message[Any, R],
        delivery: Deliver,
        state: ServerState | None = None,
    ) -> None:
        """*state*: the task's state; None if the message is no task."""
        self._connection = connection
        self._message = message
        self._delivery = delivery
        self._state = state
        self._open_delivery = current_delivery()  # of the handler that owes the reply
        self._lock = threading.Lock()
        self._answer: tuple[Reply | Fail, bytes] | None = None
        # Whether the handler has returned. No answer is sent before the return, because central
        # would think that the handler's thread is free.
        self._has_returned = False
        self._why_closed = ""  # the reason why no answer is accepted any more
        self._is_stopped = False  # a client's cancel was accepted
        self.frees_slot = False  #: whether the slot handles other messages until the reply
        if state is not None:
            # The library holds no strong reference to this object, so that __del__ runs when the
            # user drops it.
            state.on_stop = WeakMethod(self._on_stop)

    def __del__(self) -> None:
        # An object whose creation failed lacks the attribute.
        is_owed = getattr(self, "_has_returned", False) and self.is_open
        if is_owed and not self._connection.is_inherited:
            self._connection.call_soon(self._on_dropped)

    def __repr__(self) -> str:
        name, task = self._message.name, self._delivery.task
        return numbered(name, task) if task else f"'{name}'"

    @property
    def cancelled(self) -> bool:
        """Whether the task was killed or is retried, or the module ends, while the reply is owed.

        When it is true, stop as soon as that is safe, then reply.
        """
        self._connection.check_process()
        # A restarted central may use the same number for another delivery. This block ensures that
        # the number means the delivery of this reply.
        with working_on(self._open_delivery):
            return self.is_open and self._connection.session.open_deliveries.is_cancelled(
                self._delivery.delivery
            )

    @property
    def is_open(self) -> bool:
        """Whether the reply is still owed."""
        return self._answer is None and not self._why_closed

    def _server_state(self) -> ServerState:
        if self._state is None:
            raise MisuseError(f"{self} is no task of the tree: only goals and commands are")
        if self._why_closed:
            raise Stopped(f"{self} can't be reported on any more: {self._why_closed}")
        if self._answer is not None:
            text = "has been answered already: accept(), report() and take() come before that"
            raise MisuseError(f"{self} {text}")
        return self._state

    @overload
    def reply(self: "LaterReply[None]", value: None = None) -> None: ...
    @overload
    def reply(self, value: R) -> None: ...
    def reply(self, value: Any = None) -> None:
        """Complete the message with its reply or result.

        Args:
            value: the reply or result. Default: None, for a message that declares none.

        Raises:
            BadData: *value* does not fit the declaration; the reply is still owed.
            MisuseError: the message has been answered already.
            Stopped: the module has ended.
        """
        ending = self._state.ending if self._state is not None else ""
        reply = Reply(self._delivery.delivery, transition=ending)
        body = self._message.encode_reply(value)
        self._answer_with(reply, self._connection.store(body, self._message.title))

    def fail(self, error: BaseException) -> None:
        """Complete the message with a failure.

        Args:
            error: a declared failure with its data, or any exception.

        Raises:
            MisuseError: the message has been answered already, or *error* is no exception.
            Stopped: the module has ended.

        Example::

            later.fail(COLLISION(contact))
        """
        if not isinstance(error, BaseException):
            advice = "give it FAILURE(data) of a declared Failure, or an exception"
            raise MisuseError(f"{self} can't fail with {error!r:.60}: {advice}")
        self._answer_with(*failure_of(self._delivery.delivery, error))

    def _answer_with(self, header: Reply | Fail, body: bytes) -> None:
        """Accept the answer, and send it if the handler has returned."""
        self._connection.check_process()
        with self._lock:
            if self._why_closed:
                raise Stopped(f"{self} can't be answered any more: {self._why_closed}")
            if self._is_stopped:
                return
            if self._answer is not None:
                raise MisuseError(f"{self} has been answered already: reply() or fail() it once")
            self._answer = header, body
            if self._has_returned:
                self._connection.call_soon(self._send)

    def handler_returned(self) -> None:
        """Record that the handler has returned, and send the answer if there is one."""
        with self._lock:
            self._has_returned = True
            if self._answer is not None:
                self._connection.call_soon(self._send)  # after all its reports
                return
        if self.frees_slot or self._state is not None:
            self._connection.postpone(Postpone(self._delivery.delivery, self.frees_slot))

    def end(self, why: str) -> None:
        """Refuse replies from now on, because the caller answers instead."""
        with self._lock:
            self._why_closed = self._why_closed or why

    def _on_stop(self) -> None:
        """Answer without a value: the task has ended at its client's request."""
        if self.is_open:
            self._answer_with(Reply(self._delivery.delivery), NIL)
            self._is_stopped = True

    def _on_dropped(self) -> None:
        """Answer for a LaterReply that was dropped. The connection's thread calls this."""
        if not self.is_open:
            return
        with working_on(self._open_delivery):
            is_killed = self._connection.session.open_deliveries.is_killed(self._delivery.delivery)
        self._answer = Reply(self._delivery.delivery), NIL
        if not is_killed:
            advice = "keep a reference to it until you have called its reply() or fail()"
            text = f"the LaterReply of {self} was dropped: {advice}"
            self._connection.log.error("%s", text)
            self._answer = Fail(self._delivery.delivery, FORGOTTEN, text, [HANDLER_ERROR]), b""
        self._send()

    def module_ends(self) -> None:
        """Send the answer, because the handler's thread ends. Without an answer, fail."""
        self.end("its module has ended")
        text = "its module ended before it was answered"
        failure = Fail(self._delivery.delivery, MODULE_LOST, text)
        with working_on(self._open_delivery):
            # Central ignores this if an answer was sent before.
            self._connection.reply(*(self._answer or (failure, b"")))

    def _send(self) -> None:
        """Send the answer. The connection's thread calls this."""
        assert self._answer is not None
        with working_on(self._open_delivery):
            self._connection.reply(*self._answer)
