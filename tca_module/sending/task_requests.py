"""The state of a task as those who work on it know it, and what clients ask of that: a new goal,
the task's end.

The table of its life cycle says what the handler may do; what it may not is refused here, as far as
the handler has looked at what clients have asked for. Where they were faster central decides
(tca_central/life_cycles).
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
    """A client has taken a transition of the task, such as "update" or "cancel": accept or reject
    it. It is open until then, or until another one overtakes it.
    """

    def __init__(
        self, served: "ServerState", row: Transition, header: Requested, goal: Any
    ) -> None:
        self.transition = header.transition
        self.goal = goal  #: the new one, of an update; else None
        self.why = header.text  #: the client's reason
        self.serial = header.serial
        self.row = row
        self.is_given = False  #: a wait has given it to the handler
        self._served = served

    def __repr__(self) -> str:
        return f"'{self.transition}' of {self._served}" + (f": {self.why}" if self.why else "")

    @property
    def is_open(self) -> bool:
        """Whether it waits for the handler's word. Never waits."""
        return self._served.is_open(self)

    def accept(self, goal: Any = None) -> bool:
        """Grant it: the new goal is the task's, or the task ends as cancelled, and its handler
        should return. Returns False if another request has overtaken it.

        With *goal* that one is the task's, in place of the one asked for: where an update names
        only what changes. Raises BadData if it is no data of the task.
        """
        return self._served.accept(self, goal)

    def reject(self, why: str = "") -> bool:
        """Refuse it: the task goes on as it was, and the client is told why. Returns what
        ``accept`` does.
        """
        return self._served.reject(self, why)


