"""Task: the argument of a handler. It is the message being handled, and sends its subtasks."""

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
from tca_module.sending.task_ref import FIND_IT, TaskNode, TaskRef
from tca_module.sending.task_requests import ReportingTask, Requests, ServerState, TaskRequest
from tca_module.session.epoch_numbers import check_epoch, with_epoch
from tca_wire.messages.declarations import Message
from tca_wire.packets.headers import Deliver
from tca_wire.points import ROOT, Interval, TaskId
from tca_wire.text.measures import numbered

C = TypeVar("C")


class Task(Sender, TaskNode, ReportingTask):
    """The message being handled, and a Sender: goals and commands sent with it become its subtasks.

    ``kill``, ``suspend`` and the other steering calls concern the handled task itself. A Task
    belongs to the handler's thread, until the handler returns. A query, inform or broadcast is not
    a task of the tree: its *id* is 0, and its handler sends under the root.

    Attributes:
        message: the name of the message.
        later: the ``LaterReply`` that ``reply_later()`` returned; None before.

    Example::

        @planner.handles(WALK)
        def walk(task: Task, path: Path) -> None:
            for step in path.steps:
                task.command(TAKE_STEP, step)
    """

    def __init__(
        self,
        connection: Connection,
        delivery: Deliver,
        message: Message[Any, Any],
        *,
        accepts: bool = False,
    ) -> None:
        """*accepts*: the handler itself calls ``accept()``."""
        self._link: Connection | None = connection
        self._connection_to_wake: Connection = (
            connection  # for wake(), also after the handler has returned
        )
        self._message = message
        self.message = message.name
        self._delivery = delivery
        self._accepts = accepts
        self.is_async = False  #: the handler is a coroutine
        self._what = numbered(message.name, delivery.task) if delivery.task else f"'{message.name}'"
        epoch = connection.session.epoch
        task_id = with_epoch(delivery.task, epoch, self._what)
        Sender.__init__(self, task_id, with_epoch(delivery.delivery, epoch, self._what))
        TaskNode.__init__(self, task_id)
        self.began = connection.now()
        self.later: LaterReply[Any] | None = None
        self._served: ServerState | None = None  # for a task of the tree, from its first use on

    def __repr__(self) -> str:
        return self._what

    @property
    def delivery(self) -> int:
        """The number by which central knows this delivery."""
        return self._delivery.delivery

    @property
    def cancelled(self) -> bool:
        """Whether the handler should return: after a kill or retry, or at the module's end.

        Clean up and return when ``cancelled`` is true. Reading it never waits. If a handler does
        not read it, the handler's next wait raises TaskKilled or Stopped, once. A handler that was
        notified of its module's end fails with "module lost", whatever it returns.

        Example::

            while not task.cancelled:
                step()
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
        """This task as other programs see it, to follow it or to wait for one of its points."""
        return TaskRef(self._connection(), self.message, self._tree_id(), self._origin)

    @property
    def trouble(self) -> Trouble:
        """The failure that this exception handler handles.

        Raises:
            MisuseError: the message was not sent as an exception handler.
        """
        return self._context(Trouble, "trouble", "an exception handler", "on_failure()")

    @property
    def tap_event(self) -> TapEvent:
        """The event for which this listener of a wiretap was sent.

        Raises:
            MisuseError: the message was not sent as a listener.
        """
        return self._context(TapEvent, "tap_event", "a listener of a wiretap", "tap()")

    @property
    def monitor_ref(self) -> MonitorRef[Any]:
        """The monitor that sent this message.

        Raises:
            MisuseError: the message was not sent by a monitor.
        """
        return self._context(MonitorRef, "monitor_ref", "a message of a monitor", "monitor()")

    def _context(self, kind: type[C], name: str, what: str, call: str) -> C:
        context = context_of(self._connection(), self._delivery, self._origin)
        if not isinstance(context, kind):
            text = f"task.{name}: '{self.message}' was not sent as {what}"
            raise MisuseError(f"{text}: name it in {call} instead of sending it")
        return context

    # --- requests of clients ----------------------------------------------------------------------

    @overload
    def wait_for_request(self, timeout: None = None) -> TaskRequest: ...
    @overload
    def wait_for_request(self, timeout: float | None) -> TaskRequest | None: ...
    def wait_for_request(self, timeout: float | None = None) -> TaskRequest | None:
        """Wait for the next request of a client. Each request is returned once.

        In an async handler use ``requests()`` instead.

        Args:
            timeout: the most seconds to wait. Default: None, no bound.

        Returns:
            The TaskRequest; None if there was none in time.

        Raises:
            TaskKilled: the task was killed.
            Stopped: the module ends.
            MisuseError: the message is not a task of the tree.

        Example::

            while (request := task.wait_for_request(timeout=0.1)) is None:
                step()
            request.accept()
        """
        check(f"wait_for_request() of {self}", checks.TIMEOUT, timeout=timeout)
        return self._server_state().wait(timeout)

    def requests(self) -> Requests:
        """Return the requests of clients, to iterate over as they arrive.

        Example::

            async for request in task.requests():
                request.reject("too late to change")
        """
        return Requests(self._server_state())

    def rejected(self, why: str = "") -> Exception:
        """Return the error to raise when the handler does not start the task.

        The task's client gets the failure "rejected".

        Args:
            why: the reason, for people. Default: "".

        Example::

            raise task.rejected("no hand is free")
        """
        check(f"rejected() of {self}", checks.TEXT, why=why)
        return Rejection(why or "its handler gives no reason")

    def aborted(self, why: str = "") -> TaskKilled:
        """Return the error to raise when all is safe after a client has asked for the task's end.

        The call also accepts the client's request. ``raise task.aborted()`` replaces
        ``request.accept()`` and a return.

        Args:
            why: the reason, for people. Default: "".

        Raises:
            MisuseError: no client has asked for the task's end.

        Example::

            raise task.aborted()
        """
        check(f"aborted() of {self}", checks.TEXT, why=why)
        self._server_state().stop(why)
        return Aborted(str(self), why or "a client has asked for its end")

    # --- time -------------------------------------------------------------------------------------

    def time(self) -> float:
        """Return the seconds of the clock by which handlers sleep.

        This works even if central was restarted and has forgotten the task.
        """
        return self._own_connection().transport.time()

    def sleep(self, seconds: float) -> Any:
        """Sleep for *seconds*. In an async handler: ``await task.sleep(2)``.

        Args:
            seconds: 0 or more; a test may step the clock.

        Returns:
            None; in an async handler an awaitable.

        Raises:
            TaskKilled: the task was killed; in an async handler CancelledError.
            Stopped: the module ends; in an async handler CancelledError.
            CentralLost: central does not answer, or has forgotten the task.

        Example::

            task.sleep(0.5)
        """
        check(f"sleep() of {self}", checks.SECONDS, seconds=seconds)
        return self.sleep_until(self.time() + seconds)

    def sleep_until(self, moment: float) -> Any:
        """Sleep until a time on the clock of ``time()``. A loop of such sleeps does not drift.

        In an async handler: ``await task.sleep_until(moment)``.

        Args:
            moment: the time, in seconds of ``time()``. If it has passed, the call returns at once.

        Returns:
            None; in an async handler an awaitable.

        Raises:
            TaskKilled: the task was killed; in an async handler CancelledError.
            Stopped: the module ends; in an async handler CancelledError.
            CentralLost: central does not answer, or has forgotten the task.

        Example::

            moment = task.time()
            while moving:
                step()
                moment += 0.02
                task.sleep_until(moment)
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
        """Wait until *is_over* returns true.

        The library calls *is_over* at the start, and whenever a thread calls ``wake()``. Central
        counts the wait as work of the handler. With *on*, central counts the wait as one for
        changes of the tasks in *on*. Errors are those of ``sleep``.

        Args:
            is_over: a function without arguments.
            timeout: the most seconds of ``time()`` to wait. Default: None, no bound.
            on: tasks whose changes also cause a call of *is_over*. Default: none.

        Returns:
            The last value of *is_over*, as a bool.

        Example::

            driver.on_stop = task.wake  # called in the driver's thread
            if not task.wait_until(lambda: driver.has_stopped, timeout=5):
                raise STUCK()
        """
        what = f"wait_until() of {self}"
        check(what, checks.TIMEOUT, timeout=timeout)
        connection = self._own_connection()
        connection.transport.waker()  # so that wake() has effect at once
        observed = [task._ensure_mirror().request for task in on]  # noqa: SLF001
        moment = None if timeout is None else self.time() + timeout
        return connection.wait_until(is_over, what, moment, observed)

    def wake(self) -> None:
        """Have ``wait_until()`` call its function again; from any thread, at any time."""
        self._connection_to_wake.wake()

    def shielded(self) -> AbstractContextManager[None]:
        """Start a ``with`` block whose waits are not cut short by a kill or the module's end.

        Use it for the steps that leave things safe. ``cancelled`` still becomes true. A subtask
        that is sent here is killed at once with its task: send actions with ``on_termination()``.

        Returns:
            The block.

        Example::

            with task.shielded():
                task.query(IS_RETRACTED)
        """
        return self._own_connection().session.open_deliveries.shielded()

    def reply_later(self, *, frees_slot: bool = False) -> LaterReply[Any]:
        """Return a LaterReply: the handler returns it, and another thread or callback replies.

        The message is complete when that thread or callback has replied. From the handler's return
        until then, the slot handles only tasks below this one.

        Args:
            frees_slot: the slot handles any message in the meantime. Default: False.

        Returns:
            The LaterReply. Each call returns the same one.

        Example::

            @arm.handles(MOVE)
            def move(task: Task, place: Place) -> LaterReply[Footfall]:
                later = task.reply_later()
                driver.start(place, later)  # its thread calls later.reply(footfall)
                return later
        """
        connection = self._connection()
        if self.later is None:
            connection.transport.waker()  # so that an answer can wake this thread at once
            state = self._server_state() if self._task_id != ROOT else None
            self.later = LaterReply(connection, self._message, self._delivery, state)
        self.later.frees_slot |= frees_slot
        return self.later

    def _server_state(self) -> ServerState:
        """Return the task's state, with the requests that have arrived."""
        self._tree_id()
        connection = self._connection()
        connection.catch_up()
        delivery, message = self._delivery, self._message
        self._served = connection.session.open_deliveries.state_of(
            self.delivery,
            lambda handler: ServerState(
                connection, delivery, handler, message, accepts=self._accepts
            ),
        )
        return self._served

    @property
    def ending(self) -> str:
        """The transition by which the handler ends the task, if it has chosen one with ``take()``;
        else "".
        """
        return self._served.ending if self._served is not None else ""

    def raise_send_errors(self) -> None:
        """Raise the error of a task that the handler has sent, if one is known.

        The library calls this when the handler returns.
        """
        if self._link is not None:
            self._link.raise_send_errors(self._origin, wait=False)

    def encode_reply(self, reply: Any) -> bytes:
        """Return the handler's reply or result as it is sent. Raises BadData or Refused."""
        body = self._message.encode_reply(reply)
        return self._own_connection().store(body, self._message.title)

    def handler_returned(self) -> None:
        """Record that the handler has returned. This Task sends nothing more."""
        self._link = self.later = None

    def _connection(self) -> Connection:
        connection = self._own_connection()
        check_epoch([self._origin], connection.session.epoch)
        return connection

    def _own_connection(self) -> Connection:
        """Return the handler's connection, even if central has forgotten the task."""
        if self._link is None:
            advice = "send before it returns, or from the module"
            raise MisuseError(f"{self} is used after its handler returned: {advice}")
        self._link.check_thread(self, "handles it", FIND_IT)
        return self._link

    def _tree_id(self) -> TaskId:
        if self._task_id == ROOT:
            text = "is no task of the tree: only goals and commands are"
            raise MisuseError(f"'{self.message}' {text}")
        return self._task_id

    def _interval(self, interval: Interval) -> TaskInterval:
        return TaskInterval(self._tree_id(), interval)
