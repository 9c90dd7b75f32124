"""Sender: the calls that send messages, the same for a handler's Task, a Module and a Client."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Annotated, Any, TypedDict, Unpack, overload

from tca_module import checks
from tca_module.checks import (
    EXECUTED,
    check,
    check_class,
    check_function,
    check_options,
    checked_call,
)
from tca_module.errors import MisuseError, Refused
from tca_module.sending.attachments import Recovery
from tca_module.sending.questions import QuestionServices
from tca_module.sending.replies import Notification
from tca_module.sending.task_ref import SentTask, TaskRef, tree_id_of
from tca_module.sending.watching import TASK, WatchingServices
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
    Retry,
    TaskMessage,
)
from tca_wire.packets.headers import Constrain, Send
from tca_wire.points import THIS, TaskId
from tca_wire.text.measures import counted
from tca_wire.vocabulary import Refusal

# Seconds between two attempts to send a message for which there was no room.
SHORTEST_PAUSE, LONGEST_PAUSE = 0.01, 0.1

_RECOVERIES = checks.list_of(
    "a list of recoveries, such as [Recovery(COLLISION, RAISE_LEG)]",
    checks.instance_of("a recovery", Recovery),
)


_NO_RETRY = Retry(1)
"""The policy of a task that is not retried, although its message declares retries."""

_RETRY = checks.instance_of("a Retry, such as Retry(3)", Retry).or_none(" for no retry")


class TaskOptions(TypedDict, total=False):
    """The options of a new goal or command.

    Args:
        sequential: the task is achieved after its previous sibling (SEQ_ACH). Default: True.
        sequential_planning: the task is planned after its previous sibling has been planned
            (SEQ_PLANNING). Default: False.
        plan_first: the whole task is planned before any part of it is achieved (PLAN_FIRST).
            Default: False.
        delay_planning: the task is planned only when it may be achieved (DELAY_PLANNING). Default:
            False.
        priority: -1,000,000 to 1,000,000; the highest is first at a busy resource. Default: 0.
        constraints: more constraints, in which ``this`` stands for the new task. Default: none.
        on_failure: exception handlers of the new task; the last one is asked first. Default: none.
        deadline: seconds, above 0. If the task is not achieved in that time, the failure "timeout"
            is raised on it. Default: None, no bound.
        delay: the seconds from now until the earliest start of the task. Default: 0.
        keep: retain the task's data, outcome and place in the tree after its end, as ``keep()``
            does. Default: False.
        retry: how central retries the task if it fails. Default: the ``Retry`` of its declaration.
        suspended: create the task suspended; it starts after ``resume()``. To order it with other
            tasks, add the constraints before ``resume()``. Default: False.
    """

    sequential: Annotated[bool, checks.FLAG, True]
    sequential_planning: Annotated[bool, checks.FLAG, False]
    plan_first: Annotated[bool, checks.FLAG, False]
    delay_planning: Annotated[bool, checks.FLAG, False]
    priority: Annotated[int, checks.PRIORITY, 0]
    constraints: Annotated[Sequence[Constraint], checks.CONSTRAINTS, ()]
    on_failure: Annotated[Sequence[Recovery], _RECOVERIES, ()]
    deadline: Annotated[float | None, checks.DURATION_OR_NONE, None]
    delay: Annotated[float, checks.SECONDS, 0]
    keep: Annotated[bool, checks.FLAG, False]
    retry: Annotated[Retry | None, _RETRY, ...]
    suspended: Annotated[bool, checks.FLAG, False]


_FLAGS = {
    "sequential_planning": Flags.SEQ_PLANNING,
    "plan_first": Flags.PLAN_FIRST,
    "delay_planning": Flags.DELAY_PLANNING,
}
"""The options that central knows as flags, for constraints with the last sibling or between the
task's own points."""


