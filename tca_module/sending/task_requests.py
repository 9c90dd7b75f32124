"""A task's state on its server's side, and the requests of clients: a new goal, the task's end.

The table of the task's life cycle says which transitions the handler may make. Other transitions
are refused here, without central. This check knows only the requests that have been read here. If
another request of a client is on its way, central decides (tca_central/life_cycles).
"""

import threading
from collections.abc import AsyncIterator, Callable, Iterator
from functools import partial
from typing import Any

from tca_module.checks import NAME, TEXT, check, quoted
from tca_module.errors import BadData, CentralLost, MisuseError
from tca_module.following.followed_task import life_cycle_of
from tca_module.following.stream import awaited
from tca_module.link.connection import Connection
from tca_module.session.epoch_numbers import with_epoch
from tca_module.session.open_deliveries import OpenDelivery
from tca_module.session.request import Request
from tca_wire.life_cycles import Effect, Transition
from tca_wire.messages.declarations import Message, TaskMessage
from tca_wire.packets.changes import ChangeState, Observe, Requested
from tca_wire.packets.headers import Deliver
from tca_wire.text.measures import numbered
from tca_wire.vocabulary import Party


class TaskRequest:
    """A request of a client, such as "update" or "cancel": ``accept()`` or ``reject()`` it.

    The client has made a transition of the task's state. The request stays open until the handler
    answers, or until another request overtakes this one.

    Attributes:
        transition: the name of the transition.
        goal: the new goal of an update; None for other requests.
        why: the client's reason; "" without one.
        serial: the number of changes of the task's state, the client's transition included.

    Example::

        for request in task.requests():
            if request.transition == "cancel":
                stop_motors()
                request.accept()
                return None
            request.reject("only a cancel is possible")
    """

    def __init__(
        self, server_state: "ServerState", row: Transition, header: Requested, goal: Any
    ) -> None:
        self.transition = header.transition
        self.goal = goal
        self.why = header.text
        self.serial = header.serial
        self.row = row
        self.is_delivered = False  #: a wait has returned it to the handler
        self._server_state = server_state

    def __repr__(self) -> str:
        why = f": {self.why}" if self.why else ""
        return f"'{self.transition}' of {self._server_state}{why}"

    @property
    def is_open(self) -> bool:
        """Whether the request is still to be answered by the handler. Never waits."""
        return self._server_state.is_open(self)

    def accept(self, goal: Any = None) -> bool:
        """Grant the request: the new goal becomes the task's, or the task ends as cancelled.

        After a cancel, the handler should return.

        Args:
            goal: for an update, the goal that the task gets instead of the requested goal. It is
                useful if updates name only what changes. Default: None, the requested goal.

        Returns:
            False if another request has overtaken this one.

        Raises:
            BadData: *goal* does not fit the task's message.
            MisuseError: *goal* is given, and the request is no update.

        Example::

            for request in task.requests():
                if request.transition == "update":
                    request.accept()
                else:
                    request.reject("not while I hold a cup")
        """
        return self._server_state.accept(self, goal)

    def reject(self, why: str = "") -> bool:
        """Reject the request: the task continues as before, and the client gets the reason.

        Args:
            why: the reason, for people. Default: "".

        Returns:
            False if another request has overtaken this one.

        Raises:
            MisuseError: the task's life cycle has no transition that rejects the request.
        """
        return self._server_state.reject(self, why)


