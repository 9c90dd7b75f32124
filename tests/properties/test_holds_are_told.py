"""Why a task waits: whatever central names as its hold, the tools, which know the journal alone, name too."""

import re

from hypothesis import given, settings
from hypothesis import strategies as st
from properties.folded import FoldedPlayer
from properties.life import Life, operation

from tca_central.core import Central
from tca_central.status.load import load
from tca_tools.run.at_time import RunAt
from tca_tools.run.fold import History
from tca_tools.run.records import State
from tca_tools.why.waiting import Until, reasons_of, why_waiting
from tca_wire.points import TaskId
from tca_wire.waits import Waiter, WaitKind

_NUMBER = re.compile(r"\{(\d+)\}")


class ToldPlayer(FoldedPlayer):
    """After every event central and the fold are asked why each task waits."""

    def compare(self) -> None:
        assert_same_reasons(self.central, self.history)


def assert_same_reasons(central: Central, history: History) -> None:
    at, told = RunAt(history), load(central)
    for task_id, task in central.tree.tasks.items():
        if not task.is_running:
            assert why_waiting(at, TaskId(task_id)), f"no reason why {task} does not go on ({at.tasks[task_id].state})"
    for waiter in told["held"]:
        if at.tasks[waiter.number].state not in (State.SUSPENDED, State.RECOVERING):
            assert_named(at, waiter)
    for waiter in told["waits"]:
        if waiter.number in at.tasks:
            assert_named(at, waiter)


def assert_named(at: RunAt, waiter: Waiter) -> None:
    """What central says that a task waits for is named by the tools, or is one of the others that they count."""
    found = reasons_of(at, TaskId(waiter.number))
    named = {int(number) for reason in found for number in _NUMBER.findall(str(reason))}
    named |= {one for reason in found if isinstance(reason, Until) for one in reason.tasks}
    waited_for = {wait.number for wait in waiter.waits if wait.kind is not WaitKind.LOCK} - {0, waiter.number}
    assert waited_for <= named, f"{waiter} ({at.tasks[waiter.number].state}) is told: {list(map(str, found))}"


@given(st.lists(operation, max_size=50))
@settings(max_examples=300)
def test_what_holds_a_task_is_told_as_central_tells_it(operations: list[tuple[str, int, int, int, int]]) -> None:
    life = Life(ToldPlayer())
    for name, *given_numbers in operations:
        life.do(name, *given_numbers)


@given(st.integers(0, 1 << 32))
@settings(max_examples=2)
def test_the_same_in_a_long_life(seed: int) -> None:
    Life(ToldPlayer()).go_on(seed, 1_000)