class Sender(WatchingServices, QuestionServices):
    """An object that sends messages. Task, Module, Client and Callback are Senders.

    A Task sends goals and commands as subtasks of the task being handled. The others send them as
    top-level tasks, under the root.
    """

    # --- tasks ------------------------------------------------------------------------------------

    @overload
    def goal(
        self, message: Goal[None], data: None = None, **options: Unpack[TaskOptions]
    ) -> SentTask[None]: ...
    @overload
    def goal(self, message: Goal[D], data: D, **options: Unpack[TaskOptions]) -> SentTask[None]: ...
    @checked_call
    def goal(
        self, message: Goal[Any], data: Any = None, **options: Unpack[TaskOptions]
    ) -> SentTask[None]:
        """Send a goal: a task that its handler expands into subtasks. Returns at once.

        Args:
            message: the Goal.
            data: its data. Default: None, for a goal without data.
            options: see ``TaskOptions``: sequential, sequential_planning, plan_first,
                delay_planning, priority, constraints, on_failure, retry, deadline, delay, keep,
                suspended.

        Returns:
            The SentTask: wait for it, follow it, cancel it, or use its points in constraints.

        Raises:
            BadData: *data* does not fit the message.
            FormatRefused: other programs declare the message differently.
            Refused: central can't accept the task, for example because its constraints can never be
                met. The error is raised by the first use of the task, such as ``task.id``, or by
                the next call of this Sender. Without either, the sending handler fails with this
                error when it returns.
            CentralLost: central does not answer.
            MisuseError: an option is wrong.

        Example::

            walk = user.goal(WALK, path, deadline=60)
            walk.wait()
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
    @checked_call
    def command(
        self, message: Command[Any, R], data: Any = None, **options: Unpack[TaskOptions]
    ) -> SentTask[R]:
        """Send a command: a task that acts. Returns at once.

        Args:
            message: the Command.
            data: its data. Default: None, for a command without data.
            options: see ``TaskOptions``; the same as those of ``goal``.

        Returns:
            The SentTask; its ``result()`` waits for the end and returns the handler's result.

        Raises:
            BadData: *data* does not fit the message.
            FormatRefused: other programs declare the message differently.
            Refused: central can't accept the task. The error is raised later, see ``goal``.
            CentralLost: central does not answer.
            MisuseError: an option is wrong.

        Example::

            with task.parallel():
                left = task.command(MOVE_LEG, 1)
                right = task.command(MOVE_LEG, 2)
            print(left.result(timeout=10), right.result(timeout=10))
        """
        check_class(message, Command)
        return self._task(message, data, options)

    def _task(self, message: TaskMessage[D, R], data: D, options: TaskOptions) -> SentTask[R]:
        task = self._send_task(message, data, options, must_be_handled=False)
        assert task is not None
        return task

    def _send_task(
        self, message: TaskMessage[D, R], data: D, options: TaskOptions, *, must_be_handled: bool
    ) -> SentTask[R] | None:
        """Send a task and return it. Returns None if it *must_be_handled* but has no handler."""
        if options:
            check_options(message.title, options, TaskOptions)
        body, recoveries = message.encode_data(data), options.get("on_failure", ())
        retry = (options["retry"] or _NO_RETRY) if "retry" in options else None
        needs = retry.needs if retry is not None else ()
        connection = self._declare(message, *(one.handler for one in recoveries), *needs)
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
            attachments=[recovery.attachment for recovery in recoveries],
            deadline=options.get("deadline") or 0,
            if_handled=must_be_handled,
            keep=options.get("keep", False),
            suspended=options.get("suspended", False),
            retry=retry.policy_for(message) if retry is not None else None,
        )
        if not must_be_handled:
            task_id = connection.send_task(header, body, message.title)
        elif not (task_id := TaskId(connection.call(header, message.title, body))):
            return None
        self._ordering.add(task_id, sequential=sequential)
        self._sent.append((connection.transport.time(), message.name, task_id))
        return SentTask(connection, message, task_id, self._origin)

    def under(self, task: TaskRef) -> "Sender":
        """Return a Sender for monitors, goals and commands under *task*, anywhere in the tree.

        A goal or command joins the sequence of the task's children. With ``sequential=False`` it
        waits for none of them. A monitor without a bound of its own ends with *task*. A kill of
        *task* also kills everything that was sent under it. A send raises Refused ("too late") if
        *task* has ended.

        Args:
            task: a task that was sent or found.

        Returns:
            The Sender.

        Raises:
            MisuseError: *task* is no task.

        Example::

            walking = user.tasks(WALK)[0]
            user.under(walking).monitor(CUP_GONE, cup, period=0.1)
        """
        check("under()", TASK, task=task)
        return Sender(tree_id_of(task), self._origin, is_shared=True, connection=self._connection)

    def sequence(self, plan_ahead: int | None = None) -> AbstractContextManager[None]:
        """Start a ``with`` block of subtasks that are achieved one after the other.

        Blocks nest: a block counts as one element of the block around it.

        Args:
            plan_ahead: the most elements that are planned beyond the element being achieved. With
                0, each element is planned only when it may be achieved. Default: None, any number.

        Returns:
            The block.

        Raises:
            MisuseError: *plan_ahead* is negative.

        Example::

            with task.sequence(plan_ahead=1):
                for row in range(rows):
                    task.goal(MOW_ROW, row)
        """
        return self._ordering.sequence(plan_ahead)

    def parallel(self) -> AbstractContextManager[None]:
        """Start a ``with`` block of subtasks that have no order among themselves.

        All of them come after the subtasks sent before the block. Later subtasks wait for all of
        them.

        Returns:
            The block.

        Example::

            with task.parallel():
                task.command(OPEN_GRIPPER)
                task.command(MOVE_ARM, place)
            task.command(CLOSE_GRIPPER)  # after both
        """
        return self._ordering.parallel()

    def constrain(self, *constraints: Constraint) -> None:
        """Add constraints between existing tasks. If one constraint is refused, none is added.

        Args:
            constraints: constraints such as ``a.achieving.end + 0.3 <= b.achieving.start``.

        Raises:
            Refused: a constraint comes "too late", or would close a cycle.
            CentralLost: central does not answer.
            MisuseError: an argument is no constraint.

        Example::

            task.constrain(warm_up.achieving.end <= flash.achieving.start)
        """
        for constraint in constraints:
            check("constrain()", checks.CONSTRAINT, each=constraint)
        if constraints:
            header = Constrain(0, list(constraints), self._origin)
            self._connection().call(header, f"adding {counted(len(constraints), 'constraint')}")

    # --- questions --------------------------------------------------------------------------------

    def query_notify(
        self,
        message: Query[D, R],
        data: D,
        callback: "Callable[[Sender, R], object]",
        on_failure: "Callable[[Sender, Exception], object] | None" = None,
        *,
        priority: int = 0,
    ) -> Notification[R]:
        """Send a query, and have a function called with its reply.

        This thread makes the calls, one at a time, while it waits for central or for its next
        message. An error in a function is logged. Without *on_failure*, a failure of the query is
        logged, too.

        Args:
            message: the Query.
            data: its data; None for a query without data.
            callback: a plain function that takes (sender, reply); the Sender sends under the root.
            on_failure: a plain function that takes (sender, error), with the error that ``query``
                would raise. Default: None.
            priority: the query with the highest is first at a busy resource. Default: 0.

        Returns:
            A Notification, with ``wait()`` and ``cancel()``.

        Raises:
            MisuseError: a function takes other arguments, or is ``async def``.
            BadData: *data* does not fit the message.
            FormatRefused: other programs declare the message differently.
            CentralLost: central does not answer.

        Example::

            def too_hot(sender: Sender, degrees: float) -> None:
                if degrees > 80:
                    sender.command(COOL_DOWN)

            task.query_notify(TEMPERATURE, None, too_hot)
        """
        check_function("query_notify()", callback, "(sender, reply)")
        if on_failure is not None:
            check_function("query_notify()", on_failure, "(sender, error)")
        pending = self.query_send(message, data, priority=priority)
        return Notification(pending, callback, on_failure)

    # --- statements -------------------------------------------------------------------------------

    @overload
    def inform(
        self, message: Inform[None], data: None = None, *, wait: float | None = ...
    ) -> None: ...
    @overload
    def inform(self, message: Inform[D], data: D, *, wait: float | None = ...) -> None: ...
    @checked_call
    def inform(self, message: Inform[Any], data: Any = None, *, wait: float | None = None) -> None:
        """Send an inform to its one handler: at most once, and in order.

        Args:
            message: the Inform.
            data: its data. Default: None, for an inform without data.
            wait: the most seconds to wait for room in the handler's queue. The call then returns
                when central has accepted the message. With None, the call returns at once, and the
                message is dropped if the queue is full. Default: None.

        Raises:
            BadData: *data* does not fit the message.
            FormatRefused: other programs declare the message differently.
            Refused: "overload": with *wait*, there was no room in time.
            CentralLost: central does not answer.

        Example::

            task.inform(BATTERY, 0.8)
            task.inform(LOG_LINE, text, wait=2.0)
        """
        self._send_statement(message, Inform, data, wait)

    @overload
    def broadcast(
        self, message: Broadcast[None], data: None = None, *, wait: float | None = ...
    ) -> None: ...
    @overload
    def broadcast(self, message: Broadcast[D], data: D, *, wait: float | None = ...) -> None: ...
    @checked_call
    def broadcast(
        self, message: Broadcast[Any], data: Any = None, *, wait: float | None = None
    ) -> None:
        """Send a broadcast to every module that handles it: at most once each, and in order.

        Args:
            message: the Broadcast.
            data: its data. Default: None, for a broadcast without data.
            wait: the most seconds to wait for room in a handler's queue. The call then returns when
                at least one handler has room. With None, the call returns at once, and a handler
                whose queue is full does not get the message. Default: None.

        Raises:
            BadData: *data* does not fit the message.
            FormatRefused: other programs declare the message differently.
            Refused: "overload": with *wait*, no handler had room in time.
            CentralLost: central does not answer.

        Example::

            task.broadcast(POSE_CHANGED, pose)
        """
        self._send_statement(message, Broadcast, data, wait)

    def _send_statement(
        self, message: Message[D, None], kind: type[Message[Any, Any]], data: D, wait: float | None
    ) -> None:
        """Send an inform or broadcast; with *wait*, retry until the handler has room."""
        check_class(message, kind)
        if wait is not None:
            check(message.title, checks.SECONDS_OR_NONE, wait=wait)
        body = message.encode_data(data)
        connection = self._declare(message)
        header = Send(0, message.name, origin=self._origin, flags=Flags.NONE)
        if wait is None:
            connection.post(header, body)
            return
        deadline, pause = connection.now() + wait, SHORTEST_PAUSE
        while True:
            try:
                connection.call(header, message.title, body)
            except Refused as error:
                left = deadline - connection.now()
                if error.refusal is not Refusal.OVERLOAD or left <= 0:
                    raise
            else:
                return
            connection.pause(min(pause, left), message.title)
            pause = min(2 * pause, LONGEST_PAUSE)

    # --- messages of any class --------------------------------------------------------------------

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
    @checked_call
    def execute(self, message: Any, data: Any = None) -> Any:
        """Send a message of any class except a monitor (TCA 8.5: tcaExecute).

        Depending on the message's class, this does what ``goal``, ``command``, ``query``,
        ``multi_query``, ``inform`` or ``broadcast`` does.

        Args:
            message: the message.
            data: its data. Default: None, for a message without data.

        Returns:
            The result of the call for the message's class.

        Raises:
            MisuseError: the message's class cannot be sent.
        """
        check_class(message, *EXECUTED, call="execute")
        calls = (call for kind, call in EXECUTED.items() if isinstance(message, kind))
        return getattr(self, next(calls))(message, data)

    @overload
    def execute_if_handled(
        self, message: TaskMessage[None, R], data: None = None, **options: Unpack[TaskOptions]
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
    def execute_if_handled(
        self, message: TaskMessage[D, R], data: D, **options: Unpack[TaskOptions]
    ) -> SentTask[R] | None: ...
    @overload
    def execute_if_handled(self, message: Query[D, R], data: D) -> R | None: ...
    @overload
    def execute_if_handled(self, message: MultiQuery[D, R], data: D) -> list[R] | None: ...
    @overload
    def execute_if_handled(self, message: Inform[D] | Broadcast[D], data: D) -> bool: ...
    @checked_call
    def execute_if_handled(
        self, message: Any, data: Any = None, **options: Unpack[TaskOptions]
    ) -> Any:
        """Send a message only if it has a handler now (TCA 8.5: tcaMaybeExecute).

        Central checks and sends in one step. The handler may still be lost afterwards.

        Args:
            message: the message, of any class that ``execute`` accepts.
            data: its data. Default: None, for a message without data.
            options: for a goal or command, see ``TaskOptions``.

        Returns:
            The result of ``execute``, or None if the message has no handler. For an inform or
            broadcast: True if it was sent.

        Raises:
            MisuseError: the message's class cannot be sent, or an option is wrong.

        Example::

            blinking = user.execute_if_handled(BLINK, "green")
            if blinking is None:
                print("no lamp")
        """
        check_class(message, *EXECUTED, call="execute_if_handled")
        if isinstance(message, TaskMessage):
            return self._send_task(message, data, options, must_be_handled=True)
        if options:
            text = f"has no option {next(iter(options))}: only goals and commands have options"
            raise MisuseError(f"{message.title} {text}")
        if isinstance(message, Query | MultiQuery):
            return self._ask_if_handled(message, data)
        body = message.encode_data(data)
        header = Send(0, message.name, origin=self._origin, flags=Flags.NONE, if_handled=True)
        return bool(self._declare(message).call(header, message.title, body))
