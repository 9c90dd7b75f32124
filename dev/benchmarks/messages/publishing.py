"""A contestant that publishes under names: subscribers count, and report the count on request."""

import queue
from abc import abstractmethod
from collections.abc import Callable

from dev.benchmarks.messages.contestant import (
    COUNT,
    LISTENERS,
    MARK,
    SOON,
    NotThere,
    body_of,
    check_arrived,
    until,
)
from dev.benchmarks.messages.images import Showing


class Publishing(Showing):
    """One subscriber receives *pose*, ``LISTENERS`` receive *tick*."""

    pose, tick = "pose", "tick"

    def __init__(self) -> None:
        super().__init__()
        self.counts = queue.SimpleQueue[bytes]()  #: reports of subscribers

    @abstractmethod
    def publisher(self, name: str) -> Callable[[bytes], object]:
        """Return a function that publishes a body under a name."""

    def ready(self) -> None:
        until(lambda: self._check_received(self.pose, 1))
        until(lambda: self._check_received(self.tick, LISTENERS))

    def _check_received(self, name: str, subscribers: int) -> None:
        self.publisher(name)(MARK)
        try:
            for _ in range(subscribers):
                self.counts.get(timeout=0.3)
        except queue.Empty as error:
            raise NotThere("not all are connected yet") from error

    def oneway(self, number: int) -> None:
        self._flood(self.pose, number, 1)

    def fanout(self, number: int) -> None:
        self._flood(self.tick, number, LISTENERS)

    def _flood(self, name: str, number: int, subscribers: int) -> None:
        body, publish = body_of(100, COUNT), self.publisher(name)
        for _ in range(number):
            publish(body)
        publish(MARK)
        check_arrived(number, *(int(self.counts.get(timeout=SOON)) for _ in range(subscribers)))
