"""Modules of a scenario: how they join, their options, and the errors of a scenario."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from explore.scenarios import (
    NOTE,
    REST,
    SLIPPED,
    STEP,
    WALK,
    WHERE,
    assert_good,
    counterexample,
    walking,
)

import tca_tools.explore as tca
from tca_module import Condition, Goal, Module, PollingMonitor, Query, Variable
from tca_tools.explore import (
    accepted,
    achieved,
    always,
    at_most,
    at_most_in_all,
    before,
    begun,
    being_achieved,
    eventually,
    fired,
    handled,
    handled_by,
    killed,
    never,
    never_stuck,
    planned_ahead,
    queued,
    sent,
    within,
)
from tca_wire.messages.declarations import Command

POSITION: Variable[int] = Variable("position", int)
ANY: Any = 0.5  # a value of a wrong type
TEXT: Any = "5"


# --- variables and pending limits -----------------------------------------------------------------


def test_newest_value_of_watched_variable_is_handled() -> None:
    """The newest value is queued, and displaces the older values."""
    scenario = tca.Scenario(
        "watching", never_stuck(), at_most(1, queued(POSITION)), eventually(handled(POSITION, 3))
    )
    scenario.module("display").handles(POSITION)(lambda _task, _position: None)

    @scenario.module("sensor").does
    def sense(me: tca.Script) -> None:
        for position in (1, 2, 3):
            me.set_variable(POSITION, position)

    assert_good(scenario)
    counterexample(scenario, eventually(handled(POSITION, 2)))


@pytest.mark.parametrize("pending", [1, 2])
def test_pending_limit_displaces_oldest_messages(pending: int) -> None:
    scenario = tca.Scenario(
        "pending", never_stuck(), at_most(pending, queued(NOTE)), eventually(handled(NOTE, 4))
    )
    scenario.module("ear").handles(NOTE, pending=pending)(lambda _task, _number: None)

    @scenario.module("mouth").does
    def send_notes(me: tca.Script) -> None:
        for number in (1, 2, 3, 4):
            me.inform(NOTE, number)

    assert_good(scenario)
    counterexample(scenario, at_most(pending - 1, queued(NOTE)))
    counterexample(scenario, eventually(handled(NOTE, 2)))


def test_displaced_command_is_killed() -> None:
    scenario = tca.Scenario("pending commands", never_stuck())
    scenario.module("legs").handles(STEP, pending=1)(lambda _: None)

    @scenario.module("user").does
    def hurry(me: tca.Script) -> None:
        for number in range(3):
            me.command(STEP, number, sequential=False)

    assert_good(scenario)
    assert "killed" in counterexample(scenario, never(killed(STEP, 1)))


# --- at_start and requires ------------------------------------------------------------------------


def tapping(*properties: Any, **options: Any) -> tca.Scenario:
    """Return a scenario: a watcher taps each step, and starts before any other module."""
    scenario = tca.Scenario("tapping", *properties)
    scenario.module("legs").handles(STEP)(lambda _: None)
    watcher = scenario.module("watcher", **options)
    watcher.handles(NOTE)(lambda _: None)

    @watcher.at_start
    def tap(module: tca.Script) -> None:
        module.tap(Condition.BEFORE_HANDLING, STEP, NOTE)

    scenario.module("user").does(lambda me: [me.command(STEP)])
    return scenario


def test_at_start_is_done_before_the_run() -> None:
    assert_good(tapping(before(fired(NOTE), begun(STEP)), never_stuck()))


@pytest.mark.soak
def test_at_start_is_done_when_module_arrives_late() -> None:
    """The step may start before the tap is added. A tap that has fired was added in time."""
    counterexample(tapping(before(fired(NOTE), begun(STEP)), arrives_late=True))
    assert_good(
        tapping(never_stuck(), arrives_late=True, may_be_lost=1, comes_back=True), limit=20_000
    )
    assert "watcher taps all step before handling with note" in tca.report(
        tca.explore(tapping(never(fired(NOTE)), arrives_late=True))
    )


def test_at_start_functions_run_in_order() -> None:
    scenario = tca.Scenario(
        "in order", before(sent(NOTE, 1), sent(NOTE, 2)), before(sent(NOTE, 2), begun(WHERE))
    )
    scenario.module("ear").handles(NOTE)(lambda _: None)
    guide = scenario.module("guide", arrives_late=True)
    guide.handles(WHERE)(lambda _: 7)
    guide.at_start(lambda module: module.inform(NOTE, 1))
    guide.at_start(lambda module: module.inform(NOTE, 2))
    scenario.module("user").does(lambda me: [me.query(WHERE)])
    result = assert_good(scenario, never_stuck())
    assert not result.vacuous


def test_error_in_at_start_is_scenario_error() -> None:
    scenario = tapping()

    @scenario.modules["watcher"].at_start
    def slip(_: tca.Script) -> None:
        raise SLIPPED(text="ice")

    with pytest.raises(
        tca.ScenarioError,
        match=r"at_start in watcher .*line \d+\): this error ends the module: slipped",
    ):
        tca.explore(scenario)


@pytest.mark.soak
def test_error_in_script_ends_only_that_script() -> None:
    """The module with the error handles nothing, so the walk is not affected."""
    scenario = walking(never_stuck())

    @scenario.module("slipper").does
    def slip(_: tca.Script) -> None:
        raise SLIPPED(text="ice")

    assert_good(scenario)


def test_module_without_handlers_may_use_at_start() -> None:
    scenario = tca.Scenario(
        "only asking", before(sent(NOTE, "first"), sent(NOTE, "later")), never_stuck()
    )
    scenario.module("ear").handles(NOTE)(lambda _: None)
    mouth = scenario.module("mouth", arrives_late=True, requires=[STEP])
    mouth.does(lambda me: me.inform(NOTE, "later"))
    mouth.at_start(lambda module: module.inform(NOTE, "first"))
    scenario.module("legs", arrives_late=True).handles(STEP)(lambda _: None)
    result = assert_good(scenario)
    assert not result.vacuous


def test_module_waits_for_its_requirements() -> None:
    scenario = tca.Scenario("requiring", before(begun(STEP), begun(REST)), never_stuck())
    planner = scenario.module("planner", requires=[STEP, WALK])
    planner.handles(WALK)(lambda _: None)
    scenario.module("legs", arrives_late=True).handles(STEP)(lambda _: None)

    @planner.does
    def story(me: tca.Script) -> None:
        me.command(STEP).wait()
        me.goal(REST)

    scenario.module("couch").handles(REST)(lambda _: None)
    result = assert_good(scenario)
    assert not result.vacuous


def test_modules_with_circular_requirements_are_stuck() -> None:
    scenario = tca.Scenario("a circle", never_stuck())
    scenario.module("legs", requires=[REST]).handles(STEP)(lambda _: None)
    scenario.module("couch", requires=[STEP]).handles(REST)(lambda _: None)
    text = counterexample(scenario)
    assert "legs waits until rest are handled" in text


# --- errors ----------------------------------------------------------------------------------------


def locking(**lock: Any) -> tca.Scenario:
    scenario = tca.Scenario("locking", never_stuck())
    scenario.module("arm").handles(STEP)(lambda _: None)
    scenario.module("other arm").resource("unused")

    @scenario.module("planner").handles(WALK)
    def walk(task: tca.Task) -> None:
        with task.lock(**lock):
            task.command(STEP)

    scenario.module("user").does(lambda me: [me.goal(WALK)])
    return scenario


@pytest.mark.parametrize(
    ("lock", "words"),
    [
        ({"resource": "amr"}, "the scenario has no resource 'amr'"),
        ({"resource": "arm", "module": "leg"}, "module 'leg' has no resource 'arm'"),
        ({"resource": "unused"}, "the scenario has no resource 'unused'"),
    ],
)
def test_lock_of_unknown_resource_is_scenario_error(lock: dict[str, str], words: str) -> None:
    lines = Path(__file__).read_text().splitlines()
    line = next(number for number, text in enumerate(lines, start=1) if "task.lock(**lock)" in text)
    with pytest.raises(tca.ScenarioError, match=re.escape(f"{__file__}, line {line}): {words}")):
        tca.explore(locking(**lock))


def test_lock_of_ambiguous_resource_must_name_module() -> None:
    scenario = locking(resource="gripper")
    for name in ("arm", "other arm"):
        module = scenario.modules[name]
        module.handles(Command(f"grip of {name}"), resource=module.resource("gripper"))(
            lambda _: None
        )
    with pytest.raises(
        tca.ScenarioError,
        match="modules arm, other arm have a resource 'gripper': choose one with module=",
    ):
        tca.explore(scenario)


def test_lock_of_known_resource_is_good() -> None:
    assert_good(locking(resource="planner"))


def module() -> Any:
    return tca.Scenario("s").module("m")


INVALID_ARGUMENTS: list[Callable[[], object]] = [
    *(
        lambda option=option: walking(**option)
        for option in (
            {"may_be_lost": -1},
            {"may_be_lost": True},
            {"comes_back": "no"},
            {"may_leave": 1},
            {"arrives_late": None},
            {"capacity": 0},
            {"capacity": 2.5},
            {"capacity": 257},
            {"requires": "step"},
        )
    ),
    *(
        lambda option=option: module().handles(NOTE, **option)
        for option in (
            {"pending": 0},
            {"pool": 1},
            {"pool": ""},
            {"resource": ""},
        )
    ),
    *(
        lambda call=call: call(ANY)
        for call in (
            tca.Scenario,
            accepted,
            never,
            always,
            eventually,
            tca.Scenario("s").module,
            tca.Scenario("s").may_kill,
            tca.explore,
        )
    ),
    lambda: module().resource("r", 0),
    lambda: module().resource(""),
    lambda: module().every(1.0),
    lambda: module().goal(WALK),
    lambda: tca.Scenario(""),
    lambda: tca.Scenario("s", ANY),
    lambda: tca.Scenario("s").may_kill(WALK, -1),
    lambda: tca.Scenario("s").may_suspend(WALK, ANY),
    lambda: accepted("kill", by=" "),
    lambda: tca.explore(walking(), never(accepted("kill", by="legz"))),
    lambda: at_most(-1, begun(WALK)),
    lambda: at_most_in_all(ANY, begun(WALK)),
    *(
        lambda seconds=seconds: within(seconds, begun(WALK), begun(STEP))
        for seconds in (-1, float("nan"), TEXT)
    ),
    lambda: tca.explore(walking(), ANY),
    lambda: tca.explore(walking(), limit=0),
]


@pytest.mark.parametrize("make", INVALID_ARGUMENTS)
def test_invalid_scenario_argument_is_refused_at_once(make: Callable[[], object]) -> None:
    with pytest.raises((tca.ScenarioError, tca.BadProperty)):
        make()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: walking(capacity=257), "module 'legs': capacity must be 1 to 256, not 257"),
        (lambda: accepted("kil"), r"accepted\(\) knows no call 'kil'; did you mean 'kill'"),
        (
            lambda: module().every(1.0),
            "every of module 'm' is not explored: write what the module sends outside of tasks",
        ),
    ],
)
def test_invalid_scenario_argument_error_names_valid_ones(
    make: Callable[[], object], words: str
) -> None:
    with pytest.raises(tca.ScenarioError, match=words):
        make()


def test_unexplored_module_method_is_named() -> None:
    """A method of the library's Module that a scenario lacks must not raise a bare AttributeError."""
    module = tca.Scenario("s").module("m")
    for name in (
        name for name in dir(Module) if not name.startswith("_") and name not in dir(module)
    ):
        with pytest.raises(tca.ScenarioError, match=f"{name} of module 'm' is not explored"):
            getattr(module, name)


