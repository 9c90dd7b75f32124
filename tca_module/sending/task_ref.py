"""A task of the tree, for any program that knows its number, and for its sender."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any, Generic

from tca_module import checks
from tca_module.checks import LateText, check, is_brief
from tca_module.errors import (
    NIL,
    BadData,
    CentralLost,
    TaskFailed,
    TaskKilled,
    Timeout,
)
from tca_module.following.followed_task import (
    FollowedTask,
    decode_progress,
    life_cycle_of,
)
from tca_module.following.observation import ObservedChange, is_progress
from tca_module.link.connection import Connection
from tca_module.sending.attachments import AttachmentRef, Recovery
from tca_module.sending.steerable_task import SteerableTask
from tca_module.session import given_up
from tca_module.session.request import Request
from tca_module.session.sent_tasks import SentId
from tca_wire.messages.controls import ExceptionHandler
from tca_wire.messages.declarations import Failure, Message, R
from tca_wire.messages.formats import decode_untyped
from tca_wire.packets import headers
from tca_wire.points import Point, TaskId, describe_moments
from tca_wire.text.measures import numbered
from tca_wire.vocabulary import Outcome

FIND_IT = "other threads connect() themselves, and find it with task(number)"
"""The remedy for a task that is used in a wrong thread."""

_RESULT_THERE = "the last of its changes() there has the result as data"
_NO_RESULT = "its failure was resolved: the task is done after a failure and has no result"


def tree_id_of(task: "TaskRef") -> TaskId:
    """Return a task's id for requests. Central may not have assigned the id yet."""
    return task._tree_id()  # noqa: SLF001


class TaskNode(SteerableTask):
    """A task of the tree, with its relatives."""

    def parent(self) -> "TaskRef | None":
        """Return the parent of the task; None for a top-level task, or if the task has ended."""
        return next(iter(self._relatives("parent")), None)

    def children(self, message: Message[Any, Any] | str | None = None) -> "list[TaskRef]":
        """Return the living children of the task, oldest first.

        Args:
            message: only tasks of this message or name. Default: None, all.

        Example::

            for step in walk.children(MOVE_LEG):
                print(step.state)
        """
        return self._relatives("children", message)

    def ancestors(self, message: Message[Any, Any] | str | None = None) -> "list[TaskRef]":
        """Return the tasks above this one, nearest first.

        Args:
            message: only tasks of this message or name. Default: None, all.
        """
        return self._relatives("ancestors", message)

    def descendants(self, message: Message[Any, Any] | str | None = None) -> "list[TaskRef]":
        """Return the living tasks under this one, parents before children.

        Args:
            message: only tasks of this message or name. Default: None, all.
        """
        return self._relatives("descendants", message)

    def kept(self, message: Message[Any, Any] | str | None = None) -> "list[TaskRef]":
        """Return the retained tasks that have ended under this task, in the order of their ends.

        Args:
            message: only tasks of this message or name. Default: None, all.
        """
        return self._relatives("kept", message)

    def _relatives(
        self, relation: Any, message: Message[Any, Any] | str | None = None
    ) -> "list[TaskRef]":
        """Return the tasks in a *relation* to this one, of one *message* or name only."""
        return [
            TaskRef(self._connection(), info.message, info.id, self._origin)
            for info in self._inspect(relation, message)
        ]


