"""The deliveries that are not answered yet, and what their handlers have been told.

A handler is woken from its present or next wait once because its task was killed or is to be
handled again, and once because its module ends. Reading ``task.cancelled`` as true counts as being
told. Later waits work as ever, so that it can clean up. The context tells which handler waits: for
asyncio tasks, the one that started them.
"""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import Context, ContextVar
from typing import Any, TypeVar

from tca_module.errors import Stopped, TaskKilled
from tca_wire.packets.changes import Requested

S = TypeVar("S")

KILLED = "its task has been killed"
ENDS = "its module ends"


def never() -> bool:
    """Nobody is told to end: outside of modules."""
    return False


class OpenDelivery:
    """A delivery that is being handled, or about to be."""

    __slots__ = (
        "delivery",
        "is_killed",
        "is_shielded",
        "is_suspended",
        "is_told_of_end",
        "is_told_of_kill",
        "name",
        "on_request",
        "owner",
        "requested",
        "state",
        "why_killed",
    )

    def __init__(
        self, owner: "OpenDeliveries", delivery: int, *, is_suspended: bool = False
    ) -> None:
        self.owner = owner
        self.delivery = delivery
        self.name = ""  #: its message, for people
        self.is_killed = False  #: its task; or the task is to be handled again, or forgotten
        self.why_killed = ""  #: and by whom
        self.is_shielded = False  #: its handler cleans up, and is not woken meanwhile
        self.is_suspended = is_suspended  #: its task
        self.is_told_of_kill = False  #: the handler knows it
        self.is_told_of_end = False  #: the handler knows that the module ends
        #: what clients have asked for, if anything
        self.requested: deque[tuple[Requested, bytes]] | None = None
        self.on_request: tuple[Callable[[], None], ...] = ()  #: become news with each of those
        self.state: Any = None  #: its task's, as the handler knows it; made when it is first needed


