"""Scripts: their calls, their choices, and the errors of scripts that cannot be played."""

import contextlib
import signal
import threading
from collections.abc import Callable
from typing import Any

import pytest
from explore.accepting import messages_with
from explore.scenarios import (
    HEIGHTS,
    LIFT,
    NOTE,
    REST,
    SLIPPED,
    STEP,
    WALK,
    WHERE,
    assert_good,
    counterexample,
    slips,
)

import tca_tools.explore as tca
from tca_module import QueryFailed, Refused, SentTask, Stopped, TaskKilled, this
from tca_tools.explore import (
    achieved,
    at_most,
    at_most_in_all,
    begun,
    eventually,
    failed,
    handled,
    killed,
    never,
    never_stuck,
    sent,
    within,
)
from tca_tools.explore.scenario.script_connection import ScriptConnection
from tca_wire.constraints import sequential_achievement
from tca_wire.messages.declarations import Command, Goal
from tca_wire.points import THIS
from tca_wire.vocabulary import Refusal


def scenario_of(
    handler: Any, *properties: Any, story: Any = lambda me: [me.goal(WALK).wait()]
) -> tca.Scenario:
    """Return a scenario: a user sends a walk, *handler* handles it, and one module handles all
    other messages.
    """
    scenario = tca.Scenario("one", *properties)
    scenario.module("planner").handles(WALK)(handler)
    scenario.module("user").does(story)
    others = scenario.module("others", capacity=2)
    for message, result in ((STEP, None), (WHERE, 7), (HEIGHTS, 7), (NOTE, None)):
        others.handles(message)(lambda _, result=result: result)
    return scenario


def test_script_killed_with_its_subtask_has_not_failed() -> None:
    scenario = scenario_of(lambda task: task.command(STEP).result(), never(failed(WALK)))
    scenario.may_kill(WALK)
    assert_good(scenario)
    scenario.may_kill(STEP)
    counterexample(scenario)


def test_script_supports_calls_of_a_module() -> None:
    seen = set()

    def everything(task: tca.Task) -> None:
        here = task.query(WHERE)
        heights = task.multi_query(HEIGHTS)
        task.inform(NOTE, here)
        first = task.command(STEP, {"left": here})
        second = task.command(STEP, priority=1)
        with contextlib.suppress(Refused):  # too late if the second has begun
            task.constrain(sequential_achievement(first.id, second.id))
        seen.add(f"{here} {heights} {second.wait()}")

    assert_good(scenario_of(everything, eventually(achieved(WALK)), never_stuck()))
    assert seen == {"7 [7] done"}


def test_every_choice_of_script_is_explored() -> None:
    def chooses(task: tca.Task) -> None:
        if task.choose("well", "badly") == "badly":
            raise SLIPPED(text="ice")

    scenario = scenario_of(chooses)
    bad, good = (
        tca.explore(scenario, never(failed(WALK))),
        tca.explore(scenario, never(achieved(WALK))),
    )
    assert bad.violation is not None
    assert good.violation is not None
    assert "planner in walk {1} chooses badly, fails: slipped" in tca.report(bad)
    assert "planner in walk {1} chooses well, returns" in tca.report(good)


def test_hanging_handler_is_reported_as_stuck() -> None:
    result = tca.explore(scenario_of(lambda task: task.hang(), never_stuck()))
    assert "planner in walk {1} waits forever" in tca.report(result)


def test_killed_handler_sees_cancelled() -> None:
    def obeys(task: tca.Task) -> None:
        while not task.cancelled:
            task.query(WHERE)

    scenario = scenario_of(
        obeys, never_stuck(), eventually(killed(WALK)), story=lambda me: [me.goal(WALK).kill()]
    )
    assert tca.explore(scenario, limit=150).violation is None
    deaf = scenario_of(
        lambda task: task.command(STEP) and None,
        never(handled(STEP)),
        story=lambda me: [me.goal(WALK).kill()],
    )
    counterexample(deaf)


