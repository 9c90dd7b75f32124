"""A simulated network in one thread, with a clock of its own. Its seed decides which datagrams it
loses, delays, duplicates and reorders.
"""

import heapq
import itertools
import random
from collections.abc import Callable

from robots.turtle_sim.sync.link import REPEAT
from robots.turtle_sim.sync.statuses import Statuses


class LossyNetwork:
    """Robots with their status tables, and the datagrams in transit between them."""

    def __init__(self, names: list[str], seed: int, loss: float = 0.5) -> None:
        self.chance, self.loss = random.Random(seed), loss
        self.tables = {
            name: Statuses(name, [other for other in names if other != name]) for name in names
        }
        self.now = 0.0
        self.sent = 0
        self._numbers = itertools.count()
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        for name in names:
            self._repeat(name)

    def at(self, delay: float, what: Callable[[], None]) -> None:
        heapq.heappush(self._due, (self.now + delay, next(self._numbers), what))

    def run(self, until: Callable[[], bool], at_most: float = 1000.0) -> None:
        while not until():
            self.now, _, happens = heapq.heappop(self._due)
            assert self.now < at_most, "it never comes to its end"
            happens()

    def _repeat(self, name: str) -> None:
        for partner, datagram in self.tables[name].due():
            self._send(name, partner, datagram)
        self.at(REPEAT, lambda: self._repeat(name))

    def _send(self, sender: str, receiver: str, datagram: bytes) -> None:
        for _ in range(1 + (self.chance.random() < 0.1)):
            self.sent += 1
            if self.chance.random() >= self.loss:
                self.at(
                    self.chance.uniform(0.0, 0.3), lambda: self._arrive(sender, receiver, datagram)
                )

    def _arrive(self, sender: str, receiver: str, datagram: bytes) -> None:
        answer = self.tables[receiver].receive(sender, datagram)
        if answer is not None:
            self._send(receiver, sender, answer)
