"""What deals with a failure: a retry, a kill, or an exception handler that calls resolved() and ends well."""

import threading
from collections.abc import Iterator
from typing import Any

import pytest

from tca_module import (
    Client,
    Command,
    ExceptionHandler,
    Failure,
    Goal,
    LaterReply,
    Module,
    Outcome,
    Recovery,
    Refused,
    Task,
    TaskFailed,
    connect,
)
from tca_module.testing import LocalCentral

SOON = 5.0
SLIP, JAM = Failure("slip"), Failure("jam")
WALK, STEP, SWING, MEND = Goal("walk"), Command("step"), Command("swing"), Command("mend")
WEIGH: Command[None, float | None] = Command("weigh", result=float | None)
LOOK = ExceptionHandler("look")


class Robot:
    """Its *looks* say what the exception handler does, one call after the other."""

    def __init__(self, central: LocalCentral) -> None:
        self.said: list[str] = []
        self.looks: list[Any] = []
        self.mends = True
        self.legs, self.expert, self.helper = (Module(name, central) for name in ("legs", "expert", "helper"))
        self.legs.resource("walk")
        self.legs.handles(WALK, resource="walk")(self.walk)
        for name, failing in ((STEP, True), (SWING, False)):
            self.legs.handles(name)(lambda task, failing=failing: self.move(task, failing))
        self.legs.handles(WEIGH)(lambda task: self.move(task, True))
        self.expert.handles(LOOK)(self.look)
        self.helper.handles(MEND)(self.mend)

    def walk(self, task: Task) -> None:
        with task.sequence():
            task.command(STEP)
            task.command(SWING)

    def move(self, task: Task, failing: bool) -> None:
        self.said.append(task.message)
        if failing:
            raise SLIP(text="on ice")

    def look(self, task: Task) -> Any:
        return self.looks.pop(0)(task)

    def mend(self, _: Task) -> None:
        if not self.mends:
            raise JAM(text="it does not move")


@pytest.fixture
def robot() -> Iterator[tuple[Robot, Client]]:
    with LocalCentral(check=True) as central:
        robot = Robot(central)
        with (
            robot.legs.running(),
            robot.expert.running(),
            robot.helper.running(),
            connect("user", central) as user,
        ):
            yield robot, user


def observe(_: Task) -> None:
    pass


def stop(task: Task) -> None:
    task.command(MEND)


def resolve(task: Task) -> None:
    assert task.trouble.resolved()


