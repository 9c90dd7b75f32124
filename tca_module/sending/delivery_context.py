"""Why central sent a message: for a failure, a wiretap or a monitor."""

from dataclasses import dataclass
from typing import Any, Generic, TypeVar, overload

from tca_module.checks import LateText
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
    """The failure that an exception handler is called for."""

    failure: str  #: its name
    text: str
    failing: TaskRef  #: the task on which it was raised
    attached: TaskRef | None  #: the task that the exception handler is attached to; None: the root
    attempts: int  #: how often the failing task has been handled
    invocations: int  #: how often this exception handler was called for the task it is attached to

    def __repr__(self) -> str:
        return f"failure '{self.failure}' of {self.failing}"

    def resolved(self) -> bool:
        """Say that the failure has been dealt with: the task is *done after a failure*, and what
        follows it goes on.

        It counts when the task of the exception handler has ended, with all that it has sent. If
        the handler then fails, is killed, or reissues the failure, that goes on up the tree. An
        exception handler that neither says this nor retries or kills the failed task, or one above
        it, has only looked on: the failure goes on up, too.

        Returns False if the failed task was killed, or is retried: then that counts. Raises Refused
        ("too late") when the handler has returned.

        Example:
            ::

                @module.handles(DROPPED)
                def pick_up(task: Task, cup: Cup) -> None:
                    task.command(PICK_UP, cup)
                    task.trouble.resolved()

        """
        header = Resolve(0, self.failing._origin)  # noqa: SLF001
        return self.failing._steer(header, f"resolving failure '{self.failure}' of")  # noqa: SLF001

    def reissue(self) -> Exception:
        """The error to raise so that the search goes on above at once: ``raise
        task.trouble.reissue()`` (ByPassException). It overrules ``resolved()``.
        """
        return Reissued(f"{self} is reissued")


@dataclass(eq=False)
class TapEvent:
    """The event that a wiretap's listener was sent for."""

    condition: Condition
    message: str  #: the name of the tapped message
    tapped: TaskRef | None  #: the tapped task; None if the message is none


class MonitorRef(TaskRef, Generic[D]):
    """A monitor; *action* is the name of the message that a demon monitor is fired with, "" for any
    other.
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
        """Send the *action* of a demon monitor, with these data: the event that it watches for has
        happened. Any other is fired without: it tests its condition now, and its period starts
        anew.

        Returns False if the monitor has ended or does not watch yet (TCM: a warning). Raises
        MisuseError for another message than its action.
        """
        check_action(LateText(lambda: str(self)), self.action, action)
        name, body = "", b""
        if action is not None:
            name, body = action.name, action.encode_data(data)
            self._connection().declare(action)
        return self._steer(Fire(0, self._node(), name, self._origin), "firing", body)

    def end(self) -> bool:
        """End the monitor; the tasks it has sent go on. Returns False if it had ended."""
        return self._steer(EndMonitor(0, self._node(), self._origin), "ending")


def check_action(what: object, wanted: str, action: Any) -> None:
    """Raises MisuseError if a monitor is not fired with *action*, but with the message called
    *wanted*, or none.
    """
    if action is None and not wanted:
        return
    if not isinstance(action, Message) or action.name != wanted:
        says = (
            f"its action is '{wanted}'" if wanted else "it needs none, fire() it without a message"
        )
        given = action.title if isinstance(action, Message) else repr(action)
        raise MisuseError(f"{what} can't be fired with {given:.60}: {says}")


def context_of(
    connection: Connection, delivery: Deliver, origin: int
) -> "Trouble | TapEvent | MonitorRef[Any] | None":
    """The context of a delivery, with references to tasks of its central."""

    def known(involved: parts.Involved) -> tuple[Connection, str, TaskId, int]:
        message, task = involved.message, involved.task
        return (
            connection,
            message,
            with_epoch(task, connection.session.epoch, numbered(message, task)),
            origin,
        )

    def ref(involved: parts.Involved) -> TaskRef | None:
        return TaskRef(*known(involved)) if involved.task else None

    context = delivery.context
    if isinstance(context, parts.Trouble):
        failing, attached = TaskRef(*known(context.failing)), ref(context.attached)
        return Trouble(
            context.failure, context.text, failing, attached, context.attempts, context.invocations
        )
    if isinstance(context, parts.Tapped):
        return TapEvent(context.condition, context.tapped.message, ref(context.tapped))
    if isinstance(context, parts.Watching):
        return MonitorRef(*known(context.monitor), context.action)
    return None
