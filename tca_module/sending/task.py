"""The Task that a handler gets: the message being handled, and a Sender for its subtasks."""

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from typing import Any, TypeVar, overload

from tca_module import checks
from tca_module.checks import check
from tca_module.errors import CentralLost, MisuseError, TaskKilled
from tca_module.link.connection import Connection
from tca_module.sending.delivery_context import MonitorRef, TapEvent, Trouble, context_of
from tca_module.sending.handler_errors import Aborted, Rejection
from tca_module.sending.later_reply import LaterReply
from tca_module.sending.sender import Sender
from tca_module.sending.task_points import TaskInterval
from tca_module.sending.task_ref import FIND_IT, SteerableTask, TaskRef
from tca_module.sending.task_requests import ReportingTask, Requests, ServerState, TaskRequest
from tca_module.session.epoch_numbers import check_epoch, with_epoch
from tca_wire.messages.declarations import Message
from tca_wire.packets.headers import Deliver
from tca_wire.points import ROOT, Interval, TaskId
from tca_wire.text.measures import numbered

C = TypeVar("C")


class Task(Sender, SteerableTask, ReportingTask):
    """The message being handled. Goals and commands sent from it become its subtasks; ``kill``,
    ``suspend`` and their like are about itself.

    It belongs to the handler's thread, until the handler returns. A query, inform or broadcast is
    no task of the tree:
    its *id* is 0, and its handler sends under the root.
    """

    def __init__(
        self,
        connection: Connection,
        delivery: Deliver,
        message: Message[Any, Any],
        *,
        accepts: bool = False,
    ) -> None:
        """*accepts*: the handler says itself when it accepts the task."""
        self._link: Connection | None = connection
        self._wakes: Connection = connection  # also when the handler has returned
        self._message = message
        self.message = message.name
        self._delivery = delivery
        self._accepts = accepts
        self.is_async = False  #: its handler is a coroutine
        self._what = numbered(message.name, delivery.task) if delivery.task else f"'{message.name}'"
        epoch = connection.session.epoch
        task_id = with_epoch(delivery.task, epoch, self._what)
        origin = max(0, delivery.delivery)  # central knows no direct delivery
        Sender.__init__(self, task_id, with_epoch(origin, epoch, self._what))
        SteerableTask.__init__(self, task_id)
        self.began = connection.now()
        self.later: LaterReply[Any] | None = None  #: answers for the handler, if it said so

    def __repr__(self) -> str:
        return self._what

    @property
    def delivery(self) -> int:
        """The number by which the handler's answer names the message; below 0 if it came
        directly.
        """
        return self._delivery.delivery

    @property
    def cancelled(self) -> bool:
        """Whether the task has been killed or the module ends: clean up and return. Never waits.

        A handler that does not look is woken from its next wait with TaskKilled or Stopped, once.
        If it was told that its module ends, it has failed with "module lost", whatever it returns.
        """
        try:
            return self._connection().is_cancelled(self.delivery)
        except CentralLost:
            return True

    @property
    def suspended(self) -> bool:
        """Whether the task is suspended: the handler may pause, or finish. Never waits."""
        try:
            return self._connection().is_suspended(self.delivery)
        except CentralLost:
            return False

    @property
    def ref(self) -> TaskRef:
        """This task as others see it: to watch it, or to wait for a point of it."""
        return TaskRef(self._connection(), self.message, self._node(), self._origin)

    @property
    def trouble(self) -> Trouble:
        """The failure that this exception handler handles."""
        return self._context(Trouble, "exception handler")

    @property
    def tap_event(self) -> TapEvent:
        """The event that this listener of a wiretap was sent for."""
        return self._context(TapEvent, "listener of a wiretap")

    @property
    def monitor_ref(self) -> MonitorRef[Any]:
        """The monitor that sent this message."""
        return self._context(MonitorRef, "message of a monitor")

    def _context(self, kind: type[C], what: str) -> C:
        context = context_of(self._connection(), self._delivery, self._origin)
        if not isinstance(context, kind):
            raise MisuseError(f"'{self.message}' was not sent as {what}")
        return context

    # --- requests of clients ----------------------------------------------------------------------

    @overload
    def wait_for_request(self, timeout: None = None) -> TaskRequest: ...
    @overload
    def wait_for_request(self, timeout: float | None) -> TaskRequest | None: ...
    def wait_for_request(self, timeout: float | None = None) -> TaskRequest | None:
        """The next request of a client, each once; None after *timeout* seconds. Raises TaskKilled
        if the task is killed, Stopped if the module ends. In async handlers use ``requests()``.
        """
        check(f"wait_for_request() of {self}", checks.TIMEOUT, timeout=timeout)
        return self._served().wait(timeout)

    def requests(self) -> Requests:
        """The requests of clients as they come; in async handlers for ``async for request in
        task.requests():``.
        """
        return Requests(self._served())

    def rejected(self, why: str = "") -> Exception:
        """The error to raise when the task is not begun: ``raise task.rejected("no hand is
        free")``. Its client gets the failure "rejected".
        """
        check(f"rejected() of {self}", checks.TEXT, why=why)
        return Rejection(why or "its handler gives no reason")

    def aborted(self, why: str = "") -> TaskKilled:
        """The error to raise when all is safe after a request for the task's end: ``raise
        task.aborted()``. It is the short form of ``request.accept()`` and a return.
        """
        check(f"aborted() of {self}", checks.TEXT, why=why)
        self._served().stop(why)
        return Aborted(str(self), why or "a client has asked for its end")

    # --- time -------------------------------------------------------------------------------------

    def time(self) -> float:
        """The seconds of the clock by which handlers sleep, also if a restarted central has
        forgotten the task.
        """
        return self._own_connection().transport.time()

    def sleep(self, seconds: float) -> Any:
        """Let so many seconds pass. Raises TaskKilled or Stopped as soon as the task is killed or
        the module ends.

        In an async handler ``await task.sleep(2)``: its event loop turns, and a kill or the
        module's end raises CancelledError.
        """
        check(f"sleep() of {self}", checks.SECONDS, seconds=seconds)
        return self.sleep_until(self.time() + seconds)

    def sleep_until(self, moment: float) -> Any:
        """Let time pass until that moment of ``time()``: without drift, what a loop does meanwhile
        counts. Otherwise like ``sleep``.
        """
        connection = self._own_connection()
        if self.is_async and connection.await_moment is not None:
            return connection.await_moment(moment)
        connection.wait_until(lambda: False, f"the sleep of {self}", moment)
        return None

    def wait_until(
        self,
        is_over: Callable[[], bool],
        timeout: float | None = None,
        *,
        on: Iterable[TaskRef] = (),
    ) -> bool:
        """Wait until *is_over*, at most *timeout* seconds of ``time()``; whether it is. Otherwise
        like ``sleep``.

        It looks when ``wake()`` was called, from any thread: a driver's, for example. Central takes
        that for work of the handler's own; with *on* for a wait for changes of these tasks.
        """
        what = f"wait_until() of {self}"
        check(what, checks.TIMEOUT, timeout=timeout)
        connection = self._own_connection()
        connection.transport.waker()
        observed = [task._followed().request for task in on]  # noqa: SLF001 - a wait for many is made of each
        return connection.wait_until(
            is_over, what, None if timeout is None else self.time() + timeout, observed
        )

    def wake(self) -> None:
        """Have ``wait_until()`` look again; from any thread, at any time."""
        self._wakes.wake()

    def shielded(self) -> AbstractContextManager[None]:
        """A block whose waits no kill and no end of the module cuts short: for what must be done to
        leave things safe. ``cancelled`` still tells.
        """
        return self._own_connection().session.open_deliveries.shielded()

    def reply_later(self) -> LaterReply[Any]:
        """Let somebody else reply: return this from the handler, which is then done; the message is
        not.

        ::

            @arm.handles(MOVE)
            def move(task: Task, place: Place) -> LaterReply[Footfall]:
                later = task.reply_later()
                driver.begin(place, later)  # its thread calls later.reply(footfall)
                return later
        """
        connection = self._connection()
        if self.later is None:
            connection.transport.waker()  # an answer from another thread must not wait
            state = self._served() if self._task_id != ROOT else None
            self.later = LaterReply(connection, self._message, self._delivery, state)
        return self.later

    def _served(self) -> ServerState:
        self._node()
        connection = self._connection()
        connection.catch_up()
        delivery, message = self._delivery, self._message
        return connection.session.open_deliveries.state_of(
            self.delivery,
            lambda one: ServerState(connection, delivery, one, message, accepts=self._accepts),
        )

    def check_sent(self) -> None:
        """The handler is about to return: raises the error of a task that it has sent, if one is
        known. If a message came directly, waits until central has spoken of all: it does not know
        whose they are.
        """
        if self._link is not None:
            self._link.settle(self._origin, wait=self.delivery < 0)

    def returned(self) -> None:
        """The handler has returned: this sends nothing more."""
        self._link = self.later = None

    def _connection(self) -> Connection:
        connection = self._own_connection()
        check_epoch([self._origin], connection.session.epoch)
        return connection

    def _own_connection(self) -> Connection:
        """The handler's connection, also if central was restarted and has forgotten the task."""
        if self._link is None:
            raise MisuseError(
                f"{self} is used after its handler returned: send before it returns, or from the module"
            )
        self._link.check_thread(self, "handles it", FIND_IT)
        return self._link

    def _node(self) -> TaskId:
        if self._task_id == ROOT:
            raise MisuseError(
                f"'{self.message}' is no task of the tree: only goals and commands are"
            )
        return self._task_id

    def _interval(self, interval: Interval) -> TaskInterval:
        if self._task_id == ROOT:
            msg = f"'{self.message}' is no task of the tree and has no points: only goals and commands have"
            raise MisuseError(msg)
        return TaskInterval(self._task_id, interval)
