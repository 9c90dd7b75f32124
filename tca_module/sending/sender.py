"""Sender: the calls that send, the same for a handler's Task, a Module and a Client."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Annotated, Any, TypedDict, Unpack, overload

from tca_module import checks
from tca_module.checks import (
    EXECUTED,
    LateText,
    check,
    check_class,
    check_function,
    check_options,
    is_brief,
)
from tca_module.errors import Refused, Timeout
from tca_module.link.connection import Connection
from tca_module.sending.attachments import Recovery
from tca_module.sending.replies import (
    QUERY_TIMEOUT,
    Notification,
    PendingReplies,
    PendingReply,
    not_answered,
)
from tca_module.sending.task_ref import SentTask, TaskRef, node_of
from tca_module.sending.watching import TASK, WatchingServices
from tca_module.session.request import Request
from tca_wire.constraints import Constraint, Flags, not_before
from tca_wire.messages.declarations import (
    Broadcast,
    Command,
    D,
    Goal,
    Inform,
    Message,
    MultiQuery,
    Query,
    R,
    TaskMessage,
)
from tca_wire.packets.headers import Constrain, Send
from tca_wire.points import THIS, TaskId
from tca_wire.vocabulary import Refusal

_SHORTEST_PAUSE, _LONGEST_PAUSE = (
    0.01,
    0.1,
)  # seconds between two tries to send where there was no room

_RECOVERIES = checks.list_of(
    "a list of recoveries, such as [Recovery(COLLISION, RAISE_LEG)]",
    checks.instance_of("a recovery", Recovery),
)


class TaskOptions(TypedDict, total=False):
    """The relation of a new task to its siblings.

    Args:
        sequential: it is achieved after the sibling before it (SEQ_ACH). Default: True.
        sequential_planning: it is planned after the sibling before it has been planned
            (SEQ_PLANNING).
        plan_first: all of it is planned before any of it is done (PLAN_FIRST).
        delay_planning: it is planned only when it may be achieved (DELAY_PLANNING).
        priority: the higher one is first where several wait for one resource. Default: 0.
        constraints: other constraints; ``this`` stands for the new task.
        on_failure: exception handlers of the new task, each newer than the one before it.
        deadline: seconds, above 0. If it is not achieved within them, the failure "timeout" is
            raised on it. Default: None, no bound.
        delay: seconds from now before which it is not started. Default: 0.
        keep: its data, outcome and place can be asked for after its end, as after ``keep()`` of its
            handle.
        suspended: it is created suspended, and starts after ``resume()`` of its handle: order it
            with others before.
    """

    sequential: Annotated[bool, checks.FLAG]
    sequential_planning: Annotated[bool, checks.FLAG]
    plan_first: Annotated[bool, checks.FLAG]
    delay_planning: Annotated[bool, checks.FLAG]
    priority: Annotated[int, checks.PRIORITY]
    constraints: Annotated[Sequence[Constraint], checks.CONSTRAINTS]
    on_failure: Annotated[Sequence[Recovery], _RECOVERIES]
    deadline: Annotated[float | None, checks.DURATION_OR_NONE]
    delay: Annotated[float, checks.SECONDS]
    keep: Annotated[bool, checks.FLAG]
    suspended: Annotated[bool, checks.FLAG]


class QueryOptions(TypedDict, total=False):
    """The options of ``query``: seconds to wait (None: for ever), and which query is first at a
    busy resource.
    """

    timeout: float | None
    priority: int


class RepliesOptions(TypedDict, total=False):
    """The options of ``multi_query``: how many replies (None: all), and seconds to wait (None: for
    ever).
    """

    maximum: int | None
    timeout: float | None


_FLAGS = {
    "sequential_planning": Flags.SEQ_PLANNING,
    "plan_first": Flags.PLAN_FIRST,
    "delay_planning": Flags.DELAY_PLANNING,
}
"""The options that are constraints between siblings, as central knows them."""


class Sender(WatchingServices):
    """Sends messages. Task, Module, Client and Callback are Senders."""

    # --- tasks ------------------------------------------------------------------------------------

    @overload
    def goal(
        self, message: Goal[None], data: None = None, **options: Unpack[TaskOptions]
    ) -> SentTask[None]: ...
    @overload
    def goal(self, message: Goal[D], data: D, **options: Unpack[TaskOptions]) -> SentTask[None]: ...
    def goal(
        self, message: Goal[Any], data: Any = None, **options: Unpack[TaskOptions]
    ) -> SentTask[None]:
        """Make a subtask that expands into subtasks of its own. Returns at once; central may have
        yet to take it.

        Raises BadData if *data* does not fit, FormatRefused if others declare the message
        differently. Refused, if the constraints can never be met, is raised by whatever uses the
        task first (``task.id`` waits for central's word), by the next call of this Sender, or at
        the latest when the handler returns, which then has failed.
        """
        check_class(message, Goal)
        return self._task(message, data, options)

    @overload
    def command(
        self, message: Command[None, R], data: None = None, **options: Unpack[TaskOptions]
    ) -> SentTask[R]: ...
    @overload
    def command(
        self, message: Command[D, R], data: D, **options: Unpack[TaskOptions]
    ) -> SentTask[R]: ...
    def command(
        self, message: Command[Any, R], data: Any = None, **options: Unpack[TaskOptions]
    ) -> SentTask[R]:
        """Make a subtask that acts; ``result()`` waits for its end. Otherwise like ``goal``."""
        check_class(message, Command)
        return self._task(message, data, options)

    def _task(self, message: Message[D, R], data: D, options: TaskOptions) -> SentTask[R]:
        task = self._task_if(message, data, options, handled=False)
        assert task is not None
        return task

    def _task_if(
        self, message: Message[D, R], data: D, options: TaskOptions, *, handled: bool
    ) -> SentTask[R] | None:
        """The new task; None if *handled* and nobody handles the message."""
        if options:
            check_options(message.title, options, TaskOptions)
        body, recoveries = message.encode_data(data), options.get("on_failure", ())
        connection = self._declare(message, *(one.handler for one in recoveries))
        sequential = options.get("sequential", True)
        is_goal = message.message_class.is_goal
        flags, constraints = self._ordering.place(
            connection.session.epoch, is_goal=is_goal, sequential=sequential
        )
        constraints += options.get("constraints", ())
        for name, flag in _FLAGS.items():
            if options.get(name):
                flags |= flag
        if delay := options.get("delay"):
            constraints.append(not_before(THIS, delay))
        header = Send(
            0,
            message.name,
            self._parent,
            self._origin,
            flags,
            constraints,
            options.get("priority", 0),
            attachments=[one.attachment for one in recoveries],
            deadline=options.get("deadline") or 0,
            if_handled=handled,
            keep=options.get("keep", False),
            suspended=options.get("suspended", False),
        )
        if not handled:
            task_id = connection.send_task(header, body, message.title)
        elif not (task_id := TaskId(connection.call(header, message.title, body))):
            return None
        self._ordering.add(task_id, sequential=sequential)
        self._sent.append((connection.transport.time(), message.name, task_id))
        return SentTask(connection, message, task_id, self._origin)

    def under(self, task: TaskRef) -> "Sender":
        """A Sender for monitors, goals and commands under *task*, which others may handle.

        ::

            walking = user.tasks(WALK)[0]
            user.under(walking).monitor(CUP_GONE, cup, period=0.1)

        A goal or command joins the sequence of the task's children; with ``sequential=False`` it
        waits for none of them. A monitor without an end of its own ends with the task, and a kill
        of the task kills all. Sending raises Refused ("too late") when the task has ended.
        """
        check("under()", TASK, task=task)
        return Sender(node_of(task), self._origin, is_shared=True, connection=self._connection)

    def sequence(self, plan_ahead: int | None = None) -> AbstractContextManager[None]:
        """A block of subtasks, each achieved after the one before. Blocks nest.

        With *plan_ahead*, at most that many are planned beyond the one that is being achieved. With
        0, each is planned only when it may be achieved.
        """
        return self._ordering.sequence(plan_ahead)

    def parallel(self) -> AbstractContextManager[None]:
        """A block of subtasks without order: each comes after those sent before the block; later
        ones wait for all.
        """
        return self._ordering.parallel()

    def constrain(self, *constraints: Constraint) -> None:
        """Add constraints between tasks that exist: all, or with an error none. Raises Refused if
        one comes too late or would close a circle.
        """
        for constraint in constraints:
            check("constrain()", checks.CONSTRAINT, each=constraint)
        if constraints:
            header = Constrain(0, list(constraints), self._origin)
            self._connection().call(
                header, LateText(lambda: f"constraint {', '.join(map(str, constraints))}")
            )

    # --- questions --------------------------------------------------------------------------------

    @overload
    def query(
        self, message: Query[None, R], data: None = None, **options: Unpack[QueryOptions]
    ) -> R: ...
    @overload
    def query(self, message: Query[D, R], data: D, **options: Unpack[QueryOptions]) -> R: ...
    def query(
        self,
        message: Query[Any, R],
        data: Any = None,
        *,
        timeout: float | None = QUERY_TIMEOUT,
        priority: int = 0,
    ) -> R:
        """Ask, and wait for the reply, at most *timeout* seconds (None: for ever).

        Raises QueryFailed if the handler fails, Timeout if no reply comes in time; in a handler
        once TaskKilled if its task is killed, and Stopped if its module ends.
        """
        brief = is_brief("query()", timeout)
        check_class(message, Query)
        try:
            left = self._declare_within(timeout, message)
        except Timeout:
            assert timeout is not None
            raise not_answered(message, timeout, self._connection().silence) from None
        question = self._question(message, data, priority=priority, blocking=True, brief=brief)
        return PendingReply(*question, message).receive_within(left, timeout)

    @overload
    def query_send(
        self, message: Query[None, R], data: None = None, *, priority: int = ...
    ) -> PendingReply[R]: ...
    @overload
    def query_send(
        self, message: Query[D, R], data: D, *, priority: int = ...
    ) -> PendingReply[R]: ...
    def query_send(
        self, message: Query[Any, R], data: Any = None, *, priority: int = 0
    ) -> PendingReply[R]:
        """Ask, and fetch the reply later with ``receive()``, or with ``await`` in an async
        handler.
        """
        return self._ask(message, data, priority)

    def query_notify(
        self,
        message: Query[D, R],
        data: D,
        callback: "Callable[[Sender, R], object]",
        on_failure: "Callable[[Sender, Exception], object] | None" = None,
        *,
        priority: int = 0,
    ) -> Notification[R]:
        """Ask, and have *callback* called with a Sender under the root and the reply, or
        *on_failure* with a Sender and the error that ``query`` would raise.

        They are called in this thread, one at a time, while it waits for central or its next
        message. Errors in them are logged, and so is a failure without *on_failure*.
        """
        check_function("query_notify()", callback, "(sender, reply)")
        if on_failure is not None:
            check_function("query_notify()", on_failure, "(sender, error)")
        pending = self._ask(message, data, priority)
        return Notification(pending, callback, on_failure)

    def _ask(self, message: Query[D, R], data: D, priority: int) -> PendingReply[R]:
        check_class(message, Query)
        return PendingReply(
            *self._question(message, data, priority=priority, is_awaited=False), message
        )

    def _question(
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
        return connection, connection.request(
            header, body, wants_answer=True, is_awaited=is_awaited
        )

    @overload
    def multi_query(
        self, message: MultiQuery[None, R], data: None = None, **options: Unpack[RepliesOptions]
    ) -> list[R]: ...
    @overload
    def multi_query(
        self, message: MultiQuery[D, R], data: D, **options: Unpack[RepliesOptions]
    ) -> list[R]: ...
    def multi_query(
        self,
        message: MultiQuery[Any, R],
        data: Any = None,
        *,
        maximum: int | None = None,
        timeout: float | None = QUERY_TIMEOUT,
    ) -> list[R]:
        """Ask every module that handles the message; the replies in the order they came.

        Ends with *maximum* replies (None: all), when nobody is left who could reply, or after
            *timeout* seconds with
        the replies so far. If nobody replied and somebody failed, raises QueryFailed with the first
        failure and a text that names all; otherwise modules that fail are left out.
        """
        return list(self._ask_all(message, data, maximum, timeout, blocking=True))

    @overload
    def multi_query_send(
        self, message: MultiQuery[None, R], data: None = None, **options: Unpack[RepliesOptions]
    ) -> PendingReplies[R]: ...
    @overload
    def multi_query_send(
        self, message: MultiQuery[D, R], data: D, **options: Unpack[RepliesOptions]
    ) -> PendingReplies[R]: ...
    def multi_query_send(
        self,
        message: MultiQuery[Any, R],
        data: Any = None,
        *,
        maximum: int | None = None,
        timeout: float | None = QUERY_TIMEOUT,
    ) -> PendingReplies[R]:
        """Ask every module that handles the message; iterate over the result to get the replies as
        they come. It ends as ``multi_query`` does; *timeout* counts from now.
        """
        return self._ask_all(message, data, maximum, timeout, blocking=False)

    def _ask_all(
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
        except Timeout:
            unsent = Request(Send(0, message.name), b"", wants_answer=True)
            unsent.is_over = True
            return PendingReplies(self._connection(), unsent, message, 0)
        connection, request = self._question(message, data, blocking=blocking, maximum=maximum or 0)
        return PendingReplies(connection, request, message, left)

    # --- statements -------------------------------------------------------------------------------

    @overload
    def inform(
        self, message: Inform[None], data: None = None, *, wait: float | None = ...
    ) -> None: ...
    @overload
    def inform(self, message: Inform[D], data: D, *, wait: float | None = ...) -> None: ...
    def inform(self, message: Inform[Any], data: Any = None, *, wait: float | None = None) -> None:
        """Tell the one module that handles the message: at most once, in order, without waiting.

        With *wait*, returns when central has taken it, and waits at most so many seconds for room
        where too much waits for the handler. Then raises Refused ("overload"); without *wait* it
        would be dropped.
        """
        self._tell(message, Inform, data, wait)

    @overload
    def broadcast(
        self, message: Broadcast[None], data: None = None, *, wait: float | None = ...
    ) -> None: ...
    @overload
    def broadcast(self, message: Broadcast[D], data: D, *, wait: float | None = ...) -> None: ...
    def broadcast(
        self, message: Broadcast[Any], data: Any = None, *, wait: float | None = None
    ) -> None:
        """Tell every module that handles the message: at most once, in order, without waiting.
        *wait* as for ``inform``, until one of them has room.
        """
        self._tell(message, Broadcast, data, wait)

    def _tell(
        self, message: Message[D, None], kind: type[Message[Any, Any]], data: D, wait: float | None
    ) -> None:
        check_class(message, kind)
        if wait is not None:
            check(message.title, checks.SECONDS_OR_NONE, wait=wait)
        body = message.encode_data(data)
        connection = self._declare(message)
        header = Send(0, message.name, origin=self._origin, flags=Flags.NONE)
        if wait is None:
            connection.post(header, body)
            return
        until, pause = connection.now() + wait, _SHORTEST_PAUSE
        while True:
            try:
                connection.call(header, message.title, body)
            except Refused as error:
                left = until - connection.now()
                if error.refusal is not Refusal.OVERLOAD or left <= 0:
                    raise
            else:
                return
            connection.pause(min(pause, left), message.title)
            pause = min(2 * pause, _LONGEST_PAUSE)

    # --- whatever the class -----------------------------------------------------------------------

    @overload
    def execute(self, message: TaskMessage[None, R], data: None = None) -> SentTask[R]: ...
    @overload
    def execute(self, message: Query[None, R], data: None = None) -> R: ...
    @overload
    def execute(self, message: MultiQuery[None, R], data: None = None) -> list[R]: ...
    @overload
    def execute(self, message: Inform[None] | Broadcast[None], data: None = None) -> None: ...
    @overload
    def execute(self, message: TaskMessage[D, R], data: D) -> SentTask[R]: ...
    @overload
    def execute(self, message: Query[D, R], data: D) -> R: ...
    @overload
    def execute(self, message: MultiQuery[D, R], data: D) -> list[R]: ...
    @overload
    def execute(self, message: Inform[D] | Broadcast[D], data: D) -> None: ...
    def execute(self, message: Any, data: Any = None) -> Any:
        """Send a message of any class as the call for that class does (TCA 8.5: tcaExecute)."""
        check_class(message, *EXECUTED, call="execute")
        return next(
            getattr(self, call) for kind, call in EXECUTED.items() if isinstance(message, kind)
        )(message, data)

    @overload
    def execute_if_handled(
        self, message: TaskMessage[None, R], data: None = None
    ) -> SentTask[R] | None: ...
    @overload
    def execute_if_handled(self, message: Query[None, R], data: None = None) -> R | None: ...
    @overload
    def execute_if_handled(
        self, message: MultiQuery[None, R], data: None = None
    ) -> list[R] | None: ...
    @overload
    def execute_if_handled(
        self, message: Inform[None] | Broadcast[None], data: None = None
    ) -> bool: ...
    @overload
    def execute_if_handled(self, message: TaskMessage[D, R], data: D) -> SentTask[R] | None: ...
    @overload
    def execute_if_handled(self, message: Query[D, R], data: D) -> R | None: ...
    @overload
    def execute_if_handled(self, message: MultiQuery[D, R], data: D) -> list[R] | None: ...
    @overload
    def execute_if_handled(self, message: Inform[D] | Broadcast[D], data: D) -> bool: ...
    def execute_if_handled(self, message: Any, data: Any = None) -> Any:
        """Send a message only if somebody handles it now; central decides and sends in one step
        (TCA 8.5:
        tcaMaybeExecute).

        Returns what ``execute`` does, or None if nobody handles the message; of an inform or
        broadcast, whether it was sent. The handler may still be lost afterwards.
        """
        check_class(message, *EXECUTED, call="execute_if_handled")
        if isinstance(message, TaskMessage):
            return self._task_if(message, data, {}, handled=True)
        if isinstance(message, Query | MultiQuery):
            return self._ask_if_handled(message, data)
        body = message.encode_data(data)
        header = Send(0, message.name, origin=self._origin, flags=Flags.NONE, if_handled=True)
        return bool(self._declare(message).call(header, message.title, body))

    def _ask_if_handled(
        self, message: Query[D, R] | MultiQuery[D, R], data: D
    ) -> R | list[R] | None:
        connection, request = self._question(message, data, blocking=True, if_handled=True)
        is_over = connection.wait(request, QUERY_TIMEOUT, message.title)
        if request.accepted is not None:  # instead of answered: it was not sent
            return None
        if isinstance(message, MultiQuery):
            return list(PendingReplies(connection, request, message, 0))
        if not is_over:
            raise not_answered(message, QUERY_TIMEOUT, connection.give_up(request))
        return PendingReply(connection, request, message).receive()
