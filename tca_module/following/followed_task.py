"""The calls of a client on a task, beside waiting for its end: follow, update and cancel it."""

from collections.abc import Callable, Collection
from typing import Any, Generic, TypeVar, overload

from tca_module.checks import NAME, TEXT, LateText, check, check_message, quoted
from tca_module.errors import MisuseError, Refused, Timeout
from tca_module.following.mirror import C, ChangeCallback, Mirror
from tca_module.following.observation import ObservedChange
from tca_module.following.stream import Stream
from tca_module.following.update import PendingUpdate
from tca_module.link.connection import Connection
from tca_wire.life_cycles import GENERAL, Effect, LifeCycle
from tca_wire.messages.declarations import Message, TaskMessage
from tca_wire.messages.formats import decode_untyped
from tca_wire.packets.changes import ChangeState, Observe
from tca_wire.points import TaskId
from tca_wire.vocabulary import Party, Refusal

P = TypeVar("P")


def _is_after_first_state(observed: ObservedChange) -> bool:
    """Whether a task has left its first state."""
    return observed.change.serial != 0


def decode_progress(message: Message[Any, Any] | None, data: bytes) -> Any:
    """Return an intermediate result; plain values if the task's message is not declared here."""
    if isinstance(message, TaskMessage):
        return message.progress.decode(data)
    return decode_untyped(data)


def life_cycle_of(message: Message[Any, Any] | None) -> LifeCycle:
    """Return the life cycle of a message's tasks; ``GENERAL`` for an undeclared message (None)."""
    return message.life_cycle if isinstance(message, TaskMessage) else GENERAL


def cancel_transitions(cycle: LifeCycle) -> list[str]:
    """Return the transitions by which a client asks for a task's end."""
    return [
        row.name
        for row in cycle.transitions
        if row.by is Party.CLIENT and cycle.ends_on_request(row.target)
    ]


def check_states(what: str, message: Message[Any, Any] | None, states: Collection[str]) -> None:
    """Raise MisuseError for a state that the tasks of a message never have.

    Nothing is checked if *message* is None: the message is not declared here.
    """
    cycle = life_cycle_of(message)
    if message is not None and (unknown := sorted(set(states) - set(cycle.states))):
        raise MisuseError(f"{what} is never '{unknown[0]}': {cycle} has {quoted(cycle.states)}")


class NamedTask:
    """A task, with the names and numbers by which requests and errors refer to it."""

    message: str  #: the name of the task's message
    _task_id: TaskId
    _origin: int

    @property
    def _description(self) -> str:
        """The task in words, with the id if that is known. Never waits for the id."""
        return str(self)

    def _action(self, action: str) -> LateText:
        """Describe an action on the task, for errors."""
        return LateText(lambda: f"{action} {self._description}")

    def _connection(self) -> Connection:
        """Return the connection of the calling thread."""
        raise NotImplementedError

    def _tree_id(self) -> TaskId:
        """Return the number by which requests name the task. Central may not have assigned it yet.

        Raises MisuseError for a message that is no task.
        """
        return self._task_id


