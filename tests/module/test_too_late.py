"""Who steers a task is told whether anything was done: it may have ended just before, which is no error."""

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tca_module import (
    Client,
    Command,
    DemonMonitor,
    ExceptionHandler,
    Failure,
    Goal,
    Module,
    Outcome,
    Refused,
    Task,
    TaskRef,
    connect,
)
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Ignored

SOON = 10.0
REST, WALK, SHRUG = Command("rest"), Goal("walk"), ExceptionHandler("shrug")
STUCK = Failure("stuck")
ROCKS = DemonMonitor("rocks")

STEERS: dict[str, Callable[[TaskRef], Any]] = {
    "suspend": lambda task: task.suspend(),
    "resume": lambda task: task.resume(),
    "deadline": lambda task: task.deadline(60.0),
    "retry": lambda task: task.retry(),
    "fail": lambda task: task.fail(STUCK()),
    "kill": lambda task: task.kill(),
    "kill later": lambda task: task.kill(delay=60.0),
}
NOT_OF_KILLED = {"deadline", "retry", "fail"}


class Legs:
    """They rest until they may go on, and shrug at failures."""

    def __init__(self, central: LocalCentral) -> None:
        self.module = Module("legs", central)
        self.resting, self.go_on = threading.Semaphore(0), threading.Semaphore(0)
        self.module.handles(REST)(self._rest)
        self.module.handles(SHRUG, resource="head")(lambda _: None)

    def _rest(self, _: Task) -> None:
        self.resting.release()
        assert self.go_on.acquire(timeout=SOON)


@pytest.fixture
def legs(central: LocalCentral) -> Iterator[Legs]:
    legs = Legs(central)
    with legs.module.running():
        yield legs
        legs.go_on.release(20)


@pytest.fixture
def user(central: LocalCentral, legs: Legs) -> Iterator[Client]:
    with connect("user", central) as user:
        user.on_failure(STUCK, SHRUG)
        yield user


@pytest.mark.parametrize("steer", STEERS.values(), ids=STEERS)
def test_a_task_that_lives_is_steered(legs: Legs, user: Client, steer: Callable[[TaskRef], Any]) -> None:
    ref = user.command(REST)
    assert legs.resting.acquire(timeout=SOON)
    assert steer(ref) is True


@pytest.mark.parametrize("steer", STEERS.values(), ids=STEERS)
def test_one_that_has_ended_is_not(
    legs: Legs, user: Client, central: LocalCentral, steer: Callable[[TaskRef], Any]
) -> None:
    ref = user.command(REST)
    legs.go_on.release()
    assert ref.wait(SOON) is Outcome.DONE
    assert steer(ref) is False
    assert [fact.sender for fact in central.facts if isinstance(fact, Ignored)] == ["user"]


@pytest.mark.parametrize(("name", "steer"), STEERS.items(), ids=STEERS)
def test_one_that_was_killed_and_whose_handler_runs_has_not_ended_but_gets_no_second_chance(
    legs: Legs, user: Client, name: str, steer: Callable[[TaskRef], Any]
) -> None:
    ref = user.command(REST)
    assert legs.resting.acquire(timeout=SOON)
    assert ref.kill() is True
    assert steer(ref) is (name not in NOT_OF_KILLED)
    legs.go_on.release()
    assert ref.wait(SOON) is Outcome.KILLED
    assert ref.kill() is False


def test_what_is_promised_for_later_is_refused(legs: Legs, user: Client) -> None:
    ref = user.command(REST)
    legs.go_on.release()
    assert ref.wait(SOON) is Outcome.DONE
    promises: list[Callable[[], Any]] = [
        ref.keep,
        lambda: ref.on_failure(STUCK, SHRUG),
        lambda: ref.on_termination(REST),
        lambda: user.under(ref).command(REST),
    ]
    for promise in promises:
        with pytest.raises(Refused, match="has ended"):
            promise()
    ref.release()  # what is not kept need not be let go


def test_a_monitor_is_ended_once(legs: Legs, user: Client) -> None:
    monitor = user.monitor(ROCKS, duration=60.0)
    assert monitor.fire() is True
    assert monitor.end() is True
    assert monitor.end() is False
    assert monitor.fire() is False
