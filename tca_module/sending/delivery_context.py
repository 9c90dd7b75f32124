"""The context of a message that central itself sent: for a failure, a wiretap or a monitor."""

from dataclasses import dataclass
from typing import Any, Generic, TypeVar, overload

from tca_module.errors import MisuseError
from tca_module.link.connection import Connection
from tca_module.sending.handler_errors import Reissued
from tca_module.sending.task_ref import TaskRef
from tca_module.session.epoch_numbers import with_epoch
from tca_wire.messages.declarations import D, Message
from tca_wire.packets import parts
from tca_wire.packets.headers import Deliver, EndMonitor, Fire, Resolve
from tca_wire.points import TaskId
from tca_wire.text.measures import numbered
from tca_wire.vocabulary import Condition

A = TypeVar("A")


@dataclass(repr=False, eq=False)
class Trouble:
    """The failure that an exception handler is called for: ``task.trouble``.

    Attributes:
        failure: the failure's name.
        text: the failure's explanation.
        failing: the task on which the failure was raised.
        attached: the task that the exception handler is attached to; None for the root.
        attempts: how often the failing task has been handled.
        invocations: how often this exception handler was called for the *attached* task.
    """

    failure: str
    text: str
    failing: TaskRef
    attached: TaskRef | None
    attempts: int
    invocations: int

    def __repr__(self) -> str:
        return f"failure '{self.failure}' of {self.failing}"

    def resolved(self) -> bool:
        """Declare the failure dealt with: the task is *done after a failure*.

        The successors of the task then continue. The call takes effect when the task of the
        exception handler has ended, with all that it has sent. If the handler then fails, is
        killed, or reissues the failure, the failure continues up the tree. It also continues if the
        handler does none of these: call ``resolved()``; retry or kill the failed task or a task
        above it.

        Returns:
            False if the failed task was killed or is being retried: this call then has no effect.

        Raises:
            Refused: "too late": the exception handler has returned.

        Example::

            @module.handles(DROPPED)
            def pick_up(task: Task, cup: Cup) -> None:
                task.command(PICK_UP, cup)
                task.trouble.resolved()
        """
        header = Resolve(0, self.failing._origin)  # noqa: SLF001
        return self.failing._steer(header, f"resolving failure '{self.failure}' of")  # noqa: SLF001

    def reissue(self) -> Exception:
        """Return the error to raise so that the search for an exception handler continues at once.

        Raising this error overrules ``resolved()`` (TCA: ByPassException).

        Example::

            if not can_help(task.trouble.failing):
                raise task.trouble.reissue()
        """
        return Reissued(f"{self} is reissued")


@dataclass(eq=False)
class TapEvent:
    """The event for which the listener of a wiretap was sent: ``task.tap_event``.

    Attributes:
        condition: the wiretap's condition.
        message: the name of the tapped message.
        tapped: the tapped task; None if the message is no task.
    """

    condition: Condition
    message: str
    tapped: TaskRef | None


class MonitorRef(TaskRef, Generic[D]):
    """A monitor that was started, or that sent the message being handled.

    Attributes:
        action: the name of the message that a demon monitor is fired with; "" for other monitors.
    """

    def __init__(
        self, connection: Connection, message: str, task_id: TaskId, origin: int, action: str
    ) -> None:
        super().__init__(connection, message, task_id, origin)
        self.action = action

    @overload
    def fire(self, action: Message[None, Any] | None = None, data: None = None) -> bool: ...
    @overload
    def fire(self, action: Message[A, Any], data: A) -> bool: ...
    def fire(self, action: Message[Any, Any] | None = None, data: Any = None) -> bool:
        """Fire the monitor.

        Fire a demon monitor when the event that it watches for has happened: it then sends its
        action with *data*. Fire other monitors without arguments: they test their condition now,
        and the period of a polling monitor starts again.

        Args:
            action: the action of a demon monitor. Default: None, for other monitors.
            data: the action's data. Default: None.

        Returns:
            False if the monitor has ended or does not watch yet.

        Raises:
            MisuseError: *action* is not the monitor's action.
            BadData: *data* does not fit the action.

        Example::

            rocks = task.monitor(ROCKS)
            rocks.fire(STOP_WALKING, rock)
        """
        check_action(self, self.action, action)
        name, body = "", b""
        if action is not None:
            name, body = action.name, action.encode_data(data)
            self._connection().declare(action)
        return self._steer(Fire(0, self._tree_id(), name, self._origin), "firing", body)

    def end(self) -> bool:
        """End the monitor. The tasks that it has sent continue.

        Returns:
            False if the monitor had ended.
        """
        return self._steer(EndMonitor(0, self._tree_id(), self._origin), "ending")


def check_action(what: object, wanted: str, action: Any) -> None:
    """Raise MisuseError if a monitor can't be fired with *action*.

    *wanted* is the name of the monitor's action; "" if the monitor is fired without a message.
    """
    if action is None and not wanted:
        return
    if not isinstance(action, Message) or action.name != wanted:
        advice = "it needs none, fire() it without a message"
        if wanted:
            advice = f"its action is '{wanted}'"
        given = action.title if isinstance(action, Message) else repr(action)
        raise MisuseError(f"{what} can't be fired with {given:.60}: {advice}")


def context_of(
    connection: Connection, delivery: Deliver, origin: int
) -> "Trouble | TapEvent | MonitorRef[Any] | None":
    """Return the context of a delivery, with references to tasks of its central."""

    def arguments_of(involved: parts.Involved) -> tuple[Connection, str, TaskId, int]:
        message, task = involved.message, involved.task
        task = with_epoch(task, connection.session.epoch, numbered(message, task))
        return connection, message, task, origin

    def ref(involved: parts.Involved) -> TaskRef | None:
        return TaskRef(*arguments_of(involved)) if involved.task else None

    context = delivery.context
    if isinstance(context, parts.Trouble):
        failing, attached = TaskRef(*arguments_of(context.failing)), ref(context.attached)
        return Trouble(
            context.failure, context.text, failing, attached, context.attempts, context.invocations
        )
    if isinstance(context, parts.Tapped):
        return TapEvent(context.condition, context.tapped.message, ref(context.tapped))
    if isinstance(context, parts.Watching):
        return MonitorRef(*arguments_of(context.monitor), context.action)
    return None
