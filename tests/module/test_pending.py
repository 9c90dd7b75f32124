"""Handlers that say how many messages may wait for them."""

import queue
import threading
from typing import Any

import pytest
from module.gait_messages import MOVE_LEG, POSITION, STANCE, Arc, Footfall

from tca_module import Client, Module, QueryFailed, TaskKilled
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


def test_who_asked_or_commanded_is_told(slow: Slow, user: Client) -> None:
    slow.module.handles(MOVE_LEG, pending=1)(slow.move)
    slow.module.handles(STANCE, pending=2)(slow.stance)
    with slow.module.running():
        legs = [user.command(MOVE_LEG, leg, sequential=False) for leg in range(3)]
        questions = [user.query_send(STANCE, float(number)) for number in range(3)]
        why = "overload: at most 1 of 'move leg' may wait for 'slow', and a newer one came"
        with pytest.raises(TaskKilled, match=rf"move leg \{{2\}} was killed: {why}"):
            legs[1].result(SOON)
        with pytest.raises(QueryFailed) as failed:
            questions[0].receive(SOON)
        assert failed.value.failure == "overload"
        assert failed.value.text == "at most 2 of 'stance' may wait for 'slow', and a newer one came"
        slow.go_on.set()
        assert legs[2].result(SOON) == Footfall(2, 0.0)
        assert [question.receive(SOON) for question in questions[1:]] == [[1], [2]]
