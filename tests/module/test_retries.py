"""Retry policies, names for failures of central, mutexes, and options of what may have no handler."""

import threading
from typing import Any

import pytest

from tca_module import (
    HANDLER_ERROR,
    MODULE_LOST,
    TIMEOUT,
    BadFormat,
    Client,
    Command,
    ExceptionHandler,
    Failure,
    FormatRefused,
    Goal,
    MisuseError,
    Module,
    Outcome,
    Query,
    Recovery,
    Retry,
    Task,
    TaskFailed,
    TaskKilled,
)
from tca_module.testing import LocalCentral
from tca_wire.messages import built_in, failures

SOON = 10.0
SLIPPED = Failure("slipped")
LIFT = Command("lift", float, result=int, retry=Retry(3, pause=0, failures=[SLIPPED]))
CALL_HELP = Command("call help", float)
SAY = Command("say", str)
FETCH = Goal("fetch", float, retry=Retry(2, pause=0))
RECOVER = ExceptionHandler("recover")


@pytest.fixture
def lifted(legs: Module) -> list[float]:
    """Return the heights of all attempts. A height below 0 slips; from 0 on it is reached."""
    lifted: list[float] = []

    @legs.handles(LIFT)
    def lift(_: Task, height: float) -> int:
        lifted.append(height)
        if height < 0 or len(lifted) < height:
            raise SLIPPED()  # noqa: RSE102 - a declaration
        return len(lifted)

    return lifted


def test_declared_policy_retries_tasks(legs: Module, user: Client, lifted: list[float]) -> None:
    with legs.running():
        assert user.command(LIFT, 3.0).result(SOON) == 3


def test_declared_policy_retries_tasks_sent_by_name(
    legs: Module, user: Client, lifted: list[float]
) -> None:
    with legs.running():
        assert user.command(user.declared("lift"), 3.0).result(SOON) == 3


def test_declared_policies_must_agree(legs: Module, user: Client, lifted: list[float]) -> None:
    with legs.running(), pytest.raises(FormatRefused, match="retry policy"):
        user.command(Command("lift", float, result=int), 3.0)


def test_declared_fallback_replaces_a_task(legs: Module, user: Client) -> None:
    called: list[float] = []
    reach = Command("reach", float, retry=Retry(1, otherwise=CALL_HELP))
    legs.handles(CALL_HELP)(lambda _, height: called.append(height))

    @legs.handles(reach)
    def slip(_: Task, __: float) -> None:
        raise SLIPPED()  # noqa: RSE102 - a declaration

    with legs.running():
        assert user.command(user.declared("reach"), 7.0).wait(SOON) is Outcome.RESOLVED
    assert called == [7.0]


def test_senders_policy_replaces_declared_one(
    legs: Module, user: Client, lifted: list[float]
) -> None:
    with legs.running():
        assert user.command(LIFT, -1.0, retry=None).wait(SOON) is Outcome.FAILED
        assert user.command(LIFT, -1.0, retry=Retry(2, pause=0)).wait(SOON) is Outcome.FAILED
    assert len(lifted) == 1 + 2


@pytest.mark.parametrize("otherwise", [CALL_HELP, (SAY, "help"), (CALL_HELP, 7.0)])
def test_fallback_gets_its_data_or_those_of_the_task(
    legs: Module, user: Client, lifted: list[float], otherwise: object
) -> None:
    called: list[object] = []
    legs.handles(CALL_HELP)(lambda task, height: called.append((height, task.trouble.failure)))
    legs.handles(SAY)(lambda task, text: called.append((text, task.trouble.failure)))
    retry = Retry(2, pause=0, otherwise=otherwise)  # type: ignore[arg-type]  # one of three
    with legs.running():
        assert user.command(LIFT, -1.0, retry=retry).wait(SOON) is Outcome.RESOLVED
    data = otherwise[1] if isinstance(otherwise, tuple) else -1.0
    assert called == [(data, "slipped")]


@pytest.mark.parametrize(("result", "expected"), [(7, 7), (None, "call help"), ("7", "call help")])
def test_task_has_result_of_its_fallback_if_types_agree(
    legs: Module, user: Client, lifted: list[float], result: object, expected: object
) -> None:
    call_help: Command[float, Any] = Command("call help", float, result=type(result))
    legs.handles(call_help)(lambda *_: result)
    with legs.running():
        lifting = user.command(LIFT, -1.0, retry=Retry(1, otherwise=call_help))
        if isinstance(expected, int):
            assert lifting.result(SOON) == expected
        else:
            with pytest.raises(TaskFailed, match=str(expected)):
                lifting.result(SOON)
        assert lifting.wait(SOON) is Outcome.RESOLVED


