"""Who steers a task is told whether anything was done: it may have ended just before, which is no error."""

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from module.real_central import RealCentral

from tca_live import tasks as task_commands
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
    Scope,
    Task,
    TaskRef,
    connect,
)
from tca_wire.journal.facts import Ignored, Retried

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

    def __init__(self, central: str) -> None:
        self.module = Module("legs", central)
        self.resting, self.go_on = threading.Semaphore(0), threading.Semaphore(0)
        self.module.handles(REST)(self._rest)
        self.module.handles(SHRUG, resource="head")(lambda _: None)

    def _rest(self, _: Task) -> None:
        self.resting.release()
        assert self.go_on.acquire(timeout=SOON)


@pytest.fixture
def central(tmp_path: Path) -> Iterator[RealCentral]:
    with RealCentral(f"ipc://{tmp_path}/central.sock") as central:
        yield central


@pytest.fixture
def legs(central: RealCentral) -> Iterator[Legs]:
    legs = Legs(central.address)
    with legs.module.running():
        yield legs
        legs.go_on.release(20)


@pytest.fixture
def user(central: RealCentral, legs: Legs) -> Iterator[Client]:
    with connect("user", central.address) as user:
        user.on_failure(STUCK, SHRUG)
        yield user


@pytest.mark.parametrize("steer", STEERS.values(), ids=STEERS)
def test_a_task_that_lives_is_steered(legs: Legs, user: Client, steer: Callable[[TaskRef], Any]) -> None:
    ref = user.command(REST)
    assert legs.resting.acquire(timeout=SOON)
    assert steer(ref) is True


@pytest.mark.parametrize("steer", STEERS.values(), ids=STEERS)
def test_one_that_has_ended_is_not(
    legs: Legs, user: Client, central: RealCentral, steer: Callable[[TaskRef], Any]
) -> None:
    ref = user.command(REST)
    legs.go_on.release()
    assert ref.wait(SOON) is Outcome.DONE
    assert not central.facts(Ignored)
    assert steer(ref) is False
    assert [fact.sender for fact in central.facts(Ignored)] == ["user"]


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


def test_a_deadline_that_was_kept_is_no_news(legs: Legs, user: Client) -> None:
    ref = user.command(REST)
    assert legs.resting.acquire(timeout=SOON)
    assert ref.deadline(0.001, ref.handling.start) is True
    assert ref.kill(after=ref.handling.start, scope=Scope.SIBLINGS) is True


def test_a_monitor_is_ended_once(legs: Legs, user: Client) -> None:
    monitor = user.monitor(ROCKS, duration=60.0)
    assert monitor.fire() is True
    assert monitor.end() is True
    assert monitor.end() is False
    assert monitor.fire() is False


def test_an_exception_handler_learns_that_its_task_was_given_up(legs: Legs, user: Client, central: RealCentral) -> None:
    """It looks at the failure for long, and meanwhile somebody kills the task: there is nothing to retry."""
    looking, go_on, retried = threading.Semaphore(0), threading.Semaphore(0), list[bool]()
    expert = Module("expert", central.address)
    look = ExceptionHandler("look")

    @expert.handles(look)
    def on_look(task: Task) -> None:
        looking.release()
        assert go_on.acquire(timeout=SOON)
        retried.append(task.trouble.failing.retry())

    @expert.handles(WALK, resource="planner")
    def walk(_: Task) -> None:
        raise STUCK()  # noqa: RSE102

    with expert.running():
        walking = user.goal(WALK, on_failure=[(STUCK, look)])
        assert looking.acquire(timeout=SOON)
        assert walking.kill() is True
        go_on.release()
        assert walking.wait(SOON) is Outcome.FAILED
    assert retried == [False]
    assert not central.facts(Retried)


@pytest.mark.parametrize(
    ("command", "words", "what"),
    [
        (task_commands.raise_failure, ["stuck"], "failed"),
        (task_commands.kill, [], None),
        (task_commands.suspend, [], None),
    ],
)
def test_commands_do_not_claim_what_was_not_done(
    legs: Legs, user: Client, central: RealCentral, command: Any, words: list[str], what: str | None
) -> None:
    ref = user.command(REST)
    assert legs.resting.acquire(timeout=SOON)
    ref.kill()
    result = CliRunner().invoke(command, [str(ref.id), *words, "--central", central.address])
    assert (result.exit_code == 0) is (what is None), result.output
    if what is not None:
        assert (
            f"rest {{{ref.id}}} was killed, and ends when its handler has returned: it can't be {what}" in result.output
        )