def test_script_raising_system_exit_is_scenario_error() -> None:
    scenario = walking()

    @scenario.module("quitter").does
    def quits(_: tca.Script) -> None:
        raise SystemExit(3)

    with pytest.raises(tca.ScenarioError, match=r"line \d+\): SystemExit"):
        tca.explore(scenario)


@pytest.mark.parametrize("changes", ["choice", "data"])
def test_script_that_counts_its_runs_is_refused(changes: str) -> None:
    runs: list[int] = []

    def counts(task: tca.Task) -> None:
        runs.append(1)
        if changes == "choice":
            task.choose(len(runs))
        else:
            task.inform(NOTE, len(runs))
        task.query(WHERE)
        task.query(WHERE)

    scenario = tca.Scenario("counting")
    scenario.module("planner").handles(WALK)(counts)
    others = scenario.module("others")
    others.handles(WHERE)(lambda _: 7)
    others.handles(NOTE)(lambda _: None)
    scenario.module("user").does(lambda me: [me.goal(WALK)])
    with pytest.raises(tca.ScenarioError, match="acts differently when it is run again"):
        tca.explore(scenario)


# --- names in properties --------------------------------------------------------------------------


WAKE, STEPS = Goal("wake"), Goal("steps")
IS_LOW: Query[None, bool] = Query("is low", reply=bool)
GAUGE = PollingMonitor("gauge", condition=IS_LOW)
WRONG: Any = ("step", None, 5, STEP)  # values of wrong types


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
def test_property_with_unknown_name_is_scenario_error(
    scenario: tca.Scenario,
) -> None:
    name = (
        "module 'leg'; did you mean 'legs'"
        if "leg" in repr(scenario.properties[0]).split()
        else "message 'steps': "
    )
    with pytest.raises(tca.ScenarioError, match=rf"^.*{scenario.properties[0]}.* no {name}"):
        tca.explore(scenario)


