"""The wait for the first of several tasks to end."""

import threading
from collections.abc import Iterator

import pytest

from tca_module import (
    CentralLost,
    Client,
    Command,
    MisuseError,
    Module,
    Task,
    connect,
    wait_for_any,
)
from tca_module.testing import LocalCentral

QUICK, SLOW, FAILS = Command("quick"), Command("slow"), Command("fails")


@pytest.fixture
def release() -> threading.Event:
    """Return the event that ends the slow tasks."""
    return threading.Event()


@pytest.fixture(autouse=True)
def _robot(central: LocalCentral, release: threading.Event) -> Iterator[None]:
    module = Module("robot", central, capacity=3)
    module.handles(QUICK)(lambda _: None)

    @module.handles(SLOW)
    def slow(_: Task) -> None:
        release.wait(10)

    @module.handles(FAILS)
    def fails(_: Task) -> None:
        raise ValueError("a slip")

    with module.running():
        yield
        release.set()


def test_wait_for_any_returns_first_ended_task(user: Client, release: threading.Event) -> None:
    slow, quick = user.command(SLOW, sequential=False), user.command(QUICK, sequential=False)
    assert wait_for_any([slow, quick]) == [quick]
    assert wait_for_any([slow, quick]) == [quick]  # a task that has ended is returned again
    release.set()
    assert wait_for_any([slow]) == [slow]
    assert slow.result(0) is None


def test_wait_for_any_counts_failed_task_as_ended(user: Client) -> None:
    fails = user.command(FAILS)
    assert wait_for_any([fails]) == [fails]
    with pytest.raises(Exception, match="a slip"):
        fails.result(0)


def test_wait_for_any_ends_at_timeout_or_condition(user: Client) -> None:
    slow = user.command(SLOW)
    assert wait_for_any([slow], 0.01) == []
    answers = iter([False, False, True])
    assert wait_for_any([slow], until=lambda: next(answers)) == []
    assert next(answers, "all asked") == "all asked"


def test_wait_for_any_raises_when_central_is_silent(central: LocalCentral) -> None:
    user = connect("hasty", central, 0.3, linger=0.1)
    slow = user.command(SLOW)
    assert slow.id
    central.submit = lambda *_: False  # type: ignore[method-assign]
    with pytest.raises(
        CentralLost, match=r"does not answer: .* the wait for slow \{1\} is given up"
    ):
        wait_for_any([slow], until=lambda: False)


def test_wait_for_any_of_no_or_foreign_tasks_is_misuse(user: Client, central: LocalCentral) -> None:
    with pytest.raises(MisuseError, match="needs a list of tasks"):
        wait_for_any([])
    with (
        connect("other", central) as other,
        pytest.raises(MisuseError, match="those of one client"),
    ):
        wait_for_any([user.command(QUICK), other.command(QUICK)])
