"""What can be done to a task of the tree by anybody who knows its number."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec

from tca_module import checks
from tca_module.checks import check, check_class, check_handles, check_message, check_raised, is_brief, name_of
from tca_module.errors import CentralLost, MisuseError, Timeout
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, Connection
from tca_module.sending.task_points import TaskIntervals
from tca_module.session.epoch_numbers import foreign, given
from tca_module.session.request import Request
from tca_wire.messages.controls import ExceptionHandler
from tca_wire.messages.declarations import NOTHING, Command, D, Failure, FailureRaised, Goal, Message
from tca_wire.packets.headers import (
    Answer,
    Attach,
    Deadline,
    Inspect,
    Keep,
    Kill,
    Raise,
    Remove,
    Retry,
    Send,
    Suspend,
    Tap,
    WaitFor,
)
from tca_wire.packets.parts import Attachment
from tca_wire.points import ROOT, Point, TaskId
from tca_wire.text.measures import numbered
from tca_wire.vocabulary import Outcome, Scope


class TaskInfo(NamedTuple):
    """How a task stands, or how one that is kept has ended."""

    id: TaskId
    message: str
    message_class: str
    parent: TaskId
    reached: list[str]
    """Its moments that are past, in words."""
    held: dict[str, int]
    """The moments that constraints hold back, and how many of them."""
    module: str
    """Whose handler has it now."""
    suspended: bool
    killed: str
    failure: str
    data: bytes
    outcome: str
    """"" while it lives; of an ended one that is kept "done", "failed" or "killed"."""
    result: bytes
    """Of an ended one: what its handler returned, or the failure's data."""


_ROW = (
    "task", "message", "class", "parent", "reached", "held", "module", "suspended", "killed", "failure", "data",
    "outcome", "result",
)  # fmt: skip


def _known_from(row: dict[str, Any], epoch: str) -> TaskInfo:
    """What the central of that epoch says of a task."""
    info = TaskInfo(*(row[key] for key in _ROW))
    return info._replace(
        id=given(info.id, epoch, numbered(info.message, info.id)),
        parent=given(info.parent, epoch, numbered("task", info.parent)),
    )


_RELATIONS = {"self": "state", "kept": "kept tasks"}


class AttachmentRef:
    """An exception handler or wiretap that was attached; ``remove()`` takes it away.

    What is attached to a message or to the root is attached anew when central was restarted.
    """

    def __init__(self, connection: Connection, number: int, header: Attach | Tap) -> None:
        self._connection = connection
        self._attachments = connection.session.attachments
        self._standing = self._attachments.of(header)
        self._number = number  # of what is attached to a task
        self._origin = header.origin

    @property
    def id(self) -> int:
        """Its number, as in ``tca attached``; another one after a restart of central."""
        return self._standing.number if self._standing is not None else self._number

    def remove(self) -> None:
        """Take it away, if no other module wants it, too; what it has sent stays. It is not attached anew to a central
        that is restarted; one that was restarted meanwhile, and does not know it, has nothing to take away.
        """
        connection = self._connection
        if self._standing is not None:
            self._attachments.forget(self._standing, connection.session.epoch)
        try:
            origin = 0 if foreign([self._origin], connection.session.epoch) else self._origin
            connection.call(Remove(0, self.id, origin=origin), f"removing {self.id}")
        except CentralLost:
            if foreign([self.id], connection.session.epoch) is None:
                raise


def attachment(failure: Failure[Any] | None, handler: ExceptionHandler[Any], maximum: int | None = None) -> Attachment:
    """That *handler* takes care of *failure* (None: of any). Raises MisuseError if it can't."""
    check_handles(failure, handler)
    check(name_of(handler), checks.MAXIMUM, maximum=maximum)
    return Attachment(failure.name if failure is not None else "", handler.name, maximum or 0)