class TaskRef(TaskNode, FollowedTask["Change"]):
    """A task of the tree: wait for it, follow it, steer it, inspect it.

    ``user.tasks()`` and ``user.task()`` find tasks. A TaskRef belongs to the thread that sent or
    found the task. Other threads connect themselves, and find the task by its number.

    ``kill``, ``deadline``, ``fail``, ``retry``, ``suspend`` and ``resume`` return True if they took
    effect, False if the task had ended. ``on_failure``, ``on_termination`` and ``keep`` have their
    effect later. They raise Refused ("too late") if the task had ended.

    Attributes:
        message: the name of the task's message.

    Example::

        for walking in user.tasks(WALK):
            walking.kill("the battery is low")
            print(walking.wait(timeout=10))
    """

    def __init__(
        self, connection: Connection, message: str, task_id: TaskId, origin: int = 0
    ) -> None:
        super().__init__(task_id)
        self._link = connection
        self.message = message
        self._origin = origin
        self._end: tuple[headers.Answer, bytes] | None = None  # how the task ended, if known

    def __repr__(self) -> str:
        return numbered(self.message or "task", self.id)

    @property
    def id(self) -> TaskId:
        """The task's number, as in the journal.

        For a task that was just sent, the first use waits until central has assigned the number. It
        raises Refused if central refused the task.
        """
        if isinstance(self._task_id, SentId):
            self._task_id = TaskId(self._task_id.assigned_id)
        return self._task_id

    @property
    def _description(self) -> str:
        """The task in words, with the id if that is known. Never waits for the id."""
        task = self._task_id
        return task.what if isinstance(task, SentId) else str(self)

    def _connection(self) -> Connection:
        self._link.check_thread(self, "sent or found it", f"{FIND_IT}; {_RESULT_THERE}")
        return self._link

    def _as_change(self, observed: ObservedChange) -> "Change":
        return Change(observed, self, self._link.declared(self.message))

    # --- its end ----------------------------------------------------------------------------------

    def wait(self, timeout: float | None = None) -> Outcome:
        """Wait until the task has ended, and return its outcome.

        Args:
            timeout: the most seconds to wait. Default: None, no bound. It does not interrupt a
                message that this thread handles within the wait: the wait ends after that message.
                The option ``deadline=`` of a task ends it in time.

        Returns:
            ``Outcome.DONE``, ``FAILED``, ``KILLED`` or ``RESOLVED``. ``RESOLVED`` means *done after
            a failure*: an exception handler has resolved the failure.

        Raises:
            Timeout: the task has not ended in time; the text says what the task waits for.
            Refused: central refused the task; or "too late": central has forgotten the outcome.
            Deadlock: in a handler: the wait would never end.
            CentralLost: central does not answer, or has forgotten the task.
            TaskKilled: in a handler, once: the handler's own task was killed.
            Stopped: in a handler, once: the handler's module ends.

        Example::

            if user.goal(WALK, path).wait(timeout=60) is Outcome.FAILED:
                print("the walk failed")
        """
        return self._await_end(timeout)[0].outcome

    def wait_for(self, point: Point, timeout: float | None = None) -> Outcome:
        """Wait until a point of this task or of another task is reached.

        A killed task reaches all its points at once.

        Args:
            point: the point, such as ``leg.handling.end``.
            timeout: the most seconds to wait, as for ``wait``. Default: None, no bound.

        Returns:
            The outcome of the point's task at that time: ``Outcome.DONE`` if the task has neither
            failed nor been killed.

        Raises:
            Timeout: the point was not reached in time.
            Refused, Deadlock, CentralLost, TaskKilled, Stopped: as for ``wait``.

        Example::

            leg.wait_for(leg.handling.end, timeout=5)
        """
        return self._await_point(point, timeout)[0].outcome

    def _await_end(self, timeout: float | None) -> tuple[headers.Answer, bytes]:
        """Wait until the task has ended, and return central's answer."""
        if self._end is None:
            self._end = self._await_point(self.achieving.end, timeout)
            if self._mirror is not None:
                self._mirror.receive_end()
        return self._end

    def _await_point(self, point: Point, timeout: float | None) -> tuple[headers.Answer, bytes]:
        """Wait until a point is reached, and return central's answer."""
        brief = is_brief(self._action("the wait for"), timeout)
        request = self._request_point(point, blocking=True, brief=brief, is_awaited=True)
        with self._recalled_if_lost():
            what = LateText(lambda: f"the wait for {self._describe_point(point)}")
            self._connection().wait(request, timeout, what)
        return self._point_answer(request, point, timeout)

    def _point_answer(
        self, request: Request, point: Point, timeout: float | None
    ) -> tuple[headers.Answer, bytes]:
        """Return the answer to a wait for a point. Raises Timeout if there is none yet."""
        if not request.is_over:
            why = self._connection().abandon_late(request)
            text = f"{self._describe_point(point)} was not reached within {timeout:g} s"
            raise Timeout(f"{text}: {why}" if why else text, can_wait=True)
        return request.answers[-1]

    @contextmanager
    def _recalled_if_lost(self) -> Iterator[None]:
        """Return a block for a wait for the task. It gives up the task if central is lost.

        A task is given up only if central has not acknowledged it. Central then kills the task.
        """
        try:
            yield
        except CentralLost as error:
            task = self._task_id
            if not isinstance(task, SentId):
                raise
            self._link.session.sends.discard(task.request)
            if task.request.is_over:
                raise
            self._link.abandon(task.request)
            fate = f"{task.what} {given_up.fate_of(self._link.session, task.request)}"
            raise CentralLost(f"{error}; {fate}") from None

    def _request_point(
        self,
        point: Point,
        *,
        blocking: bool,
        brief: bool = False,
        is_awaited: bool = False,
        lends_slot: bool = False,
    ) -> Request:
        """Ask central to report when a point is reached."""
        check(self._action("the wait for"), checks.POINT, point=point)
        header = headers.AwaitPoint(0, point, self._origin, blocking, brief, lends_slot)
        return self._connection().request(header, wants_answer=True, is_awaited=is_awaited)

    def _describe_point(self, point: Point) -> str:
        """Return a point in words. Never waits for the id of the point's task."""
        if isinstance(point.task, SentId) and not point.task.request.is_over:
            return f"{describe_moments(point.moment)[0]} of {point.task.what}"
        if point.task != self._tree_id():
            return str(point)
        return f"{describe_moments(point.moment)[0]} of {self!r}"

    # --- failures ---------------------------------------------------------------------------------

    def on_failure(
        self,
        failure: Failure[Any] | None,
        handler: ExceptionHandler[Any],
        *,
        maximum: int | None = None,
    ) -> AttachmentRef:
        """Attach an exception handler, for failures of the task and of the tasks below it.

        Args:
            failure: the failure that *handler* handles; None for any failure.
            handler: the ExceptionHandler. It must accept the failure's data, see
                ``Sender.on_failure``.
            maximum: how often *handler* may be called for this task. Default: None, any number.

        Returns:
            The AttachmentRef; its ``remove()`` detaches the handler.

        Raises:
            Refused: "too late": the task has ended.
            MisuseError: *handler* can't accept the failure's data.
            CentralLost: central does not answer, or has forgotten the task.

        Example::

            leg = task.command(MOVE_LEG, 3)
            leg.on_failure(COLLISION, RAISE_LEG, maximum=2)
        """
        attachment = Recovery(failure, handler, maximum=maximum).attachment
        self._connection().declare(handler)
        header = headers.Attach(0, attachment, self._tree_id(), origin=self._origin)
        number = self._connection().call(header, self._action(f"attaching '{handler.name}' to"))
        return AttachmentRef(self._connection(), number, header)


