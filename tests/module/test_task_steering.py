"""Senders steer their tasks, and other modules extend these tasks."""

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from module.real_central import SOON
from module.robot import (
    REST,
    STOP,
)

from dev.invariants import check_invariants
from tca_module import (
    Client,
    Command,
    DemonMonitor,
    ExceptionHandler,
    Failure,
    Goal,
    Module,
    Outcome,
    PollingMonitor,
    Query,
    Refused,
    Sender,
    SentTask,
    Task,
    TaskRef,
    connect,
)
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Ignored, Received

# --- Steering returns whether it had an effect ----------------------------------------------------


SHRUG = ExceptionHandler("shrug")
STUCK = Failure("stuck")
ROCKS = DemonMonitor("rocks")

CALLS: dict[str, Callable[[TaskRef], Any]] = {
    "suspend": lambda task: task.suspend(),
    "resume": lambda task: task.resume(),
    "deadline": lambda task: task.deadline(60.0),
    "retry": lambda task: task.retry(),
    "fail": lambda task: task.fail(STUCK()),
    "kill": lambda task: task.kill(),
    "kill later": lambda task: task.kill(delay=60.0),
}
NOT_OF_KILLED = {"deadline", "retry", "fail"}


class RestingLegs:
    """Legs that rest until they may continue, and that only observe failures."""

    def __init__(self, central: LocalCentral) -> None:
        self.module = Module("resting_legs", central)
        self.resting, self.go_on = threading.Semaphore(0), threading.Semaphore(0)
        self.module.handles(STOP)(self._rest)
        self.module.handles(SHRUG, resource="head")(lambda _: None)

    def _rest(self, _: Task) -> None:
        self.resting.release()
        assert self.go_on.acquire(timeout=SOON)


@pytest.fixture
def resting_legs(central: LocalCentral) -> Iterator[RestingLegs]:
    resting_legs = RestingLegs(central)
    with resting_legs.module.running():
        yield resting_legs
        resting_legs.go_on.release(20)


@pytest.fixture
def supervisor(central: LocalCentral, resting_legs: RestingLegs) -> Iterator[Client]:
    with connect("supervisor", central) as supervisor:
        supervisor.on_failure(STUCK, SHRUG)
        yield supervisor


@pytest.mark.parametrize("steer", CALLS.values(), ids=CALLS)
def test_live_task_is_steered(
    resting_legs: RestingLegs, supervisor: Client, steer: Callable[[TaskRef], Any]
) -> None:
    ref = supervisor.command(STOP)
    assert resting_legs.resting.acquire(timeout=SOON)
    assert steer(ref) is True


@pytest.mark.parametrize("steer", CALLS.values(), ids=CALLS)
def test_ended_task_ignores_steering(
    resting_legs: RestingLegs,
    supervisor: Client,
    central: LocalCentral,
    steer: Callable[[TaskRef], Any],
) -> None:
    ref = supervisor.command(STOP)
    resting_legs.go_on.release()
    assert ref.wait(SOON) is Outcome.DONE
    assert steer(ref) is False
    assert [fact.sender for fact in central.facts if isinstance(fact, Ignored)] == ["supervisor"]


@pytest.mark.parametrize(("name", "steer"), CALLS.items(), ids=CALLS)
def test_killed_task_with_running_handler_gets_no_second_chance(
    resting_legs: RestingLegs, supervisor: Client, name: str, steer: Callable[[TaskRef], Any]
) -> None:
    ref = supervisor.command(STOP)
    assert resting_legs.resting.acquire(timeout=SOON)
    assert ref.kill() is True
    assert steer(ref) is (name not in NOT_OF_KILLED)
    resting_legs.go_on.release()
    assert ref.wait(SOON) is Outcome.KILLED
    assert ref.kill() is False


def test_retaining_or_attaching_to_ended_task_is_refused(
    resting_legs: RestingLegs, supervisor: Client
) -> None:
    ref = supervisor.command(STOP)
    resting_legs.go_on.release()
    assert ref.wait(SOON) is Outcome.DONE
    promises: list[Callable[[], Any]] = [
        ref.keep,
        lambda: ref.on_failure(STUCK, SHRUG),
        lambda: ref.on_termination(STOP),
        lambda: supervisor.under(ref).command(STOP).id,
    ]
    for promise in promises:
        with pytest.raises(Refused, match="has ended"):
            promise()
    ref.release()  # releasing a task that is not retained does no harm


