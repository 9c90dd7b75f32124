"""Requests reach the handler and answers reach the client through any break, each exactly once."""

import gc
from collections.abc import Iterator

import pytest
from module.real_central import SOON

from tca_module import (
    Change,
    Client,
    Command,
    Goal,
    Module,
    Outcome,
    Rejected,
    Task,
    TaskKilled,
    connect,
)
from tca_module.testing import LocalCentral

WATCH, WAVE, PLAN = (
    Command("watch", float, result=str, progress=float),
    Command("wave"),
    Goal("plan"),
)

STEPPED = True  # the tests step the clock of central


@pytest.fixture
def camera(central: LocalCentral) -> Iterator[list[str]]:
    """Run a camera. Yield the requests that it has received."""
    camera, requests = Module("camera", central), list[str]()

    @camera.handles(WATCH, takes=["update", "cancel"])
    def watch(task: Task, angle: float) -> str:
        task.report(angle)
        for request in task.requests():
            requests.append(f"{request.transition} {request.goal}")
            if request.transition == "cancel":
                raise task.aborted()
            if request.goal > 90:
                request.reject("too far")
            else:
                task.report(request.goal)
                request.accept()
        raise AssertionError

    @camera.handles(WAVE, resource="hand")
    def wave(task: Task) -> None:
        task.sleep(1)

    with camera.running():
        yield requests


def test_task_requests_and_answers_survive_breaks(
    user: Client, camera: list[str], central: LocalCentral
) -> None:
    watch = user.command(WATCH, 1.0)
    progress = watch.progress(float)
    assert next(progress) == 1.0
    for _ in range(4):
        central.cut("user")
        first = watch.update_send(2.0)
        central.cut("user")
        first.wait(SOON)
        with pytest.raises(Rejected, match="too far"):
            watch.update(91.0, timeout=SOON)
    central.cut("user")
    watch.cancel()
    central.cut("user")
    assert watch.wait(SOON) is Outcome.KILLED
    assert camera == ["update 2.0", "update 91.0"] * 4 + ["cancel None"]


def test_pending_update_is_rejected_when_task_ends_in_break(
    user: Client, camera: list[str], central: LocalCentral
) -> None:
    watch = user.command(WATCH, 1.0)
    assert watch.state == "running"
    with connect("visitor", central) as visitor:
        (found,) = visitor.tasks(WATCH)
        central.cut("user")
        pending = watch.update_send(91.0)
        found.kill("enough")
        central.until_quiet()
        with pytest.raises(Rejected):
            pending.wait(SOON)
        assert pending.is_over
        assert watch.state == "cancelled"


@pytest.mark.soak
def test_unfollowed_task_has_no_observers(
    user: Client, camera: list[str], central: LocalCentral
) -> None:
    watch = user.command(WATCH, 1.0)
    watch.follow()
    called = user.command(WAVE, delay=1, sequential=False)
    seen: list[Change] = []
    called.on_change(seen.append)
    assert central.core.observers.count == 2
    watch.update(2.0)
    number = watch.id
    del watch, called
    gc.collect()
    with connect("visitor", central) as visitor:
        found = visitor.task(number)
        assert found is not None
        found.update(3.0, message=WATCH, timeout=SOON)
        user.tasks()  # the user receives this change, and needs no more
        assert central.core.observers.count == 2, "only the visitor and the function observe"
        central.advance(2)
        user.tasks()
        assert [one.state for one in seen] == ["running", "done"]
        found.kill()
        central.until_quiet()
        assert central.core.observers.count == 0


def test_change_functions_run_after_wait_is_interrupted(
    user: Client, camera: list[str], central: LocalCentral
) -> None:
    brain, seen = Module("brain", central), list[str]()

    @brain.handles(PLAN)
    def plan(task: Task) -> None:
        watch = user_of(task).command(WATCH, 1.0)
        watch.on_change(lambda change: seen.append(change.state))
        try:
            for _ in watch.changes():
                pass
        except TaskKilled:
            seen.append("woken")
            watch.cancel()
            watch.wait()
            raise

    def user_of(task: Task) -> Task:
        return task

    with brain.running():
        planning = user.goal(PLAN)
        central.until_quiet()
        planning.kill()
        assert planning.wait(SOON) is Outcome.KILLED
    assert seen.index("woken") < len(seen) - 1
    assert seen[-1] == "cancelled"


def test_retried_task_is_initiated_again(
    user: Client, camera: list[str], central: LocalCentral
) -> None:
    watch = user.command(WATCH, 1.0)
    changes = watch.changes()
    assert watch.state == "running"
    watch.retry(WATCH, 5.0)
    central.until_quiet()
    watch.cancel()
    seen = [(one.state, one.goal) for one in changes if one.transition != "result available"]
    assert seen[-4:] == [
        ("initiated", 5.0),
        ("running", 5.0),
        ("cancel requested", 5.0),
        ("cancelled", 5.0),
    ]
