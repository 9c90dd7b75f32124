"""What people read: a line, or the shortest counterexample."""

import re

import pytest
from explorer.scenarios import REST, STEP, WALK, WHERE, walking

from tca_central.core import Central
from tca_explorer import (
    Result,
    Scenario,
    Script,
    Task,
    achieved,
    always,
    before,
    begun,
    explore,
    never,
    never_stuck,
    report,
)

SHORTEST = """\
walking: NOT rest achieved before walk achieved
  1. user sends goal walk
       received: goal walk {1} from user
       delivered: walk {1} to planner
       reached: walk {1}: start handling, start planning
       reached: walk {1}: start achieving
  2. planner in walk {1} sends command step 0
       received: command step {2} from planner under walk {1}
       reached: step {2}: start planning, end planning
       delivered: step {2} to legs
       reached: step {2}: start handling, start achieving
  3. planner in walk {1} returns
       returned: walk {1}: done
       reached: walk {1}: end handling, end planning
  4. legs in step {2} returns
       returned: step {2}: done
       reached: step {2}: end handling, end achieving
       reached: walk {1}: end achieving
  => the second came first: walk {1}
"""


def test_the_shortest_counterexample_is_shown() -> None:
    shown = report(explore(walking(before(achieved(REST), achieved(WALK)), steps=1)))
    assert re.sub(r" \(after \d+ states\)", "", shown) + "\n" == SHORTEST


def test_no_run_with_fewer_actions_shows_it() -> None:
    """The same scenario without the property: nothing in reach of three actions is the end of a walk."""
    result = explore(walking(never(achieved(WALK)), steps=1))
    assert result.violation is not None
    assert len(result.violation.actions) == 4


def test_a_good_result_is_a_line() -> None:
    assert re.fullmatch(r"walking: good, \d+ states, at most 9 actions a run", report(explore(walking(never_stuck()))))


def test_a_limit_is_no_answer() -> None:
    result = explore(walking(never_stuck()), limit=20)
    assert not result.ok
    first, second = report(result).splitlines()
    assert first == "walking: not known, nothing wrong in the first 21 states: make it smaller, or raise the limit"
    assert second.startswith("  open beside other things: steps of user (")


def stuck() -> Result:
    """A handler waits for a task that only it could handle."""
    scenario = Scenario("a short circuit", never_stuck())

    @scenario.module("planner").handles(WALK)
    def walk(task: Task, times: int) -> None:
        if times:
            task.goal(WALK, times - 1).wait()

    @scenario.module("user").does
    def story(me: Script) -> None:
        me.goal(WALK, 1).wait()

    return explore(scenario)


def test_what_is_stuck_is_named() -> None:
    *_, why, second, who, what, whom = report(stuck()).splitlines()[-6:]
    assert why == "  => nothing further need happen, and this is left:"
    assert (
        second.strip() == "walk {1} has not ended: start handling, start planning, start achieving; handled by planner"
    )
    assert who.strip() == "walk {2} has not ended: nothing reached; queued"
    assert what.strip() == "planner in walk {1} waits for end achieving of walk {2}"
    assert whom.strip() == "user waits for end achieving of walk {1}"


def test_a_fault_of_central_is_a_counterexample(monkeypatch: pytest.MonkeyPatch) -> None:
    def settle(self: Central, real: object = Central._settle) -> None:
        real(self)  # type: ignore[operator]
        assert len(self.tree.tasks) < 3, "too many tasks"

    monkeypatch.setattr(Central, "_settle", settle)
    result = explore(walking())
    assert result.violation is not None
    assert result.violation.broken == "central handles everything"
    assert "too many tasks" in report(result)


def test_properties_say_what_is_wrong() -> None:
    result = explore(walking(always(lambda world: len(world.tasks) < 2)))
    assert result.violation is not None
    assert result.violation.why == "here it is not"
    assert str(never(begun(STEP, 1))) == "never step begun with data=1"
    assert str(before(begun(WHERE), begun(STEP))) == "where begun before step begun"