def test_failed_query_raises_in_script() -> None:
    def asks(task: tca.Task) -> None:
        with pytest.raises(QueryFailed, match="query 'where' failed: slipped"):
            task.query(WHERE)
        task.command(STEP)

    scenario = scenario_of(asks, never_stuck(), eventually(handled(STEP)))
    scenario.module("newest").handles(WHERE)(slips)
    assert_good(scenario)
    careless = scenario_of(lambda task: task.query(WHERE), eventually(failed(WALK)))
    careless.module("newest").handles(WHERE)(slips)
    assert_good(careless)


def test_script_may_catch_refusal() -> None:
    refusals = set()

    def circle(task: tca.Task) -> None:
        first, second = task.command(STEP), task.command(STEP)
        try:
            task.constrain(sequential_achievement(second.id, first.id))
        except Refused as error:
            refusals.add(error.refusal)

    assert_good(scenario_of(circle, never_stuck()))
    assert refusals == {Refusal.TOO_LATE}


def send_under_ended_task(task: tca.Task) -> SentTask[Any]:
    """Send under an ended task, which is refused."""
    first = task.command(STEP)
    first.wait()
    return task.under(first).command(STEP)


@pytest.mark.parametrize("ending", ["returns", "goes on", "orders", "waits"])
def test_handler_that_ignores_refused_send_fails(ending: str) -> None:
    """The handler uses the refused task, sends another task, or returns. Its later sends have no
    effect.
    """

    def walk(task: tca.Task) -> None:
        refused = send_under_ended_task(task)
        if ending == "goes on":
            task.command(STEP)
        elif ending == "orders":
            task.command(STEP, constraints=[refused.achieving.end <= this.achieving.start])
        elif ending == "waits":
            refused.wait()

    assert_good(
        scenario_of(walk, eventually(failed(WALK)), at_most_in_all(1, sent(STEP)), never_stuck())
    )


def test_refused_send_has_no_effect() -> None:
    def walk(task: tca.Task) -> None:
        with task.sequence():
            refused = send_under_ended_task(task)
            with pytest.raises(Refused, match=r"command 'step' was refused: task .* has ended"):
                refused.id  # noqa: B018
            task.command(STEP)
            task.command(STEP)

    assert_good(
        scenario_of(walk, eventually(achieved(WALK)), at_most(1, begun(STEP)), never_stuck())
    )


def sends_unhandled_command(task: tca.Task) -> None:
    task.command(LIFT)


def constrains_task_to_itself(task: tca.Task) -> None:
    task.goal(WALK, constraints=[sequential_achievement(THIS, THIS)])


def sends_command_as_goal(task: tca.Task) -> None:
    task.goal(STEP)  # type: ignore[call-overload]


def raises_key_error(task: tca.Task) -> None:
    task.query(WHERE)
    raise KeyError("left")


@pytest.mark.parametrize(
    ("handler", "words"),
    [
        (
            sends_unhandled_command,
            "planner sends command 'lift', which no module of the scenario handles",
        ),
        (constrains_task_to_itself, "goal 'walk' was refused"),
        (sends_command_as_goal, r"goal\(\) takes messages of class Goal, not Command\('step'"),
        (raises_key_error, r"test_scripts.py, line \d+\): KeyError\('left'\)"),
        (lambda _: (yield), "make it a plain function"),
        (lambda: None, r"declare it with \(task, data\)"),
    ],
)
def test_unplayable_script_is_named(handler: Any, words: str) -> None:
    with pytest.raises(tca.ScenarioError, match=words):
        tca.explore(scenario_of(handler))


