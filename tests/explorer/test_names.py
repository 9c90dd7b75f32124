"""What properties name must be there: of what is not everything would hold, and nobody would hear of it."""

from typing import Any

import pytest
from explorer.scenarios import STEP, WALK, walking

from tca_explorer import (
    BadProperty,
    Scenario,
    ScenarioError,
    achieved,
    at_most,
    before,
    begun,
    being_achieved,
    eventually,
    explore,
    fired,
    handled_by,
    never,
    never_stuck,
    planned_ahead,
    within,
)
from tca_module import Goal, PollingMonitor, Query

WAKE, STEPS = Goal("wake"), Goal("steps")
IS_LOW: Query[None, bool] = Query("is low", reply=bool)
GAUGE = PollingMonitor("gauge", condition=IS_LOW)
ANY: Any = ("step", None, 5, STEP)  # wrong types


@pytest.mark.parametrize(
    "scenario",
    [
        walking(never(begun(STEPS))),
        walking(never(begun(STEPS, 1))),
        walking(at_most(3, begun(STEPS))),
        walking(before(begun(WALK), begun(STEPS))),
        walking(within(1.0, begun(STEPS), achieved(WALK))),
        walking(never(handled_by("leg"))),
        walking(before(begun(WALK), handled_by("leg"))),
    ],
)
def test_a_name_that_the_scenario_has_not_is_a_mistake_and_no_property_that_holds(scenario: Scenario) -> None:
    name = "module 'leg'; did you mean 'legs'" if "leg" in repr(scenario.properties[0]).split() else "message 'steps': "
    with pytest.raises(ScenarioError, match=rf"^.*{scenario.properties[0]}.* no {name}"):
        explore(scenario)


def test_so_is_the_name_of_a_task_that_may_be_killed_or_suspended() -> None:
    for call in ("may_kill", "may_suspend"):
        scenario = walking(never_stuck())
        getattr(scenario, call)(WAKE)
        words = rf"can't be judged: {call}\(\): there is no message 'wake': .* did you mean 'walk'\?$"
        with pytest.raises(ScenarioError, match=words):
            explore(scenario)


def test_what_never_comes_because_of_its_name_says_so() -> None:
    result = explore(walking(eventually(begun(STEPS))))
    assert result.violation is not None
    assert result.violation.why.endswith("there is no message 'steps': no module handles it, and no script uses it; "
                                         "did you mean 'step'?")  # fmt: skip


def test_what_central_carries_out_and_keeps_has_a_name_too() -> None:
    scenario = Scenario("polled", at_most(1, fired(GAUGE)), never_stuck())
    scenario.module("battery").handles(IS_LOW)(lambda _: False)
    scenario.module("user").does(lambda me: [me.monitor(GAUGE, period=1.0, for_ever=True)])
    assert explore(scenario).ok


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: begun(ANY[0]), r"^begun\(\) takes a message \(Goal, Command, ...\), and 'step' is none"),
        (lambda: planned_ahead(ANY[1]), r"^planned_ahead\(\) takes a message"),
        (lambda: being_achieved(ANY[2], 1), r"^being_achieved\(\) takes a message"),
        (lambda: handled_by(ANY[3]), "is no name of a module"),
    ],
)
def test_what_is_no_message_is_found_where_it_is_written(wrong: Any, words: str) -> None:
    with pytest.raises(BadProperty, match=words):
        wrong()