class Change:
    """A change of a task's state, as an observer sees it.

    If *is_late*, there was no change: this is the state that the observer found.

    Attributes:
        task: the task.
        message: the name of the task's message.
        serial: the number of changes of the task's state, this change included.
        state: the task's state after the change; "" if the task ended while this program had no
            connection.
        transition: the transition that led to the state; "" if *is_late*.
        by: the ``Party`` that made the transition: client, server or central.
        module: the module of that client or server.
        text: the reason, for people.
        is_late: whether this is the state that the observer found, and not a change.
        is_over: whether the task has ended.
        outcome: the task's ``Outcome`` if the task has ended and the outcome is known; else None.
        missed: the number of changes directly before this one that the iteration does not show.
    """

    def __init__(
        self, observed: ObservedChange, task: TaskRef, message: Message[Any, Any] | None
    ) -> None:
        change = observed.change
        self.task = task
        self.message = change.message
        self.serial = change.serial
        self.state = change.state
        self.transition = change.transition
        self.by = change.by
        self.module = change.module
        self.text = change.text
        self.is_late = change.is_late
        self.is_over = change.is_over
        self.outcome = change.outcome
        self.missed = observed.missed
        self._observed = observed
        self._message = message

    def __repr__(self) -> str:
        transition = f" ({self.transition})" if self.transition else ""
        return f"{self.task}: {self.state}{transition}"

    @cached_property
    def goal(self) -> Any:
        """The task's data; plain values if the task's message is not declared here."""
        return self._goal_of(self._observed.change.goal)

    @cached_property
    def data(self) -> Any:
        """The data of the change; None for a change without data.

        After a client's request, this is the new goal. After an intermediate result, it is that
        result. If *is_late*, it is the newest intermediate result. At the end of the task, it is
        the task's result, or the data of the task's failure.
        """
        data, message = self._observed.change.data, self._message
        if is_progress(self._observed):
            return decode_progress(message, data)
        if not self.is_over:
            return self._goal_of(data)
        if message is not None and data and self.state in life_cycle_of(message).successes:
            return message.decode_reply(data)
        return decode_untyped(data)

    def _goal_of(self, data: bytes) -> Any:
        if self._message is not None and data:
            return self._message.decode_data(data)
        return decode_untyped(data)


