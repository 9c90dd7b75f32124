"""What a client does with a task beside waiting for its end: follow its state, give it a new goal,
cancel it.
"""

from collections.abc import Callable, Collection
from typing import Any, Generic, TypeVar, overload

from tca_module.checks import NAME, TEXT, LateText, check, check_message, quoted
from tca_module.errors import MisuseError, Refused, Timeout
from tca_module.following.mirror import C, ChangeCallback, Mirror
from tca_module.following.observation import News
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


def _is_change(news: News) -> bool:
    """Whether the task has left its first state."""
    return news.change.serial != 0


def decode_progress(message: Message[Any, Any] | None, data: bytes) -> Any:
    """An intermediate result; as plain values if its message is not declared here."""
    return (
        message.progress.decode(data) if isinstance(message, TaskMessage) else decode_untyped(data)
    )


def life_cycle_of(message: Message[Any, Any] | None) -> LifeCycle:
    """The life cycle of a message's tasks; the general one if it is not declared here."""
    return message.life_cycle if isinstance(message, TaskMessage) else GENERAL


def cancels_of(cycle: LifeCycle) -> list[str]:
    """The transitions by which a client asks for a task's end."""
    return [
        row.name
        for row in cycle.transitions
        if row.by is Party.CLIENT and cycle.ends_on_request(row.target)
    ]


def check_states(what: str, message: Message[Any, Any] | None, states: Collection[str]) -> None:
    """Raise MisuseError for a state that the tasks of a message never have, if it is declared
    here.
    """
    cycle = life_cycle_of(message)
    if message is not None and (unknown := sorted(set(states) - set(cycle.states))):
        raise MisuseError(f"{what} is never '{unknown[0]}': {cycle} has {quoted(cycle.states)}")


class NamedTask:
    """A task as a program has it: what its handle provides."""

    message: str  #: the name of the message that the task is
    _task_id: TaskId
    _origin: int

    @property
    def _description(self) -> str:
        """The task for people, with its id if that is known: nobody waits for it."""
        return str(self)

    def _action(self, doing: str) -> LateText:
        """That something is done to the task, for errors."""
        return LateText(lambda: f"{doing} {self._description}")

    def _connection(self) -> Connection:
        """The connection of the calling thread."""
        raise NotImplementedError

    def _node(self) -> TaskId:
        """The task as requests name it: its id may yet be unknown. Raises MisuseError where there
        is none.
        """
        return self._task_id


