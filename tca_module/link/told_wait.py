"""A wait of which central is told as long as it lasts: for news of an observation, or for the first of several answers.

Of all other waits central knows by the requests themselves. Nothing is sent if there is nothing to wait for: a wait is
told when it has looked in vain at all that has come. It says how much that was, so that central, which may have sent
more, never takes a handler for waiting that is about to go on. News ends the wait for central, too.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, Self

from tca_module.link.packet_line import PacketLine
from tca_module.link.wait_loop import WaitLoop
from tca_module.session.request import Request
from tca_module.session.session import Session
from tca_wire.packets.changes import Observe
from tca_wire.packets.headers import Await


class Telling(Protocol):
    """A connection by which central is told."""

    session: Session
    line: PacketLine
    waiting: WaitLoop


@dataclass(slots=True)
class ToldWait:
    """One wait for the first news of some requests; used in a ``with`` block. Without requests none is told."""

    connection: Telling
    requests: Sequence[Request]
    brief: bool
    """It may end by itself, or soon does: no deadlock."""
    blocking: bool = True
    told: tuple[list[int], int] | None = None
    """The requests, and the number of answers to observations among them, as central was told."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """It is over. Central knows, if an answer ended it; requests that are no observations are given up."""
        if self.told is not None and self.told == self._now and isinstance(self.requests[0].header, Observe):
            self._post(-1)
            self.connection.line.flush(0.0, is_patient=True)

    def until(self, is_over: Callable[[], bool]) -> Callable[[], bool]:
        """*is_over*, with central told whenever it is not."""
        return (lambda: is_over() or self._tell()) if self.requests else is_over

    def _tell(self) -> bool:
        """There is nothing new: have central told, unless it knows, or something is called first. Always False."""
        if not (self.blocking and self.connection.waiting.has_news):
            now = self._now
            if now is not None and now != self.told:
                self.told = now
                self._post(now[1])
        return False

    def _post(self, seen: int) -> None:
        number, *others = [one.header.number for one in self.requests]
        origin = self.requests[0].header.origin
        self.connection.session.post(Await(number, self.blocking, origin, others, self.brief, seen))

    @property
    def _now(self) -> tuple[list[int], int] | None:
        """What to tell; None if an answer is under way: the last one, or the first, of how things stand."""
        observed = [one for one in self.requests if isinstance(one.header, Observe)]
        is_asked = all(one.was_sent and not one.is_over and one.path is None for one in self.requests)
        if not (self.connection.session.is_welcome and is_asked and all(one.seen for one in observed)):
            return None
        return [one.header.number for one in self.requests], sum(one.seen for one in observed)
