"""Three ways to get replies later: fetch one, iterate over many, or have a function called."""

import asyncio
from collections.abc import Callable, Generator, Iterator
from typing import Any, Generic

from tca_module.checks import TIMEOUT, check
from tca_module.errors import (
    BadData,
    MisuseError,
    QueryFailed,
    Stopped,
    TaskKilled,
    TcaError,
    Timeout,
)
from tca_module.link.connection import Connection
from tca_module.session.request import Request
from tca_wire.messages.declarations import Message, MultiQuery, Query, R
from tca_wire.packets.headers import Answer
from tca_wire.vocabulary import Outcome

QUERY_TIMEOUT = 30.0  # seconds that a query waits for its reply by default


def reply_timeout(message: Message[Any, Any], timeout: float | None, why: str) -> Timeout:
    """Return the Timeout for a query that got no reply in time.

    *why* says where the query was; "" if that is unknown.
    """
    where = f": {why}" if why else ""
    return Timeout(f"{message.title} was not answered within {timeout:g} s{where}", can_wait=True)


def _query_failed(message: Message[Any, Any], answer: Answer, body: bytes) -> QueryFailed:
    """Return the QueryFailed for an answer."""
    return QueryFailed(message.title, answer.failure or str(answer.outcome), answer.text, body)


class _Question:
    """A query that was sent. It can be given up."""

    def __init__(self, connection: Connection, request: Request) -> None:
        self.connection = connection
        self.request = request
        self._is_cancelled = False

    def cancel(self) -> None:
        """Give the query up. If no handler has started it, no handler will."""
        if not self._is_cancelled:
            self._is_cancelled = True
            self.connection.abandon(self.request)


class PendingReply(_Question, Generic[R]):
    """A query that was sent; ``receive()`` waits for the reply.

    In an async handler ``await`` returns the reply. ``asyncio.timeout`` limits that wait.

    Example::

        pending = [task.query_send(HEIGHT, place) for place in places]
        heights = [reply.receive(timeout=5) for reply in pending]
    """

    def __init__(self, connection: Connection, request: Request, message: Query[Any, R]) -> None:
        super().__init__(connection, request)
        self._message = message

    def receive(self, timeout: float | None = QUERY_TIMEOUT) -> R:
        """Wait for the reply, and return it.

        Args:
            timeout: the most seconds to wait, from now on; None waits for ever. Default: 30.

        Returns:
            The reply.

        Raises:
            QueryFailed: the handler failed.
            Timeout: no reply came in time; the query is given up.
            Refused: "overload": too many messages wait for the handler.
            CentralLost: central does not answer; the query is given up.
            TaskKilled: in a handler: its task was killed; the query is given up.
            Stopped: in a handler: its module ends; the query is given up.
            MisuseError: the query was given up before.
        """
        check(self._message.title, TIMEOUT, timeout=timeout)
        return self.receive_within(timeout, timeout)

    def receive_within(self, left: float | None, timeout: float | None) -> R:
        """Wait *left* seconds for the reply: the rest of the caller's *timeout*."""
        what = self._checked_name()
        try:
            has_reply = self.connection.wait(self.request, left, what)
        except (TaskKilled, Stopped):
            self._is_cancelled = True
            raise
        if not has_reply:
            self._is_cancelled = True
            raise reply_timeout(self._message, timeout, self.connection.abandon_late(self.request))
        return self._reply(*self.request.answers[-1])

    def __await__(self) -> Generator[Any, None, R]:
        try:
            yield from self.connection.wait_in_coroutine(self.request, self._checked_name())
        except asyncio.CancelledError:
            self.cancel()
            raise
        return self._reply(*self.request.answers[-1])

    def _checked_name(self) -> str:
        """Return the message's title for errors. Raises MisuseError if the query was given up."""
        if self._is_cancelled:
            raise MisuseError(f"{self._message.title} was given up: send it again to get a reply")
        return self._message.title

    def _reply(self, answer: Answer, body: bytes) -> R:
        """Return the reply in an answer. Raises QueryFailed if the answer reports a failure."""
        if answer.outcome is not Outcome.DONE:
            raise _query_failed(self._message, answer, body)
        return self._message.decode_reply(body)


