"""The part of a Sender that asks: queries, and multi-queries to all handlers of a message."""

from typing import Any, TypedDict, Unpack, overload

from tca_module import checks
from tca_module.checks import check, check_class, checked_call, is_brief
from tca_module.errors import Timeout
from tca_module.link.connection import Connection
from tca_module.sending.central_services import CentralServices
from tca_module.sending.replies import (
    QUERY_TIMEOUT,
    PendingReplies,
    PendingReply,
    reply_timeout,
)
from tca_module.session.request import Request
from tca_wire.constraints import Flags
from tca_wire.messages.declarations import D, Message, MultiQuery, Query, R
from tca_wire.packets.headers import Send


class QueryOptions(TypedDict, total=False):
    """The options of ``query``.

    Args:
        timeout: the most seconds to wait for the reply; None waits for ever. Default: 30.
        priority: the query with the highest is first at a busy resource. Default: 0.
    """

    timeout: float | None
    priority: int


class RepliesOptions(TypedDict, total=False):
    """The options of ``multi_query``.

    Args:
        maximum: the number of replies to wait for. Default: None, all.
        timeout: the most seconds to wait; None waits for ever. Default: 30.
    """

    maximum: int | None
    timeout: float | None


class QuestionServices(CentralServices):
    """The part of a Sender that asks questions."""

    @overload
    def query(
        self, message: Query[None, R], data: None = None, **options: Unpack[QueryOptions]
    ) -> R: ...
    @overload
    def query(self, message: Query[D, R], data: D, **options: Unpack[QueryOptions]) -> R: ...
    @checked_call
    def query(
        self,
        message: Query[Any, R],
        data: Any = None,
        *,
        timeout: float | None = QUERY_TIMEOUT,
        priority: int = 0,
    ) -> R:
        """Send a query, and wait for its reply.

        Args:
            message: the Query.
            data: its data. Default: None, for a query without data.
            timeout: the most seconds to wait for the reply; None waits for ever. Default: 30. The
                wait does not interrupt a message that this thread handles within it.
            priority: -1,000,000 to 1,000,000; the highest is first at a busy resource. Default: 0.

        Returns:
            The reply.

        Raises:
            QueryFailed: the handler failed.
            Timeout: no reply came in time; the text says where the query was.
            BadData: *data* does not fit the message.
            FormatRefused: other programs declare the message differently.
            Refused: "overload": too many messages wait for the handler.
            Deadlock: in a handler: the wait would never end.
            CentralLost: central does not answer.
            TaskKilled: in a handler, once: its task was killed.
            Stopped: in a handler, once: its module ends.

        Example::

            stance = task.query(NEXT_STANCE, pose, timeout=2.0)
        """
        pending, left = self._query_within(message, data, timeout, priority, blocking=True)
        return pending.receive_within(left, timeout)

    def _query_within(
        self,
        message: Query[Any, R],
        data: Any,
        timeout: float | None,
        priority: int,
        *,
        blocking: bool,
    ) -> tuple[PendingReply[R], float | None]:
        """Send a query; return it, and the seconds that are left of the timeout.

        *blocking*: the sender waits for nothing else. Raises Timeout.
        """
        brief = is_brief("query()", timeout)
        check_class(message, Query)
        try:
            left = self._declare_within(timeout, message)
        except Timeout:
            assert timeout is not None
            raise reply_timeout(message, timeout, self._connection().why_silent) from None
        question = self._send_question(
            message, data, priority=priority, blocking=blocking, brief=brief
        )
        return PendingReply(*question, message), left

    @overload
    def query_send(
        self, message: Query[None, R], data: None = None, *, priority: int = ...
    ) -> PendingReply[R]: ...
    @overload
    def query_send(
        self, message: Query[D, R], data: D, *, priority: int = ...
    ) -> PendingReply[R]: ...
    @checked_call
    def query_send(
        self, message: Query[Any, R], data: Any = None, *, priority: int = 0
    ) -> PendingReply[R]:
        """Send a query, and return at once.

        Args:
            message: the Query.
            data: its data. Default: None, for a query without data.
            priority: the query with the highest is first at a busy resource. Default: 0.

        Returns:
            A PendingReply: ``receive()`` waits for the reply; an async handler can ``await`` it.

        Raises:
            BadData: *data* does not fit the message.
            FormatRefused: other programs declare the message differently.
            CentralLost: central does not answer.

        Example::

            pending = task.query_send(HEIGHT, place)
            height = pending.receive(timeout=5)
        """
        check_class(message, Query)
        question = self._send_question(message, data, priority=priority, is_awaited=False)
        return PendingReply(*question, message)

    def _send_question(
        self,
        message: Message[Any, Any],
        data: Any,
        *,
        priority: int = 0,
        blocking: bool = False,
        brief: bool = False,
        maximum: int = 0,
        if_handled: bool = False,
        is_awaited: bool = True,
    ) -> tuple[Connection, Request]:
        """Send a query or multi-query; return its connection and request.

        *is_awaited*: the caller waits for the answer next.
        """
        if not checks.PRIORITY.fits(priority):
            check(message.title, checks.PRIORITY, priority=priority)
        body = message.encode_data(data)
        connection = self._declare(message)
        header = Send(
            0,
            message.name,
            origin=self._origin,
            priority=priority,
            blocking=blocking,
            maximum=maximum,
            flags=Flags.NONE,
            if_handled=if_handled,
            brief=brief,
        )
        request = connection.request(header, body, wants_answer=True, is_awaited=is_awaited)
        return connection, request

    @overload
    def multi_query(
        self, message: MultiQuery[None, R], data: None = None, **options: Unpack[RepliesOptions]
    ) -> list[R]: ...
    @overload
    def multi_query(
        self, message: MultiQuery[D, R], data: D, **options: Unpack[RepliesOptions]
    ) -> list[R]: ...
    @checked_call
    def multi_query(
        self,
        message: MultiQuery[Any, R],
        data: Any = None,
        *,
        maximum: int | None = None,
        timeout: float | None = QUERY_TIMEOUT,
    ) -> list[R]:
        """Send a multi-query to all modules that handle it, and wait for their replies.

        The wait ends when *maximum* replies have arrived, when no more can come, or when the time
        is over.

        Args:
            message: the MultiQuery.
            data: its data. Default: None, for a message without data.
            maximum: the number of replies to wait for. Default: None, all.
            timeout: the most seconds to wait; None waits for ever. Default: 30.

        Returns:
            The replies, in the order of their arrival. Handlers that failed or were late are left
            out. [] means that no module handles the message, or that all were late.

        Raises:
            QueryFailed: no handler replied, and at least one failed; the text names each failure.
            BadData: *data* does not fit the message.
            FormatRefused: other programs declare the message differently.
            CentralLost: central does not answer.
            TaskKilled: in a handler, once: its task was killed.
            Stopped: in a handler, once: its module ends.

        Example::

            bids = task.multi_query(BID, "dig", timeout=1.0)
        """
        return list(self._multi_query_send(message, data, maximum, timeout, blocking=True))

    @overload
    def multi_query_send(
        self, message: MultiQuery[None, R], data: None = None, **options: Unpack[RepliesOptions]
    ) -> PendingReplies[R]: ...
    @overload
    def multi_query_send(
        self, message: MultiQuery[D, R], data: D, **options: Unpack[RepliesOptions]
    ) -> PendingReplies[R]: ...
    @checked_call
    def multi_query_send(
        self,
        message: MultiQuery[Any, R],
        data: Any = None,
        *,
        maximum: int | None = None,
        timeout: float | None = QUERY_TIMEOUT,
    ) -> PendingReplies[R]:
        """Send a multi-query to all modules that handle it, and return at once.

        The iteration ends when the wait of ``multi_query`` would end.

        Args:
            message: the MultiQuery.
            data: its data. Default: None, for a message without data.
            maximum: the number of replies to wait for. Default: None, all.
            timeout: the most seconds until the end of the iteration, from now on; None for no
                bound. Default: 30.

        Returns:
            PendingReplies, to iterate over: it yields the replies as they arrive.

        Raises:
            BadData: *data* does not fit the message.
            FormatRefused: other programs declare the message differently.
            CentralLost: central does not answer.

        Example::

            for bid in task.multi_query_send(BID, "dig", timeout=10):
                print(bid)
        """
        return self._multi_query_send(message, data, maximum, timeout, blocking=False)

    def _multi_query_send(
        self,
        message: MultiQuery[D, R],
        data: D,
        maximum: int | None,
        timeout: float | None,
        *,
        blocking: bool,
    ) -> PendingReplies[R]:
        check_class(message, MultiQuery)
        check(message.title, checks.TIMEOUT, timeout=timeout)
        check(message.title, checks.MAXIMUM, maximum=maximum)
        try:
            left = self._declare_within(timeout, message)
        except Timeout:  # no replies, as if all handlers were late
            unsent = Request(Send(0, message.name), b"", wants_answer=True)
            unsent.is_over = True
            return PendingReplies(self._connection(), unsent, message, 0)
        connection, request = self._send_question(
            message, data, blocking=blocking, maximum=maximum or 0
        )
        return PendingReplies(connection, request, message, left)

    def _ask_if_handled(
        self, message: Query[D, R] | MultiQuery[D, R], data: D
    ) -> R | list[R] | None:
        """Ask and wait for the answer. Returns None if the message has no handler."""
        connection, request = self._send_question(message, data, blocking=True, if_handled=True)
        is_over = connection.wait(request, QUERY_TIMEOUT, message.title)
        # Central answers a question that has a handler. It only accepts a question without one.
        if request.accepted is not None:
            return None
        if isinstance(message, MultiQuery):
            return list(PendingReplies(connection, request, message, 0))
        if not is_over:
            raise reply_timeout(message, QUERY_TIMEOUT, connection.abandon_late(request))
        return PendingReply(connection, request, message).receive()