class ServerState:
    """The state of a task that is being handled; from any thread."""

    def __init__(
        self,
        connection: Connection,
        delivery: Deliver,
        one: OpenDelivery,
        message: Message[Any, Any],
        *,
        accepts: bool,
    ) -> None:
        self.life_cycle = cycle = life_cycle_of(message)
        self._state = cycle.initial if accepts else cycle.accepted.target
        self.is_conversing = False  #: a Server has methods for requests: no wait gives them
        self.on_stop: Callable[[], Callable[[], object] | None] = lambda: (
            None
        )  #: refers to what hears of the stop
        self._is_begun_by_refusal = False
        self._serial = 0  # the newest that a client's transition had
        self._open: list[TaskRequest] = []  # oldest first
        self._connection = connection
        self._message = message
        self.delivery = one  #: of its handler
        self._what = numbered(message.name, delivery.task)
        epoch = connection.session.epoch
        self._task = with_epoch(delivery.task, epoch, self._what)
        self._origin = with_epoch(delivery.delivery, epoch, self._what)
        self._lock = threading.RLock()
        self._awaited = Request(
            Observe(0), b"", wants_answer=True
        )  # stands for what clients may ask of it
        self._awaited.path = (
            self  # so no deadlock is seen in a wait for it: clients may come from outside
        )
        one.on_request += (self._wake,)

    def __repr__(self) -> str:
        return self._what

    def abandon(self, _: Request) -> None:
        """A wait for what clients ask for has ended: there is nothing to give up."""

    def _wake(self) -> None:
        if self._awaited.wakes is not None:
            self._awaited.wakes()

    # --- what clients ask for ---------------------------------------------------------------------

    @property
    def state(self) -> str:
        """The task's state."""
        self._look()
        return self._state

    @property
    def is_over(self) -> bool:
        """Whether the task has been stopped as a client wanted."""
        return self.life_cycle.is_over(self._state)

    @property
    def can_reject(self) -> bool:
        """Whether a request can be refused in the task's state."""
        return self.life_cycle.refusal(self._state) is not None

    @property
    def oldest(self) -> TaskRequest | None:
        """The oldest open request."""
        self._look()
        return next(iter(self._open), None)

    def is_open(self, request: TaskRequest) -> bool:
        """Whether a request waits for the handler's word."""
        self._look()
        return request in self._open

    @property
    def has_new(self) -> bool:
        """Whether there is one that no wait has given yet."""
        if self.is_conversing:
            return False
        self._look()
        return any(not one.is_given for one in self._open)

    def take_new(self) -> TaskRequest | None:
        """The oldest open request that no wait has given yet."""
        with self._lock:
            self._look()
            found = next((one for one in self._open if not one.is_given), None)
            if found is not None:
                found.is_given = True
            return found

    def _look(self) -> None:
        """The handler looks at what has come."""
        with self._lock:
            while self.delivery.requested:
                header, body = self.delivery.requested.popleft()
                if header.serial > self._serial:  # else central has said it twice
                    self._hear(header, body)

    def _hear(self, header: Requested, body: bytes) -> None:
        cycle, self._serial = self.life_cycle, header.serial
        rows = (one for one in cycle.transitions if one.name == header.transition)
        row = cycle.step(self._state, header.transition, Party.CLIENT) or next(rows)
        self._state = row.target
        self._open = [
            one for one in self._open if not self._wants_answer(one)
        ]  # it overtakes those
        try:
            goal = self._message.decode_data(body) if body else None
        except BadData as error:  # of a program that does not use this library
            self._connection.log.warning("%s is rejected: %s", f"'{row.name}' of {self}", error)
            if (refusal := cycle.refusal(row.target)) is not None:
                self._take(refusal, str(error))
            return
        self._open.append(TaskRequest(self, row, header, goal))

    def _wants_answer(self, request: TaskRequest) -> bool:
        """Whether the client waits for the handler's word in a state of its own."""
        cycle, state = self.life_cycle, request.row.target
        return cycle.ends_on_request(state) or bool(cycle.grant(state) or cycle.refusal(state))

    def accept(self, request: TaskRequest, goal: Any) -> bool:
        """Grant a request, with another goal if that is not None; False if it is no longer open."""
        is_goal = request.row.effect is Effect.NEW_GOAL
        if goal is not None and not is_goal:
            raise MisuseError(f"{request} is for no goal: accept() it without one")
        body = b"" if goal is None else self._message.encode_data(goal)
        with self._lock:
            if request not in self._open:
                return False
            self._open.remove(request)
            row = self.life_cycle.grant(self._state) if is_goal else self._row_with(Effect.STOP)
            if row is not None:
                self._take(row, body=body)
            return True

    def reject(self, request: TaskRequest, why: str) -> bool:
        """Refuse a request; False if it is no longer open."""
        with self._lock:
            if request not in self._open:
                return False
            row = self.life_cycle.refusal(self._state)
            if row is None:
                raise MisuseError(
                    f"{request} can't be rejected: {self.life_cycle} has no transition for that"
                )
            self._open.remove(request)
            self._is_begun_by_refusal = request.row.source == self.life_cycle.initial
            self._take(row, why)
            return True

    # --- what the handler does --------------------------------------------------------------------

    def begin(self) -> None:
        """Accept the task, unless it is begun because a cancel that came before that was
        refused.
        """
        with self._lock:
            if not self._is_begun_by_refusal:
                self.take(self.life_cycle.accepted.name)
            self._is_begun_by_refusal = False

    def take(self, name: str, why: str = "", body: bytes = b"") -> None:
        """Take a transition of the server's."""
        with self._lock:
            cycle = self.life_cycle
            row = cycle.step(self._state, name, Party.SERVER)
            if row is None:
                raise MisuseError(self._not_now(name))
            if cycle.is_over(row.target) and row.effect is not Effect.STOP:
                raise MisuseError(
                    f"'{name}' ends {self}: its handler returns, or raises a failure, instead"
                )
            if row.effect is not Effect.RESULT:
                self._open = [one for one in self._open if not self._wants_answer(one)]
            self._take(row, why, body)

    def _not_now(self, name: str) -> str:
        cycle = self.life_cycle
        if name not in (names := cycle.names(Party.SERVER)):
            return f"the handler of {self} can't take '{name}': {cycle} has for servers: {quoted(names)}"
        sources = quoted(cycle.sources(name, Party.SERVER), " or ")
        advice = ""
        if name == cycle.accepted.name:
            advice = "; a task is accepted when its handler gets it, unless that is declared with accepts=True"
        elif self._state == cycle.initial:
            advice = "; accept() it first"
        return f"{self} is '{self._state}': '{name}' is possible while it is {sources}{advice}"

    def report(self, body: bytes) -> None:
        """Tell of an intermediate result; one of a task that has just been stopped is dropped."""
        with self._lock:
            if self.is_over:
                return
            rows = [row for row in self.life_cycle.transitions if row.effect is Effect.RESULT]
            if not rows:
                raise MisuseError(
                    f"{self} can't report(): {self.life_cycle} has no transition for results"
                )
            row = self._row_with(Effect.RESULT) or rows[0]
            self.take(row.name, body=body)

    def stop(self, why: str = "") -> None:
        """End the task as its client wants."""
        with self._lock:
            self._look()
            row = self._row_with(Effect.STOP)
            if row is None:
                raise MisuseError(
                    f"{self} is '{self._state}', and nobody has asked for its end: return, or fail"
                )
            self._open.clear()
            self._take(row, why)

    def _row_with(self, effect: Effect) -> Transition | None:
        rows = (
            row
            for row in self.life_cycle.transitions
            if row.source == self._state and row.effect is effect
        )
        return next(rows, None)

    def _take(self, row: Transition, why: str = "", body: bytes = b"") -> None:
        self._state = row.target
        header = ChangeState(0, self._task, row.name, self._serial, why, self._origin)
        send = partial(self._connection.send_change, header, body, f"'{row.name}' of {self}")
        if self._connection.is_mine:
            send()
        else:
            self._connection.call_soon(partial(self._send_late, send))
        if row.effect is Effect.STOP and (stopped := self.on_stop()) is not None:
            stopped()

    def _send_late(self, send: Callable[[], object]) -> None:
        """Another thread wants it."""
        try:
            send()
        except CentralLost as error:
            self._connection.log.warning("%s", error)

    # --- waiting ----------------------------------------------------------------------------------

    def wait(self, timeout: float | None) -> TaskRequest | None:
        """The next request that no wait has given yet; None after so many seconds."""
        connection = self._connection
        connection.attend()  # also if there is no time to wait
        moment = None if timeout is None else connection.transport.time() + timeout
        connection.wait_until(lambda: self.has_new, f"a request to {self}", moment)
        return None if self.is_conversing else self.take_new()

    async def come(self) -> TaskRequest:
        """The same in a coroutine, without end."""
        waiting = self._connection.until_over(
            self._awaited, f"a request to {self}", lambda: self.has_new
        )
        await awaited(waiting)
        found = self.take_new()
        assert found is not None
        return found