class TaskRef(TaskIntervals):
    """A task of the tree: wait for it, kill, suspend or retry it, raise a failure on it, look at its relatives.

    Who steers a task can't know whether it has just ended. What changes it (kill, deadline, fail, retry, suspend,
    resume) returns when central has done it: True, or False if the task had ended and nothing was done. What promises
    something for later (on_failure, on_termination, keep) raises Refused ("too late") then.
    """

    def __init__(self, connection: Connection, message: str, task_id: TaskId, origin: int = 0) -> None:
        super().__init__(task_id)
        self._connection = connection
        self._name = message
        self._origin = origin
        self._end: tuple[Answer, bytes] | None = None  # how it ended, once that has been waited for

    def __repr__(self) -> str:
        return numbered(self.message or "task", self.id)

    @property
    def id(self) -> TaskId:
        """The task's number, as in the journal."""
        return self._task_id

    @property
    def message(self) -> str:
        """The name of the message that the task is."""
        return self._name

    # --- its end ---------------------------------------------------------------------------------------------------

    def wait(self, timeout: float | None = None) -> Outcome:
        """Wait until the task has been achieved, failed or been killed, and say which. Raises Timeout."""
        return self._ended(timeout)[0].outcome

    def wait_for(self, point: Point, timeout: float | None = None) -> Outcome:
        """Wait until a point, of this task or another, is reached: ``leg.wait_for(leg.handling.end)``.

        Returns how the point's task stands then: a task that is killed reaches all its points at once. Raises Timeout.
        """
        return self._reached(point, timeout)[0].outcome

    def _ended(self, timeout: float | None) -> tuple[Answer, bytes]:
        check(f"the wait for {self}", checks.TIMEOUT, timeout=timeout)
        if self._end is None:
            self._end = self._reached(self.achieving.end, timeout)
        return self._end

    def _reached(self, point: Point, timeout: float | None) -> tuple[Answer, bytes]:
        what, request = self._ask(
            point, blocking=True, brief=is_brief(f"the wait for {self}", timeout), is_awaited=True
        )
        if not self._connection.wait(request, timeout, f"the wait for {what}"):
            why = self._connection.give_up(request)
            where = f": {why}" if why else ""
            raise Timeout(f"{what} was not reached within {timeout:g} s{where}; to wait longer give timeout=")
        return request.answers[-1]

    def _ask(
        self, point: Point, *, blocking: bool, brief: bool = False, is_awaited: bool = False
    ) -> tuple[str, Request]:
        """Ask to be told when a point is reached; its name for people, and the request."""
        check(f"the wait for {self}", checks.POINT, point=point)
        what = f"{point} ('{self.message}')" if point.task == self.id else str(point)
        header = WaitFor(0, point, self._origin, blocking, brief)
        return what, self._connection.request(header, wants_answer=True, is_awaited=is_awaited)

    def kill(self, why: str = "", *, delay: float = 0, after: Point | None = None, scope: Scope = Scope.TASK) -> bool:
        """End the task and everything under it; *delay* seconds from now, or after a point. Handlers that run are told,
        and woken from what they wait for, and else not interrupted. Another *scope* ends only what is under it, or its
        siblings (TDL: TERMINATE AT, IN, AFTER).

        False if the task had ended; one that was killed, and whose handler still runs, has not.
        """
        what = f"killing {self}"
        check(what, checks.TEXT, why=why)
        check(what, checks.SECONDS, delay=delay)
        check(what, checks.SCOPE, scope=scope)
        check(what, checks.POINT_OR_NONE, after=after)
        return self._steer(Kill(0, self.id, why, scope, after, delay, origin=self._origin), what)

    def on_termination(self, message: Goal[D] | Command[D, Any], data: D = NOTHING) -> None:
        """Send *message* when the task is killed after it was started: to leave things safe (TDL: ON TERMINATE).

        It is sent at once and waits for a free slot only: handlers of the task that still run, and have been told, may
        run beside it. So it fits a "stop". What must come after a handler of the task belongs into that handler's
        resource, of capacity 1. What comes after the task waits until that has been done. Of a task that has been
        killed and whose handler is not done it is sent now; of a killed one whose handler is, refused ("too late").
        """
        check_class(message, Goal, Command, call="on_termination()")
        body = message.encode_data(data)
        self._connection.declare(message)
        header = Send(0, message.name, self.id, self._origin, when_killed=True)
        self._connection.call(header, f"on termination of {self}", body)

    def deadline(self, seconds: float, point: Point | None = None) -> bool:
        """Raise the failure "timeout" on the task if its *point* (its end) is not reached within *seconds* from now,
        which are more than 0: for "at once" there are ``fail`` and ``kill``.

        A point that is reached already is in time. Of several deadlines each counts: a later one lengthens nothing.
        False if the point's task had ended, or been killed.
        """
        what = f"a deadline of {self}"
        check(what, checks.DURATION, seconds=seconds)
        check(what, checks.POINT_OR_NONE, point=point)
        return self._steer(Deadline(0, point or self.achieving.end, seconds, self._origin), what)

    # --- failures --------------------------------------------------------------------------------------------------

    def on_failure(
        self, failure: Failure[Any] | None, handler: ExceptionHandler[Any], *, maximum: int | None = None
    ) -> AttachmentRef:
        """Let *handler* take care of *failure* (None: of any) where it is raised on the task or below, *maximum* times
        at most (None: any number).

        Of several on one task the newest is called first; then those of its message, then those of the task above. It
        gets the failure's data, or none if it is declared without. Raises MisuseError if it can't take them: it may
        want the same type, a union with it, or a dataclass with fewer fields; and one for any failure must do without
        data. The same *failure* and *handler*, attached once more by this module, take the place of the first.
        """
        wanted = attachment(failure, handler, maximum)
        self._connection.declare(handler)
        header = Attach(0, wanted, self.id, origin=self._origin)
        number = self._connection.call(header, f"attaching '{handler.name}' to {self}")
        return AttachmentRef(self._connection, number, header)

    def fail(self, failure: FailureRaised) -> bool:
        """Raise a failure on the task from outside: ``ref.fail(COLLISION(contact))``. A handler that runs goes on.

        False if the task had ended, or been killed.
        """
        check_raised(failure)
        header = Raise(0, self.id, failure.name, failure.text, failure.kinds, self._origin)
        return self._steer(header, f"raising '{failure.name}' on {self}", failure.body)

    def retry(self, message: Message[D, Any] | None = None, data: D = NOTHING) -> bool:
        """Kill what is under the task but the monitors that others have put there, and let it be handled again when
        that, and the exception handler that asks for it, has ended. With *message*, which it is, it gets new *data*.

        False if the task had ended, or been killed.
        """
        if message is not None:
            check_message(message)
        elif data is not NOTHING:
            raise MisuseError(f"a retry of {self}: data needs its message, too: retry(MESSAGE, data)")
        if message is not None and message.name != self.message:
            raise MisuseError(f"{self} can't be retried with data of '{message.name}'")
        body = message.encode_data(data) if message is not None else b""
        return self._steer(Retry(0, self.id, message is not None, self._origin), f"a retry of {self}", body)

    # --- suspending ------------------------------------------------------------------------------------------------

    def suspend(self) -> bool:
        """Start nothing of the task and what is under it from now on; handlers that run are told. False if the task had
        ended.
        """
        return self._steer(Suspend(0, self.id, origin=self._origin), f"suspending {self}")

    def resume(self) -> bool:
        """Let it go on, also one that was not suspended. False if the task had ended."""
        return self._steer(Suspend(0, self.id, resume=True, origin=self._origin), f"resuming {self}")

    # --- what is remembered ----------------------------------------------------------------------------------------

    def keep(self) -> None:
        """Have the task remembered after its end (TCM: SetPersistence; TDL: PERSISTENT).

        What is kept: its message, its data, its outcome with the result or the failure's text and data, and what it
        hung under; not its constraints, and not the tasks under it, each of which is kept for itself. So ``info()``,
        ``data()``, ``wait()`` and ``parent()`` go on to answer, and ``kept()`` of the task above lists it.

        Until when: until ``release()`` or until this module leaves (each module keeps for itself, twice is once); at
        the latest until the task above it ends without being kept, or is forgotten. A top-level task has none above.

        What it costs: nothing per event; in central's memory the bytes of data, result and failure, from the end on.
        At most 10 000 tasks may be kept by all modules together, living ones too. Raises Refused ("overload") for one
        more, and ("too late") if the task has ended already. Of records that hold more than 64 MiB the oldest are
        forgotten, with all under them.
        """
        self._connection.call(Keep(0, self.id, origin=self._origin), f"keeping {self}")

    def release(self) -> None:
        """Have it remembered no longer, as far as this module is concerned; nothing happens if it was not kept."""
        self._connection.call(Keep(0, self.id, release=True, origin=self._origin), f"releasing {self}")

    def kept(self, message: Message[Any, Any] | str | None = None) -> "list[TaskRef]":
        """The ended tasks under it that are kept, in the order in which they ended; their ``info()`` tells how."""
        return [handle for _, handle in self._relatives("kept", message)]

    # --- relatives -------------------------------------------------------------------------------------------------

    def info(self) -> TaskInfo | None:
        """How the task stands; None if it has ended and is not kept."""
        return next((info for info, _ in self._relatives("self")), None)

    def data(self, message: Message[D, Any]) -> D:
        """The data with which the task is being done. Raises MisuseError if it has ended or is another message."""
        check_message(message)
        info = self.info()
        if info is None or info.message != message.name:
            raise MisuseError(f"{self} has ended" if info is None else f"{self} is no '{message.name}'")
        return message.decode_data(info.data)

    def parent(self) -> "TaskRef | None":
        """The task that it is under; None at the top, or if it has ended."""
        return next((handle for _, handle in self._relatives("parent")), None)

    def children(self, message: Message[Any, Any] | str | None = None) -> "list[TaskRef]":
        """Its living children, oldest first (those of one *message*, or of that name)."""
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
        check(f"the tasks of {self}", checks.MESSAGE_OR_NAME, message=message)
        name = message.name if isinstance(message, Message) else message or ""
        header = Inspect(0, self.id, relation, name)
        request = self._connection.request(header, wants_answer=True)
        asked = f"{_RELATIONS.get(relation, relation)} of {self}" if self.id != ROOT else "tasks"
        what = f"the question for the {asked}"
        if not self._connection.wait(request, ACKNOWLEDGED_WITHIN, what):
            self._connection.abandon(request)
            raise Timeout(f"{what}: central did not answer within {ACKNOWLEDGED_WITHIN:g} s")
        for row in msgspec.msgpack.decode(request.answers[-1][1]):
            info = _known_from(row, request.epoch)
            yield info, TaskRef(self._connection, info.message, info.id, self._origin)

    def _steer(self, header: Any, what: str, body: bytes = b"") -> bool:
        """Whether it was done: central accepts with id 0 where it changed nothing."""
        return bool(self._connection.call(header, what, body))