class OpenDeliveries:
    """The open deliveries of one connection."""

    def __init__(self) -> None:
        #: whether the module ends, and handlers are to be told
        self.is_ending: Callable[[], bool] = never
        self._known: dict[
            int, OpenDelivery
        ] = {}  #: by delivery; one that came directly (< 0) from its beginning

    def __contains__(self, delivery: int) -> bool:
        return delivery in self._known

    def __len__(self) -> int:
        return len(self._known)

    def knows(self, one: OpenDelivery | None) -> bool:
        """Whether a handler is still at its delivery, and central has not forgotten it."""
        return one is not None and self._known.get(one.delivery) is one

    @property
    def begun(self) -> list[int]:
        """The deliveries whose handlers have begun."""
        return [delivery for delivery, one in self._known.items() if one.name]

    def name_of(self, delivery: int) -> str:
        """The message of a delivery whose handler has begun."""
        one = self._known.get(delivery)
        return one.name if one is not None else ""

    def add(self, delivery: int, *, is_suspended: bool) -> None:
        """A message is to be handled."""
        self._known[delivery] = OpenDelivery(self, delivery, is_suspended=is_suspended)

    def kill(self, delivery: int, why: str = "") -> None:
        """The task of a delivery was killed, or is to be handled again."""
        if (one := self._known.get(delivery)) is not None:
            one.is_killed, one.why_killed = True, why

    def suspend(self, delivery: int, *, is_suspended: bool) -> None:
        """The task of a delivery was suspended or resumed."""
        if (one := self._known.get(delivery)) is not None:
            one.is_suspended = is_suspended

    def request(self, header: Requested, body: bytes) -> tuple[Callable[[], None], ...]:
        """A client wants something of a delivery's handler; what is to be called because of it."""
        if (one := self._known.get(header.delivery)) is None:
            return ()
        if one.requested is None:
            one.requested = deque()
        one.requested.append((header, body))
        return one.on_request

    def forget(self) -> None:
        """Central was restarted and has forgotten them; it may use the same numbers again."""
        for delivery, one in self._known.items():
            one.is_killed, one.why_killed = (
                delivery > 0,
                "central was restarted and has forgotten it",
            )
        self._known = {delivery: one for delivery, one in self._known.items() if delivery < 0}

    def begin(self, delivery: int, name: str) -> OpenDelivery:
        """A handler begins with a delivery."""
        one = self._known.get(delivery)
        if one is None:
            one = self._known[delivery] = OpenDelivery(self, delivery)
        one.name = name
        return one

    def end(self, delivery: int) -> bool:
        """A delivery has been handled; False if central has forgotten it."""
        one = self._of(delivery)
        if not self.knows(one):
            return False
        del self._known[delivery]
        return True

    def _of(self, delivery: int) -> OpenDelivery | None:
        """The open delivery of that number; a handler that asks for its own never gets a newer one
        of that number.
        """
        mine = current_delivery()
        if mine is not None and mine.owner is self and mine.delivery == delivery:
            return mine
        return self._known.get(delivery)

    def state_of(self, delivery: int, make: Callable[[OpenDelivery], S]) -> S:
        """The state of the task of a delivery, as its handler knows it; made when it is first asked
        for.
        """
        one = self._of(delivery)
        assert one is not None
        if one.state is None:
            one.state = make(one)
        state: S = one.state
        return state

    def is_killed(self, delivery: int) -> bool:
        """Whether the task of a delivery was killed or forgotten; never that of a direct one (<
        0).
        """
        one = self._of(delivery)
        return one.is_killed if one is not None else delivery > 0

    def is_cancelled(self, delivery: int) -> bool:
        """Whether a delivery's handler is to clean up and return: its task was killed, or the
        module ends.
        """
        return self.is_killed(delivery) or self.is_ending()

    def read_cancelled(self, delivery: int) -> bool:
        """Whether it ``is_cancelled``, for its handler, which has been told everything by then."""
        if is_cancelled := self.is_cancelled(delivery):
            self.mark_told(self._of(delivery))
        return is_cancelled

    def is_suspended(self, delivery: int) -> bool:
        """Whether the task of a delivery is suspended; a killed one is to end instead."""
        one = self._of(delivery)
        return one is not None and one.is_suspended and not self.is_cancelled(delivery)

    def was_told_to_end(self, delivery: int) -> bool:
        """Whether the handler was told to return because the module ends, and so may have stopped
        halfway.
        """
        one = self._of(delivery)
        return one is not None and one.is_told_of_end and not one.is_killed

    def wake_reason(self, one: OpenDelivery | None) -> str:
        """Why a handler is to be woken: KILLED, ENDS or "". A callback (None) is woken whenever the
        module ends.
        """
        if one is not None and one.is_shielded:
            return ""
        if one is not None and one.is_killed and not one.is_told_of_kill:
            return KILLED
        return ENDS if self.is_ending() and not (one is not None and one.is_told_of_end) else ""

    def mark_told(self, one: OpenDelivery | None) -> None:
        """A handler has been told everything by now."""
        if one is not None:
            one.is_told_of_kill = one.is_killed
            one.is_told_of_end = self.is_ending()

    @contextmanager
    def shielded(self) -> Iterator[None]:
        """A block in which the calling handler is not woken: it cleans up."""
        one = self.waiting_handler()
        before = one is not None and one.is_shielded
        if one is not None:
            one.is_shielded = True
        try:
            yield
        finally:
            if one is not None:
                one.is_shielded = before

    def waiting_handler(self) -> OpenDelivery | None:
        """The handler that waits now; None for a callback, or outside of handlers."""
        one = _at_work.get()
        return one if one is not None and one.owner is self else None


def task_is_killed() -> bool:
    """Whether the task of the calling handler was killed."""
    one = _at_work.get()
    return one is not None and one.is_killed


def current_delivery(context: Context | None = None) -> OpenDelivery | None:
    """The delivery that the caller, or a *context*, works for."""
    return _at_work.get() if context is None else context.get(_at_work, None)


_at_work: ContextVar[OpenDelivery | None] = ContextVar("at_work", default=None)


class working_on:  # noqa: N801 - every message passes here, and a generator would cost it two microseconds
    """Work within the block is for that delivery; None: for none."""

    __slots__ = ("_one", "_token")

    def __init__(self, one: OpenDelivery | None) -> None:
        self._one = one

    def __enter__(self) -> None:
        self._token = _at_work.set(self._one)

    def __exit__(self, *_: object) -> None:
        _at_work.reset(self._token)


def wake_error(one: OpenDelivery | None, why: str, module: str, what: str) -> TaskKilled | Stopped:
    """The error that wakes a handler or callback from the wait for *what*."""
    if why == KILLED and one is not None:
        reason = f"{one.why_killed}; " if one.why_killed else ""
        return TaskKilled(one.name, f"{reason}{what} is not waited for any more")
    return Stopped(f"module '{module}' ends: {what} is not waited for any more")
