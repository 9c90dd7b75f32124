"""A task of the tree, as anybody who knows its number can use it, and as its sender can."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any, Generic, NamedTuple, overload

import msgspec

from tca_module import checks
from tca_module.checks import LateText, check, check_class, check_message, is_brief
from tca_module.errors import (
    NIL,
    BadData,
    CentralLost,
    MisuseError,
    TaskFailed,
    TaskKilled,
    Timeout,
)
from tca_module.following.followed_task import (
    FollowedTask,
    NamedTask,
    decode_progress,
    life_cycle_of,
)
from tca_module.following.observation import News, is_progress
from tca_module.link.connection import Connection
from tca_module.sending.attachments import AttachmentRef, Recovery
from tca_module.sending.task_points import TaskIntervals
from tca_module.session import given_up
from tca_module.session.epoch_numbers import with_epoch
from tca_module.session.request import Request
from tca_module.session.sent_tasks import SentId
from tca_wire.messages.controls import ExceptionHandler
from tca_wire.messages.declarations import Command, D, Failure, FailureRaised, Goal, Message, R
from tca_wire.messages.formats import decode_untyped
from tca_wire.packets import headers
from tca_wire.points import Point, TaskId, describe_moments
from tca_wire.text.measures import numbered
from tca_wire.vocabulary import Outcome, Scope


class TaskInfo(NamedTuple):
    """The state of a task, or the end of a kept one."""

    id: TaskId
    message: str
    message_class: str
    parent: TaskId
    reached: list[str]
    """Its moments that are past, in words."""
    held: dict[str, int]
    """The moments that constraints hold back, and how many of them."""
    module: str
    """The module whose handler has it now."""
    suspended: bool
    killed: str
    failure: str
    data: bytes
    outcome: str
    """"" while it lives; of an ended one that is kept an ``Outcome``: "done", "done after a
    failure", ...
    """
    result: bytes
    """The handler's result, or the failure's data, of an ended task."""

    @classmethod
    def known_from(cls, row: dict[str, Any], epoch: str) -> "TaskInfo":
        """From a row of the answer of that central."""
        task = with_epoch(row["task"], epoch, numbered(row["message"], row["task"]))
        parent = with_epoch(row["parent"], epoch, numbered("task", row["parent"]))
        return cls(
            task, row["message"], row["class"], parent, *(row[key] for key in cls._fields[4:])
        )


FIND_IT = "in other threads connect(), and use task(number) of that"
"""The remedy for a task that is used in a wrong thread."""

_NO_RESULT = (
    "an exception handler resolved it, so the task is done after a failure and has no result"
)
_RELATIONS = {"self": "state", "kept": "kept tasks"}


def node_of(task: "TaskRef") -> TaskId:
    """A task as requests name it: its id may yet be unknown."""
    return task._node()  # noqa: SLF001


class SteerableTask(TaskIntervals, NamedTask):
    """A task of the tree that can be steered, by its handler too: kill, suspend or retry it, look
    at its relatives.

    ``kill``, ``deadline``, ``fail``, ``retry``, ``suspend`` and ``resume`` return True if they took
    effect, False if the task had ended. Promises for later (``on_termination``, ``keep``) raise
    Refused ("too late").
    """

    @property
    def id(self) -> TaskId:
        """The task's number, as in the journal."""
        return self._task_id

    # --- stopping ---------------------------------------------------------------------------------

    def kill(
        self,
        why: str = "",
        *,
        delay: float = 0,
        after: Point | None = None,
        scope: Scope = Scope.TASK,
    ) -> bool:
        """End the task and everything under it: at once, *delay* seconds from now, or *after* a
        point. Another *scope* ends only what is under it, or its siblings (TDL: TERMINATE AT, IN,
        AFTER).

        Running handlers are told and woken from their waits, but not interrupted. Returns False if
        the task had ended; a killed task whose handler still runs has not.
        """
        what = self._doing("killing")
        check(what, checks.TEXT, why=why)
        check(what, checks.SECONDS, delay=delay)
        check(what, checks.SCOPE, scope=scope)
        check(what, checks.POINT_OR_NONE, after=after)
        return self._steer(
            headers.Kill(0, self._node(), why, scope, after, delay, origin=self._origin), "killing"
        )

    @overload
    def on_termination(
        self, message: Goal[None] | Command[None, Any], data: None = None
    ) -> None: ...
    @overload
    def on_termination(self, message: Goal[D] | Command[D, Any], data: D) -> None: ...
    def on_termination(self, message: Goal[Any] | Command[Any, Any], data: Any = None) -> None:
        """Send *message* if the task is killed after its start, to leave things safe (TDL: ON
        TERMINATE).

        It is sent at once and may run beside handlers that have yet to return, unless both share a
        resource of capacity 1. The tasks that follow wait for it. Raises Refused ("too late") if
        the task has ended.
        """
        check_class(message, Goal, Command, call="on_termination")
        body = message.encode_data(data)
        header = headers.Send(0, message.name, self._node(), self._origin, when_killed=True)
        self._connection().declare(message)
        self._connection().call(header, self._doing("on termination of"), body)

    def deadline(self, seconds: float, point: Point | None = None) -> bool:
        """Raise the failure "timeout" on the task if *point* (its end) is not reached within
        *seconds* from now.

        Every deadline counts: a later one extends nothing. Returns False if the point's task had
            ended or been killed.
        """
        what = self._doing("a deadline of")
        check(what, checks.DURATION, seconds=seconds)
        check(what, checks.POINT_OR_NONE, point=point)
        header = headers.Deadline(0, point or self.achieving.end, seconds, self._origin)
        return self._steer(header, "a deadline of")

    # --- failures ---------------------------------------------------------------------------------

    def fail(self, failure: FailureRaised) -> bool:
        """Raise a failure on the task from outside: ``ref.fail(COLLISION(contact))``. A running
        handler goes on. Returns False if the task had ended or been killed.
        """
        if not isinstance(failure, FailureRaised):
            hint = (
                f"'{failure.name}' is only declared, call it"
                if isinstance(failure, Failure)
                else "COLLISION(data)"
            )
            raise MisuseError(f"fail() takes a failure with its data, not {failure!r:.60}: {hint}")
        header = headers.Raise(
            0, self._node(), failure.name, failure.text, failure.kinds, self._origin
        )
        return self._steer(header, f"raising '{failure.name}' on", failure.body)

    @overload
    def retry(self, message: Message[None, Any] | None = None, data: None = None) -> bool: ...
    @overload
    def retry(self, message: Message[D, Any], data: D) -> bool: ...
    def retry(self, message: Message[Any, Any] | None = None, data: Any = None) -> bool:
        """Kill all under the task, except monitors of others, and handle it again, when that and
        the calling exception handler have ended. With its *message* it gets new *data*. Returns
        False if the task had ended or been killed.
        """
        if message is not None:
            check_message(message)
        elif data is not None:
            raise MisuseError(
                f"a retry of {self}: data needs its message, too: retry(MESSAGE, data)"
            )
        if message is not None and message.name != self.message:
            raise MisuseError(f"{self} can't be retried with data of '{message.name}'")
        body = message.encode_data(data) if message is not None else b""
        header = headers.Retry(0, self._node(), message is not None, self._origin)
        return self._steer(header, "a retry of", body)

    # --- suspending -------------------------------------------------------------------------------

    def suspend(self) -> bool:
        """Start nothing more of the task and its subtasks. Handlers are told. False if the task had
        ended.
        """
        return self._steer(headers.Suspend(0, self._node(), origin=self._origin), "suspending")

    def resume(self) -> bool:
        """Let a suspended task go on; does no harm to one that was not. Returns False if the task
        had ended.
        """
        return self._steer(
            headers.Suspend(0, self._node(), resume=True, origin=self._origin), "resuming"
        )

    # --- kept tasks -------------------------------------------------------------------------------

    def keep(self) -> None:
        """Remember the task after its end (TCM: SetPersistence; TDL: PERSISTENT), until
        ``release()``, until this module leaves, or until the task above is forgotten: ``info()``,
        ``data()``, ``wait()`` and ``parent()`` still answer, and ``kept()`` of the task above lists
        it. Its constraints and the tasks under it are not kept.

        At most 10,000 tasks, living ones too, may be kept; Refused ("overload") for one more, ("too
        late") if the task has ended. Beyond 64 MiB the oldest records are forgotten, with all under
        them.
        """
        self._steer(headers.Keep(0, self._node(), origin=self._origin), "keeping")

    def release(self) -> None:
        """Undo ``keep`` for this module; does no harm to a task that was not kept."""
        self._steer(headers.Keep(0, self._node(), release=True, origin=self._origin), "releasing")

    def kept(self, message: Message[Any, Any] | str | None = None) -> "list[TaskRef]":
        """The ended tasks under it that are kept, in the order of their ends."""
        return [handle for _, handle in self._relatives("kept", message)]

    # --- relatives --------------------------------------------------------------------------------

    def info(self) -> TaskInfo | None:
        """The state of the task; None if it has ended and is not kept."""
        return next((info for info, _ in self._relatives("self")), None)

    def data(self, message: Message[D, Any]) -> D:
        """The task's data. Raises MisuseError if it has ended or is another message."""
        check_message(message)
        info = self.info()
        if info is None or info.message != message.name:
            raise MisuseError(
                f"{self} has ended" if info is None else f"{self} is no '{message.name}'"
            )
        return message.decode_data(info.data)

    def parent(self) -> "TaskRef | None":
        """The task above it; None at the top, or if it has ended."""
        return next((handle for _, handle in self._relatives("parent")), None)

    def children(self, message: Message[Any, Any] | str | None = None) -> "list[TaskRef]":
        """Its living children, oldest first; of one *message* or name only."""
        return [handle for _, handle in self._relatives("children", message)]

    def ancestors(self, message: Message[Any, Any] | str | None = None) -> "list[TaskRef]":
        """The tasks above it, nearest first."""
        return [handle for _, handle in self._relatives("ancestors", message)]

    def descendants(self, message: Message[Any, Any] | str | None = None) -> "list[TaskRef]":
        """The living tasks under it, parents first."""
        return [handle for _, handle in self._relatives("descendants", message)]

    def _relatives(
        self, relation: Any, message: Message[Any, Any] | str | None = None
    ) -> "Iterator[tuple[TaskInfo, TaskRef]]":
        check(LateText(lambda: f"the tasks of {self}"), checks.MESSAGE_OR_NAME, message=message)
        name = message.name if isinstance(message, Message) else message or ""
        header = headers.Inspect(0, self._node(), relation, name)
        asked = _RELATIONS.get(relation, relation)
        what = LateText(
            lambda: (
                f"the question for the {f'{asked} of {self._in_words}' if self._node() else 'tasks'}"
            )
        )
        connection = self._connection()
        request = connection.answered(header, what)
        for row in msgspec.msgpack.decode(request.answers[-1][1]):
            info = TaskInfo.known_from(row, request.epoch)
            yield info, TaskRef(connection, info.message, info.id, self._origin)

    def _steer(self, header: headers.ToCentral, doing: str, body: bytes = b"") -> bool:
        """Call central; whether that changed anything: else it answers with id 0. *doing* says what
        is done to it.
        """
        return bool(self._connection().call(header, self._doing(doing), body))


