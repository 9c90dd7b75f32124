"""The part of a Sender that finds and watches tasks, with exception handlers and monitors."""

from collections.abc import Collection
from typing import Annotated, Any, TypedDict, Unpack, overload

from tca_module import checks
from tca_module.checks import (
    LateText,
    check,
    check_class,
    check_message,
    check_options,
    with_options,
)
from tca_module.errors import MisuseError
from tca_module.following.followed_task import cancel_transitions, check_states, life_cycle_of
from tca_module.following.observation import Observation
from tca_module.following.stream import Stream
from tca_module.link.connection import Connection
from tca_module.sending.attachments import AttachmentRef, Recovery
from tca_module.sending.central_services import CentralServices
from tca_module.sending.delivery_context import A, MonitorRef, check_action
from tca_module.sending.task_ref import Change, SentTask, TaskRef, change_of, tree_id_of
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
    """The options of every monitor, also of one that is a wiretap's listener.

    See ``MonitorOptions``.
    """

    period: Annotated[float | None, checks.DURATION_OR_NONE, None]
    maximum: Annotated[int | None, checks.MAXIMUM, None]
    fire_every: Annotated[int, checks.COUNT, 1]
    initial_wait: Annotated[bool, checks.FLAG, False]
    duration: Annotated[float | None, checks.DURATION_OR_NONE, None]
    until: Annotated[Point | None, checks.POINT_OR_NONE, None]
    waited_for: Annotated[bool, checks.FLAG, False]


class MonitorOptions(Watched, total=False):
    """The options of a new monitor (TCA 8.5: CreateMonitorOptions).

    Args:
        period: the seconds, above 0, between a polling monitor's tests. A polling monitor needs it.
        maximum: the number of actions after which the monitor ends. Default: None, no bound.
        fire_every: send the action only every n-th time that the condition holds or the monitor is
            fired. Default: 1.
        initial_wait: a polling monitor tests first after one period, not at once. Default: False.
        duration: the seconds, above 0, after which the monitor ends. Default: None, no bound.
        until: the point at which the monitor ends. Default: None, no bound.
        waited_for: the parent waits for the monitor's end. Give *maximum*, *duration* or *until*,
            or call ``end()``, so that the monitor ends. Default: False.
        sequential: a point monitor tests after its previous sibling has been achieved. Default:
            True.
        constraints: more constraints, in which ``this`` stands for the new monitor. Default: none.
        suspended: create the monitor suspended; it watches after ``resume()``. Default: False.
    """

    sequential: Annotated[bool, checks.FLAG, True]
    constraints: Annotated[list[Constraint], checks.CONSTRAINTS, ()]
    suspended: Annotated[bool, checks.FLAG, False]


_STATES = checks.collection_of("a list of states, such as ['running']", checks.NAME)
TASK = checks.instance_of("a task that was sent or found, such as tasks(WALK)[0]", TaskRef)


