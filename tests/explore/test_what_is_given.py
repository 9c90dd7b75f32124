"""The same promise of messages, variables and resources: each is answered, handled or given, or
whoever asked is told.

Whoever asks says in a note what came of it. Programs are lost, come back, and leave in between.
"""

import contextlib
from collections.abc import Callable
from typing import Any

import pytest
from explore.accepting import EVER, LOST, at_once, holds, over, those
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


def asks(me: tca.Script, what: Callable[[tca.Script], Any]) -> None:
    """Note what came of it."""
    try:
        me.inform(NOTE, str(what(me)))
    except (QueryFailed, Timeout, Refused) as error:
        me.inform(NOTE, type(error).__name__)


def given_up(me: tca.Script) -> str:
    question = me.query_send(WHERE)
    question.cancel()
    return "given up"


ASKED: dict[str, Callable[[tca.Script], Any]] = {
    "query": lambda me: me.query(WHERE),
    "query with a timeout": lambda me: me.query(WHERE, timeout=2.0),
    "query that is given up": given_up,
    "query if it is handled": lambda me: me.execute_if_handled(WHERE),
    "multi-query": lambda me: me.multi_query(HEIGHTS),
    "multi-query, the first": lambda me: me.multi_query(HEIGHTS, maximum=1),
    "wait until it is handled": lambda me: me.wait_until_handled(WHERE),
}


HOWS: dict[str, dict[str, Any]] = {
    "lost": LOST,
    "leaves": {"may_leave": True},
    "late": {"arrives_late": True},
}


@pytest.mark.parametrize(("name", "how"), one_in(3, ASKED, HOWS))
def test_every_query_is_answered(name: str, how: str) -> None:
    """What waits for who handles it waits as long as nobody does: one of the two maps stays."""
    scenario = tca.Scenario(name)
    for module in (scenario.module("map"), scenario.module("other map", **HOWS[how])):
        for message in (WHERE, HEIGHTS):
            module.handles(message)(lambda _: 7)
    scenario.module("ear").handles(NOTE)(nothing)
    scenario.module("user").does(lambda me: asks(me, ASKED[name]))
    holds(scenario, eventually(over(NOTE)))


@pytest.mark.soak
def test_sent_inform_and_broadcast_are_handled() -> None:
    """By all, of a broadcast. Who dies while he handles it has had it: nobody is told it twice."""
    scenario = tca.Scenario("telling")
    for name in ("ear", "other ear"):
        scenario.module(name, **(LOST if name == "ear" else {})).handles(ALARM)(nothing)
    scenario.modules["other ear"].handles(NOTE)(nothing)

    @scenario.module("user", may_be_lost=1).does
    def tell(me: tca.Script) -> None:
        me.broadcast(ALARM, "fire")
        me.inform(NOTE, "told")

    holds(
        scenario,
        within(EVER, sent(NOTE), over(NOTE)),
        within(EVER, sent(ALARM), handled(ALARM)),
        at_most(2, handled(ALARM)),
    )


# --- variables ------------------------------------------------------------------------------------


def test_variable_value_reaches_every_watcher() -> None:
    """Also to those who come later, or again; whoever set it may be gone."""
    scenario = tca.Scenario("watching")
    scenario.module("display", arrives_late=True, **LOST).handles(POSITION)(nothing)

    @scenario.module("sensor", may_be_lost=1).does
    def sense(me: tca.Script) -> None:
        me.set_variable(POSITION, 1)

    holds(scenario, within(EVER, accepted("set_variable"), handled(POSITION, 1)))


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

    holds(
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


def given(world: tca.World) -> bool:
    """Who wanted a resource has it; or he is told, as he may be by his own end."""
    return any(
        held.sender.startswith("planner") for held in world.held_by.values()
    ) or not going_on(world)


def going_on(world: tca.World) -> bool:
    return any(not (walk.is_over or walk.is_killed) for walk in those(world, WALK))


def kept_too_long(world: tca.World) -> bool:
    return bool(world.held_by) and not those(world, WALK)


@pytest.mark.parametrize(("claim", "loses"), one_in(4, CLAIMS, LOSES))
def test_claim_is_granted_and_later_commands_are_handled(claim: str, loses: str) -> None:
    """What waits behind him is done in the end, too, whatever becomes of him and his resource."""
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
        within(EVER, accepted(claim.partition(" ")[0]), given),
        never(kept_too_long),
        eventually(over(STEP, "others'")),
    ]
    if loses == "its claim":
        properties.append(at_once("unlock", lambda world: not world.held_by))
    if loses in ("nothing", "its claim"):
        scenario.may_kill(WALK)
    holds(scenario, *properties)
