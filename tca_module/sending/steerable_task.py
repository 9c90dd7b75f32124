"""A task of the tree that can be steered: killed, suspended, retried, inspected."""

from collections.abc import Iterator
from typing import Any, NamedTuple, overload

import msgspec

from tca_module import checks
from tca_module.checks import LateText, check, check_class, check_message
from tca_module.errors import MisuseError
from tca_module.following.followed_task import NamedTask
from tca_module.sending.task_points import TaskIntervals
from tca_module.session.epoch_numbers import with_epoch
from tca_wire.messages.declarations import Command, D, Failure, FailureRaised, Goal, Message
from tca_wire.packets import headers
from tca_wire.points import Point, TaskId
from tca_wire.text.measures import numbered
from tca_wire.vocabulary import Scope


class TaskInfo(NamedTuple):
    """A snapshot of a living task, or the record of a retained task that has ended.

    Attributes:
        id: the task's number.
        message: the name of the task's message.
        message_class: the class of that message, such as "goal".
        parent: the number of the task above this one; 0 for a top-level task.
        reached: the moments that the task has reached, in words.
        held: for each moment that is held back, the number of constraints that hold the moment.
        module: the module whose handler has the task now; "" without any.
        suspended: whether the task is suspended.
        killed: the reason of the task's kill; "" without a kill.
        failure: the name of the task's failure; "" without a failure.
        data: the task's data, encoded; ``SteerableTask.data()`` decodes them.
        outcome: the ``Outcome`` of an ended task, such as "done"; "" for a living task.
        result: for an ended task, the handler's result or the failure's data, encoded.
    """

    id: TaskId
    message: str
    message_class: str
    parent: TaskId
    reached: list[str]
    held: dict[str, int]
    module: str
    suspended: bool
    killed: str
    failure: str
    data: bytes
    outcome: str
    result: bytes

    @classmethod
    def from_row(cls, row: dict[str, Any], epoch: str) -> "TaskInfo":
        """Return the info in one row of central's answer. *epoch*: that of the central."""
        task = with_epoch(row["task"], epoch, numbered(row["message"], row["task"]))
        parent = with_epoch(row["parent"], epoch, numbered("task", row["parent"]))
        others = (row[key] for key in cls._fields[4:])
        return cls(task, row["message"], row["class"], parent, *others)


_RELATIVES = {"self": "state", "kept": "kept tasks"}
"""Relation -> its name in errors, if that is not the name of the relation itself."""


