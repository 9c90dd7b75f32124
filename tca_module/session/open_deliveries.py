"""The deliveries that are not answered yet, and what their handlers know of.

A handler is woken from its present or next wait at most twice. The one reason is a kill or retry of
its task, the other its module's end. Reading ``task.cancelled`` as true counts as being woken.
Later waits work as usual, so the handler can clean up.

A context variable identifies the waiting handler. An asyncio task counts as part of the handler
that started it.
"""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import Context, ContextVar
from typing import Any, TypeVar

from tca_module.errors import Stopped, TaskKilled
from tca_wire.packets.changes import Requested
from tca_wire.packets.headers import Postpone

S = TypeVar("S")

KILLED = "its task has been killed"
ENDS = "its module ends"


def never() -> bool:
    """Always return False: outside of modules, nothing ends handlers."""
    return False


class OpenDelivery:
    """A delivery that is being handled, or about to be. It also stands for its handler."""

    __slots__ = (
        "delivery",
        "is_killed",
        "is_shielded",
        "is_suspended",
        "knows_of_end",
        "knows_of_kill",
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
        self.delivery = delivery  #: the number of the delivery
        self.name = ""  #: the message, for people; "" until the handler starts
        self.is_killed = False  #: the task was killed, is retried, or was forgotten
        self.why_killed = ""  #: the reason of the kill
        self.is_shielded = False  #: the handler cleans up and must not be woken
        self.is_suspended = is_suspended  #: the task is suspended
        self.knows_of_kill = False  #: the handler knows of the kill
        self.knows_of_end = False  #: the handler knows that the module ends
        #: requests of clients, if any
        self.requested: deque[tuple[Requested, bytes]] | None = None
        self.on_request: tuple[Callable[[], None], ...] = ()  #: called soon after each request
        #: the state of the task as the handler knows it, created when first needed
        self.state: Any = None


class OpenDeliveries:
    """The open deliveries of one connection."""

    def __init__(self) -> None:
        #: whether the module ends, so that handlers must be woken
        self.is_ending: Callable[[], bool] = never
        self._known: dict[int, OpenDelivery] = {}  #: number -> delivery
        #: delivery -> what central was told of it: its handler has returned, and replies later
        self.postponed: dict[int, Postpone] = {}

    def __contains__(self, delivery: int) -> bool:
        return delivery in self._known

    def __len__(self) -> int:
        return len(self._known)

    @property
    def occupying(self) -> int:
        """The number of deliveries that keep the slot from other messages."""
        number = len(self._known)
        if self.postponed:
            number -= sum(one.frees_slot for one in self.postponed.values())
        return number

    def is_open(self, handler: OpenDelivery | None) -> bool:
        """Return whether a delivery is still open: neither answered nor forgotten by central."""
        return handler is not None and self._known.get(handler.delivery) is handler

    @property
    def begun(self) -> list[int]:
        """The deliveries whose handlers have started."""
        return [delivery for delivery, handler in self._known.items() if handler.name]

    def name_of(self, delivery: int) -> str:
        """Return the message of a delivery whose handler has started."""
        return self._known[delivery].name if delivery in self._known else ""

    def add(self, delivery: int, *, is_suspended: bool) -> None:
        """Add a delivery that will be handled."""
        self._known[delivery] = OpenDelivery(self, delivery, is_suspended=is_suspended)

    def kill(self, delivery: int, why: str = "") -> None:
        """Record that the task of a delivery was killed or is retried."""
        if (handler := self._known.get(delivery)) is not None:
            handler.is_killed, handler.why_killed = True, why

    def suspend(self, delivery: int, *, is_suspended: bool) -> None:
        """Record that the task of a delivery was suspended or resumed."""
        if (handler := self._known.get(delivery)) is not None:
            handler.is_suspended = is_suspended

    def request(self, header: Requested, body: bytes) -> tuple[Callable[[], None], ...]:
        """Add a client's request to a delivery; return the functions to call for the request."""
        if (handler := self._known.get(header.delivery)) is None:
            return ()
        if handler.requested is None:
            handler.requested = deque()
        handler.requested.append((header, body))
        return handler.on_request

    def forget(self) -> None:
        """Forget all deliveries of a restarted central, which may use the same numbers again."""
        for handler in self._known.values():
            handler.is_killed = True
            handler.why_killed = "central was restarted and has forgotten it"
        self._known.clear()
        self.postponed.clear()

    def begin(self, delivery: int, name: str) -> OpenDelivery:
        """Record that the handler of a delivery starts."""
        handler = self._known.get(delivery)
        if handler is None:
            handler = self._known[delivery] = OpenDelivery(self, delivery)
        handler.name = name
        return handler

    def remove(self, delivery: int) -> bool:
        """Remove a delivery that has been handled; return False if it is no longer open."""
        handler = self._find(delivery)
        if handler is None or self._known.get(delivery) is not handler:
            return False
        del self._known[delivery]
        self.postponed.pop(delivery, None)
        return True

    def _find(self, delivery: int) -> OpenDelivery | None:
        """Return the open delivery of that number.

        A restarted central may use the number again. Within the handler of an older delivery of
        that number, this returns the older delivery.
        """
        own = current_delivery()
        if own is not None and own.owner is self and own.delivery == delivery:
            return own
        return self._known.get(delivery)

    def state_of(self, delivery: int, make: Callable[[OpenDelivery], S]) -> S:
        """Return the state of a delivery's task, as its handler knows it; *make* it if needed."""
        handler = self._find(delivery)
        assert handler is not None
        if handler.state is None:
            handler.state = make(handler)
        state: S = handler.state
        return state

    def is_killed(self, delivery: int) -> bool:
        """Return whether the task of a delivery was killed or forgotten."""
        handler = self._find(delivery)
        return handler is None or handler.is_killed

    def is_cancelled(self, delivery: int) -> bool:
        """Return whether a handler should return: its task was killed, or its module ends."""
        return self.is_killed(delivery) or self.is_ending()

    def read_cancelled(self, delivery: int) -> bool:
        """Return ``is_cancelled`` to the handler, which then counts as woken."""
        if is_cancelled := self.is_cancelled(delivery):
            self.mark_notified(self._find(delivery))
        return is_cancelled

    def is_suspended(self, delivery: int) -> bool:
        """Return whether a delivery's task is suspended; False once its handler should return."""
        handler = self._find(delivery)
        return handler is not None and handler.is_suspended and not self.is_cancelled(delivery)

    def was_woken_to_end(self, delivery: int) -> bool:
        """Return whether a handler was woken by its module's end, and its task was not killed.

        Such a handler may have stopped halfway.
        """
        handler = self._find(delivery)
        return handler is not None and handler.knows_of_end and not handler.is_killed

    def wake_reason(self, handler: OpenDelivery | None) -> str:
        """Return why a handler must be woken: KILLED, ENDS or "".

        A callback (None) is always woken when the module ends.
        """
        if handler is not None and handler.is_shielded:
            return ""
        if handler is not None and handler.is_killed and not handler.knows_of_kill:
            return KILLED
        knows_of_end = handler is not None and handler.knows_of_end
        return ENDS if self.is_ending() and not knows_of_end else ""

    def mark_notified(self, handler: OpenDelivery | None) -> None:
        """Record that a handler knows of a kill of its task and of its module's end, if any."""
        if handler is not None:
            handler.knows_of_kill = handler.is_killed
            handler.knows_of_end = self.is_ending()

    @contextmanager
    def shielded(self) -> Iterator[None]:
        """Return a block in which the calling handler is not woken, so that it can clean up."""
        handler = self.waiting_handler()
        was_shielded = handler is not None and handler.is_shielded
        if handler is not None:
            handler.is_shielded = True
        try:
            yield
        finally:
            if handler is not None:
                handler.is_shielded = was_shielded

    def waiting_handler(self) -> OpenDelivery | None:
        """Return the calling handler; None in a callback or outside of handlers."""
        handler = _at_work.get()
        return handler if handler is not None and handler.owner is self else None


def task_is_killed() -> bool:
    """Return whether the task of the calling handler was killed."""
    handler = _at_work.get()
    return handler is not None and handler.is_killed


def current_delivery(context: Context | None = None) -> OpenDelivery | None:
    """Return the delivery that the caller, or a *context*, works for."""
    return _at_work.get() if context is None else context.get(_at_work, None)


_at_work: ContextVar[OpenDelivery | None] = ContextVar("at_work", default=None)


# A class rather than a generator, which would cost every message two microseconds.
class working_on:  # noqa: N801
    """A block whose work counts as that of a delivery's handler; with None, as no handler's."""

    __slots__ = ("_handler", "_token")

    def __init__(self, handler: OpenDelivery | None) -> None:
        self._handler = handler

    def __enter__(self) -> None:
        self._token = _at_work.set(self._handler)

    def __exit__(self, *_: object) -> None:
        _at_work.reset(self._token)


def wake_error(
    handler: OpenDelivery | None, why: str, module: str, what: str
) -> TaskKilled | Stopped:
    """Return the error that wakes a handler or callback from the wait for *what*."""
    if why == KILLED and handler is not None:
        reason = f"{handler.why_killed}; " if handler.why_killed else ""
        return TaskKilled(handler.name, f"{reason}{what} is given up")
    return Stopped(f"module '{module}' ends: {what} is given up")
