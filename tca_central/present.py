"""The base classes of ``State``: the event being handled, and the connections that block."""

from collections import deque
from collections.abc import Iterable

from tca_central.events import Effect, Transmit
from tca_central.model.clock import Clock, Timer
from tca_central.model.deliveries import Connection
from tca_central.model.values import Blocking
from tca_central.order.dispatcher import Suspect
from tca_wire.journal import facts
from tca_wire.packets.headers import ToModule


class Present:
    """The event being handled: its number, time and origin, and its results so far."""

    __slots__ = ("clock", "epoch", "event_count", "facts", "failed", "messages", "origin")

    def __init__(self, epoch: str) -> None:
        self.epoch = epoch
        self.clock = Clock()
        self.event_count = 0  #: number of events and timers handled
        self.origin = 0  #: the delivery whose handler sent the request (0: none)
        self.facts: list[facts.Fact] = []  #: facts of the event, for its journal entry
        self.failed: dict[int, str] = {}  #: by id: messages that failed, as text for the log
        self.messages: list[Effect] = []  #: messages to send after the event is recorded

    def notify(self, connection: Connection, header: ToModule, body: bytes = b"") -> None:
        """Send a message that is not the final answer to a request."""
        self.messages.append(Transmit(connection.id, header, body))


class Waits(Present):
    """The connections that block until they are answered, and the waits suspected of deadlock."""

    __slots__ = ("blocked", "may_have_closed", "scan", "search_delay", "search_timer", "suspects")

    def __init__(self, epoch: str) -> None:
        Present.__init__(self, epoch)
        self.blocked: dict[Connection, None] = {}  #: connections with waits that are not brief
        self.suspects: deque[Suspect] = deque()  #: waits that may have closed a cycle
        #: Seconds between an event that may have closed a cycle and the search of all waits
        #: (0: no search for deadlocks)
        self.search_delay = 0.25
        self.search_timer: Timer | None = None
        #: An unfinished search, which ``search_timer`` continues (deadlocks.py)
        self.scan: object = None
        #: Whether an event since the last search began may have closed a cycle.
        self.may_have_closed = False

    def block(
        self,
        connection: Connection,
        number: int,
        origin: int,
        *,
        brief: bool,
        others: Iterable[int] = (),
    ) -> None:
        """Have a connection do nothing until request *number*, or one of *others*, is answered.

        A *brief* wait ends soon by itself, so it is never searched for deadlocks.
        """
        numbers = (number, *others)
        wait = Blocking(origin, self.event_count, self.clock.now, numbers if others else ())
        if brief:
            connection.unchecked_waits.update(dict.fromkeys(numbers, wait))
            # From now on, the slot may be lent to a task that its older waits need.
            self.suspects.extend((connection, one) for one in connection.waits)
        else:
            self._block(connection, numbers, wait)

    def block_coroutine(
        self, connection: Connection, numbers: tuple[int, ...], delivery: int
    ) -> None:
        """Have a delivery's coroutine wait for one of several answers. Its slot does other work."""
        self._block(
            connection, numbers, Blocking(delivery, self.event_count, self.clock.now, numbers, True)
        )

    def _block(self, connection: Connection, numbers: tuple[int, ...], wait: Blocking) -> None:
        """Add a wait that may be part of a deadlock."""
        for number in numbers:
            self.unblock(connection, number)  # the wait for it was brief so far
        connection.waits.update(dict.fromkeys(numbers, wait))
        self.blocked[connection] = None
        # One request is enough as a suspect: all these requests share the wait.
        self.suspects.append((connection, numbers[0]))

    def unblock(self, connection: Connection, number: int) -> None:
        """End the wait for request *number*, and for the other requests that share the wait."""
        if (wait := connection.unchecked_waits.pop(number, None)) is not None:
            for other in wait.together:
                connection.unchecked_waits.pop(other, None)
        elif (wait := connection.waits.pop(number, None)) is not None:
            for other in wait.together:
                connection.waits.pop(other, None)
            if not connection.waits:
                del self.blocked[connection]

    def unblock_coroutine(self, connection: Connection, delivery: int) -> None:
        """End the wait of a delivery's coroutine."""
        waits = connection.waits.items()
        found = next(
            (number for number, wait in waits if wait.is_coroutine and wait.origin == delivery),
            None,
        )
        if found is not None:
            self.unblock(connection, found)
