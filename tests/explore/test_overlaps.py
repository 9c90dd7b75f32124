"""Clients and handlers change the state of a task in every order. The observer is checked in each
state of each scenario. It misses no change, and its state and goal agree with the facts of central.
"""

from typing import Any

import pytest
from explore.scenarios import assert_good, counterexample
from sampling import every

from tca_module import Refused
from tca_module.serving.handler_options import WhenBusy
from tca_tools.explore import (
    Scenario,
    Script,
    Seen,
    Task,
    World,
    at_most,
    eventually,
    handled,
    never,
    never_stuck,
)
from tca_wire.life_cycles import GENERAL, LifeCycle, Transition, ending
from tca_wire.messages.controls import ExceptionHandler
from tca_wire.messages.declarations import Command, Goal, Inform
from tca_wire.vocabulary import Party

PAUSABLE = LifeCycle(
    "pausable",
    [
        *GENERAL.transitions,
        Transition("pause", "running", "paused", Party.CLIENT),
        Transition("resume", "paused", "running", Party.CLIENT),
        *ending("paused"),
    ],
)
WALK: Command[Any, Any] = Command("walk", int, progress=int, life_cycle=PAUSABLE)
GRASP: Command[Any, Any] = Command("grasp", int, result=int, progress=int)
AGAIN = ExceptionHandler("again")
TIDY, PUT, USED = Goal("tidy", int), Command("put", int), Inform("used", int)


def ended(state: str, goal: int | None = None) -> Any:
    """Return a predicate for an ended grasp with *state* and *goal*."""

    def predicate(world: World) -> list[Seen]:
        tasks = [task for task in world.tasks if task.message == "grasp" and task.is_over]
        return [task for task in tasks if task.state == state and goal in (None, task.data)]

    return predicate


def used_another_goal(world: World) -> bool:
    """Whether the handler has ended with a goal other than its task's. Kills and restarts do not
    count.
    """
    used = [one.data for one in world.messages if one.message == "used" and one.is_new]
    tasks = [
        task
        for task in world.tasks
        if task.message == "grasp" and not task.is_killed and task.attempts == 1
    ]
    return any(task.data not in used for task in tasks if used)


def try_transition(sent: Any, me: Script, name: str, data: Any = None) -> None:
    """Request a transition as a client, if it is possible."""
    try:
        sent.take(name, data)
    except Refused:
        me.choose("it was not possible")


def grasping(*, updates: int = 1, **options: Any) -> Scenario:
    """Return a scenario: a client updates and cancels a grasp. The handler looks for requests once
    more before its end.
    """
    ends = eventually(lambda world: ended("done")(world) or ended("cancelled")(world))
    scenario = Scenario("grasping", never_stuck(), never(used_another_goal), ends)
    scenario.observe()
    arm, user = scenario.module("arm"), scenario.module("user")

    @user.does
    def want(me: Script) -> None:
        sent = me.command(GRASP, 1)
        for number in range(updates):
            try_transition(sent, me, "update", number + 2)
        try_transition(sent, me, "cancel")
        sent.wait()

    @arm.handles(GRASP, **options)
    def grasp(task: Task, goal: int) -> int:
        if "accepts" in options:
            task.accept()
        for _ in range(updates + 1):
            if request := task.request:
                if task.choose("accept", "reject") == "reject":
                    request.reject("no")
                elif request.accept():
                    goal = request.goal or goal
                    if request.transition == "cancel":
                        return goal
        task.report(2)
        task.inform(USED, goal)
        return goal

    user.handles(USED)(lambda _task, _goal: None)
    return scenario


HANDLER_OPTIONS: list[dict[str, Any]] = [
    {"takes": ["update", "cancel"]},
    {"takes": ["update", "cancel"], "accepts": True},
    {"takes": ["update"]},
    {"takes": ["cancel"], "refuses": ["update"]},
    {"refuses": ["update", "cancel"]},
    {},
]


@pytest.mark.parametrize("options", every(3, HANDLER_OPTIONS), ids=str)
def test_client_and_server_transitions_hold_in_every_order(options: dict[str, Any]) -> None:
    assert_good(grasping(**options))


@pytest.mark.soak
def test_two_updates_and_cancel_hold_in_every_order() -> None:
    result = assert_good(grasping(updates=2, takes=["update", "cancel"]))
    assert result.states > 300


@pytest.mark.soak
@pytest.mark.parametrize(
    ("state", "goal"), [("done", 1), ("done", 2), ("cancelled", 1), ("cancelled", 2)]
)
def test_each_state_and_goal_is_reached_in_some_order(state: str, goal: int) -> None:
    assert "NOT never" in counterexample(
        grasping(takes=["update", "cancel"]), never(ended(state, goal))
    )