class ReportingTask:
    """A task that somebody works on: its handler, or whoever owes its reply."""

    _message: Message[Any, Any]

    def _served(self) -> ServerState:
        """The task's state. Raises MisuseError for what is no task."""
        raise NotImplementedError

    @property
    def state(self) -> str:
        """The task's state, as far as is known here. Never waits."""
        return self._served().state

    def accept(self) -> None:
        """Say that the task is begun; for handlers declared with ``accepts=True``. If an early
        cancel was rejected, that has begun it, and this says nothing more.
        """
        self._served().begin()

    def report(self, data: Any = None) -> None:
        """Tell those who follow the task of an intermediate result, of the type *progress* of its
        message. Does not wait. Raises BadData.
        """
        message = self._message
        if not isinstance(message, TaskMessage):
            raise MisuseError(
                f"{self} can't report(): only goals and commands have intermediate results"
            )
        served = self._served()
        if data is not None and message.progress.kind is type(None):
            raise MisuseError(
                f"{message.title} is declared without progress=, and report() was given {data!r:.60}"
            )
        try:
            body = message.progress.encode(data)
        except BadData as error:
            raise BadData(
                f"the intermediate results of {message.title} are {message.progress}: {error}"
            ) from None
        served.report(body)

    def take(self, transition: str, why: str = "") -> None:
        """Take a server's transition of the task's own life cycle: ``task.take("paused")``. Raises
        MisuseError for one that is no server's, or not possible in the task's state.
        """
        check(f"take() of {self}", NAME, transition=transition)
        check(f"'{transition}' of {self}", TEXT, why=why)
        self._served().take(transition, why)

    @property
    def request(self) -> TaskRequest | None:
        """The oldest open request of a client, if there is one: for handlers that say in ``takes=``
        what they hear. Never waits.
        """
        return self._served().oldest


class Requests(Iterator[TaskRequest], AsyncIterator[TaskRequest]):
    """What clients ask of a task, each once: ``for`` waits for each, in async handlers ``async
    for``. The task's end, and that of the module, raise TaskKilled and Stopped, or CancelledError.
    """

    def __init__(self, served: ServerState) -> None:
        self._served = served

    def __next__(self) -> TaskRequest:
        found = self._served.wait(None)
        assert found is not None
        return found

    async def __anext__(self) -> TaskRequest:
        return await self._served.come()