class TaskRef(SteerableTask, FollowedTask["Change"]):
    """A task of the tree: wait for it, follow its state, give it a new goal, cancel, kill, suspend
    or retry it, raise a failure on it, look at its relatives.

    ``kill``, ``deadline``, ``fail``, ``retry``, ``suspend`` and ``resume`` return True if they took
    effect, False if the task had ended. Promises for later (``on_failure``, ``on_termination``,
    ``keep``) raise Refused ("too late").
    """

    def __init__(
        self, connection: Connection, message: str, task_id: TaskId, origin: int = 0
    ) -> None:
        super().__init__(task_id)
        self._link = connection
        self.message = message
        self._origin = origin
        self._end: tuple[headers.Answer, bytes] | None = (
            None  # how it ended, once that has been waited for
        )

    def __repr__(self) -> str:
        return numbered(self.message or "task", self.id)

    @property
    def id(self) -> TaskId:
        """The task's number, as in the journal. Of a task that was just sent, waits until central
        has told it.
        """
        if isinstance(self._task_id, SentId):
            self._task_id = TaskId(self._task_id.known)
        return self._task_id

    @property
    def _in_words(self) -> str:
        """The task for people, with its id if that is known: nobody waits for it."""
        task = self._task_id
        return task.what if isinstance(task, SentId) else str(self)

    def _connection(self) -> Connection:
        self._link.check_thread(self, "sent or found it", FIND_IT)
        return self._link

    def _as_change(self, news: News) -> "Change":
        return Change(news, self, self._link.declared(self.message))

    # --- its end ----------------------------------------------------------------------------------

    def wait(self, timeout: float | None = None) -> Outcome:
        """Wait until the task has ended; its outcome. Raises Timeout.

        ``Outcome.RESOLVED`` is *done after a failure*: an exception handler has resolved the
        failure.
        """
        return self._ended(timeout)[0].outcome

    def wait_for(self, point: Point, timeout: float | None = None) -> Outcome:
        """Wait until a point, of this task or another, is reached:
        ``leg.wait_for(leg.handling.end)``. Raises Timeout.

        Returns the state of the point's task: a task that is killed reaches all its points at once.
        """
        return self._reached(point, timeout)[0].outcome

    def _ended(self, timeout: float | None) -> tuple[headers.Answer, bytes]:
        if self._end is None:
            self._end = self._reached(self.achieving.end, timeout)
            if self._mirror is not None:
                self._mirror.hear_end()
        return self._end

    def _reached(self, point: Point, timeout: float | None) -> tuple[headers.Answer, bytes]:
        brief = is_brief(self._doing("the wait for"), timeout)
        request = self._ask(point, blocking=True, brief=brief, is_awaited=True)
        with self._called_back():
            what = LateText(lambda: f"the wait for {self._words_of(point)}")
            is_over = self._connection().wait(request, timeout, what)
        if not is_over:
            why = self._connection().give_up(request)
            where = f": {why}" if why else ""
            raise Timeout(
                f"{self._words_of(point)} was not reached within {timeout:g} s{where}",
                can_wait=True,
            )
        return request.answers[-1]

    @contextmanager
    def _called_back(self) -> Iterator[None]:
        """A wait in which a task of which central has said nothing yet is called back, if it can't
        be waited for.
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

    def _ask(
        self, point: Point, *, blocking: bool, brief: bool = False, is_awaited: bool = False
    ) -> Request:
        """Ask to be told when a point is reached."""
        check(self._doing("the wait for"), checks.POINT, point=point)
        header = headers.AwaitPoint(0, point, self._origin, blocking, brief)
        return self._connection().request(header, wants_answer=True, is_awaited=is_awaited)

    def _words_of(self, point: Point) -> str:
        """A point for people: nobody waits for the id of its task."""
        if isinstance(point.task, SentId) and not point.task.request.is_over:
            return f"{describe_moments(point.moment)[0]} of {point.task.what}"
        return f"{point} ('{self.message}')" if point.task == self._node() else str(point)

    # --- failures ---------------------------------------------------------------------------------

    def on_failure(
        self,
        failure: Failure[Any] | None,
        handler: ExceptionHandler[Any],
        *,
        maximum: int | None = None,
    ) -> AttachmentRef:
        """Let *handler* handle *failure* (None: any) raised on the task or below it, at most
        *maximum* times (None: any number); see ``on_failure`` of Sender.
        """
        wanted = Recovery(failure, handler, maximum=maximum).attachment
        self._connection().declare(handler)
        header = headers.Attach(0, wanted, self._node(), origin=self._origin)
        number = self._connection().call(header, self._doing(f"attaching '{handler.name}' to"))
        return AttachmentRef(self._connection(), number, header)


class Change:
    """A change of a task's state; or, if *is_late*, how it stood when the observer came."""

    def __init__(self, news: News, task: TaskRef, message: Message[Any, Any] | None) -> None:
        change = news.change
        self.task = task
        self.message = change.message  #: its name
        self.serial = change.serial  #: the number of changes of this task, this one included
        self.state = (
            change.state
        )  #: the task's, from now on; "" if it ended while nobody here heard central
        self.transition = change.transition  #: by which it came to that; "" if *is_late*
        self.by = change.by  #: client, server or central
        self.module = change.module  #: the client's or server's
        self.text = change.text  #: the reason, for people
        self.is_late = change.is_late
        self.is_over = change.is_over  #: the task has ended
        self.outcome = change.outcome  #: how, then; None if nothing here heard central meanwhile
        self.missed = news.missed  #: the number of changes before this one that were not seen here
        self._news = news
        self._message = message

    def __repr__(self) -> str:
        return f"{self.task}: {self.state}" + (f" ({self.transition})" if self.transition else "")

    @cached_property
    def goal(self) -> Any:
        """The task's data; as plain values if its message is not declared here."""
        return self._goal_of(self._news.change.goal)

    @cached_property
    def data(self) -> Any:
        """What came with it: the goal that a client asks for, an intermediate result (the newest,
        if *is_late*), the result, or the data of the failure. None if nothing did.
        """
        data, message = self._news.change.data, self._message
        if is_progress(self._news):
            return decode_progress(message, data)
        if not self.is_over:
            return self._goal_of(data)
        is_result = message is not None and self.state == life_cycle_of(message).done
        return (
            message.decode_reply(data)
            if message is not None and is_result and data
            else decode_untyped(data)
        )

    def _goal_of(self, data: bytes) -> Any:
        return (
            self._message.decode_data(data)
            if self._message is not None and data
            else decode_untyped(data)
        )


