"""Messages, variables and resources: each request is answered, handled or granted, or its sender is
notified.

Each sender notes the result of its request. Meanwhile programs are lost, return, and leave.
"""

import contextlib
from collections.abc import Callable
from typing import Any

import pytest
from explore.accepting import EVENTUALLY, LOST, assert_holds, has_ended, kept_at_once, messages_with
from explore.scenarios import HEIGHTS, NOTE, STEP, WALK, WHERE, nothing
from sampling import one_in

import tca_tools.explore as tca
from tca_module import QueryFailed, Refused, Timeout
from tca_tools.explore import (
    accepted,
    at_most,
    at_most_in_all,
    eventually,
    handled,
    never,
    sent,
    within,
)
from tca_wire.messages.declarations import Broadcast, Variable

ALARM: Broadcast[Any] = Broadcast("alarm", Any)
POSITION: Variable[int] = Variable("position", int)


# --- messages -------------------------------------------------------------------------------------


def note_result(me: tca.Script, request: Callable[[tca.Script], Any]) -> None:
    """Make a request, and send its result in a note."""
    try:
        me.inform(NOTE, str(request(me)))
    except (QueryFailed, Timeout, Refused) as error:
        me.inform(NOTE, type(error).__name__)


def given_up(me: tca.Script) -> str:
    question = me.query_send(WHERE)
    question.cancel()
    return "given up"


ASKED: dict[str, Callable[[tca.Script], Any]] = {
    "query": lambda me: me.query(WHERE),
    "query with a timeout": lambda me: me.query(WHERE, timeout=2.0),
    "cancelled query": given_up,
    "query if handled": lambda me: me.execute_if_handled(WHERE),
    "multi-query": lambda me: me.multi_query(HEIGHTS),
    "multi-query with maximum": lambda me: me.multi_query(HEIGHTS, maximum=1),
    "wait until handled": lambda me: me.wait_until_handled(WHERE),
}


MODULE_OPTIONS: dict[str, dict[str, Any]] = {
    "lost": LOST,
    "leaves": {"may_leave": True},
    "late": {"arrives_late": True},
}


@pytest.mark.parametrize(("name", "options_name"), one_in(3, ASKED, MODULE_OPTIONS))
def test_every_query_is_answered(name: str, options_name: str) -> None:
    """A query waits as long as it has no handler. One of the two maps stays."""
    scenario = tca.Scenario(name)
    for module in (
        scenario.module("map"),
        scenario.module("other map", **MODULE_OPTIONS[options_name]),
    ):
        for message in (WHERE, HEIGHTS):
            module.handles(message)(lambda _: 7)
    scenario.module("ear").handles(NOTE)(nothing)
    scenario.module("user").does(lambda me: note_result(me, ASKED[name]))
    assert_holds(scenario, eventually(has_ended(NOTE)))


@pytest.mark.soak
def test_sent_inform_and_broadcast_are_handled() -> None:
    """The broadcast goes to all ears. A message is not repeated to a handler that was lost."""
    scenario = tca.Scenario("telling")
    for name in ("ear", "other ear"):
        scenario.module(name, **(LOST if name == "ear" else {})).handles(ALARM)(nothing)
    scenario.modules["other ear"].handles(NOTE)(nothing)

    @scenario.module("user", may_be_lost=1).does
    def send_both(me: tca.Script) -> None:
        me.broadcast(ALARM, "fire")
        me.inform(NOTE, "told")

    assert_holds(
        scenario,
        within(EVENTUALLY, sent(NOTE), has_ended(NOTE)),
        within(EVENTUALLY, sent(ALARM), handled(ALARM)),
        at_most(2, handled(ALARM)),
    )


# --- variables ------------------------------------------------------------------------------------


def test_variable_value_reaches_every_watcher() -> None:
    """The rule also holds if the watcher comes late or returns, or if the sender has left."""
    scenario = tca.Scenario("watching")
    scenario.module("display", arrives_late=True, **LOST).handles(POSITION)(nothing)

    @scenario.module("sensor", may_be_lost=1).does
    def sense(me: tca.Script) -> None:
        me.set_variable(POSITION, 1)

    assert_holds(scenario, within(EVENTUALLY, accepted("set_variable"), handled(POSITION, 1)))


def test_swap_of_variable_succeeds_for_one_of_two() -> None:
    scenario = tca.Scenario("swapping")
    scenario.module("ear").handles(NOTE)(nothing)

    @scenario.module("keeper").at_start
    def begin(me: tca.Script) -> None:
        me.set_variable(POSITION, 0)

    for name in ("one", "other"):

        @scenario.module(name).does
        def swap(me: tca.Script) -> None:
            me.inform(NOTE, me.swap_variable(POSITION, 1))

    assert_holds(
        scenario,
        at_most_in_all(1, sent(NOTE, 0)),
        eventually(sent(NOTE, 0)),
        eventually(sent(NOTE, 1)),
    )


# --- resources ------------------------------------------------------------------------------------


def locked(task: tca.Task) -> None:
    with task.lock("legs"):
        pass


def locked_in_time(task: tca.Task) -> None:
    with contextlib.suppress(Timeout), task.lock("legs", timeout=1.0):
        pass


def reserved(task: tca.Task) -> None:
    with task.reserve("legs"):
        task.command(STEP, "mine").wait()


def reserved_as_long_as_it_takes(task: tca.Task) -> None:
    task.reserve("legs")
    task.command(STEP, "mine")


CLAIMS = {
    "lock": locked,
    "lock in time": locked_in_time,
    "reserve": reserved,
    "reserve as long as it takes": reserved_as_long_as_it_takes,
}
LOSES = ("legs", "its claim", "nothing", "planner")


def granted_or_ended(world: tca.World) -> bool:
    """Whether the planner holds the resource, or its walk has ended."""
    return any(
        held.sender.startswith("planner") for held in world.held_by.values()
    ) or not has_living_walk(world)


def has_living_walk(world: tca.World) -> bool:
    return any(not (walk.is_over or walk.is_killed) for walk in messages_with(world, WALK))


def held_after_end(world: tca.World) -> bool:
    return bool(world.held_by) and not messages_with(world, WALK)


@pytest.mark.parametrize(("claim", "loses"), one_in(4, CLAIMS, LOSES))
def test_claim_is_granted_and_later_commands_are_handled(claim: str, loses: str) -> None:
    """Queued commands are done afterwards, whatever happens to the lock holder and the resource."""
    scenario = tca.Scenario(f"{claim}, and loses {loses}")
    planner, legs = (
        scenario.module(name, **(LOST if name == loses else {})) for name in ("planner", "legs")
    )
    planner.handles(WALK)(CLAIMS[claim])
    legs.handles(STEP)(nothing)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        me.goal(WALK)
        me.command(STEP, "others'", sequential=False)

    if loses == "its claim":
        scenario.module("operator").does(lambda me: me.unlock("legs") and None)
    properties = [
        within(EVENTUALLY, accepted(claim.partition(" ")[0]), granted_or_ended),
        never(held_after_end),
        eventually(has_ended(STEP, "others'")),
    ]
    if loses == "its claim":
        properties.append(kept_at_once("unlock", lambda world: not world.held_by))
    if loses in ("nothing", "its claim"):
        scenario.may_kill(WALK)
    assert_holds(scenario, *properties)