def test_policy_of_goal_retries_what_its_handler_sends(
    legs: Module, user: Client, lifted: list[float]
) -> None:
    legs.resource("arm")

    @legs.handles(FETCH, resource="arm")
    def fetch(task: Task, height: float) -> None:
        task.command(LIFT, height, retry=None).result(SOON)

    with legs.running():
        assert user.goal(FETCH, 2.0).wait(SOON) is Outcome.DONE
    assert lifted == [2.0, 2.0]


def test_attempt_that_takes_too_long_is_retried(legs: Module, user: Client) -> None:
    attempts: list[bool] = []

    @legs.handles(CALL_HELP)
    def call_help(task: Task, _: float) -> None:
        attempts.append(task.cancelled)
        if len(attempts) == 1:
            with pytest.raises(TaskKilled):
                task.sleep(SOON)

    with legs.running():
        retry = Retry(2, pause=0, attempt_timeout=0.3, failures=[TIMEOUT])
        assert user.command(CALL_HELP, 1.0, retry=retry).wait(SOON) is Outcome.DONE
    assert attempts == [False, False]


def test_policy_outlives_its_sender(
    central: LocalCentral, legs: Module, lifted: list[float]
) -> None:
    helped = threading.Event()
    legs.handles(CALL_HELP)(lambda _, __: helped.set())
    with legs.running():
        with Module("sender", central).running() as sender:
            sender.command(LIFT, -1.0, retry=Retry(2, pause=0.05, otherwise=CALL_HELP)).id  # noqa: B018
        assert helped.wait(SOON)
    assert len(lifted) == 2


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Retry(0),
        lambda: Retry(True),
        lambda: Retry(pause=-1),
        lambda: Retry(backoff=0.5),
        lambda: Retry(attempt_timeout=0),
        lambda: Retry(failures=SLIPPED),  # type: ignore[arg-type]
        lambda: Retry(failures=["slipped"]),  # type: ignore[list-item]
        lambda: Retry(otherwise=Query("height", reply=float)),  # type: ignore[arg-type]
        lambda: Retry(otherwise=(CALL_HELP,)),  # type: ignore[arg-type]
        lambda: Retry(otherwise=()),  # type: ignore[arg-type]
        lambda: Retry(otherwise=(None, 2.0)),  # type: ignore[arg-type]
        lambda: Command("a", str, retry=3),  # type: ignore[call-overload]
        lambda: Command("a", str, retry=Retry(otherwise=CALL_HELP)),
    ],
)
def test_wrong_policy_is_refused_where_it_is_declared(wrong: object) -> None:
    with pytest.raises(BadFormat):
        wrong()  # type: ignore[operator]


# --- names for failures of central ----------------------------------------------------------------


def test_built_in_failures_have_declarations() -> None:
    declared = [one for one in vars(built_in).values() if isinstance(one, Failure)]
    assert {one.name for one in declared} == failures.BUILT_IN


def test_built_in_failure_has_exception_handlers(legs: Module, user: Client) -> None:
    @legs.handles(RECOVER)
    def recover(task: Task) -> None:
        assert task.trouble is not None
        recovered.append(task.trouble.failure)
        task.trouble.resolved()

    @legs.handles(SAY)
    def say(_: Task, text: str) -> None:
        raise ValueError(text)

    recovered: list[str] = []
    user.on_failure(MODULE_LOST, RECOVER)
    with legs.running():
        options = [Recovery(HANDLER_ERROR, RECOVER)]
        assert user.command(SAY, "hi", on_failure=options).wait(SOON) is Outcome.RESOLVED
    assert recovered == [HANDLER_ERROR.name]


# --- what may have no handler ---------------------------------------------------------------------


def test_task_that_is_sent_if_handled_has_options(
    central: LocalCentral, legs: Module, user: Client, lifted: list[float]
) -> None:
    assert user.execute_if_handled(LIFT, 1.0, deadline=SOON) is None
    with legs.running():
        lifting = user.execute_if_handled(LIFT, 2.0, deadline=SOON, priority=3)
        assert lifting is not None
        assert lifting.result(SOON) == 2
    with pytest.raises(MisuseError, match="sequentially"):
        user.execute_if_handled(LIFT, 1.0, sequentially=True)  # type: ignore[call-overload]


def test_option_of_a_question_that_is_sent_if_handled_is_refused(user: Client) -> None:
    with pytest.raises(MisuseError, match="deadline"):
        user.execute_if_handled(Query("height", reply=float), deadline=1)  # type: ignore[call-overload]


def test_resource_without_handlers_is_a_mutex(
    central: LocalCentral, legs: Module, eyes: Module
) -> None:
    legs.resource("pen")
    with legs.running(), eyes.running(), Module("user", central).running() as user:
        with eyes.lock("pen"), pytest.raises(TimeoutError):
            user.lock("pen", timeout=0.01)
        with user.lock("pen", timeout=SOON) as claim:
            assert claim.held