def change_of(connection: Connection, news: News, origin: int = 0) -> Change:
    """A change of any task's state, as its observers see it."""
    name = news.change.message
    return Change(news, TaskRef(connection, name, news.task, origin), connection.declared(name))


class SentTask(TaskRef, Generic[R]):
    """A task that was sent. Its points, such as ``sent.achieving.end``, are for constraints.

    In an async handler ``await sent`` gives what ``sent.result()`` does; ``asyncio.timeout`` limits
    the wait.
    """

    def __init__(
        self, connection: Connection, message: Message[Any, R], task_id: TaskId, origin: int
    ) -> None:
        super().__init__(connection, message.name, task_id, origin)
        self._message = message

    def result(self, timeout: float | None = None) -> R:
        """The handler's result, at the task's end. Raises TaskFailed, TaskKilled, or Timeout after
        *timeout* s.

        A task that is done after a failure has none. Then this returns None, or raises TaskFailed
        if its message declares a result.
        """
        is_new = self._end is None
        answer, body = self._ended(timeout)
        if is_new and not answer.outcome.lets_go_on:
            self._connection().mark_told()
        return self._result(answer, body)

    def __await__(self) -> Generator[Any, None, R]:
        if self._end is None:
            point = self.achieving.end
            request = self._ask(point, blocking=False)
            with self._called_back():
                what = LateText(lambda: f"the wait for {self._words_of(point)}")
                yield from self._connection().until_over(request, what)
            self._end = request.answers[-1]
            if self._mirror is not None:
                self._mirror.hear_end()
        return self._result(*self._end)

    def _result(self, answer: headers.Answer, body: bytes) -> R:
        if answer.outcome is Outcome.FAILED:
            raise TaskFailed(repr(self), answer.failure, answer.text, body)
        if answer.outcome is Outcome.KILLED:
            raise TaskKilled(repr(self), answer.text)
        if (
            answer.outcome is Outcome.RESOLVED
            and not body
            and self._message.reply.kind is not type(None)
        ):
            first, newline, rest = answer.text.partition("\n")
            text = (f"{first} ({_NO_RESULT})" if first else _NO_RESULT) + newline + rest
            raise TaskFailed(repr(self), answer.failure, text, b"")
        try:
            return self._message.decode_reply(body or NIL)
        except BadData as error:
            if body:
                raise
            msg = f"the result of {self} is no longer kept: call result() sooner after its end ({error})"
            raise BadData(msg) from None