@pytest.mark.soak
def test_handler_without_takes_is_restarted_or_killed() -> None:
    counterexample(grasping(), never(ended("done", 2)))
    counterexample(grasping(), never(ended("cancelled", 2)))
    assert_good(grasping(refuses=["update", "cancel"]), never(ended("done", 2)))


def test_cancel_before_acceptance_may_be_rejected() -> None:
    """The rejection makes the task run. So the handler need not know whether the cancel came before
    the acceptance.
    """
    scenario = Scenario("early", never_stuck(), never(ended("cancelled")))
    scenario.observe()
    arm, user = scenario.module("arm"), scenario.module("user")

    @user.does
    def want(me: Script) -> None:
        sent = me.command(GRASP, 1)
        sent.cancel()
        sent.wait()

    @arm.handles(GRASP, takes=["cancel"], accepts=True)
    def grasp(task: Task, _: int) -> int:
        if request := task.request:
            request.reject("not now")
        task.accept()
        if request := task.request:
            request.reject("not now")
        task.report(1)
        return 2

    assert_good(scenario)


def test_unanswered_request_is_decided_by_default_at_return() -> None:
    """A goal outlives its handler, so no handler would answer the cancel."""
    scenario = Scenario("tidying", never_stuck())
    scenario.observe()
    planner, hand, user = (
        scenario.module("planner"),
        scenario.module("hand"),
        scenario.module("user"),
    )

    @user.does
    def want(me: Script) -> None:
        sent = me.goal(TIDY, 1)
        try_transition(sent, me, "cancel")
        sent.wait()

    @planner.handles(TIDY, takes=["cancel"])
    def tidy(task: Task, _: int) -> None:
        task.command(PUT, 1)

    @hand.handles(PUT)
    def put(task: Task, _: int) -> None:
        task.wait_for_request()  # until the task is killed

    assert_good(scenario)


@pytest.mark.soak
def test_custom_transitions_of_two_clients_hold_in_every_order() -> None:
    """Two clients pause and resume the walk, while its handler reports progress."""
    scenario = Scenario("walking", never_stuck())
    scenario.observe()
    legs = scenario.module("legs")

    for name in ("one", "other"):

        @scenario.module(name).does
        def want(me: Script) -> None:
            for walk in me.tasks(WALK):
                try_transition(walk, me, "pause")
                try_transition(walk, me, "resume")

    @scenario.module("user").does
    def send(me: Script) -> None:
        me.command(WALK, 1).wait()

    @legs.handles(WALK, takes=["pause", "resume"])
    def walk(task: Task, _: int) -> None:
        task.report(1)  # even while paused

    assert_good(scenario)


def crowded(users: int, policy: WhenBusy, takes: list[str]) -> Scenario:
    """Return a scenario: several users send grasps to one arm. *policy* says what a busy arm does
    with another grasp.
    """
    scenario = Scenario(f"an arm that is to {policy}", never_stuck(), at_most(1, handled(GRASP)))
    scenario.observe()

    for number in range(users):

        @scenario.module(f"user {number}").does
        def want(me: Script) -> None:
            me.command(GRASP, 1).wait()

    @scenario.module("arm").handles(GRASP, when_busy=policy, takes=takes)
    def grasp(task: Task, goal: int) -> int:
        request = task.wait_for_request(1.0) if takes else None
        if request and task.choose("accept", "reject") == "accept":
            request.accept()
        elif request:
            request.reject("no")
        return goal

    return scenario


@pytest.mark.parametrize("policy", ["queue", "reject", "preempt"])
@pytest.mark.parametrize("takes", [[], pytest.param(["cancel"], marks=pytest.mark.soak)], ids=str)
@pytest.mark.parametrize("users", [2, pytest.param(3, marks=pytest.mark.soak)])
def test_busy_policy_allows_one_task_at_a_time(
    users: int, policy: WhenBusy, takes: list[str]
) -> None:
    assert_good(crowded(users, policy, takes))


@pytest.mark.soak
def test_cancelled_task_may_lose_server_and_be_retried() -> None:
    scenario = Scenario("losing", never_stuck())
    scenario.observe()
    arm, user = scenario.module("arm", may_be_lost=1, comes_back=True), scenario.module("user")
    doctor = scenario.module("doctor")

    @user.does
    def want(me: Script) -> None:
        sent = me.command(GRASP, 1)
        sent.cancel()
        sent.wait()

    @doctor.at_start
    def attach(me: Script) -> None:
        me.on_failure(None, AGAIN, of=GRASP)

    @doctor.handles(AGAIN)
    def again(task: Task) -> None:
        task.trouble.failing.retry()

    @arm.handles(GRASP, takes=["cancel"])
    def grasp(task: Task, goal: int) -> int:
        if request := task.request:
            request.reject("no")
        return goal

    assert_good(scenario)
