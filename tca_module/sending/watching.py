"""Watching tasks, from any Sender: their states, exception handlers, wiretaps and monitors."""

from collections.abc import Collection
from typing import Annotated, Any, TypedDict, Unpack, overload

from tca_module import checks
from tca_module.checks import LateText, check, check_class, check_message, check_options
from tca_module.errors import MisuseError
from tca_module.following.followed_task import cancels_of, check_states, life_cycle_of
from tca_module.following.observation import Observation
from tca_module.following.stream import Stream
from tca_module.link.connection import Connection
from tca_module.sending.attachments import AttachmentRef, Recovery
from tca_module.sending.central_services import CentralServices
from tca_module.sending.delivery_context import A, MonitorRef, check_action
from tca_module.sending.task_ref import Change, SentTask, TaskRef, change_of, node_of
from tca_module.session.epoch_numbers import EpochNumber, check_epoch, with_epoch
from tca_module.session.sent_tasks import SentId
from tca_wire.constraints import Constraint, Flags
from tca_wire.messages.controls import (
    DemonMonitor,
    ExceptionHandler,
    Monitor,
    PointMonitor,
    PollingMonitor,
)
from tca_wire.messages.declarations import Command, D, Failure, Goal, Message, R
from tca_wire.packets.changes import Observe
from tca_wire.packets.headers import Attach, Fire, Send, Tap
from tca_wire.packets.parts import WatchOptions
from tca_wire.points import ROOT, Point, TaskId
from tca_wire.text.measures import numbered
from tca_wire.vocabulary import Condition


class Watched(TypedDict, total=False):
    """The options of a watching monitor (TCA 8.5: CreateMonitorOptions). None is as if not given.

    Args:
        period: seconds, above 0, between a polling monitor's tests of its condition.
        maximum: the number of actions after which it ends.
        fire_every: an action is sent once in this number of times that the condition holds, or it
            is fired.
        initial_wait: a polling monitor tests first after one period, not at once.
        duration: seconds, above 0, after which it ends.
        until: the point at which it ends.
        waited_for: its parent waits for its end, which something must bring about: for a goal that
            is over when the monitor has acted.
    """

    period: Annotated[float, checks.DURATION_OR_NONE]
    maximum: Annotated[int | None, checks.MAXIMUM]
    fire_every: Annotated[int, checks.COUNT]
    initial_wait: Annotated[bool, checks.FLAG]
    duration: Annotated[float | None, checks.DURATION_OR_NONE]
    until: Annotated[Point | None, checks.POINT_OR_NONE]
    waited_for: Annotated[bool, checks.FLAG]


class MonitorOptions(Watched, total=False):
    """All options of a new monitor: those of ``Watched``, and its relation to its siblings.

    Args:
        period, maximum, fire_every, initial_wait, duration, until, waited_for: see ``Watched``.
        sequential: a point monitor tests after the sibling before it has been achieved. Default:
            True.
        constraints: other constraints; ``this`` stands for the new monitor.
        suspended: it is created suspended, and watches only after ``resume()`` of its handle.
    """

    sequential: Annotated[bool, checks.FLAG]
    constraints: Annotated[list[Constraint], checks.CONSTRAINTS]
    suspended: Annotated[bool, checks.FLAG]


_STATES = checks.ArgumentKind(
    "a list of states, such as ['running']",
    lambda value: (
        isinstance(value, list | tuple | set | frozenset) and all(map(checks.NAME.fits, value))
    ),
)
TASK = checks.instance_of("a task that was sent or found, such as tasks(WALK)[0]", TaskRef)


def checked_states(call: str, message: object, states: Collection[str]) -> list[str]:
    """The states of which an observer wants to hear. Raises MisuseError for one that the message's
    tasks never have.
    """
    check(call, _STATES, states=states)
    check(call, checks.MESSAGE_OR_NAME, message=message)
    if isinstance(message, Message):
        check_states(f"{call}: {message.title}", message, states)
    return list(states)