def checked_states(call: str, message: object, states: Collection[str]) -> list[str]:
    """Check the states that an observer wants to see, and return them as a list.

    Raises MisuseError for a state that the message's tasks never have.
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
        """Find a task by its number.

        Args:
            task_id: the number, as in the journal.

        Returns:
            The TaskRef; None if the task has ended and is not retained.

        Raises:
            Refused: there has never been a task of that number.
            CentralLost: central does not answer, or has forgotten the task.

        Example::

            if moving := user.task(12):
                moving.kill("the driver says stop")
        """
        check("task()", checks.NUMBER, task_id=task_id)
        info = TaskRef(self._connection(), "", TaskId(task_id)).info()
        if info is None:
            return None
        return TaskRef(self._connection(), info.message, info.id, self._origin)

    def sent_task(self, message: Message[Any, R], task_id: int, epoch: str = "") -> SentTask[R]:
        """Return a task that an earlier run of this program has sent, to wait for its end.

        If the task ended long ago, its ``wait()`` raises Refused ("too late").

        Args:
            message: the task's goal or command.
            task_id: the task's number, which the earlier run stored: ``task.id``.
            epoch: the central that assigned the number: ``task.id.epoch``. Default: "", the present
                central.

        Raises:
            CentralLost: the present central does not have that *epoch*.
            MisuseError: *message* is no goal or command.

        Example::

            walk = user.sent_task(WALK, stored_id, stored_epoch)
            print(walk.wait())
        """
        check("sent_task()", checks.NUMBER, task_id=task_id)
        check("sent_task()", checks.TEXT, epoch=epoch)
        check_class(message, Goal, Command, call="sent_task")
        connection = self._declare(message)
        number = with_epoch(TaskId(task_id), epoch, numbered(message.name, task_id))
        check_epoch([number], connection.session.epoch)
        return SentTask(connection, message, number, self._origin)

    def tasks(self, message: Message[Any, Any] | str | None = None) -> list[TaskRef]:
        """Return the living tasks, parents before children, at most 10,000 (TCA 8.5: ChildByName).

        Args:
            message: only tasks of this message or name. Default: None, all.

        Raises:
            CentralLost: central does not answer.

        Example::

            for walking in user.tasks(WALK):
                walking.suspend()
        """
        return TaskRef(self._connection(), "root", ROOT, self._origin).descendants(message)

    def time(self) -> float:
        """Return the seconds of the clock of callbacks and sleeps.

        That clock never jumps, but a test may step it.
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
        """Observe the changes of state of tasks, of any sender and handler.

        First comes the present state of each living task (``is_late``), then each change as it
        happens. After a restart of central the present states come again. With *below*, the stream
        ends when that task ends.

        Args:
            message: only tasks of this message or name. Default: None, all.
            states: only changes to one of these states. Changes to other states then do not count
                as missed. Default: all states.
            below: only tasks below this task. Default: None, the whole tree.
            timeout: the most seconds that a step of the iteration waits. Default: None, no bound.

        Returns:
            A Stream of Changes. Close it, or use it in a ``with`` block.

        Raises:
            MisuseError: tasks of *message* never have one of the *states*, or another argument is
                wrong.
            Timeout: from the iteration: no change came in time.
            CentralLost: central does not answer.

        Example::

            with user.observe(GRASP) as changes:
                for change in changes:
                    print(change.task, change.state)
        """
        wanted_states = checked_states("observe()", message, states)
        check("observe()", TASK.or_none(), below=below)
        connection = self._declare(message) if isinstance(message, Message) else self._connection()
        name = message.name if isinstance(message, Message) else message or ""
        under = tree_id_of(below) if below is not None else ROOT
        what = LateText(lambda: f"the states of '{name}'" if name else "the states of tasks")
        header = Observe(0, TaskId(0), name, under, wanted_states, self._origin)
        observation, origin = Observation(connection, header, what), self._origin
        return Stream(
            observation,
            lambda observed: change_of(connection, observed, origin),
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
        """Cancel the living tasks that this Sender has sent: call ``cancel()`` of each task.

        A Sender remembers the newest 10,000 tasks that it has sent. Tasks whose life cycle has no
        cancel are not affected.

        Args:
            message: only tasks of this message. Default: None, all.
            before: only tasks that were sent before this value of ``time()``. Default: None, all.
            why: the reason, for people. Default: "".

        Returns:
            The number of cancelled tasks.

        Raises:
            CentralLost: central does not answer.

        Example::

            user.cancel_all(WALK, why="the operator has left")
        """
        if message is not None:
            check("cancel_all()", checks.MESSAGE, message=message)
        check("cancel_all()", checks.SECONDS_OR_NONE, before=before)
        check("cancel_all()", checks.TEXT, why=why)
        connection = self._connection()
        sent = [
            (name, task)
            for time, name, task in self._sent
            if (message is None or name == message.name) and (before is None or time < before)
        ]
        living = {int(task.id) for task in self.tasks(message)} if sent else set()
        number = 0
        for name, task in sent:
            cycle = life_cycle_of(connection.declared(name))
            if _may_be_living(task, living, connection) and cancel_transitions(cycle):
                TaskRef(connection, name, task, self._origin).cancel(why)
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
        """Attach an exception handler: *handler* handles *failure*.

        The search for an exception handler goes from the failing task up the tree. On each task,
        the exception handlers of that task come first, then those of its message. Newer ones come
        before older ones. The root comes last (TCA 8.5: AddExceptionHandler,
        AddExceptionHandlerToMessage). Attaching the same *failure* and *handler* again replaces the
        first attachment.

        The handler gets the failure's data, or none if the handler is declared without data. The
        handler's data type must be the failure's type, a union that includes it, or a dataclass
        with fewer fields. A handler of any failure must also accept None.

        Args:
            failure: the failure; None for any failure.
            handler: the ExceptionHandler.
            of: a message: all its tasks. A task: that task and those below it. Default: None, the
                root: all tasks.
            maximum: how often *handler* may be called for each task that it is attached to.
                Default: None, any number. A retry of a task that has been handled 100 times is
                always refused, and the search continues.

        Returns:
            The AttachmentRef; its ``remove()`` detaches the handler.

        Raises:
            MisuseError: *handler* can't accept the failure's data, or an argument is wrong.
            Refused: "too late": the task *of* has ended.
            CentralLost: central does not answer, or has forgotten the task.

        Example::

            planner.on_failure(COLLISION, RAISE_LEG, of=MOVE_LEG, maximum=2)
        """
        if isinstance(of, TaskRef):
            return of.on_failure(failure, handler, maximum=maximum)
        attachment = Recovery(failure, handler, maximum=maximum).attachment
        if of is not None:
            check("on_failure()", checks.CAN_FAIL, of=of)
        connection = self._declare(handler, *([of] if of is not None else []))
        where = f"all '{of.name}'" if of is not None else "the root"
        header = Attach(0, attachment, ROOT, of.name if of is not None else "", self._origin)
        number = connection.call(header, f"attaching '{handler.name}' to {where}")
        return AttachmentRef(connection, number, header)

    @with_options
    def tap(
        self,
        condition: Condition,
        tapped: Message[Any, Any] | TaskRef,
        listener: Message[Any, Any],
        *,
        at_once: bool = False,
        **options: Unpack[Watched],
    ) -> AttachmentRef:
        """Attach a wiretap: *listener* is sent when *condition* comes true for a message or task.

        The listener gets the data of the tapped message (TCA 8.5: TapMessage, TapReference). A
        *before* condition holds the moment that it names until the listener's task is done. A
        *when* condition holds the end of the tapped task. *While* and *after* conditions hold
        nothing. A listener without a handler is skipped. If several modules attach the same
        wiretap, it fires once for each event, until each module has removed it. If one module
        attaches it again, the new *options* replace the old ones.

        For a single task the condition may have come true already. Then the wiretap is refused
        ("too late"), or with *at_once* the listener is sent now, once (TCM: InvokeWhen). Central
        has the data of an ended task only if the task was kept. Otherwise the listener must be
        declared without data.

        A polling or demon monitor may listen *while* a task is in progress, or *when sent*. The
        monitor is then placed under that task, and ends with the task.

        Args:
            condition: a ``Condition``, such as ``Condition.BEFORE_HANDLING``.
            tapped: the message, or one task.
            listener: the message to send: a goal, command, inform, broadcast or monitor.
            at_once: for one task: send the listener now if the condition has come true already.
                Default: False.
            options: for a monitor that listens: period, maximum, fire_every, initial_wait,
                duration, until and waited_for of ``MonitorOptions``.

        Returns:
            The AttachmentRef; its ``remove()`` removes the wiretap.

        Raises:
            Refused: "too late"; or *listener* is a monitor that would never end; or *listener* is a
                command or monitor that would hold a goal's planning. With *at_once*, also:
                *condition* is a *before* condition, or one of success, failure or reply.
            MisuseError: an argument is wrong.
            CentralLost: central does not answer, or has forgotten the task.

        Example::

            safety.tap(Condition.BEFORE_HANDLING, MOVE_LEG, STABILITY_CHECK)
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
            connection = self._declare(listener)
            of = tapped.message if at_once else ""
            header = Tap(
                0,
                condition,
                listener.name,
                "",
                tree_id_of(tapped),
                watch,
                self._origin,
                at_once,
                of,
            )
        elif at_once:
            raise MisuseError(
                "tap(): at_once is for one task, such as tasks(WALK)[0], not for all of a message"
            )
        else:
            connection = self._declare(listener, tapped)
            header = Tap(0, condition, listener.name, tapped.name, ROOT, watch, self._origin)
        place = tapped if isinstance(tapped, TaskRef) else f"'{tapped.name}'"
        what = LateText(lambda: f"tapping {place} with '{listener.name}'")
        return AttachmentRef(connection, connection.call(header, what), header)

    @overload
    def monitor(
        self, monitor: Monitor[None], data: None = None, **options: Unpack[MonitorOptions]
    ) -> MonitorRef[None]: ...
    @overload
    def monitor(
        self, monitor: Monitor[D], data: D, **options: Unpack[MonitorOptions]
    ) -> MonitorRef[D]: ...
    @with_options
    def monitor(
        self, monitor: Monitor[Any], data: Any = None, **options: Unpack[MonitorOptions]
    ) -> MonitorRef[Any]:
        """Start a monitor under the task being handled. Returns at once.

        A polling or demon monitor ends at the latest when only such monitors are left under its
        parent. With *waited_for*, the parent waits until the monitor ends by itself.

        Args:
            monitor: the monitor.
            data: its data. Default: None, for a monitor without data.
            options: see ``MonitorOptions``: period, maximum, fire_every, initial_wait, duration,
                until, waited_for, sequential, constraints, suspended.

        Returns:
            The MonitorRef, with ``fire()`` and ``end()``.

        Raises:
            BadData: *data* does not fit the monitor.
            MisuseError: an option is wrong, or a polling monitor has no period.
            Refused: as for ``goal``. The first use of the monitor raises it, or the next call of
                this Sender.
            CentralLost: central does not answer.

        Example::

            task.monitor(BATTERY_LOW, period=1.0, maximum=1)
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
        header = Send(
            0,
            monitor.name,
            self._parent,
            self._origin,
            flags,
            constraints,
            watch=watch,
            suspended=options.get("suspended", False),
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
        """Fire one monitor, or all monitors of a message (TCM: Activate; TCA 8.5: FireDemon).

        A demon monitor sends its action with *data*. Other monitors are fired without arguments.
        They test their condition now, and the period of a polling monitor starts again. A monitor
        that is fired during a test tests once more.

        Args:
            monitor: the monitor's message, or one monitor.
            action: the action of a demon monitor. Default: None, for other monitors.
            data: the action's data. Default: None.

        Returns:
            True if at least one monitor was fired.

        Raises:
            MisuseError: *action* is not the monitor's action, or *monitor* is no monitor.
            BadData: *data* does not fit the action.
            CentralLost: central does not answer.

        Example::

            user.fire(ROCKS, STOP_WALKING, rock)
        """
        if isinstance(monitor, MonitorRef):
            return monitor.fire(action, data)
        if isinstance(monitor, TaskRef):
            node, message = tree_id_of(monitor), ""
        else:
            check_class(monitor, Monitor, call="fire")
            check_action(monitor.title, fired_with(monitor), action)
            node, message = ROOT, monitor.name
        if action is not None:
            check_message(action)
        name, body = (action.name, action.encode_data(data)) if action is not None else ("", b"")
        messages = [given for given in (monitor, action) if isinstance(given, Message)]
        connection = self._declare(*messages)
        header = Fire(0, node, name, self._origin, message)
        return bool(connection.call(header, LateText(lambda: f"firing {monitor}"), body))


def _may_be_living(task: TaskId, living: set[int], connection: Connection) -> bool:
    """Whether a sent task is among the *living*, or central has not acknowledged it yet."""
    if isinstance(task, SentId):
        if not task.request.is_over:
            return True
        if task.request.has_failed:
            return False
    is_foreign = isinstance(task, EpochNumber) and task.epoch != connection.session.epoch
    return not is_foreign and int(task) in living


def fired_with(monitor: Monitor[Any]) -> str:
    """Return the name of the action that a demon monitor is fired with; "" for other monitors."""
    action = monitor.parts[1] if isinstance(monitor, DemonMonitor) else None
    return action.name if action is not None else ""


def _watch_options(
    monitor: Monitor[Any], options: Watched | MonitorOptions, declared: type
) -> WatchOptions:
    """Return the options in the form for central. Raises MisuseError for an unsuitable option."""
    what = monitor.title
    check_options(what, options, declared)
    for name in ("period", "initial_wait"):
        if name in options and not isinstance(monitor, PollingMonitor):
            raise MisuseError(f"{what} can't have {name}: only polling monitors test periodically")
    if isinstance(monitor, PollingMonitor) and options.get("period") is None:
        advice = "the seconds from one test of its condition to the next"
        raise MisuseError(f"{what} needs period: {advice}")
    return WatchOptions(
        options.get("period") or 0,
        options.get("maximum") or 0,
        options.get("fire_every", 1),
        options.get("initial_wait", False),
        options.get("duration") or 0,
        options.get("until"),
        options.get("waited_for", False),
    )