class SteerableTask(TaskIntervals, NamedTask):
    """A task of the tree, with the calls that steer it: kill, suspend, retry, inspect.

    The task's own handler may call them, too. ``kill``, ``deadline``, ``fail``, ``retry``,
    ``suspend`` and ``resume`` return True if they took effect, False if the task had ended.
    ``on_termination`` and ``keep`` have their effect later. They raise Refused ("too late") if the
    task had ended.

    All calls raise CentralLost if central does not answer, or was restarted and has forgotten the
    task.
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
        """Kill the task and everything under it.

        Running handlers are notified and woken from their waits, but not interrupted. A killed task
        ends when its handler has returned.

        Args:
            why: the reason, for people. Default: "".
            delay: the seconds from now until the kill. Default: 0, at once.
            after: the point after which the kill happens. Default: None, at once.
            scope: ``Scope.TASK``: the task and everything under it. ``Scope.DESCENDANTS``:
                everything under it. ``Scope.SIBLINGS``: its siblings and everything under them.
                Default: ``Scope.TASK``.

        Returns:
            False if the task had ended.

        Raises:
            MisuseError: an argument has the wrong type or range.

        Example::

            for walking in user.tasks(WALK):
                walking.kill("the battery is low")
        """
        what = self._action("killing")
        check(what, checks.TEXT, why=why)
        check(what, checks.SECONDS, delay=delay)
        check(what, checks.SCOPE, scope=scope)
        check(what, checks.POINT_OR_NONE, after=after)
        header = headers.Kill(0, self._tree_id(), why, scope, after, delay, origin=self._origin)
        return self._steer(header, "killing")

    @overload
    def on_termination(
        self, message: Goal[None] | Command[None, Any], data: None = None
    ) -> None: ...
    @overload
    def on_termination(self, message: Goal[D] | Command[D, Any], data: D) -> None: ...
    def on_termination(self, message: Goal[Any] | Command[Any, Any], data: Any = None) -> None:
        """Send *message* if the task is killed after its start (TDL: ON TERMINATE).

        Use it to leave things safe. The message is sent at once after the kill. Its handler may run
        beside handlers that have not yet returned, unless they share a resource of capacity 1. The
        task's successors wait for the message.

        Args:
            message: a goal or command.
            data: its data. Default: None, for a message without data.

        Raises:
            Refused: "too late": the task has ended.
            BadData: *data* does not fit the message.

        Example::

            @planner.handles(DIG)
            def dig(task: Task) -> None:
                task.on_termination(RETRACT)
                task.command(DRILL)
        """
        check_class(message, Goal, Command, call="on_termination")
        body = message.encode_data(data)
        header = headers.Send(0, message.name, self._tree_id(), self._origin, when_killed=True)
        self._connection().declare(message)
        self._connection().call(header, self._action("on termination of"), body)

    def deadline(self, seconds: float, point: Point | None = None) -> bool:
        """Raise the failure "timeout" if a point is not reached in time.

        The failure is raised on the point's task. Every deadline counts. A second call does not
        extend the deadline of the first call.

        Args:
            seconds: the time from now, above 0.
            point: a point of a task. Default: None, the end of this task's achievement.

        Returns:
            False if the point's task had ended or been killed.

        Raises:
            MisuseError: an argument has the wrong type or range.

        Example::

            walk = user.goal(WALK, path)
            walk.deadline(60)
        """
        what = self._action("a deadline of")
        check(what, checks.DURATION, seconds=seconds)
        check(what, checks.POINT_OR_NONE, point=point)
        header = headers.Deadline(0, point or self.achieving.end, seconds, self._origin)
        return self._steer(header, "a deadline of")

    # --- failures ---------------------------------------------------------------------------------

    def fail(self, failure: FailureRaised) -> bool:
        """Raise a failure on the task from outside. A running handler is not interrupted.

        Args:
            failure: a declared failure with its data.

        Returns:
            False if the task had ended or been killed.

        Raises:
            MisuseError: *failure* is no failure with its data.

        Example::

            walking.fail(COLLISION(contact))
        """
        if not isinstance(failure, FailureRaised):
            advice = "give COLLISION(data)"
            if isinstance(failure, Failure):
                advice = f"'{failure.name}' is only declared, call it"
            text = f"fail() takes a failure with its data, not {failure!r:.60}: {advice}"
            raise MisuseError(text)
        header = headers.Raise(
            0, self._tree_id(), failure.name, failure.text, failure.kinds, self._origin
        )
        return self._steer(header, f"raising '{failure.name}' on", failure.body)

    @overload
    def retry(self, message: Message[None, Any] | None = None, data: None = None) -> bool: ...
    @overload
    def retry(self, message: Message[D, Any], data: D) -> bool: ...
    def retry(self, message: Message[Any, Any] | None = None, data: Any = None) -> bool:
        """Handle the task again.

        All tasks under the task are killed, except monitors that another module put there. The task
        is handled again when these tasks and the calling exception handler have ended.

        Args:
            message: the task's message, if *data* is given. Default: None, the same data.
            data: the new data. Default: None.

        Returns:
            False if the task had ended or been killed.

        Raises:
            Refused: "overload": exception handlers have retried the task too often.
            BadData: *data* does not fit the message.
            MisuseError: *message* is not the task's message, or *data* comes without *message*.

        Example::

            @expert.handles(RAISE_LEG)
            def raise_leg(task: Task) -> None:
                task.trouble.failing.retry(MOVE_LEG, higher)
        """
        if message is not None:
            check_message(message)
        elif data is not None:
            text = "data needs its message, too: retry(MESSAGE, data)"
            raise MisuseError(f"a retry of {self}: {text}")
        if message is not None and message.name != self.message:
            raise MisuseError(f"{self} can't be retried with data of '{message.name}'")
        body = message.encode_data(data) if message is not None else b""
        header = headers.Retry(0, self._tree_id(), message is not None, self._origin)
        return self._steer(header, "a retry of", body)

    # --- suspending -------------------------------------------------------------------------------

    def suspend(self) -> bool:
        """Start nothing more of the task and its subtasks. Running handlers are notified.

        Returns:
            False if the task had ended.

        Example::

            walk = user.goal(WALK, path)
            walk.suspend()
            walk.resume()
        """
        return self._steer(headers.Suspend(0, self._tree_id(), origin=self._origin), "suspending")

    def resume(self) -> bool:
        """Let a suspended task continue. The call has no effect on a task that is not suspended.

        Returns:
            False if the task had ended.
        """
        return self._steer(
            headers.Suspend(0, self._tree_id(), resume=True, origin=self._origin),
            "resuming",
        )

    # --- retained tasks ---------------------------------------------------------------------------

    def keep(self) -> None:
        """Retain the task's record after its end (TCM: SetPersistence; TDL: PERSISTENT).

        Central retains the record until ``release()``, until this module leaves, or until the
        record of the task's parent is removed. Until then ``info()``, ``data()``, ``wait()`` and
        ``parent()`` answer, and ``kept()`` of the parent lists the task. The task's constraints and
        the tasks under it are not retained.

        Central retains at most 10,000 tasks, living tasks included, and refuses more. Central
        retains at most 64 MiB of records. Beyond that, central removes the oldest records, each
        with all records under it.

        Raises:
            Refused: "too late": the task has ended; "overload": central already retains 10,000
                tasks.

        Example::

            task.keep()
        """
        self._steer(headers.Keep(0, self._tree_id(), origin=self._origin), "keeping")

    def release(self) -> None:
        """Undo ``keep`` for this module. The call has no effect on a task that is not retained."""
        self._steer(
            headers.Keep(0, self._tree_id(), release=True, origin=self._origin), "releasing"
        )

    # --- inspecting -------------------------------------------------------------------------------

    def info(self) -> TaskInfo | None:
        """Return a snapshot of the task; None if it has ended and is not retained."""
        return next(self._inspect("self"), None)

    def data(self, message: Message[D, Any]) -> D:
        """Return the task's data.

        Args:
            message: the task's message, which decodes them.

        Returns:
            The data.

        Raises:
            MisuseError: the task has ended and is not retained, or has another message.
        """
        check_message(message)
        info = self.info()
        if info is None or info.message != message.name:
            why = "has ended" if info is None else f"is no '{message.name}'"
            raise MisuseError(f"{self} {why}")
        return message.decode_data(info.data)

    def _inspect(
        self, relation: Any, message: Message[Any, Any] | str | None = None
    ) -> Iterator[TaskInfo]:
        """Ask central about the tasks in a *relation* to this one."""
        check(LateText(lambda: f"the tasks of {self}"), checks.MESSAGE_OR_NAME, message=message)
        name = message.name if isinstance(message, Message) else message or ""
        header = headers.Inspect(0, self._tree_id(), relation, name)
        wanted = _RELATIVES.get(relation, relation)
        what: object = "the question for the tasks"  # of the whole tree
        if self._tree_id():
            what = self._action(f"the question for the {wanted} of")
        connection = self._connection()
        request, opened = connection.ask_central(header, what), connection.opened
        for row in msgspec.msgpack.decode(request.answers[-1][1]):
            row.update(data=opened(row["data"]), result=opened(row["result"]))
            yield TaskInfo.from_row(row, request.epoch)

    def _steer(self, header: headers.ToCentral, action: str, body: bytes = b"") -> bool:
        """Send a request to central; return whether it took effect.

        *action* names the request in errors.
        """
        return bool(self._connection().call(header, self._action(action), body))
