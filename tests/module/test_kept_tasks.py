"""What modules can still learn of tasks that have ended, because somebody keeps them."""

from collections.abc import Iterator

import pytest

from tca_module import Client, Command, ExceptionHandler, Failure, Goal, Module, Outcome, Task, TaskFailed, connect
from tca_module.testing import LocalCentral

SOON = 10.0
CROSS, STEP = Goal("cross the field"), Command("step", int, result=float)
FELL, DECIDE = Failure("fell", str), ExceptionHandler("decide", str)


@pytest.fixture
def legs(central: LocalCentral) -> Iterator[Module]:
    legs = Module("legs", central)

    @legs.handles(STEP)
    def step(_: Task, number: int) -> float:
        if number == 3:
            raise FELL("a hole", "step 3")
        return number / 2

    @legs.handles(CROSS)
    def cross(task: Task) -> None:
        for number in range(1, 5):
            task.command(STEP, number, keep=True)

    with legs.running():
        yield legs


def test_how_a_kept_task_ended_can_be_asked_for_by_anybody(central: LocalCentral, user: Client, legs: Module) -> None:
    step = user.command(STEP, 1, keep=True)
    assert step.result(SOON) == 0.5
    with connect("supervisor", central) as other:
        handle = other.task(step.id)
        assert handle is not None
        info = handle.info()
        assert info is not None
        assert (info.outcome, handle.data(STEP), STEP.decode_reply(info.result)) == ("done", 1, 0.5)
        assert other.tasks(STEP) == []
    step.release()
    assert step.info() is None
    assert user.task(step.id) is None


def test_an_exception_handler_sees_what_had_been_done(central: LocalCentral, user: Client, legs: Module) -> None:
    expert, seen = Module("expert", central), list[tuple[int, str]]()

    @expert.handles(DECIDE)
    def decide(task: Task, why: str) -> None:
        attached = task.trouble.attached
        assert attached is not None
        for handle in attached.kept(STEP):
            info = handle.info()
            assert info is not None
            seen.append((handle.data(STEP), info.outcome))
        raise task.trouble.reissue()

    with expert.running():
        cross = user.goal(CROSS, on_failure=[(FELL, DECIDE)], keep=True)
        assert cross.wait(SOON) is Outcome.FAILED
    assert seen == [(1, "done"), (2, "done")]
    outcomes = {handle.data(STEP): info.outcome for handle in cross.kept() if (info := handle.info())}
    assert outcomes == {1: "done", 2: "done", 3: "failed", 4: "killed"}
    failed = next(handle for handle in cross.kept("step") if handle.data(STEP) == 3)
    assert str(failed.parent()) == str(cross)
    assert [str(handle) for handle in failed.ancestors()] == [str(cross)]
    with pytest.raises(TaskFailed, match="fell"):
        cross.result(0)