def test_monitor_ends_once(resting_legs: RestingLegs, supervisor: Client) -> None:
    monitor = supervisor.monitor(ROCKS, duration=60.0)
    assert monitor.fire() is True
    assert monitor.end() is True
    assert monitor.end() is False
    assert monitor.fire() is False


# --- Tasks and monitors under a task that another module handles ----------------------------------


TREAD, GUARD = Command("tread", int), Command("guard")
IS_LOW = Query("is the battery low", reply=bool)
BATTERY = PollingMonitor("battery", condition=IS_LOW, action=STOP)


class Expedition:
    """A planner with a walk that waits for the test, legs, and a watcher that finds the walk."""

    def __init__(self, central: LocalCentral) -> None:
        self.central = central
        self.steps: list[int] = []
        self.asked, self.is_low, self.begun, self.go_on = (threading.Event() for _ in range(4))
        self.planner, self.legs, self.watcher = (
            Module(name, central) for name in ("planner", "legs", "watcher")
        )
        self.planner.handles(REST)(self.walk)
        self.planner.handles(GUARD)(self.guard)
        self.legs.handles(TREAD)(self.tread)
        self.may_tread = threading.Event()
        self.may_tread.set()
        self.watcher.handles(IS_LOW)(self.answer)
        self.watcher.handles(STOP)(self.stop)

    def walk(self, task: Task) -> None:
        task.command(TREAD, 1)
        self.guard(task)
        task.command(TREAD, 3)

    def tread(self, _: Task, number: int) -> None:
        assert self.may_tread.wait(SOON)
        self.steps.append(number)

    def guard(self, _: Task) -> None:
        self.begun.set()
        assert self.go_on.wait(SOON)

    def answer(self, _: Task) -> bool:
        self.asked.set()
        return self.is_low.is_set()

    def stop(self, task: Task) -> None:
        task.monitor_ref.ancestors(REST)[0].kill("the battery is low")
        self.go_on.set()

    def begin(self, message: Goal[None] | Command[None, None], leader: Client) -> SentTask[None]:
        sent: SentTask[None] = leader.execute(message)
        assert self.begun.wait(SOON)
        return sent


@pytest.fixture
def expedition() -> Iterator[Expedition]:
    with LocalCentral(check=check_invariants) as central:
        expedition = Expedition(central)
        with expedition.planner.running(), expedition.legs.running(), expedition.watcher.running():
            yield expedition
            expedition.go_on.set()


@pytest.fixture
def leader(expedition: Expedition) -> Iterator[Client]:
    with connect("leader", expedition.central) as client:
        yield client


def test_monitor_under_foreign_task_finds_and_kills_it(
    expedition: Expedition, leader: Client
) -> None:
    walking = expedition.begin(REST, leader)
    monitor = expedition.watcher.under(expedition.watcher.tasks(REST)[0]).monitor(
        BATTERY, period=0.01
    )
    assert monitor.parent() is not None
    expedition.is_low.set()
    assert walking.wait(SOON) is Outcome.KILLED
    assert monitor.wait(SOON) is Outcome.KILLED


def test_command_under_foreign_task_joins_its_sequence(
    expedition: Expedition, leader: Client
) -> None:
    walking = expedition.begin(REST, leader)
    leader.under(walking).command(TREAD, 2)
    expedition.go_on.set()
    assert walking.wait(SOON) is Outcome.DONE
    assert expedition.steps == [1, 2, 3]


def test_sequence_block_ignores_tasks_of_other_senders(
    expedition: Expedition, leader: Client
) -> None:
    """Under a task of another module and under the root, the sequence contains only the
    client's own tasks.
    """
    expedition.may_tread.clear()  # otherwise the first might end before the second is sent
    sent = expedition.begin(GUARD, leader)
    pairs: list[tuple[Sender, Sender]] = [
        (leader.under(sent), leader.under(sent)),
        (leader, expedition.watcher),
    ]
    for own, others in pairs:
        with own.sequence():
            first = own.command(TREAD, 1)
            stranger = others.command(TREAD, 7, sequential=False)
            second = own.command(TREAD, 2)
        facts = [
            fact
            for fact in expedition.central.facts
            if isinstance(fact, Received) and fact.id == second.id
        ]
        before = {constraint.before.task for fact in facts for constraint in fact.constraints}
        assert first.id in before
        assert stranger.id not in before
    expedition.may_tread.set()
    expedition.go_on.set()
    assert second.wait(SOON) is first.wait(SOON) is sent.wait(SOON) is Outcome.DONE
    assert sorted(expedition.steps) == [1, 1, 2, 2, 7, 7]
