"""A handler steers its own task with a sender's calls. In a wrong thread, the error advises."""

import threading
from collections.abc import Callable

import pytest
from module.real_central import SOON

from tca_module import (
    Client,
    Command,
    ExceptionHandler,
    Failure,
    Goal,
    MisuseError,
    Module,
    Outcome,
    Query,
    SentTask,
    Task,
    TaskFailed,
    TaskKilled,
    TaskRef,
    connect,
)
from tca_module.testing import LocalCentral

WALK, STEP, STOP = Goal("walk"), Command("step"), Command("stop")
WHERE = Query("where", reply=float)
SLIPPED, SHRUG = Failure("slipped", float), ExceptionHandler("shrug")


def public(kind: type) -> set[str]:
    return {name for name in dir(kind) if not name.startswith("_")}


def test_own_task_has_every_call_but_waits_and_client_calls() -> None:
    of_clients = {
        "wait_for_state",
        "follow",
        "serial",
        "changes",
        "next_change",
        "progress",
        "on_change",
        "update",
        "update_send",
        "cancel",
    }
    assert public(TaskRef) - public(Task) == {"wait", "wait_for"} | of_clients


def test_handler_kills_its_own_task(user: Client, legs: Module) -> None:
    done: list[str] = []

    @legs.handles(STOP)
    def stop(_: Task) -> None:
        done.append("stopped")

    @legs.handles(WALK)
    def walk(task: Task) -> None:
        task.keep()
        task.on_termination(STOP)
        assert task.suspend()
        assert task.resume()
        assert task.info() == task.ref.info()
        assert [task.id] == [one.id for one in task.command(STEP).ancestors()]
        assert [one.message for one in task.children()] == ["step"]
        assert task.kill("tired")

    with legs.running():
        sent = user.goal(WALK)
        with pytest.raises(TaskKilled, match="tired"):
            sent.result(SOON)
        assert sent.wait(SOON) is Outcome.KILLED
    assert done == ["stopped"]


def test_handler_fails_and_retries_its_own_task(user: Client, legs: Module) -> None:
    attempts: list[float] = []

    @legs.handles(WALK)
    def walk(task: Task) -> None:
        attempts.append(task.id)
        if len(attempts) < 2:
            assert task.retry()
        elif len(attempts) < 3:
            assert task.deadline(3600)
            task.fail(SLIPPED(1.0))

    with legs.running(), pytest.raises(TaskFailed, match="slipped"):
        user.goal(WALK).result(SOON)
    assert len(attempts) == 2


def test_steering_query_as_task_is_misuse(user: Client, legs: Module) -> None:
    refused: list[str] = []

    @legs.handles(WHERE)
    def where(task: Task) -> float:
        for steer in (task.kill, task.suspend, task.keep, task.info, task.children):
            with pytest.raises(MisuseError, match="'where' is no task of the tree"):
                steer()
            refused.append(steer.__name__)
        return 1.0

    with legs.running():
        assert user.query(WHERE) == 1.0
    assert refused == ["kill", "suspend", "keep", "info", "children"]


def refusal(call: Callable[[], object]) -> str:
    """Return the error of a call in a thread of its own."""
    texts: list[str] = []

    def elsewhere() -> None:
        with pytest.raises(MisuseError) as error:
            call()
        texts.append(str(error.value))

    thread = threading.Thread(target=elsewhere, name="driver")
    thread.start()
    thread.join(SOON)
    return texts[0]


def test_use_in_wrong_thread_names_object_and_advice(user: Client, legs: Module) -> None:
    refusals: list[str] = []

    @legs.handles(WALK)
    def walk(task: Task) -> None:
        refusals.append(refusal(task.kill))

    with legs.running():
        sent = user.goal(WALK)
        sent.result(SOON)
        refusals += [
            refusal(sent.kill),
            refusal(lambda: user.goal(WALK)),
            refusal(lambda: legs.goal(WALK)),
        ]
        pending = user.query_send(WHERE)
        refusals.append(refusal(pending.receive))
    assert refusals == [
        "walk {1} is used in thread 'driver', but belongs to thread 'legs 1', which handles it: other threads connect() \
themselves, and find it with task(number)",
        "walk {1} is used in thread 'driver', but belongs to thread 'MainThread', which sent or found it: other threads \
connect() themselves, and find it with task(number); the last of its changes() there has the result as data",
        "client 'user' is used in thread 'driver', but belongs to thread 'MainThread', which opened it: share it with \
connect(..., threads=True), or connect() in each thread",
        "module 'legs' is used in thread 'driver', but belongs to thread 'MainThread', which runs it: a handler sends with its \
task, other threads with a client of their own: connect(), or one that they share: connect(..., threads=True)",
        "a connection of module 'user' is used in thread 'driver', but belongs to thread 'MainThread', which opened it: a \
handler sends with its task, other threads with a client of their own: connect(), or one that they share: connect(..., threads=True)",
    ]


def test_other_thread_kills_task_with_own_client(
    central: LocalCentral, user: Client, legs: Module
) -> None:
    legs.handles(WALK)(lambda _: None)
    outcomes: list[bool] = []

    def elsewhere(sent: SentTask[None]) -> None:
        with connect("driver", central) as driver:
            found = driver.task(sent.id)
            assert found is not None
            outcomes.append(found.kill("by the driver"))

    with legs.running():
        sent = user.goal(WALK, delay=3600)
        thread = threading.Thread(target=elsewhere, args=(sent,))
        thread.start()
        thread.join(SOON)
        assert outcomes == [True]
        assert sent.wait(SOON) is Outcome.KILLED