def test_failure_that_is_only_observed_ends_the_walk(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    them.looks = [observe, stop]
    user.on_failure(None, LOOK)
    for _ in range(2):
        walk = user.goal(WALK)
        assert walk.wait(SOON) is Outcome.FAILED
        with pytest.raises(TaskFailed, match="'look' returned without dealing with it"):
            walk.result(SOON)
    assert them.said == ["step"] * 2  # and never the swing after it


def test_resolved_failure_lets_the_walk_go_on(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    them.looks = [resolve, resolve]
    step = user.command(STEP, on_failure=[Recovery(SLIP, LOOK)])
    ends = [(change.state, change.transition, change.outcome) for change in step.changes(SOON) if change.is_over]
    assert step.result(SOON) is None
    assert ends == [("done", Outcome.RESOLVED, Outcome.RESOLVED)]
    walk = user.goal(WALK, on_failure=[Recovery(SLIP, LOOK)])
    assert walk.wait(SOON) is Outcome.DONE
    assert them.said == ["step", "step", "swing"]


def test_result_of_a_resolved_task_is_an_error_when_declared(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    them.looks = [resolve]
    weighed = user.command(WEIGH, on_failure=[Recovery(SLIP, LOOK)])
    assert weighed.wait(SOON) is Outcome.RESOLVED
    with pytest.raises(TaskFailed, match="resolved it") as caught:
        weighed.result(SOON)
    assert caught.value.failure == "slip"


def test_failure_beside_a_handler_is_resolved_or_ends_the_task(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    go_on, calls = threading.Event(), threading.Semaphore(0)
    scales = Module("scales", them.legs.central)
    slow: Command[None, float | None] = Command("weigh slowly", result=float | None)
    scales.handles(slow)(lambda _: go_on.wait(SOON) and None)
    with scales.running():
        for look, outcome in ((resolve, Outcome.RESOLVED), (observe, Outcome.FAILED)):
            go_on.clear()

            def looked(task: Task, look: Any = look) -> None:
                look(task)
                calls.release()

            them.looks = [looked]
            weighed = user.command(slow, on_failure=[Recovery(SLIP, LOOK)])
            assert weighed.wait_for_state("running", timeout=SOON) == "running"
            assert weighed.fail(SLIP())
            assert calls.acquire(timeout=SOON)
            go_on.set()
            assert weighed.wait(SOON) is outcome
            if outcome is Outcome.RESOLVED:
                assert weighed.result(SOON) is None  # its handler has returned that


def test_resolved_counts_only_if_the_recovery_ends_well(robot: tuple[Robot, Client]) -> None:
    them, user = robot

    def mend(task: Task) -> None:
        resolve(task)
        task.command(MEND, on_failure=[Recovery(JAM, LOOK)])

    for mends, looks, outcome in (
        (True, [mend], Outcome.RESOLVED),
        (False, [mend, resolve], Outcome.RESOLVED),
        (False, [mend, observe], Outcome.FAILED),
    ):
        them.mends, them.looks = mends, looks
        assert user.command(STEP, on_failure=[Recovery(SLIP, LOOK)]).wait(SOON) is outcome


def test_reissue_and_errors_overrule_resolved(robot: tuple[Robot, Client]) -> None:
    them, user = robot

    def reissue(task: Task) -> None:
        resolve(task)
        raise task.trouble.reissue()

    def fail(task: Task) -> None:
        resolve(task)
        raise ValueError

    for look in (reissue, fail):
        them.looks = [look]
        assert user.command(STEP, on_failure=[Recovery(SLIP, LOOK)]).wait(SOON) is Outcome.FAILED


def test_resolved_says_whether_it_counts(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    kept = []

    def twice(task: Task) -> None:
        kept.append(task.trouble)
        assert (task.trouble.resolved(), task.trouble.resolved()) == (True, True)

    def killed(task: Task) -> None:
        task.trouble.failing.kill()
        assert not task.trouble.resolved()

    def retried(task: Task) -> None:
        task.trouble.failing.retry()
        assert not task.trouble.resolved()

    def late(task: Task) -> None:
        with pytest.raises(Refused, match="has returned"):
            kept[0].resolved()
        task.trouble.resolved()

    for looks, outcome in (
        ([twice], Outcome.RESOLVED),
        ([killed], Outcome.FAILED),
        ([retried, late], Outcome.RESOLVED),
    ):
        them.looks = [*looks]
        assert user.command(STEP, on_failure=[Recovery(SLIP, LOOK)]).wait(SOON) is outcome
        assert not them.looks


def test_later_reply_of_an_exception_handler_resolves(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    later: list[LaterReply[None]] = []

    def answer_later(task: Task) -> LaterReply[None]:
        resolve(task)
        later.append(task.reply_later())
        threading.Timer(0, later[0].reply).start()
        return later[0]

    them.looks = [answer_later]
    assert user.command(STEP, on_failure=[Recovery(SLIP, LOOK)]).wait(SOON) is Outcome.RESOLVED


def test_async_handler_resolves(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    nurse = Module("nurse", them.legs.central)
    treat = ExceptionHandler("treat")

    @nurse.handles(treat)
    async def treated(task: Task) -> None:
        await task.command(MEND)
        task.trouble.resolved()

    with nurse.running():
        assert user.command(STEP, on_failure=[Recovery(SLIP, treat)]).wait(SOON) is Outcome.RESOLVED