class FollowedTask(NamedTask, Generic[C]):
    """A task whose state is followed, once that is asked for: ``state``, ``changes()``,
    ``update()`` and their like.

    Following begins at their first use, or with ``follow()``. Central is then waited for once;
    later never, and it goes on by itself after a break.
    """

    _mirror: Mirror | None = None
    _changes: Stream[C] | None = None

    def _as_change(self, news: News) -> C:
        """A change as users see it."""
        raise NotImplementedError

    # --- following --------------------------------------------------------------------------------

    def follow(self) -> None:
        """Begin to follow the task now, without waiting: what happens from now on is not missed."""
        self._followed()

    def _followed(self) -> Mirror:
        if self._mirror is None:
            what = self._action("the state of")
            header = Observe(0, self._node(), self.message, origin=self._origin)
            self._mirror = Mirror(self._connection(), header, what)
        return self._mirror

    @property
    def state(self) -> str:
        """The task's state, such as "running". Waits for central the first time only, later
        never.
        """
        return self._followed().state

    @property
    def serial(self) -> int:
        """The number of changes of the task's state, as far as is known here; -1 if that was never
        told.
        """
        mirror = self._followed()
        mirror.state  # noqa: B018 - it is known with that
        return mirror.serial

    def changes(self, timeout: float | None = None) -> Stream[C]:
        """The changes of the task's state from now on, until its end; first how it stands
        (``is_late``), if it has left its first state by now. Each is waited for, at most *timeout*
        seconds: then Timeout is raised.

        ::

            for change in sent.changes():
                print(change.state)
        """
        mirror = self._followed()
        mirror.catch_up()
        return self._stream(timeout, mirror.as_it_stands())

    def _stream(self, timeout: float | None = None, first: News | None = None) -> Stream[C]:
        what = f"a change of {self._description}"
        return Stream(self._followed(), self._as_change, _is_change, what, timeout, first=first)

    def next_change(self, timeout: float | None = None) -> C | None:
        """The next change of the task's state that ``state`` and this have not shown; None if there
        will be none. If nothing has followed the task yet, how it stands, if it has left its first
        state. Raises Timeout.
        """
        if self._changes is None:
            self._changes = self._stream()
        return self._changes.receive(timeout)

    def wait_for_state(self, *states: str, timeout: float | None = None) -> str:
        """Wait until the task is, or has been since this was called, in one of these states, or has
        ended; that state. Raises Timeout.

        ::

            if grasp.wait_for_state("running") == "running":
                grasp.update(Grip("cup"))
        """
        if not states or not all(isinstance(one, str) for one in states):
            raise MisuseError(
                f'wait_for_state(): give one or more states, such as "running", not {states!r:.60}'
            )
        check_states(f"wait_for_state(): {self._description}", self._declared(), states)
        mirror = self._followed()
        came = mirror.unread(lambda news: news.change.state in states or news.change.is_over)
        mirror.catch_up()
        if mirror.newest is not None and not came:
            came.put(mirror.newest)
        if not mirror.wait(lambda: bool(came), timeout):
            mirror.check()
            what = f"{self._description} was not {' or '.join(states)}"
            raise Timeout(
                f"{what} within {timeout:g} s, but is {mirror.known or 'unknown'}", can_wait=True
            )
        return came.take().change.state

    @overload
    def progress(self, kind: None = None, *, timeout: float | None = ...) -> Stream[Any]: ...
    @overload
    def progress(self, kind: type[P], *, timeout: float | None = ...) -> Stream[P]: ...
    def progress(self, kind: Any = None, *, timeout: float | None = None) -> Stream[Any]:
        """The intermediate results of the task, from the newest on; otherwise like ``changes``.
        *kind* is their type, for type checkers.

        ::

            for feel in grasp.progress(Feel):
                print(feel.force)
        """
        mirror, message = self._followed(), self._declared()
        if kind is not None and isinstance(message, TaskMessage) and message.progress.kind != kind:
            raise MisuseError(
                f"the intermediate results of {message.title} are {message.progress}, not {kind!r:.60}"
            )
        what = f"an intermediate result of {self._description}"
        mirror.catch_up()
        return Stream(
            mirror,
            lambda news: decode_progress(message, news.change.data),
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
        """Have a function called with a Sender under the root and each change from now on, or with
        the change alone:
        in this thread, one call at a time, while it waits for central or its next message. Errors
        in it are logged.
        """
        callback = ChangeCallback("on_change()", self._connection(), function, self._as_change)
        self._followed().call(lambda news: callback.put(news) if _is_change(news) else None)
        return callback

    # --- asking for something ---------------------------------------------------------------------

    def update(
        self, goal: Any, *, timeout: float | None = None, message: Message[Any, Any] | None = None
    ) -> None:
        """Give the running task a new goal, and wait until its handler has taken it over; where
        that does not say that it takes updates, the task begins anew with it.

        Raises Rejected, with the handler's reason, if it goes on with the old one, or the task ends
        first; Refused if the task can't be given one in its state; Timeout. Of a task that was only
        found, give its *message*.
        """
        self.update_send(goal, message=message).wait(timeout)

    def update_send(self, goal: Any, *, message: Message[Any, Any] | None = None) -> PendingUpdate:
        """The same without waiting: ``wait()`` for the handler's word later, or ``await`` it in an
        async handler.
        """
        self._know(message)
        what, cycle = f"the update of {self._description}", self._life_cycle
        rows = [row for row in cycle.transitions if row.effect is Effect.NEW_GOAL]
        if not rows:
            raise MisuseError(f"{what}: {cycle} has none; kill the task and send a new one")
        body, mirror = self._encoded(goal), self._followed()
        row = next((row for row in rows if row.source == mirror.known), rows[0])
        self._check_possible(what, row.name, mirror.known)
        unread = mirror.unread()
        request = self._connection().send_change(self._change(row.name, ""), body, what)
        return PendingUpdate(what, mirror, unread, request, cycle, row)

    def cancel(self, why: str = "") -> None:
        """Ask for the end of the task, without waiting: its handler decides, and may take its time;
        where it says nothing of cancels, the task is killed. It is not lost, even while central is
        away.
        """
        what, cycle = self._action("cancelling"), self._life_cycle
        check(what, TEXT, why=why)
        if not (names := cancels_of(cycle)):
            raise MisuseError(f"{what}: {cycle} has no such transition; kill() ends the task")
        header = ChangeState(
            0, self._node(), names[0], -1, why, self._origin
        )  # whatever has changed by now
        self._connection().send_change(header, b"", str(what))

    def take(
        self,
        transition: str,
        data: Any = None,
        *,
        why: str = "",
        message: Message[Any, Any] | None = None,
    ) -> bool:
        """Take a client's transition of the task's own life cycle: ``sent.take("pause")``. *data*
        is the goal, if the transition has one. Returns False if the task had ended, or the server
        was first and left no way to it.

        Raises MisuseError for a transition that is no client's, Refused if the task's state has no
        such way out.
        """
        check(self._action("take() of"), NAME, transition=transition)
        what = f"'{transition}' of {self._description}"
        check(what, TEXT, why=why)
        self._know(message)
        body = self._encoded(data) if data is not None else b""
        self._check_possible(
            what, transition, self._mirror.known if self._mirror is not None else ""
        )
        return bool(self._connection().call(self._change(transition, why), what, body))

    def _check_possible(self, what: str, name: str, state: str) -> None:
        """Raise an error if no client can take that transition, or none in a *state* that is known
        ("": it is not).
        """
        cycle = self._life_cycle
        if name not in (names := cycle.names(Party.CLIENT)) and self._declared() is not None:
            raise MisuseError(
                f"{what}: no client can take that; {cycle} has for clients: {quoted(names)}"
            )
        if (
            state
            and name in names
            and not cycle.is_over(state)
            and cycle.step(state, name, Party.CLIENT) is None
        ):
            sources = quoted(cycle.sources(name, Party.CLIENT), " or ")
            raise Refused(
                what,
                Refusal.TOO_LATE,
                f"the task is '{state}', and that is possible while it is {sources}",
            )

    def _change(self, name: str, why: str) -> ChangeState:
        serial = self._mirror.serial if self._mirror is not None and self._mirror.known else -1
        return ChangeState(0, self._node(), name, serial, why, self._origin)

    def _encoded(self, goal: Any) -> bytes:
        message = self._declared()
        if message is None:
            raise MisuseError(
                f"a new goal of {self._description}: say of which message it is, with message="
            )
        return message.encode_data(goal)

    def _know(self, message: Message[Any, Any] | None) -> None:
        """The task is that *message*, if it is given."""
        if message is None:
            return
        check_message(message)
        if message.name != self.message:
            raise MisuseError(f"{self._description} is no '{message.name}'")
        self._connection().declare(message)

    def _declared(self) -> Message[Any, Any] | None:
        """The task's message, if it was declared here."""
        return self._connection().declared(self.message)

    @property
    def _life_cycle(self) -> LifeCycle:
        return life_cycle_of(self._declared())
