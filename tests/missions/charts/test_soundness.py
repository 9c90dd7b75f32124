"""An unsound machine is refused when it is built. The error speaks of what the author wrote."""

from collections.abc import Callable

import pytest

from tca_behaviours.missions.charts import (
    Concurrence,
    FromData,
    Sequence,
    StateMachine,
    UnsoundMachine,
    UserData,
    state,
)
from tca_module import MisuseError


@state(outcomes=["found", "lost"])
def _search(_: UserData) -> str:
    raise AssertionError


def _unknown_target(sm: StateMachine) -> None:
    sm.GoTo().on(completed="hom")
    sm.Wait("home")


def _unreachable(sm: StateMachine) -> None:
    first = sm.GoTo()
    sm.Wait().on(completed=first)
    sm.Turn("lost")


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


def _undeclared_outcome(sm: StateMachine) -> None:
    with sm.machine("inner", outcomes=["gone"]):
        sm.call(_search, "search").on(found="completed")


def _outcome_that_nothing_leads_to(sm: StateMachine) -> None:
    with sm.machine("inner", outcomes=["gone"]):
        sm.call(_search, "search").on(found="again", lost="again")
        sm.call(_search, "again").on(found="search", lost="search")


def _target_like_an_outcome(sm: StateMachine) -> None:
    with sm.machine("inner", outcomes=["lost"]).on(lost="completed"):
        sm.GoTo().on(failed="losst")


def _label_is_an_outcome(sm: StateMachine) -> None:
    with sm.machine("inner", outcomes=["lost"]).on(lost="completed"):
        sm.GoTo("lost")


def _misspelt_ending(sm: StateMachine) -> None:
    sm.GoTo().on(compleated="home")
    sm.GoTo("home")


def _map_of_another_state(sm: StateMachine) -> None:
    with sm.concurrence("both", outcome_map={"found": {"Lok": "completed"}}):
        sm.Look()
        sm.Listen(foreground=False)


def _map_of_another_ending(sm: StateMachine) -> None:
    with sm.concurrence("both", outcome_map={"found": {"search": "seen"}}):
        sm.Look()
        sm.call(_search, "search").on(found="completed", lost="completed")


def _after_in_a_python_state(sm: StateMachine) -> None:
    sm.call(_search, "search").on(found="completed", lost="completed").after(1.0, "failed")


def _after_into_container(sm: StateMachine) -> None:
    sm.GoTo().after(1.0, "inside")
    with sm.sequence("inner"):
        sm.Wait()
        sm.Wait("inside")


def _after_to_nowhere(sm: StateMachine) -> None:
    sm.GoTo().after(1.0, "hom")


def _same_label(sm: StateMachine) -> None:
    sm.GoTo("home")
    sm.Wait("home")


def test_unsound_machine_is_rejected_when_built(approve: Callable[..., None]) -> None:
    def message_of(write: str) -> str:
        with pytest.raises(UnsoundMachine) as refused, Sequence("robot") as sm:
            eval(write)(sm)
        return str(refused.value)

    approve("unsound_machines.txt", message_of)


def test_machine_misuse_is_rejected_when_written() -> None:
    with Sequence("robot") as sm:
        goto = sm.GoTo().on(failed="GoTo")
        with pytest.raises(MisuseError, match="is given twice"):
            goto.on(failed="GoTo")
        with pytest.raises(MisuseError, match="leads to a state or its label, not 3"):
            goto.on(completed=3)  # type: ignore[arg-type]
        with pytest.raises(MisuseError, match="parameters by name"):
            sm.GoTo(1.0)
        with pytest.raises(MisuseError, match=r"until must be .* not 'some'"):
            sm.concurrence(until="some")  # type: ignore[arg-type]
        with sm.sequence() as inner:
            sm.GoTo()
        with pytest.raises(MisuseError, match="can't be opened here"), inner:
            pass
        with pytest.raises(MisuseError, match="is not built"):
            assert sm.chart
    for late in (sm.GoTo, sm.epsilon, lambda: goto.on(timeout=goto), sm.__enter__):
        with pytest.raises(MisuseError):
            late()
    with pytest.raises(MisuseError, match="write its states inside its with block"):
        Sequence("robot").GoTo()
    with pytest.raises(
        MisuseError, match="a machine: name must be a text that is not blank, not ''"
    ):
        StateMachine("")
    with pytest.raises(MisuseError, match="until must be"):
        Concurrence("robot", until="first")  # type: ignore[arg-type]


def test_error_in_a_machine_block_is_not_masked() -> None:
    with pytest.raises(ZeroDivisionError), Sequence("robot"):
        raise ZeroDivisionError


def test_misuse_of_a_machine_has_an_error_of_its_own(approve: Callable[..., None]) -> None:
    def message_of(code: str) -> str:
        names = {"state": state, "FromData": FromData, "Sequence": Sequence}
        with Sequence("robot") as sm:
            with pytest.raises(MisuseError) as refused:
                eval(code, {**names, "sm": sm})
            sm.GoTo("failed")
        return str(refused.value)

    approve("misuses.txt", message_of)
