"""Clients and handlers act at random, all at once. Each update gets one answer, and each task has
one end. All programs agree on them.
"""

import random
import threading
from collections import Counter
from contextlib import suppress

import pytest

from dev.invariants import check_invariants
from tca_module import (
    Change,
    Command,
    Module,
    Outcome,
    Refused,
    Rejected,
    Sender,
    Server,
    Task,
    TaskFailed,
    TaskKilled,
    connect,
)
from tca_module.testing import LocalCentral

LATEST = 30.0  # seconds
PLAY, SING = (Command(name, int, result=int, progress=int) for name in ("play", "sing"))


class RandomHandler:
    """A handler that answers requests at random."""

    def __init__(self) -> None:
        self.answered: Counter[str] = Counter()
        self._lock = threading.Lock()

    def play(self, task: Task, goal: int) -> int:
        dice = random.Random(goal)
        if dice.random() < 0.1:
            raise task.rejected("it does not feel like it")
        if dice.random() < 0.9:
            task.accept()
        for step in range(dice.randrange(40) if task.state != "initiated" else 0):
            task.report(step)
            request = (
                task.request
                if dice.random() < 0.5
                else task.wait_for_request(dice.random() * 0.003)
            )
            if request is None or dice.random() < 0.2:
                continue
            is_granted = dice.random() < 0.5
            answered = request.accept() if is_granted else request.reject("not now")
            with self._lock:
                self.answered[f"{task.id} {request.serial}"] += answered
            if is_granted and request.transition == "cancel":
                return -1
            goal = request.goal if is_granted else goal
        return goal


class RandomServer(Server[int, int]):
    """A random handler with a method for each request."""

    def initiated(self, task: Task, goal: int) -> int:
        for step in range(random.Random(goal).randrange(40)):
            task.report(step)
            task.wait_for_request(0.001)
        return goal

    def update(self, task: Task, goal: int) -> bool:
        if goal % 5 == 0:
            raise task.rejected("no multiple of five")
        return goal % 7 != 0

    def cancel(self, task: Task, why: str) -> bool:
        return why == "please"


class RandomClient(threading.Thread):
    """A client that sends tasks, and updates, cancels or awaits them at random."""

    def __init__(self, central: LocalCentral, seed: int, tasks: int) -> None:
        super().__init__()
        self._central, self._dice, self._tasks = central, random.Random(seed), tasks
        self.errors: list[str] = []

    def run(self) -> None:
        with connect(f"client {self.name}", self._central) as user:
            for _ in range(self._tasks):
                try:
                    self._order(user)
                except Exception as error:  # noqa: BLE001 - for the test
                    self.errors.append(repr(error))

    def _order(self, user: Sender) -> None:
        dice = self._dice
        task = user.command(dice.choice([PLAY, SING]), dice.randrange(10**6), sequential=False)
        changes: list[Change] = []
        task.on_change(changes.append)
        if dice.random() < 0.8:
            task.wait_for_state("running", timeout=LATEST)
        for _ in range(dice.randrange(5)):
            with suppress(Rejected, Refused):
                if dice.random() < 0.7:
                    task.update(dice.randrange(100), timeout=LATEST)
                else:
                    task.cancel(dice.choice(["please", ""]))
        with suppress(TaskFailed, TaskKilled):
            task.result(LATEST)
        *_, last = task.changes(timeout=LATEST)
        assert (last.state == "done") == (task.wait() is Outcome.DONE), (last, task.wait())
        assert [one.serial for one in changes] == sorted({one.serial for one in changes})
        assert not any(one.missed for one in changes)


def run_band(seed: int, clients: int, tasks: int) -> None:
    handler = RandomHandler()
    with LocalCentral(check=check_invariants) as central:
        band = Module("band", central)
        band.resource("drums", capacity=3)
        band.handles(PLAY, resource="drums", accepts=True, takes=["update", "cancel"])(handler.play)
        band.serve(SING, RandomServer(), resource="voice")
        with band.running():
            threads = [RandomClient(central, seed + number, tasks) for number in range(clients)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join(LATEST)
            assert not any(thread.is_alive() for thread in threads)
    assert [error for thread in threads for error in thread.errors] == []
    assert set(handler.answered.values()) <= {0, 1}


def test_few_random_customers_and_servers_agree() -> None:
    run_band(seed=0, clients=3, tasks=6)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(0, 1000, 100))
def test_many_random_customers_and_servers_agree(seed: int) -> None:
    run_band(seed, clients=5, tasks=40)
