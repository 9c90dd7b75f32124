"""A machine that can't be run is refused when it is built, in words of the one who wrote it."""

import re
from collections.abc import Callable

import pytest

from tca_missions.charts import Concurrence, Sequence, StateMachine, UnsoundMachine
from tca_module import MisuseError


def _unknown_target(sm: StateMachine) -> None:
    sm.GoTo().on(completed="hom")
    sm.Wait("home")


def _unreachable(sm: StateMachine) -> None:
    first = sm.GoTo()
    sm.Wait().on(completed=first)
    sm.Turn("lost")


def _empty(sm: StateMachine) -> None:
    sm.GoTo()
    with sm.sequence("nothing"):
        pass


def _without_with(sm: StateMachine) -> None:
    sm.GoTo()
    sm.sequence("forgotten")


def _one_branch(sm: StateMachine) -> None:
    with sm.concurrence():
        sm.GoTo()


def _two_in_front(sm: StateMachine) -> None:
    with sm.concurrence("both"):
        sm.GoTo()
        sm.Look(foreground=False)
        with sm.sequence():
            sm.Wait(foreground=False)
            sm.Turn()


def _idle_for_ever(sm: StateMachine) -> None:
    sm.GoTo()
    here = sm.epsilon("here")
    with sm.machine("inner"):
        sm.epsilon("there").on(completed=here)


def _idle_branch(sm: StateMachine) -> None:
    with sm.concurrence("both"):
        sm.GoTo()
        with sm.sequence("quick"):
            sm.epsilon()


def _into_container(sm: StateMachine) -> None:
    sm.GoTo().on(failed="inside")
    with sm.sequence("inner"):
        sm.Wait()
        sm.Wait("inside")


def _across_branches(sm: StateMachine) -> None:
    with sm.concurrence("both"):
        sm.Look(foreground=False).on(completed="other")
        sm.GoTo("other")


def _impossible_ending(sm: StateMachine) -> None:
    sm.GoTo()
    with sm.sequence("for ever") as loop:
        first = sm.Wait()
        sm.Wait().on(completed=first)
    loop.on(completed="end")
    sm.GoTo("end")


def _never_all(sm: StateMachine) -> None:
    with sm.concurrence(until="all"):
        sm.Look(foreground=False)
        with sm.sequence():
            sm.Turn().on(completed="Turn")
    sm.GoTo()


def _epsilon_fails(sm: StateMachine) -> None:
    sm.epsilon("here").on(failed="home")
    sm.GoTo("home")


def _same_label(sm: StateMachine) -> None:
    sm.GoTo("home")
    sm.Wait("home")


@pytest.mark.parametrize(
    ("write", "error"),
    [
        (_unknown_target, "'GoTo': on(completed='hom') names no state; there are 'GoTo', 'home'"),
        (_unreachable, "'lost' in sequence 'robot' can't be reached"),
        (_empty, "sequence 'nothing' is empty: give it a task"),
        (_without_with, "sequence 'forgotten' is empty: give it a task"),
        (lambda _: None, "sequence 'robot' is empty: give it a task"),
        (_one_branch, "concurrence 'concurrence' has one state only"),
        (_two_in_front, "concurrence 'both': 'GoTo' and sequence 'sequence' would run in the foreground at once"),
        (_idle_for_ever, "lead to each other for ever without any task"),
        (_idle_branch, "sequence 'quick' may end before any task in it has run"),
        (_into_container, "'GoTo': on(failed=...): 'inside' is inside sequence 'inner'"),
        (_across_branches, "'Look': on(completed=...): 'other' runs beside it in concurrence 'both', and can't follow"),
        (_impossible_ending, "sequence 'for ever' can't end as completed: it ends as failed or timeout or interrupted"),
        (_never_all, "'GoTo' in sequence 'robot' can't be reached"),
        (_epsilon_fails, "epsilon 'here' can't end as failed: it ends as completed"),
        (_same_label, "sequence 'robot' has two states 'home'"),
    ],
)
def test_refused_when_built(write: Callable[[StateMachine], None], error: str) -> None:
    with pytest.raises(UnsoundMachine, match=re.escape(error)), Sequence("robot") as sm:
        write(sm)


def test_refused_where_it_is_written() -> None:
    with Sequence("robot") as sm:
        goto = sm.GoTo().on(failed="GoTo")
        with pytest.raises(MisuseError, match="is said twice"):
            goto.on(failed="GoTo")
        with pytest.raises(MisuseError, match="takes a state or its label, not 3"):
            goto.on(completed=3)  # type: ignore[arg-type]
        with pytest.raises(MisuseError, match="parameters are given by name"):
            sm.GoTo(1.0)
        with pytest.raises(MisuseError, match="until is 'any' or 'all', not 'some'"):
            sm.concurrence(until="some")  # type: ignore[arg-type]
        with sm.sequence() as inner:
            sm.GoTo()
        with pytest.raises(MisuseError, match="is written in one with block"), inner:
            pass
        with pytest.raises(MisuseError, match="is not built"):
            assert sm.chart
    for late in (sm.GoTo, sm.epsilon, lambda: goto.on(timeout=goto), sm.__enter__):
        with pytest.raises(MisuseError):
            late()
    with pytest.raises(MisuseError, match="its states are written inside its with block"):
        Sequence("robot").GoTo()
    with pytest.raises(MisuseError, match="a machine needs a name, not ''"):
        StateMachine("")
    with pytest.raises(MisuseError, match="until is"):
        Concurrence("robot", until="first")  # type: ignore[arg-type]


def test_an_error_inside_is_not_hidden_by_another() -> None:
    with pytest.raises(ZeroDivisionError), Sequence("robot"):
        raise ZeroDivisionError