def test_kill_or_suspend_of_unknown_name_is_scenario_error() -> None:
    for call in ("may_kill", "may_suspend"):
        scenario = walking(never_stuck())
        getattr(scenario, call)(WAKE)
        words = (
            rf"can't be judged: {call}\(\): there is no message 'wake': .* did you mean 'walk'\?$"
        )
        with pytest.raises(tca.ScenarioError, match=words):
            tca.explore(scenario)


def test_violated_eventually_names_unknown_message() -> None:
    result = tca.explore(walking(eventually(begun(STEPS))))
    assert result.violation is not None
    assert result.violation.why.endswith(
        "there is no message 'steps': no module handles it, and no script uses it; "
        "did you mean 'step'?"
    )


def test_property_may_name_a_monitor() -> None:
    scenario = tca.Scenario("polled", at_most(1, fired(GAUGE)), never_stuck())
    scenario.module("battery").handles(IS_LOW)(lambda _: False)
    scenario.module("user").does(lambda me: [me.monitor(GAUGE, period=1.0, waited_for=True)])
    assert_good(scenario)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (
            lambda: begun(WRONG[0]),
            r"^begun\(\) needs the declaration of a message \(Goal, Command, ...\), not 'step'",
        ),
        (lambda: planned_ahead(WRONG[1]), r"^planned_ahead\(\) needs the declaration"),
        (lambda: being_achieved(WRONG[2], 1), r"^being_achieved\(\) needs the declaration"),
        (lambda: handled_by(WRONG[3]), "the name of a module must have"),
    ],
)
def test_property_of_wrong_type_is_refused_at_once(wrong: Any, words: str) -> None:
    with pytest.raises(tca.BadProperty, match=words):
        wrong()
