"""The three ways to get replies later: fetch one, iterate over many, or have a function called."""

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

QUERY_TIMEOUT = 30.0  # seconds that a query waits for its reply where nobody says otherwise


def not_answered(message: Message[Any, Any], timeout: float | None, why: str) -> Timeout:
    """The Timeout of a query without a reply in time; *why* says where it was ("": unknown)."""
    where = f": {why}" if why else ""
    return Timeout(f"{message.title} was not answered within {timeout:g} s{where}", can_wait=True)


def _failed(message: Message[Any, Any], answer: Answer, body: bytes) -> QueryFailed:
    return QueryFailed(message.title, answer.failure or str(answer.outcome), answer.text, body)


class _Question:
    """A query that was sent, until it is given up."""

    def __init__(self, connection: Connection, request: Request) -> None:
        self.connection = connection
        self.request = request
        self._is_cancelled = False

    def cancel(self) -> None:
        """Give the query up: a handler that has not begun it never will."""
        if not self._is_cancelled:
            self._is_cancelled = True
            self.connection.abandon(self.request)


class PendingReply(_Question, Generic[R]):
    """A query that was sent. In an async handler ``await`` gives its reply."""

    def __init__(self, connection: Connection, request: Request, message: Query[Any, R]) -> None:
        super().__init__(connection, request)
        self._message = message

    def receive(self, timeout: float | None = QUERY_TIMEOUT) -> R:
        """The reply; waits at most *timeout* seconds (None: for ever). Raises QueryFailed if the
        handler failed; Timeout if no reply came in time, TaskKilled or Stopped as ``query`` does:
        the query is given up then.
        """
        check(self._message.title, TIMEOUT, timeout=timeout)
        return self.receive_within(timeout, timeout)

    def receive_within(self, left: float | None, timeout: float | None) -> R:
        """The reply, where only *left* seconds of the timeout remain."""
        what = self._checked_name()
        try:
            is_there = self.connection.wait(self.request, left, what)
        except (TaskKilled, Stopped):
            self._is_cancelled = True
            raise
        if not is_there:
            self._is_cancelled = True
            raise not_answered(self._message, timeout, self.connection.give_up(self.request))
        return self._reply(*self.request.answers[-1])

    def __await__(self) -> Generator[Any, None, R]:
        try:
            yield from self.connection.until_over(self.request, self._checked_name())
        except asyncio.CancelledError:
            self.cancel()
            raise
        return self._reply(*self.request.answers[-1])

    def _checked_name(self) -> str:
        if self._is_cancelled:
            raise MisuseError(f"{self._message.title} was given up: send it again to get a reply")
        return self._message.title

    def _reply(self, answer: Answer, body: bytes) -> R:
        if answer.outcome is not Outcome.DONE:
            raise _failed(self._message, answer, body)
        return self._message.decode_reply(body)


class PendingReplies(_Question, Iterator[R], Generic[R]):
    """The replies to a multi-query as they come; each step waits for the next. Ends as
    ``multi_query`` does.
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

    def __next__(self) -> R:
        if not self._is_cancelled and self._has_answer():
            answer, body = self.request.answers.popleft()
            if answer.more:
                self._has_reply = True
                return self._message.decode_reply(body)
            if answer.outcome is not Outcome.DONE:
                self.cancel()
                raise _failed(self._message, answer, body)
        self.cancel()
        raise StopIteration

    def _has_answer(self) -> bool:
        if not self.request.answers and not self.request.is_over:
            patience = (
                None if self._deadline is None else max(0.0, self._deadline - self.connection.now())
            )
            try:
                came = self.connection.wait(
                    self.request, patience, self._message.title, lambda: bool(self.request.answers)
                )
                if not came and not self._has_reply:  # a failure may have come instead
                    self.connection.give_up(self.request)
            except (TaskKilled, Stopped):
                self._is_cancelled = True
                raise
        return bool(self.request.answers)


class Notification(Generic[R]):
    """A query whose reply calls a function, once."""

    def __init__(
        self,
        pending: PendingReply[R],
        callback: Callable[[Any, R], object],
        on_failure: Callable[[Any, Exception], object] | None,
    ) -> None:
        self.is_over = False  #: the function has been called, or never will be
        self._connection = connection = pending.connection
        self._pending = pending
        self._callback = callback
        self._on_failure = on_failure
        pending.request.notify = lambda: connection.waiting.callbacks.append(self._call)

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the function has been called; False if it was not within *timeout* seconds.
        Raises CentralLost, TaskKilled or Stopped as ``query`` does; the query is given up then.
        """
        if timeout != 0:
            self._connection.announce(self._pending.request)
        try:
            return self._connection.listen(lambda: self.is_over, timeout)
        except (TaskKilled, Stopped):
            self.cancel()
            raise

    def cancel(self) -> None:
        """Don't call the function: a handler that has not begun the query never will."""
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
