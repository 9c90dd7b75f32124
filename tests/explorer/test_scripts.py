"""What scripts can do, and what is said of those that can't be played."""

import contextlib
import signal
import threading
from typing import Any

import pytest
from explorer.scenarios import HEIGHTS, LIFT, NOTE, REST, SLIPPED, STEP, WALK, WHERE

from tca_explorer import (
    Scenario,
    ScenarioError,
    Script,
    Task,
    achieved,
    eventually,
    explore,
    failed,
    handled,
    killed,
    never,
    never_stuck,
    report,
)
from tca_explorer.scenario.script_connection import ScriptConnection
from tca_module import QueryFailed, Refused
from tca_wire.constraints import sequential_achievement
from tca_wire.messages.declarations import Command, Goal
from tca_wire.points import THIS
from tca_wire.vocabulary import Refusal


def one(handler: Any, *properties: Any, story: Any = lambda me: [me.goal(WALK).wait()]) -> Scenario:
    """A user who walks, a planner that does it in some way, and others who do what they are told."""
    scenario = Scenario("one", *properties)
    scenario.module("planner").handles(WALK)(handler)
    scenario.module("user").does(story)
    others = scenario.module("others", capacity=2)
    for message, result in ((STEP, None), (WHERE, 7), (HEIGHTS, 7), (NOTE, None)):
        others.handles(message)(lambda _, result=result: result)
    return scenario


def test_a_script_that_ends_because_what_it_waits_for_is_killed_with_it_has_not_failed() -> None:
    scenario = one(lambda task: task.command(STEP).result(), never(failed(WALK)))
    scenario.may_kill(WALK)
    result = explore(scenario)
    assert result.ok, report(result)
    scenario.may_kill(STEP)
    assert not explore(scenario).ok


def test_a_script_can_do_what_a_module_can() -> None:
    seen = set()

    def everything(task: Task) -> None:
        here = task.query(WHERE)
        heights = task.multi_query(HEIGHTS)
        task.inform(NOTE, here)
        first = task.command(STEP, {"left": here})
        second = task.command(STEP, priority=1)
        with contextlib.suppress(Refused):  # too late, where the second has begun
            task.constrain(sequential_achievement(first.id, second.id))
        seen.add(f"{here} {heights} {second.wait()}")

    result = explore(one(everything, eventually(achieved(WALK)), never_stuck()))
    assert result.ok, report(result)
    assert seen == {"7 [7] done"}


def test_every_choice_is_explored() -> None:
    def chooses(task: Task) -> None:
        if task.choose("well", "badly") == "badly":
            raise SLIPPED(text="ice")

    scenario = one(chooses)
    bad, good = explore(scenario, never(failed(WALK))), explore(scenario, never(achieved(WALK)))
    assert bad.violation is not None
    assert good.violation is not None
    assert "planner in walk {1} chooses badly, fails: slipped" in report(bad)
    assert "planner in walk {1} chooses well, returns" in report(good)


def test_a_handler_may_hang() -> None:
    result = explore(one(lambda task: task.hang(), never_stuck()))
    assert "planner in walk {1} never goes on" in report(result)


def test_a_killed_handler_is_told() -> None:
    def obeys(task: Task) -> None:
        while not task.cancelled:
            task.query(WHERE)

    scenario = one(obeys, never_stuck(), eventually(killed(WALK)), story=lambda me: [me.goal(WALK).kill()])
    assert explore(scenario, limit=300).violation is None
    deaf = one(lambda task: task.command(STEP) and None, never(handled(STEP)), story=lambda me: [me.goal(WALK).kill()])
    assert explore(deaf).violation is not None


def test_a_failed_query_is_an_error_in_the_script() -> None:
    def asks(task: Task) -> None:
        with pytest.raises(QueryFailed, match="query 'where' failed: slipped"):
            task.query(WHERE)
        task.command(STEP)

    def slips(_: Task) -> None:
        raise SLIPPED(text="ice")

    scenario = one(asks, never_stuck(), eventually(handled(STEP)))
    scenario.module("newest").handles(WHERE)(slips)
    assert explore(scenario).ok
    careless = one(lambda task: task.query(WHERE), eventually(failed(WALK)))
    careless.module("newest").handles(WHERE)(slips)
    assert explore(careless).ok


def test_a_refusal_can_be_caught() -> None:
    refusals = set()

    def circle(task: Task) -> None:
        first, second = task.command(STEP), task.command(STEP)
        try:
            task.constrain(sequential_achievement(second.id, first.id))
        except Refused as error:
            refusals.add(error.refusal)

    assert explore(one(circle, never_stuck())).ok
    assert refusals == {Refusal.TOO_LATE}