class FollowedTask(NamedTask, Generic[C]):
    """A task whose state can be followed: ``state``, ``changes()``, ``update()`` and others.

    Following starts at the first use of these members, or with ``follow()``. Only the first use
    waits for central. After a broken connection, following continues.
    """

    _mirror: Mirror | None = None
    _changes: Stream[C] | None = None

    def _as_change(self, observed: ObservedChange) -> C:
        """Return a change as users see it."""
        raise NotImplementedError

    # --- following --------------------------------------------------------------------------------

    def follow(self) -> None:
        """Start to follow the task now, without waiting. No change from now on is missed."""
        self._ensure_mirror()

    def _ensure_mirror(self) -> Mirror:
        """Return the local copy of the task's state. The first call creates it."""
        if self._mirror is None:
            what = self._action("the state of")
            header = Observe(0, self._tree_id(), self.message, origin=self._origin)
            self._mirror = Mirror(self._connection(), header, what)
        return self._mirror

    @property
    def state(self) -> str:
        """The task's state, such as "running". Only the first use waits for central.

        Raises:
            Timeout: central did not report the state.
            CentralLost: central does not answer, or has forgotten the task.
        """
        return self._ensure_mirror().state

    @property
    def serial(self) -> int:
        """The number of changes of the task's state that this program knows of; -1 if unknown."""
        mirror = self._ensure_mirror()
        mirror.state  # noqa: B018 - waits until state and serial number are known
        return mirror.serial

    def changes(self, timeout: float | None = None) -> Stream[C]:
        """Return the changes of the task's state from now on, until its end.

        The first element is the present state (``is_late``), if the task has left its first state.

        Args:
            timeout: the most seconds that each step of the iteration waits. Default: None, no
                bound.

        Returns:
            A Stream of ``Change``.

        Raises:
            Timeout: from the iteration: no change came in time.
            CentralLost: central does not answer, or has forgotten the task.

        Example::

            for change in sent.changes():
                print(change.state)
        """
        mirror = self._ensure_mirror()
        mirror.catch_up()
        return self._stream(timeout, mirror.snapshot())

    def _stream(
        self, timeout: float | None = None, first: ObservedChange | None = None
    ) -> Stream[C]:
        what = f"a change of {self._description}"
        return Stream(
            self._ensure_mirror(),
            self._as_change,
            _is_after_first_state,
            what,
            timeout,
            first=first,
        )

    def next_change(self, timeout: float | None = None) -> C | None:
        """Wait for the next change of the task's state, and return it.

        Each change is returned once. The first call may return the present state, if the task has
        left its first state.

        Args:
            timeout: the most seconds to wait. Default: None, no bound.

        Returns:
            The ``Change``; None if the task has ended and all its changes were returned.

        Raises:
            Timeout: no change came in time.
            CentralLost: central does not answer, or has forgotten the task.
        """
        if self._changes is None:
            self._changes = self._stream()
        return self._changes.receive(timeout)

    def wait_for_state(self, *states: str, timeout: float | None = None) -> str:
        """Wait until the task is in one of the given states, or has ended.

        A state that the task has entered and left during the call counts, too.

        Args:
            states: one or more states, such as "running".
            timeout: the most seconds to wait. Default: None, no bound.

        Returns:
            That state, or the state in which the task ended.

        Raises:
            Timeout: the task did not reach a state in time.
            MisuseError: the task never has one of the *states*, or no state is given.
            CentralLost: central does not answer, or has forgotten the task.

        Example::

            if grasp.wait_for_state("running", timeout=5) == "running":
                grasp.update(Grip("cup"))
        """
        if not states or not all(isinstance(one, str) for one in states):
            raise MisuseError(
                f'wait_for_state(): give one or more states, such as "running", not {states!r:.60}'
            )
        check_states(f"wait_for_state(): {self._description}", self._declared(), states)
        mirror = self._ensure_mirror()
        reached = mirror.add_reader(lambda seen: seen.change.state in states or seen.change.is_over)
        mirror.catch_up()
        if mirror.newest is not None and not reached:
            reached.add(mirror.newest)
        if not mirror.wait(lambda: bool(reached), timeout):
            mirror.check()
            what = f"{self._description} was not {' or '.join(states)} within {timeout:g} s"
            raise Timeout(f"{what}, but is {mirror.known_state or 'unknown'}", can_wait=True)
        return reached.pop().change.state

    @overload
    def progress(self, kind: None = None, *, timeout: float | None = ...) -> Stream[Any]: ...
    @overload
    def progress(self, kind: type[P], *, timeout: float | None = ...) -> Stream[P]: ...
    def progress(self, kind: Any = None, *, timeout: float | None = None) -> Stream[Any]:
        """Return the intermediate results of the task, starting with the newest.

        Args:
            kind: the type of the results, for type checkers. Default: None.
            timeout: the most seconds that each step of the iteration waits. Default: None, no
                bound.

        Returns:
            A Stream of results; plain values if the message is not declared here.

        Raises:
            MisuseError: the message declares another type of results than *kind*.
            Timeout: from the iteration: no result came in time.
            CentralLost: central does not answer, or has forgotten the task.

        Example::

            for feel in grasp.progress(Feel):
                print(feel.force)
        """
        mirror, message = self._ensure_mirror(), self._declared()
        if kind is not None and isinstance(message, TaskMessage) and message.progress.kind != kind:
            raise MisuseError(
                f"the intermediate results of {message.title} are {message.progress}, "
                f"not {kind!r:.60}"
            )
        what = f"an intermediate result of {self._description}"
        mirror.catch_up()
        return Stream(
            mirror,
            lambda observed: decode_progress(message, observed.change.data),
            lambda _: mirror.has_progressed,
            what,
            timeout,
            first=mirror.progress,
        )

    @overload
    def on_change(self, function: Callable[[C], object]) -> ChangeCallback[C]: ...
    @overload
    def on_change(self, function: Callable[[Any, C], object]) -> ChangeCallback[C]: ...
    def on_change(self, function: Callable[..., object]) -> ChangeCallback[C]:
        """Call a function with each change from now on.

        This thread makes the calls, one at a time, while it waits for central or for its next
        message. Errors in the function are logged.

        Args:
            function: takes (sender, change), with a Sender under the root, or (change).

        Returns:
            The ChangeCallback; its ``cancel()`` ends the calls.

        Raises:
            MisuseError: the function takes other arguments, or is ``async def``.

        Example::

            grasp.on_change(lambda change: print(change.state))
        """
        callback = ChangeCallback("on_change()", self._connection(), function, self._as_change)
        self._ensure_mirror().call(
            lambda seen: callback.put(seen) if _is_after_first_state(seen) else None
        )
        return callback

    # --- requests ---------------------------------------------------------------------------------

    def update(
        self, goal: Any, *, timeout: float | None = None, message: Message[Any, Any] | None = None
    ) -> None:
        """Give the running task a new goal, and wait until its handler has accepted it.

        If the handler is declared without "update" in ``takes=``, it is called again with the new
        goal.

        Args:
            goal: the new data of the task.
            timeout: the most seconds to wait. Default: None, no bound.
            message: the task's message, if it is not declared here. Default: None.

        Raises:
            Rejected: the handler continues with the old goal, for the given reason; or the task
                ended first.
            Refused: the task can't get a new goal in its state.
            Timeout: the handler did not answer in time.
            BadData: *goal* does not fit the message.
            MisuseError: the task's life cycle has no updates, or its message is unknown.
            CentralLost: central does not answer, or has forgotten the task.

        Example::

            grasping.update(Grip("cup"), timeout=5)
        """
        self.update_send(goal, message=message).wait(timeout)

    def update_send(self, goal: Any, *, message: Message[Any, Any] | None = None) -> PendingUpdate:
        """Give the running task a new goal, and return at once.

        Args:
            goal: the new data of the task.
            message: the task's message, if it is not declared here. Default: None.

        Returns:
            A PendingUpdate: ``wait()`` waits for the handler's answer; an async handler can
            ``await`` it.

        Raises:
            Refused: the task can't get a new goal in its state.
            BadData: *goal* does not fit the message.
            MisuseError: the task's life cycle has no updates, or its message is unknown.
        """
        self._check_message(message)
        what, cycle = f"the update of {self._description}", self._life_cycle
        rows = [row for row in cycle.transitions if row.effect is Effect.NEW_GOAL]
        if not rows:
            raise MisuseError(f"{what}: {cycle} has no updates; kill the task and send a new one")
        body, mirror = self._encode_goal(goal), self._ensure_mirror()
        row = next((row for row in rows if row.source == mirror.known_state), rows[0])
        self._check_possible(what, row.name, mirror.known_state)
        unread = mirror.add_reader()
        request = self._connection().send_change(self._change_header(row.name, ""), body, what)
        return PendingUpdate(what, mirror, unread, request, cycle, row)

    def cancel(self, why: str = "") -> None:
        """Ask the task to end, without waiting.

        The task's handler decides, and may need time. If the handler does not take cancels, the
        task is killed. The request is not lost, even while central is away.

        Args:
            why: the reason, for people. Default: "".

        Raises:
            MisuseError: the task's life cycle has no cancel.

        Example::

            walking.cancel("the goal has moved")
            walking.wait(timeout=10)
        """
        what, cycle = self._action("cancelling"), self._life_cycle
        check(what, TEXT, why=why)
        if not (names := cancel_transitions(cycle)):
            raise MisuseError(f"{what}: {cycle} has no such transition; kill() ends the task")
        # With the serial number -1, central accepts the transition in any state of the task.
        header = ChangeState(0, self._tree_id(), names[0], -1, why, self._origin)
        self._connection().send_change(header, b"", str(what))

    def take(
        self,
        transition: str,
        data: Any = None,
        *,
        why: str = "",
        message: Message[Any, Any] | None = None,
    ) -> bool:
        """Make a client's transition of the task's own life cycle.

        Args:
            transition: the transition's name.
            data: the goal, if the transition has one. Default: None.
            why: the reason, for people. Default: "".
            message: the task's message, if it is not declared here. Default: None.

        Returns:
            False if the task had ended, or if an earlier transition of the server made this
            transition impossible.

        Raises:
            MisuseError: the transition is not a client's.
            Refused: the transition is not possible in the task's state.
            BadData: *data* does not fit the message.
            CentralLost: central does not answer, or has forgotten the task.

        Example::

            sent.take("pause")
        """
        check(self._action("take() of"), NAME, transition=transition)
        what = f"'{transition}' of {self._description}"
        check(what, TEXT, why=why)
        self._check_message(message)
        body = self._encode_goal(data) if data is not None else b""
        self._check_possible(what, transition, self._mirror.known_state if self._mirror else "")
        return bool(self._connection().call(self._change_header(transition, why), what, body))

    def _check_possible(self, what: str, name: str, state: str) -> None:
        """Raise an error if a client can't make a transition.

        Raises MisuseError if no client can make it in any state, and Refused if it is impossible in
        *state*. If *state* is "", the task's state is unknown, and only the first is checked.
        """
        cycle = self._life_cycle
        if name not in (names := cycle.names(Party.CLIENT)) and self._declared() is not None:
            text = f"no client can take that; {cycle} has for clients: {quoted(names)}"
            raise MisuseError(f"{what}: {text}")
        is_known = state and name in names and not cycle.is_over(state)
        if is_known and cycle.step(state, name, Party.CLIENT) is None:
            sources = quoted(cycle.sources(name, Party.CLIENT), " or ")
            if cycle.is_pending(state, name):
                raise Refused(what, Refusal.TOO_LATE, f"another '{name}' is pending")
            text = f"the task is '{state}', and that is possible while it is {sources}"
            raise Refused(what, Refusal.TOO_LATE, text)

    def _change_header(self, name: str, why: str) -> ChangeState:
        serial = self._mirror.serial if self._mirror and self._mirror.known_state else -1
        return ChangeState(0, self._tree_id(), name, serial, why, self._origin)

    def _encode_goal(self, goal: Any) -> bytes:
        message = self._declared()
        if message is None:
            what = f"a new goal of {self._description}"
            raise MisuseError(f"{what}: name the task's message, with message=")
        return message.encode_data(goal)

    def _check_message(self, message: Message[Any, Any] | None) -> None:
        """Declare *message*, if given. Raises MisuseError if it is not the task's message."""
        if message is None:
            return
        check_message(message)
        if message.name != self.message:
            raise MisuseError(f"{self._description} is no '{message.name}'")
        self._connection().declare(message)

    def _declared(self) -> Message[Any, Any] | None:
        """Return the task's message, if it is declared here."""
        return self._connection().declared(self.message)

    @property
    def _life_cycle(self) -> LifeCycle:
        return life_cycle_of(self._declared())