class PendingReplies(_Question, Iterator[R], Generic[R]):
    """The replies to a multi-query, to iterate over as they arrive.

    Each step waits for the next reply. The iteration ends when the wait of ``multi_query`` would
    end. It raises QueryFailed if no handler replied and at least one failed.

    Example::

        for bid in task.multi_query_send(BID, "dig", timeout=2.0):
            print(bid)
    """

    def __init__(
        self,
        connection: Connection,
        request: Request,
        message: MultiQuery[Any, R],
        timeout: float | None,
    ) -> None:
        super().__init__(connection, request)
        self._message = message
        self._deadline = None if timeout is None else connection.now() + timeout
        self._has_reply = False

    @property
    def seconds_left(self) -> float | None:
        """The seconds until the end of the iteration; None without a bound."""
        deadline = self._deadline
        return None if deadline is None else max(0.0, deadline - self.connection.now())

    def __next__(self) -> R:
        if not self._is_cancelled and self._wait_for_answer():
            answer, body = self.request.answers.popleft()
            if answer.more:
                self._has_reply = True
                return self._message.decode_reply(body)
            if answer.outcome is not Outcome.DONE:
                self.cancel()
                raise _query_failed(self._message, answer, body)
        self.cancel()
        raise StopIteration

    def _wait_for_answer(self) -> bool:
        """Wait for the next answer; return False if the time is over, or no more will come."""
        if not self.request.answers and not self.request.is_over:
            try:
                has_arrived = self.connection.wait(
                    self.request,
                    self.seconds_left,
                    self._message.title,
                    lambda: bool(self.request.answers) or self.request.is_over,
                )
                # If a handler has failed, central's answer to the GiveUp names its failure.
                if not has_arrived and not self._has_reply:
                    self.connection.abandon_late(self.request)
            except (TaskKilled, Stopped):
                self._is_cancelled = True
                raise
        return bool(self.request.answers)


class Notification(Generic[R]):
    """A query and the function to call once with its reply; ``query_notify`` returns it.

    Attributes:
        is_over: whether the function has been called, or never will be.
    """

    def __init__(
        self,
        pending: PendingReply[R],
        callback: Callable[[Any, R], object],
        on_failure: Callable[[Any, Exception], object] | None,
    ) -> None:
        self.is_over = False
        self._connection = connection = pending.connection
        self._pending = pending
        self._callback = callback
        self._on_failure = on_failure
        pending.request.notify = lambda: connection.wait_loop.callbacks.append(self._call)

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the function has been called.

        Args:
            timeout: the most seconds to wait. Default: None, no bound.

        Returns:
            False if the function was not called in time.

        Raises:
            CentralLost: central does not answer; the query is given up.
            TaskKilled: in a handler: its task was killed; the query is given up.
            Stopped: in a handler: its module ends; the query is given up.
            MisuseError: a callback waits for another callback.
        """
        if timeout != 0:
            self._connection.announce(self._pending.request)
        try:
            return self._connection.listen(lambda: self.is_over, timeout)
        except (TaskKilled, Stopped):
            self.cancel()
            raise

    def cancel(self) -> None:
        """Give the query up: the function is not called any more."""
        if not self.is_over:
            self.is_over = True
            self._pending.cancel()

    def _call(self) -> None:
        if not self.is_over:
            name = getattr(self._callback, "__qualname__", self._callback)
            self._connection.call_back(self._answer, f"callback {name}")
            self.is_over = True

    def _answer(self) -> None:
        sender = self._connection.root_sender
        try:
            reply = self._pending.receive(0)
        except (TcaError, BadData) as error:
            if self._on_failure is None:
                raise
            self._on_failure(sender, error)
        else:
            self._callback(sender, reply)