class WatchingServices(CentralServices):
    """The part of a Sender that finds and watches tasks."""

    # --- finding ----------------------------------------------------------------------------------

    def task(self, task_id: int) -> TaskRef | None:
        """The task of that number; None if it has ended and is not kept. Raises Refused if there
        has never been one.
        """
        check("task()", checks.NUMBER, task_id=task_id)
        info = TaskRef(self._connection(), "", TaskId(task_id)).info()
        return (
            TaskRef(self._connection(), info.message, info.id, self._origin)
            if info is not None
            else None
        )

    def sent_task(self, message: Message[Any, R], task_id: int, epoch: str = "") -> SentTask[R]:
        """The task of that number that an earlier run of this program has sent, to wait for its
        end: ``task.id`` was written down. Raises CentralLost if *epoch*, ``task.id.epoch``, is not
        that of this central; its ``wait()`` raises Refused ("too late") if it ended long ago.
        """
        check("sent_task()", checks.NUMBER, task_id=task_id)
        check("sent_task()", checks.TEXT, epoch=epoch)
        check_class(message, Goal, Command, call="sent_task")
        connection = self._declare(message)
        check_epoch(
            [number := with_epoch(TaskId(task_id), epoch, numbered(message.name, task_id))],
            connection.session.epoch,
        )
        return SentTask(connection, message, number, self._origin)

    def tasks(self, message: Message[Any, Any] | str | None = None) -> list[TaskRef]:
        """The living tasks (of one *message*, or its name), parents first, at most 10,000 (TCA 8.5:
        ChildByName).
        """
        return TaskRef(self._connection(), "root", ROOT, self._origin).descendants(message)

    def time(self) -> float:
        """The seconds of the clock on which callbacks are due and handlers sleep: it never jumps,
        and a test may step it.
        """
        return self._connection().transport.time()

    def observe(
        self,
        message: Message[Any, Any] | str | None = None,
        *,
        states: Collection[str] = (),
        below: TaskRef | None = None,
        timeout: float | None = None,
    ) -> Stream[Change]:
        """The changes of state of tasks, whoever sends and handles them: those of a *message*, or
        of what is *below* a task, or of all. First comes how each living one stands (``is_late``),
        then each change as it happens; and so again after a restart of central. It ends with the
        task *below* which it observes. With *states*, only changes to one of these come, and none
        is counted as missed.

        ::

            with user.observe(GRASP) as changes:
                for change in changes:
                    print(change.task, change.state)
        """
        wanted = checked_states("observe()", message, states)
        check("observe()", TASK.or_none(), below=below)
        connection = self._declare(message) if isinstance(message, Message) else self._connection()
        name = message.name if isinstance(message, Message) else message or ""
        under = node_of(below) if below is not None else ROOT
        what = LateText(lambda: f"the states of '{name}'" if name else "the states of tasks")
        header = Observe(0, TaskId(0), name, under, wanted, self._origin)
        observation, origin = Observation(connection, header, what), self._origin
        return Stream(
            observation,
            lambda news: change_of(connection, news, origin),
            lambda _: True,
            "a change of state",
            timeout,
            is_owner=True,
        )

    def cancel_all(
        self,
        message: Message[Any, Any] | None = None,
        *,
        before: float | None = None,
        why: str = "",
    ) -> int:
        """Cancel the living tasks that this Sender has sent, as ``cancel()`` of each does: of one
        *message*, or sent *before* that moment of ``time()``; the number of them. It knows the
        newest 10,000 that it has sent. Tasks whose life cycle has no such transition are left
        alone.
        """
        if message is not None:
            check("cancel_all()", checks.MESSAGE, message=message)
        check("cancel_all()", checks.SECONDS_OR_NONE, before=before)
        check("cancel_all()", checks.TEXT, why=why)
        connection = self._connection()
        name = message.name if message is not None else ""
        sent = [
            (kind, task)
            for time, kind, task in self._sent
            if name in ("", kind) and (before is None or time < before)
        ]
        living = {int(task.id) for task in self.tasks(message)} if sent else set()
        number = 0
        for kind, task in sent:
            if _may_live(task, living, connection) and cancels_of(
                life_cycle_of(connection.declared(kind))
            ):
                TaskRef(connection, kind, task, self._origin).cancel(why)
                number += 1
        return number

    # --- attaching --------------------------------------------------------------------------------

    def on_failure(
        self,
        failure: Failure[Any] | None,
        handler: ExceptionHandler[Any],
        *,
        of: Message[Any, Any] | TaskRef | None = None,
        maximum: int | None = None,
    ) -> AttachmentRef:
        """Let *handler* handle *failure* (None: any) of all tasks of a message, of one task and
        those below it, or (of=None) of all tasks, at most *maximum* times for each task it is
        attached to (None: any number, but its retry of a task that has been handled 100 times is
        refused, and the search continues further out).

        The search goes from the failing task up: on each task its own exception handlers come
            first, then those of its
        message, newest first (TCA 8.5: AddExceptionHandler, AddExceptionHandlerToMessage). The same
            pair attached again
        replaces the first.

        The handler gets the failure's data, or none if declared without. Raises MisuseError unless
        its type is the same, a union with it, or a dataclass with fewer fields; for any failure,
        None must fit too.
        """
        if isinstance(of, TaskRef):
            return of.on_failure(failure, handler, maximum=maximum)
        wanted = Recovery(failure, handler, maximum=maximum).attachment
        if of is not None:
            check("on_failure()", checks.FAILS, of=of)
        connection = self._declare(handler, *([of] if of is not None else []))
        where = f"all '{of.name}'" if of is not None else "the root"
        header = Attach(0, wanted, ROOT, of.name if of is not None else "", self._origin)
        return AttachmentRef(
            connection, connection.call(header, f"attaching '{handler.name}' to {where}"), header
        )

    def tap(
        self,
        condition: Condition,
        tapped: Message[Any, Any] | TaskRef,
        listener: Message[Any, Any],
        *,
        at_once: bool = False,
        **options: Unpack[Watched],
    ) -> AttachmentRef:
        """Send *listener*, with the tapped data, whenever the condition comes true of a message or
        task (TCA 8.5:
        TapMessage, TapReference).

        *Before* conditions hold their moment until the listener's task is done, *when* conditions
        hold the end, *while* and *after* hold nothing. A monitor that listens takes *options* as in
        ``monitor()``. A listener that nobody handles is skipped. The same wiretap of several
        modules fires once, until each has removed it; twice from one module it is one, with the
        newer *options*.

        What one task is tapped for may have happened already: then Refused ("too late") is raised,
        or with *at_once* the listener is sent now, once (TCM: InvokeWhen). Central has the data of
        a task that has ended only if it was kept: else the listener must be declared without data.

        A polling or demon monitor that listens *while* a task is in progress, or when it is sent,
        hangs under that and ends with it. Raises Refused for any other that would never end, for a
        command or monitor that is to hold a goal's planning, and for *at_once* with *before*
        conditions or those of success, failure or reply.
        """
        check("tap()", checks.CONDITION, condition=condition)
        check_message(listener)
        watch = None
        if isinstance(listener, Monitor):
            watch = _watch_options(listener, options, Watched)
        elif options:
            raise MisuseError(
                f"tap(): {min(options)} is for monitors that listen, not for {listener!r:.60}"
            )
        check("tap()", checks.FLAG, at_once=at_once)
        if isinstance(tapped, TaskRef):
            connection, where = self._declare(listener), LateText(lambda: str(tapped))
            of = tapped.message if at_once else ""
            header = Tap(
                0, condition, listener.name, "", node_of(tapped), watch, self._origin, at_once, of
            )
        elif at_once:
            raise MisuseError(
                "tap(): at_once is for one task, such as tasks(WALK)[0], not for all of a message"
            )
        else:
            connection, where = (
                self._declare(listener, tapped),
                LateText(lambda: f"'{tapped.name}'"),
            )
            header = Tap(0, condition, listener.name, tapped.name, ROOT, watch, self._origin)
        what = LateText(lambda: f"tapping {where} with '{listener.name}'")
        return AttachmentRef(connection, connection.call(header, what), header)

    @overload
    def monitor(
        self, monitor: Monitor[None], data: None = None, **options: Unpack[MonitorOptions]
    ) -> MonitorRef[None]: ...
    @overload
    def monitor(
        self, monitor: Monitor[D], data: D, **options: Unpack[MonitorOptions]
    ) -> MonitorRef[D]: ...
    def monitor(
        self, monitor: Monitor[Any], data: Any = None, **options: Unpack[MonitorOptions]
    ) -> MonitorRef[Any]:
        """Start a monitor under the task being handled. A polling or demon monitor ends at the
        latest when that waits for nothing but such monitors; one that is *waited_for* keeps it
        until its own end (maximum, duration, until).
        """
        check_class(monitor, Monitor, call="monitor")
        watch, body = _watch_options(monitor, options, MonitorOptions), monitor.encode_data(data)
        connection = self._declare(monitor)
        is_task, sequential = isinstance(monitor, PointMonitor), options.get("sequential", True)
        flags, constraints = Flags.NONE, list[Constraint]()
        if is_task:
            epoch = connection.session.epoch
            flags, constraints = self._ordering.place(epoch, is_goal=False, sequential=sequential)
        constraints += options.get("constraints", [])
        is_suspended = options.get("suspended", False)
        header = Send(
            0,
            monitor.name,
            self._parent,
            self._origin,
            flags,
            constraints,
            watch=watch,
            suspended=is_suspended,
        )
        task_id = connection.send_task(header, body, f"monitor '{monitor.name}'")
        if is_task:
            self._ordering.add(task_id, sequential=sequential)
        return MonitorRef(connection, monitor.name, task_id, self._origin, fired_with(monitor))

    @overload
    def fire(
        self,
        monitor: Monitor[Any] | TaskRef,
        action: Message[None, Any] | None = None,
        data: None = None,
    ) -> bool: ...
    @overload
    def fire(self, monitor: Monitor[Any] | TaskRef, action: Message[A, Any], data: A) -> bool: ...
    def fire(
        self,
        monitor: Monitor[Any] | TaskRef,
        action: Message[Any, Any] | None = None,
        data: Any = None,
    ) -> bool:
        """Fire one monitor, or all that watch of a message (TCM: Activate; TCA 8.5: FireDemon);
        whether any did.

        A demon monitor sends its *action*, with these data. Any other is fired without: it tests
        its condition now, and the period of a polling monitor starts anew. Fired again during a
        test, it tests again after that.
        """
        if isinstance(monitor, MonitorRef):
            return monitor.fire(action, data)
        if isinstance(monitor, TaskRef):
            which, message = node_of(monitor), ""
        else:
            check_class(monitor, Monitor, call="fire")
            check_action(monitor.title, fired_with(monitor), action)
            which, message = ROOT, monitor.name
        if action is not None:
            check_message(action)
        name, body = (action.name, action.encode_data(data)) if action is not None else ("", b"")
        connection = self._declare(*(one for one in (monitor, action) if isinstance(one, Message)))
        header = Fire(0, which, name, self._origin, message)
        return bool(connection.call(header, LateText(lambda: f"firing {monitor}"), body))