def change_of(connection: Connection, observed: ObservedChange, origin: int = 0) -> Change:
    """Return a change of any task's state, as an observer sees it."""
    name = observed.change.message
    task = TaskRef(connection, name, observed.task, origin)
    return Change(observed, task, connection.declared(name))


class SentTask(TaskRef, Generic[R]):
    """A task that was sent; ``goal()`` and ``command()`` return it.

    Use its points, such as ``sent.achieving.end``, in constraints. In an async handler ``await
    sent`` returns the result, as ``sent.result()`` does; ``asyncio.timeout`` limits that wait.

    Example::

        footfall = user.command(MOVE_LEG, 3).result(timeout=10)
    """

    def __init__(
        self, connection: Connection, message: Message[Any, R], task_id: TaskId, origin: int
    ) -> None:
        super().__init__(connection, message.name, task_id, origin)
        self._message = message

    def result(self, timeout: float | None = None) -> R:
        """Wait until the task has ended, and return the handler's result.

        A task that is *done after a failure* has the result of the fallback that replaced it, if
        that has the same type. Otherwise it has no result: ``result()`` returns None, or raises
        TaskFailed if the message declares a result.

        A handler that catches TaskFailed of its subtask does not stop the failure: an exception
        handler or a fallback does.

        Args:
            timeout: the most seconds to wait, as for ``wait``. Default: None, no bound.

        Returns:
            The result; None for a goal.

        Raises:
            TaskFailed: the task failed; the error has the failure's name and data.
            TaskKilled: the task was killed; or, in a handler, once: the handler's own task was.
            Timeout: the task has not ended in time.
            Refused: central refused the task.
            BadData: central no longer retains the result.
            Deadlock, CentralLost, Stopped: as for ``wait``.

        Example::

            patient = Retry(3, otherwise=STAND_STILL)
            footfall = task.command(MOVE_LEG, 3, retry=patient).result(timeout=10)
        """
        is_news = self._end is None
        answer, body = self._await_end(timeout)
        if is_news and not answer.outcome.lets_successors_continue:
            self._connection().mark_notified()
        return self._result(answer, body)

    def __await__(self) -> Generator[Any, None, R]:
        if self._end is None:
            point = self.achieving.end
            request = self._request_point(point, blocking=False, lends_slot=True)
            with self._recalled_if_lost():
                what = LateText(lambda: f"the wait for {self._describe_point(point)}")
                yield from self._connection().wait_in_coroutine(request, what)
            self._end = request.answers[-1]
            if self._mirror is not None:
                self._mirror.receive_end()
        return self._result(*self._end)

    def _result(self, answer: headers.Answer, body: bytes) -> R:
        """Return the result in an answer, or raise the error that the answer reports."""
        if answer.outcome is Outcome.FAILED:
            raise TaskFailed(repr(self), answer.failure, answer.text, body)
        if answer.outcome is Outcome.KILLED:
            raise TaskKilled(repr(self), answer.text)
        has_result = self._message.reply.kind is not type(None)
        if answer.outcome is Outcome.RESOLVED and has_result and not body:
            first, newline, rest = answer.text.partition("\n")
            text = (f"{first} ({_NO_RESULT})" if first else _NO_RESULT) + newline + rest
            raise TaskFailed(repr(self), answer.failure, text, b"")
        try:
            return self._message.decode_reply(body or NIL)
        except BadData as error:
            if body:
                raise
            what = f"central no longer retains the result of {self}"
            raise BadData(f"{what}: call result() sooner after its end ({error})") from None