class ServerState:
    """The state of a task that is being handled. Any thread may use it."""

    def __init__(
        self,
        connection: Connection,
        delivery: Deliver,
        open_delivery: OpenDelivery,
        message: Message[Any, Any],
        *,
        accepts: bool,
    ) -> None:
        """*accepts*: the handler itself accepts the task."""
        self.life_cycle = cycle = life_cycle_of(message)
        self._state = cycle.initial if accepts else cycle.accepted.target
        #: a Server's methods answer the requests, so no wait returns a request
        self.has_request_methods = False
        #: weak reference to the function to call when the task is stopped; it may return None
        self.on_stop: Callable[[], Callable[[], object] | None] = lambda: None
        self._is_started_by_refusal = False
        self._serial = 0  # of the newest transition of a client
        self._open: list[TaskRequest] = []  # oldest first
        self._connection = connection
        self._message = message
        self.open_delivery = open_delivery
        self.ending = ""  #: the transition by which the handler will end the task, if it has chosen
        self._what = numbered(message.name, delivery.task)
        epoch = connection.session.epoch
        self._task = with_epoch(delivery.task, epoch, self._what)
        self._origin = with_epoch(delivery.delivery, epoch, self._what)
        self._lock = threading.RLock()
        # A coroutine that waits for a client's request awaits this Request. It is never sent, so it
        # has no number. Central need not know of the wait, because any client may end it.
        self._awaited = Request(Observe(0), b"", wants_answer=True)
        open_delivery.on_request += (self._wake,)

    def __repr__(self) -> str:
        return self._what

    def _wake(self) -> None:
        """Wake the coroutine that waits for requests."""
        if self._awaited.wake is not None:
            self._awaited.wake()

    # --- requests of clients ----------------------------------------------------------------------

    @property
    def state(self) -> str:
        """The task's state."""
        self._read_requests()
        return self._state

    @property
    def is_over(self) -> bool:
        """Whether the task has been stopped at a client's request."""
        return self.life_cycle.is_over(self._state)

    @property
    def can_reject(self) -> bool:
        """Whether the handler can reject a request in the task's state."""
        return self.life_cycle.refusal(self._state) is not None

    @property
    def oldest(self) -> TaskRequest | None:
        """The oldest open request; None without any."""
        self._read_requests()
        return next(iter(self._open), None)

    def is_open(self, request: TaskRequest) -> bool:
        """Whether a request waits for the handler's answer."""
        self._read_requests()
        return request in self._open

    @property
    def has_new(self) -> bool:
        """Whether there is a request that no wait has returned yet."""
        if self.has_request_methods:
            return False
        self._read_requests()
        return any(not request.is_delivered for request in self._open)

    def pop_new_request(self) -> TaskRequest | None:
        """Return the oldest open request that no wait has returned yet; None without any."""
        with self._lock:
            self._read_requests()
            request = next((one for one in self._open if not one.is_delivered), None)
            if request is not None:
                request.is_delivered = True
            return request

    def _read_requests(self) -> None:
        """Read the requests that have arrived."""
        with self._lock:
            while self.open_delivery.requested:
                header, body = self.open_delivery.requested.popleft()
                if header.serial > self._serial:  # otherwise central has sent the request twice
                    self._apply_request(header, body)

    def _apply_request(self, header: Requested, body: bytes) -> None:
        """Make the client's transition, and add the request to the open ones."""
        cycle, self._serial = self.life_cycle, header.serial
        rows = (one for one in cycle.transitions if one.name == header.transition)
        row = cycle.step(self._state, header.transition, Party.CLIENT) or next(rows)
        self._state = row.target
        # The new request overtakes the requests that wait for an answer.
        self._open = [one for one in self._open if not self._needs_answer(one)]
        try:
            goal = self._message.decode_data(body) if body else None
        except BadData as error:  # the client does not use this library
            self._connection.log.warning("%s is rejected: %s", f"'{row.name}' of {self}", error)
            if (refusal := cycle.refusal(row.target)) is not None:
                self._apply(refusal, str(error))
            return
        self._open.append(TaskRequest(self, row, header, goal))

    def _needs_answer(self, request: TaskRequest) -> bool:
        """Whether the request led to a state that only the handler's answer ends."""
        cycle, state = self.life_cycle, request.row.target
        return cycle.ends_on_request(state) or bool(cycle.grant(state) or cycle.refusal(state))

    def accept(self, request: TaskRequest, goal: Any) -> bool:
        """Grant a request; *goal* may replace its goal. Returns False if it is no longer open."""
        is_goal = request.row.effect is Effect.NEW_GOAL
        if goal is not None and not is_goal:
            raise MisuseError(f"{request} has no goal: accept() it without one")
        body = b"" if goal is None else self._stored(self._message.encode_data(goal))
        with self._lock:
            if request not in self._open:
                return False
            self._open.remove(request)
            row = (
                self.life_cycle.grant(self._state)
                if is_goal
                else self._transition_with(Effect.STOP)
            )
            if row is not None:
                self._apply(row, body=body)
            return True

    def reject(self, request: TaskRequest, why: str) -> bool:
        """Reject a request. Returns False if it is no longer open."""
        with self._lock:
            if request not in self._open:
                return False
            row = self.life_cycle.refusal(self._state)
            if row is None:
                text = self.life_cycle.why_no_refusal(self._state)
                raise MisuseError(f"{request} can't be rejected: {text}")
            self._open.remove(request)
            self._is_started_by_refusal = request.row.source == self.life_cycle.initial
            self._apply(row, why)
            return True

    # --- transitions of the handler ---------------------------------------------------------------

    def accept_task(self) -> None:
        """Accept the task, unless the rejection of an early cancel has started it."""
        with self._lock:
            if not self._is_started_by_refusal:
                self.take_transition(self.life_cycle.accepted.name)
            self._is_started_by_refusal = False

    def take_transition(self, name: str, why: str = "", body: bytes = b"") -> None:
        """Make a transition of the server."""
        with self._lock:
            cycle = self.life_cycle
            row = cycle.step(self._state, name, Party.SERVER)
            if row is None:
                raise MisuseError(self._why_impossible(name))
            if row.target in cycle.successes:
                if self.ending not in ("", name):
                    advice = "a handler takes one end, and then returns"
                    raise MisuseError(f"'{self.ending}' already ends {self}: {advice}")
                self.ending = name
                return
            if cycle.is_over(row.target) and row.effect is not Effect.STOP:
                advice = f"raise Failure({name!r})() instead"
                raise MisuseError(f"'{name}' ends {self} as '{row.target}': {advice}")
            if row.effect is not Effect.RESULT:
                self._open = [one for one in self._open if not self._needs_answer(one)]
            self._apply(row, why, body)

    def _why_impossible(self, name: str) -> str:
        """Explain why the server can't make a transition now."""
        cycle = self.life_cycle
        if name not in (names := cycle.names(Party.SERVER)):
            text = f"{cycle} has for servers: {quoted(names)}"
            return f"the handler of {self} can't take '{name}': {text}"
        sources = quoted(cycle.sources(name, Party.SERVER), " or ")
        advice = ""
        if name == cycle.accepted.name:
            when = "a task is accepted when its handler gets it"
            advice = f"; {when}, unless the handler is declared with accepts=True"
        elif self._state == cycle.initial:
            advice = "; accept() it first"
        return f"{self} is '{self._state}': '{name}' is possible while it is {sources}{advice}"

    def report(self, body: bytes) -> None:
        """Report an intermediate result. If the task has just been stopped, the result is lost."""
        body = self._stored(body)
        with self._lock:
            if self.is_over:
                return
            rows = [row for row in self.life_cycle.transitions if row.effect is Effect.RESULT]
            if not rows:
                text = f"{self.life_cycle} has no transition for results"
                raise MisuseError(f"{self} can't report(): {text}")
            row = self._transition_with(Effect.RESULT) or rows[0]
            self.take_transition(row.name, body=body)

    def _stored(self, body: bytes) -> bytes:
        """Store large data at once: another thread may send them, and their memory may change."""
        return self._connection.store(body, self)

    def stop(self, why: str = "") -> None:
        """End the task at its client's request."""
        with self._lock:
            self._read_requests()
            row = self._transition_with(Effect.STOP)
            if row is None:
                text = "and no client has asked for its end: return, or fail"
                raise MisuseError(f"{self} is '{self._state}', {text}")
            self._open.clear()
            self._apply(row, why)

    def _transition_with(self, effect: Effect) -> Transition | None:
        """Return a transition with *effect* out of the present state; None without any."""
        rows = self.life_cycle.transitions
        here = (one for one in rows if one.source == self._state and one.effect is effect)
        return next(here, None)

    def _apply(self, row: Transition, why: str = "", body: bytes = b"") -> None:
        """Make a transition of the server, and report it to central."""
        self._state = row.target
        header = ChangeState(0, self._task, row.name, self._serial, why, self._origin)
        send = partial(self._connection.send_change, header, body, f"'{row.name}' of {self}")
        if self._connection.is_own_thread:
            send()
        else:
            self._connection.call_soon(partial(self._send_late, send))
        if row.effect is Effect.STOP and (stopped := self.on_stop()) is not None:
            stopped()

    def _send_late(self, send: Callable[[], object]) -> None:
        """Send a change that another thread made. The connection's thread calls this."""
        try:
            send()
        except CentralLost as error:
            self._connection.log.warning("%s", error)

    # --- waiting ----------------------------------------------------------------------------------

    def wait(self, timeout: float | None) -> TaskRequest | None:
        """Wait for the next request that no wait has returned yet; None after *timeout* seconds."""
        connection = self._connection
        connection.process_pending()  # reads what has arrived, also with a timeout of 0
        moment = None if timeout is None else connection.transport.time() + timeout
        connection.wait_until(lambda: self.has_new, f"a request to {self}", moment)
        return None if self.has_request_methods else self.pop_new_request()

    async def next_request(self) -> TaskRequest:
        """Await the next request that no wait has returned yet, without a timeout."""
        what = f"a request to {self}"
        wait = self._connection.wait_in_coroutine(self._awaited, what, lambda: self.has_new)
        await awaited(wait)
        request = self.pop_new_request()
        assert request is not None
        return request