def uses_what_nobody_handles(task: Task) -> None:
    task.command(LIFT)


def asks_for_a_circle(task: Task) -> None:
    task.goal(WALK, constraints=[sequential_achievement(THIS, THIS)])


def sends_the_wrong_way(task: Task) -> None:
    task.goal(STEP)  # type: ignore[arg-type]


def breaks(task: Task) -> None:
    task.query(WHERE)
    raise KeyError("left")


@pytest.mark.parametrize(
    ("handler", "words"),
    [
        (uses_what_nobody_handles, "planner sends command 'lift', which no module of the scenario handles"),
        (asks_for_a_circle, "goal 'walk' was refused"),
        (sends_the_wrong_way, r"goal\(\) takes messages of class Goal, not Command\('step'"),
        (breaks, r"test_scripts.py, line \d+\): KeyError\('left'\)"),
        (lambda _: (yield), "is no plain function"),
        (lambda: None, "is no plain function"),
    ],
)
def test_what_cannot_be_played_is_named(handler: Any, words: str) -> None:
    with pytest.raises(ScenarioError, match=words):
        explore(one(handler))


def test_a_script_that_catches_everything_and_goes_on_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    """Also what ends its runs here: no limit would come, as nothing that is raised in it leaves it."""

    def walk(task: Task) -> object:
        while True:
            with contextlib.suppress(BaseException):
                try:
                    return task.query(WHERE) and None
                except:  # noqa: E722
                    print("asks again")

    with pytest.raises(ScenarioError) as found:
        explore(one(walk))
    line = walk.__code__.co_firstlineno + 4
    assert f"the script of 'walk' in planner ({__file__}, line {line}): it catches what ends a run" in str(found.value)
    assert "write 'except Exception:' instead" in str(found.value)
    assert capsys.readouterr().out.count("asks again") >= 10_000


def test_a_script_that_catches_what_cannot_be_played_and_goes_on_is_named() -> None:
    def walk(task: Task) -> None:
        while True:
            with contextlib.suppress(Exception):
                task.choose()

    with pytest.raises(ScenarioError, match=r"nothing to choose from.*; it catches this, and goes on for ever"):
        explore(one(walk))


def test_a_script_may_catch_everything_for_a_while() -> None:
    def walk(task: Task) -> object:
        for _ in range(3):
            try:
                return task.query(WHERE) and None
            except:  # noqa: E722
                pass
        return None

    assert explore(one(walk, never_stuck())).ok


def test_whoever_does_not_wait_for_it_any_more_is_left_alone_by_an_exploration() -> None:
    """Ctrl-C ends the wait; what goes on in the thread ends, too."""
    began = set(threading.enumerate())

    def watch(states: int, _: int) -> None:
        if states > 100:
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)

    scenario = Scenario("long")
    for name in "abcdefgh":
        scenario.module(name).does(lambda me: [me.inform(NOTE, 1) for _ in range(9)])
    scenario.module("others").handles(NOTE)(lambda _: None)
    with pytest.raises(KeyboardInterrupt):
        explore(scenario, watch=watch)
    for thread in set(threading.enumerate()) - began:
        thread.join(timeout=30)
        assert not thread.is_alive()


def test_a_script_that_remembers_is_found_out() -> None:
    runs: list[int] = []

    def remembers(task: Task) -> None:
        runs.append(1)
        if len(runs) == 1:
            task.query(WHERE)
        task.command(STEP)
        task.query(WHERE)

    with pytest.raises(ScenarioError, match="does not do the same when it is run again"):
        explore(one(remembers))


def test_scenarios_are_checked_when_they_are_written() -> None:
    scenario = Scenario("bad")
    module = scenario.module("planner")
    module.handles(WALK)(lambda _: None)
    module.does(lambda _: None)
    for bad, words in (
        (lambda: scenario.module("planner"), "there is a module 'planner' already"),
        (lambda: module.handles(WALK), "handles 'walk' already"),
        (lambda: module.handles("walk"), "wants a message"),  # type: ignore[arg-type]
        (lambda: module.handles(REST, resource="arm"), "has no resource 'arm'"),
        (lambda: module.does(lambda _: None), "does something already"),
        (lambda: scenario.may_kill(NOTE), "wants a goal or command"),
        (lambda: Script(ScriptConnection(())).choose(), "nothing to choose from"),
    ):
        with pytest.raises(ScenarioError, match=words):
            bad()
    other = scenario.module("other")
    other.handles(Command(WALK.name))(lambda _: None)
    with pytest.raises(ScenarioError, match="'walk' is a command in other and a goal elsewhere"):
        explore(scenario)
    assert Goal(WALK.name).name == WALK.name