def _may_live(task: TaskId, living: set[int], connection: Connection) -> bool:
    """Whether a task that was sent lives, or central has said nothing of it yet."""
    if isinstance(task, SentId):
        if not task.request.is_over:
            return True
        if task.request.has_failed:
            return False
    is_foreign = isinstance(task, EpochNumber) and task.epoch != connection.session.epoch
    return not is_foreign and int(task) in living


def fired_with(monitor: Monitor[Any]) -> str:
    """The message that a monitor is fired with; "" if it tests a condition, or has no action."""
    action = monitor.parts[1] if isinstance(monitor, DemonMonitor) else None
    return action.name if action is not None else ""


def _watch_options(
    monitor: Monitor[Any], options: Watched | MonitorOptions, declared: type
) -> WatchOptions:
    """The options as central knows them. Raises MisuseError for those that the monitor can't
    have.
    """
    what = monitor.title
    check_options(what, options, declared)
    for name in ("period", "initial_wait"):
        if name in options and not isinstance(monitor, PollingMonitor):
            raise MisuseError(
                f"{what} can't have {name}: only polling monitors test again and again"
            )
    if isinstance(monitor, PollingMonitor) and options.get("period") is None:
        raise MisuseError(
            f"{what} needs period: the seconds from one test of its condition to the next"
        )
    return WatchOptions(
        options.get("period", 0),
        options.get("maximum") or 0,
        options.get("fire_every", 1),
        options.get("initial_wait", False),
        options.get("duration") or 0,
        options.get("until"),
        options.get("waited_for", False),
    )