class ReportingTask:
    """A task on its server's side: for its handler, or for the LaterReply that owes its reply."""

    _message: Message[Any, Any]

    def _server_state(self) -> ServerState:
        """Return the task's state. Raises MisuseError for a message that is no task."""
        raise NotImplementedError

    @property
    def state(self) -> str:
        """The task's state, as far as this program knows. Never waits."""
        return self._server_state().state

    def accept(self) -> None:
        """Accept the task, in a handler that is declared with ``accepts=True``.

        The call does nothing if the handler has rejected an early cancel, because the rejection has
        started the task.

        Raises:
            MisuseError: the task was accepted already, or the handler is declared without
                ``accepts=True``.
        """
        self._server_state().accept_task()

    def report(self, data: Any = None) -> None:
        """Report an intermediate result to the observers of the task. Does not wait.

        Args:
            data: the result, of the type *progress* of the message. Default: None.

        Raises:
            BadData: *data* does not fit the type.
            MisuseError: the message is no task, or declares no *progress*.

        Example::

            task.report(Feel(force=2.5))
        """
        message = self._message
        if not isinstance(message, TaskMessage):
            text = "only goals and commands have intermediate results"
            raise MisuseError(f"{self} can't report(): {text}")
        server_state = self._server_state()
        if data is not None and message.progress.kind is type(None):
            text = f"is declared without progress=, and report() was given {data!r:.60}"
            raise MisuseError(f"{message.title} {text}")
        server_state.report(message.encode_progress(data))

    def take(self, transition: str, why: str = "") -> None:
        """Make a server's transition of the task's own life cycle.

        A transition to an end that counts as done is made when the handler returns. To another end
        a handler raises a failure with the name of the transition.

        Args:
            transition: the transition's name.
            why: the reason, for people; not for a transition to an end. Default: "".

        Raises:
            MisuseError: the transition is not the server's, or not possible in the task's state; or
                it leads to an end that counts as cancelled, or to a second end.

        Example::

            task.take("paused")
        """
        check(f"take() of {self}", NAME, transition=transition)
        check(f"'{transition}' of {self}", TEXT, why=why)
        self._server_state().take_transition(transition, why)

    @property
    def request(self) -> TaskRequest | None:
        """The oldest open request of a client; None without any. Never waits.

        Use it in handlers that name in ``takes=`` the requests that they decide about.
        """
        return self._server_state().oldest


class Requests(Iterator[TaskRequest], AsyncIterator[TaskRequest]):
    """The requests of a task's clients, to iterate over. Each request is returned once.

    ``for`` waits for the next request; in an async handler use ``async for``. The wait raises
    TaskKilled if the task is killed, Stopped if the module ends. In an async handler it raises
    CancelledError in both cases.
    """

    def __init__(self, server_state: ServerState) -> None:
        self._server_state = server_state

    def __next__(self) -> TaskRequest:
        request = self._server_state.wait(None)
        assert request is not None
        return request

    async def __anext__(self) -> TaskRequest:
        return await self._server_state.next_request()
