"""Handlers that say how many messages may wait for them."""

import queue
import threading
from typing import Any

import pytest
from module.gait_messages import POSITION, Arc, Footfall

from tca_module import Client, Module
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Dropped

SOON = 5.0


class Slow:
    """A module whose handlers wait until they may go on."""

    def __init__(self, central: LocalCentral) -> None:
        self.module = Module("slow", central)
        self.go_on, self.began = threading.Event(), threading.Event()
        self.handled: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def handle(self, _task: Any, data: Any) -> Any:
        self.began.set()
        self.go_on.wait(SOON)
        self.handled.put(data)

    def move(self, task: Any, leg: int) -> Footfall:
        self.handle(task, leg)
        return Footfall(leg, 0.0)

    def stance(self, task: Any, radius: float) -> list[int]:
        self.handle(task, radius)
        return [int(radius)]


@pytest.fixture
def slow(central: LocalCentral) -> Slow:
    return Slow(central)


def test_an_inform_that_gives_way_is_dropped(slow: Slow, user: Client, central: LocalCentral) -> None:
    slow.module.handles(POSITION, pending=1)(slow.handle)
    with slow.module.running():
        for step in range(5):
            user.inform(POSITION, Arc(0.0, step))
            assert slow.began.wait(SOON)
        slow.go_on.set()
        assert [slow.handled.get(timeout=SOON).steps for _ in range(2)] == [0, 4]
    dropped = [fact.why for fact in central.facts if isinstance(fact, Dropped)]
    assert dropped == ["at most 1 of 'position' may wait for 'slow', and a newer one came"] * 3
