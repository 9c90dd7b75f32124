"""The event being handled, and who blocks: what the whole state is built on."""

from collections import deque
from collections.abc import Iterable

from tca_central.events import Effect, Transmit
from tca_central.model.clock import Clock, Timer
from tca_central.model.deliveries import Blocking, Connection
from tca_central.order.dispatcher import Suspect
from tca_wire.journal import facts
from tca_wire.packets.headers import ToModule


class Present:
    """The event being handled: its number, its time, its cause, and what came of it so far."""

    __slots__ = ("clock", "epoch", "events", "facts", "failed", "messages", "origin")

    def __init__(self, epoch: str) -> None:
        self.epoch = epoch
        self.clock = Clock()
        self.events = 0  #: number of events handled, and of timers
        self.origin = 0  #: the delivery whose handler asks (0: none)
        self.facts: list[facts.Fact] = []
        self.failed: dict[int, str] = {}  #: its failed parts, in words, for the log
        self.messages: list[Effect] = []

    def tell(self, connection: Connection, header: ToModule, body: bytes = b"") -> None:
        """Send a message that is no final answer."""
        self.messages.append(Transmit(connection.id, header, body))


class Waits(Present):
    """The connections that do nothing until they are answered, and the search for circles among
    them.
    """

    __slots__ = ("blocked", "look_after", "may_have_closed", "next_look", "scan", "suspects")

    def __init__(self, epoch: str) -> None:
        Present.__init__(self, epoch)
        self.blocked: dict[Connection, None] = {}
        self.suspects: deque[Suspect] = deque()  #: these may have begun to wait for themselves
        self.look_after = (
            0.25  #: seconds after which they are looked at again (0: nobody looks for deadlocks)
        )
        self.next_look: Timer | None = None
        self.scan: object = None  #: a look that goes on then (deadlocks.py)
        self.may_have_closed = (
            False  #: something has happened since it began that may have closed a circle
        )

    def block(
        self,
        connection: Connection,
        number: int,
        origin: int,
        *,
        brief: bool,
        others: Iterable[int] = (),
    ) -> None:
        """A connection does nothing until this request, or one of *others*, is answered. *Brief*:
        it is no deadlock.
        """
        numbers = (number, *others)
        wait = Blocking(origin, self.events, self.clock.now, numbers if others else ())
        if brief:
            connection.pauses.update(dict.fromkeys(numbers, wait))
        else:
            self._block(connection, numbers, wait)

    def block_coroutine(
        self, connection: Connection, numbers: tuple[int, ...], delivery: int
    ) -> None:
        """The handler of a delivery does nothing until one of these answers is there; its
        connection does.
        """
        self._block(
            connection, numbers, Blocking(delivery, self.events, self.clock.now, numbers, True)
        )

    def _block(self, connection: Connection, numbers: tuple[int, ...], wait: Blocking) -> None:
        connection.waits.update(dict.fromkeys(numbers, wait))
        self.blocked[connection] = None
        self.suspects.append((connection, numbers[0]))  # if that will be there, the handler goes on

    def unblock(self, connection: Connection, number: int) -> None:
        """End a wait: the answer is there, or nobody waits for it any more."""
        if (wait := connection.pauses.pop(number, None)) is not None:
            for other in wait.together:
                connection.pauses.pop(other, None)
        elif (wait := connection.waits.pop(number, None)) is not None:
            for other in wait.together:
                connection.waits.pop(other, None)
            if not connection.waits:
                del self.blocked[connection]

    def unblock_coroutine(self, connection: Connection, delivery: int) -> None:
        """The handler of a delivery may go on."""
        waits = connection.waits.items()
        found = next(
            (number for number, wait in waits if wait.is_coroutine and wait.origin == delivery),
            None,
        )
        if found is not None:
            self.unblock(connection, found)
