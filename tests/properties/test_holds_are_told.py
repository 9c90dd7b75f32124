"""Why a task waits: whatever central names as its hold, the tools, which know the journal alone, name too."""

import re
from operator import itemgetter

from hypothesis import given, settings
from hypothesis import strategies as st
from properties.folded import FoldedPlayer
from properties.life import Life, operation

from tca_central.core import Central
from tca_central.status.load import _held, load
from tca_tools.run.at_time import RunAt
from tca_tools.run.fold import History
from tca_tools.run.records import State
from tca_tools.why.waiting import Until, reasons_of, why_waiting
from tca_wire.points import Moment, TaskId
from tca_wire.text.facts_in_words import place

_NUMBER = re.compile(r"\{(\d+)\}")
_RESOURCE = re.compile(r"resource '(.*)' of '(.*)'")


class ToldPlayer(FoldedPlayer):
    """After every event central and the fold are asked why each task waits."""

    def compare(self) -> None:
        assert_same_reasons(self.central, self.history)


def assert_same_reasons(central: Central, history: History) -> None:
    at, told = RunAt(history), load(central)
    for task_id, task in central.tree.tasks.items():
        if not task.is_running:
            assert why_waiting(at, TaskId(task_id)), f"no reason why {task} does not go on ({at.tasks[task_id].state})"
    for row, (_, _, task, held_at) in zip(told["held"], sorted(_held(central), key=itemgetter(0, 1)), strict=False):
        state = at.tasks[task.id].state
        may_begin = (
            held_at == Moment.START_ACHIEVING
            and state in (State.HELD, State.PLANNING, State.RECOVERING)
            and not task.delayed
        )
        if state is not State.SUSPENDED and not (task.is_goal and may_begin):
            assert_named(at, task.id, row["for"])
    for row in told["waits"]:
        who = numbers(row["what"])
        if who and who[0] in at.tasks:
            assert_named(at, who[0], row["for"])
    for row in told["suspended"]:
        if not at.tasks[row["task"]].handling:
            assert_named(at, row["task"], "is resumed")


def assert_named(at: RunAt, task: int, what: str) -> None:
    """What central says that a task waits for is named by the tools, or is one of the others that they count."""
    found_reasons = reasons_of(at, TaskId(task))
    counted = [f"{{{one}}}" for reason in found_reasons if isinstance(reason, Until) for one in reason.tasks]
    reasons = " and ".join([*map(str, found_reasons), *counted])
    if found := _RESOURCE.search(what):
        name, module = found.groups()
        what = place(module, name)
    for wanted in [f"{{{number}}}" for number in numbers(what)] or [_SAID.get(what, what)]:
        assert wanted in reasons, f"{at.tasks[task]} ({at.tasks[task].state}) waits for {what}, and is told: {reasons}"


_SAID = {"the end of a delay": " s", "a module that handles it": "for a module that handles"}


def numbers(text: str) -> list[int]:
    return [int(number) for number in _NUMBER.findall(text)]


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