def test_script_that_catches_base_exception_for_ever_is_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The script even catches the exception that ends a run. Without a special rule, no limit would
    stop the script.
    """

    def walk(task: tca.Task) -> object:
        while True:
            with contextlib.suppress(BaseException):
                try:
                    return task.query(WHERE) and None
                except:  # noqa: E722
                    print("asks again")

    with pytest.raises(tca.ScenarioError) as found:
        tca.explore(scenario_of(walk))
    line = walk.__code__.co_firstlineno + 4
    assert (
        f"the script of 'walk' in planner ({__file__}, line {line}): it catches the exception that ends a run"
        in str(found.value)
    )
    assert "write 'except Exception:' instead" in str(found.value)
    assert capsys.readouterr().out.count("asks again") >= 10_000


def test_script_that_catches_scenario_error_for_ever_is_named() -> None:
    def walk(task: tca.Task) -> None:
        while True:
            with contextlib.suppress(Exception):
                task.choose()

    with pytest.raises(
        tca.ScenarioError, match=r"nothing to choose from.*; it catches this, and continues forever"
    ):
        tca.explore(scenario_of(walk))


def test_script_may_catch_base_exception_a_few_times() -> None:
    def walk(task: tca.Task) -> object:
        for _ in range(3):
            try:
                return task.query(WHERE) and None
            except:  # noqa: E722
                pass
        return None

    assert_good(scenario_of(walk, never_stuck()))


def test_interrupted_exploration_ends_its_threads() -> None:
    """Ctrl-C ends the search and the threads that the search started."""
    began = set(threading.enumerate())

    def watch(states: int, _: int) -> None:
        if states > 100:
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)

    scenario = tca.Scenario("long")
    for name in "abcdefgh":
        scenario.module(name).does(lambda me: [me.inform(NOTE, 1) for _ in range(9)])
    scenario.module("others").handles(NOTE)(lambda _: None)
    with pytest.raises(KeyboardInterrupt):
        tca.explore(scenario, watch=watch)
    for thread in set(threading.enumerate()) - began:
        thread.join(timeout=30)
        assert not thread.is_alive()


def test_script_with_memory_of_runs_is_refused() -> None:
    runs: list[int] = []

    def remembers(task: tca.Task) -> None:
        runs.append(1)
        if len(runs) == 1:
            task.query(WHERE)
        task.command(STEP)
        task.query(WHERE)

    with pytest.raises(tca.ScenarioError, match="acts differently when it is run again"):
        tca.explore(scenario_of(remembers))


def test_scenario_checks_its_declarations() -> None:
    scenario = tca.Scenario("bad")
    module = scenario.module("planner")
    module.handles(WALK)(lambda _: None)
    module.does(lambda _: None)
    for bad, words in (
        (lambda: scenario.module("planner"), "there is a module 'planner' already"),
        (lambda: module.handles(WALK), "handles 'walk' already"),
        (lambda: module.handles("walk"), "must be a message"),  # type: ignore[arg-type]
        (lambda: module.handles(REST, resource="arm"), "has no resource 'arm'"),
        (lambda: module.does(lambda _: None), "has a function under @module.does already"),
        (lambda: scenario.may_kill(NOTE), "needs a goal or command"),
        (lambda: tca.Script(ScriptConnection(())).choose(), "nothing to choose from"),
    ):
        with pytest.raises(tca.ScenarioError, match=words):
            bad()
    other = scenario.module("other")
    other.handles(Command(WALK.name))(lambda _: None)
    with pytest.raises(
        tca.ScenarioError, match="'walk' is a command in other and a goal elsewhere"
    ):
        tca.explore(scenario)
    assert Goal(WALK.name).name == WALK.name


# --- a killed handler is woken once from its wait, as on the robot ------------------------------

HELD = "arm"

WAITS: dict[str, Callable[[tca.Task], Any]] = {
    "query": lambda task: task.query(WHERE),
    "multi-query": lambda task: task.multi_query(HEIGHTS),
    "receive": lambda task: task.query_send(WHERE).receive(),
    "a stranger's task": lambda task: [step.wait() for step in task.tasks(STEP)],
    "subtask": lambda task: task.command(STEP).wait(),
    "result": lambda task: task.command(STEP).result(),
    "lock": lambda task: task.lock(HELD),
    "until handled": lambda task: task.wait_until_handled(LIFT),
}


def soak_all_but(*names: str) -> list[Any]:
    return [
        pytest.param(wait_name, marks=[] if wait_name in names else [pytest.mark.soak])
        for wait_name in WAITS
    ]


def walk_is_killed(world: tca.World) -> object:
    return messages_with(world, WALK, "is_killed")


def returned(world: tca.World) -> object:
    """Return the killed walks whose handler has returned. Their subtasks may last for ever."""
    return [walk for walk in messages_with(world, WALK, "is_killed") if not walk.is_handled]


def asking(handler: Callable[[tca.Task], Any], *properties: Any, **planner: Any) -> tca.Scenario:
    """Return a scenario with a walk that waits. The walk may be killed; no other event ends its
    wait.
    """
    scenario = tca.Scenario("asking", *properties)
    scenario.module("planner", **planner).handles(WALK)(handler)
    others = scenario.module("others", capacity=3)
    for message in (WHERE, HEIGHTS, STEP):
        others.handles(message)(lambda task: task.hang())
    scenario.module("arm").handles(REST)(lambda _: None)
    scenario.module("notes").handles(NOTE)(lambda _: None)
    scenario.module("boats", arrives_late=True).handles(LIFT)(lambda _: None)

    @scenario.module("user").does
    def story(me: Any) -> None:
        me.lock(HELD)
        me.command(STEP, sequential=False)
        me.goal(WALK, sequential=False)

    if not planner:
        scenario.may_kill(WALK)
    return scenario


@pytest.mark.parametrize("wait_name", soak_all_but("query"))
def test_killed_handler_returns_at_once_from_any_wait(wait_name: str) -> None:
    scenario = asking(WAITS[wait_name], within(0, walk_is_killed, returned), never(failed(WALK)))
    result = tca.explore(scenario, limit=20_000)
    assert result.ok, tca.report(result)


@pytest.mark.soak
@pytest.mark.parametrize("wait_name", soak_all_but("query", "lock"))
def test_killed_handler_may_ask_while_it_cleans_up(wait_name: str) -> None:
    def cleans_up(task: tca.Task) -> None:
        try:
            WAITS[wait_name](task)
        except TaskKilled:
            assert task.cancelled
            task.wait_until_handled(NOTE)
            task.inform(NOTE)
            raise

    result = tca.explore(asking(cleans_up, never(begun(NOTE))), limit=20_000)
    assert result.violation is not None
    assert "the operator kills walk" in tca.report(result)


def test_killed_handler_is_not_woken_after_it_read_cancelled() -> None:
    def waits_on(task: tca.Task) -> None:
        if task.cancelled:
            task.query(WHERE)

    result = tca.explore(asking(waits_on, within(0, walk_is_killed, returned)), limit=20_000)
    assert not result.ok
    assert "waits for the answer to query where" in tca.report(result)


# --- end of the module ----------------------------------------------------------------------------


def lost(world: tca.World) -> object:
    return [walk for walk in messages_with(world, WALK, "failure") if walk.failure == "module lost"]


def gone(world: tca.World) -> bool:
    return "planner" not in world.modules


@pytest.mark.soak
@pytest.mark.parametrize("wait_name", soak_all_but("lock"))
def test_waiting_handler_is_woken_when_its_module_leaves(wait_name: str) -> None:
    """The wait raises Stopped, as on the robot. The walk fails, and the module can leave."""
    seen = set()

    def asks(task: tca.Task) -> None:
        try:
            WAITS[wait_name](task)
        except Stopped:
            seen.add(task.cancelled)
            task.wait_until_handled(NOTE)
            raise

    result = tca.explore(asking(asks, may_leave=True), limit=20_000)
    assert result.ok, tca.report(result)
    assert seen == {True}
    for never_comes in (lost, gone):
        assert (
            tca.explore(asking(asks, never(never_comes), may_leave=True), limit=20_000).violation
            is not None
        )


def test_handler_that_returns_after_stop_may_fail_module_lost() -> None:
    def returns(task: tca.Task) -> None:
        if task.cancelled:
            return
        try:
            task.query(WHERE)
        except Stopped:
            return

    result = tca.explore(asking(returns, never(lost), may_leave=True), limit=20_000)
    assert result.violation is not None
