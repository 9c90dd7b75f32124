"""Brief waits are no deadlocks, but waits; who gives up is told why there was no answer yet."""

import pytest
from central.player import Player, before, point
from central.test_load import resource, waits

from tca_central.status.load import load
from tca_wire.constraints import Flags
from tca_wire.journal.facts import Awaited, Dropped, RequestRefused
from tca_wire.packets import headers
from tca_wire.packets.changes import Observe
from tca_wire.packets.headers import Answer
from tca_wire.points import Moment, TaskId
from tca_wire.text.waits_in_words import in_words, whereabouts
from tca_wire.vocabulary import Refusal
from tca_wire.waits import WaitFor, WaitKind


def why(robot: Player, name: str, request: int) -> str:
    """What central says to who gives a request up."""
    (answer,) = robot.receive(name, headers.GiveUp(request, robot.number(name)))
    assert isinstance(answer, Answer)
    return answer.text


@pytest.fixture
def robot() -> Player:
    """A map and eyes, whose handlers are asked by a user."""
    robot = Player.of("map: query where", "eyes: query look, command turn", "user")
    robot.declare("user", "query nobody", "goal plan")
    return robot


@pytest.mark.parametrize("brief", [False, True])
def test_a_brief_wait_is_no_deadlock(robot: Player, *, brief: bool) -> None:
    robot.send("user", "where")
    robot.send("map/1", "look", origin=1, blocking=True)
    robot.send("eyes/1", "where", origin=2, blocking=True, brief=brief)
    robot.tick(10.0)
    assert bool(robot.facts(RequestRefused)) is not brief
    told = load(robot.central)
    assert (
        ("look {2} in eyes", "for the reply to where {3}, which is queued for map, busy with where {1}", 10.0)
        in waits(told)
    ) is brief
    assert resource(told, "eyes")["blocked"] == brief
    assert resource(told, "map")["blocked"] == 1


def test_who_went_on_and_now_waits(robot: Player) -> None:
    robot.send("user", "where")
    robot.send("map/1", "look", origin=1, number=7)
    assert resource(load(robot.central), "map")["blocked"] == 0
    assert not robot.receive("map/1", headers.Await(7))
    robot.receive("map/1", headers.Await(99))  # answered meanwhile, or never asked: nothing
    assert resource(load(robot.central), "map")["blocked"] == 1
    robot.reply("eyes/1")
    robot.receive("map/1", headers.Await(7))
    assert resource(load(robot.central), "map")["blocked"] == 0
    assert robot.facts(Awaited) == [Awaited(2)]


def test_a_coroutine_that_awaits_does_not_block_its_thread(robot: Player) -> None:
    robot.send("user", "where")
    robot.send("map/1", "look", origin=1, number=7)
    robot.receive("map/1", headers.Await(7, blocking=False))
    assert resource(load(robot.central), "map")["blocked"] == 0
    assert robot.facts(Awaited) == [Awaited(2)]


def queued(*keepers: WaitFor) -> WaitFor:
    """A question to the map, which these keep from it."""
    return WaitFor(WaitKind.REPLY, because=(WaitFor(WaitKind.RESOURCE, module="map", because=keepers),))


def test_who_gives_up_a_question_is_told_where_it_was(robot: Player) -> None:
    robot.send("user", "nobody", number=101)
    robot.send("user", "where", number=102)
    robot.send("user", "where", number=103)
    robot.send("user", "look", number=104)
    robot.numbers["user"] = 104
    robot.send("eyes/1", "where", origin=4, blocking=True)
    assert why(robot, "user", 101) == "no module handles it"
    assert why(robot, "user", 103) == whereabouts(queued(WaitFor(WaitKind.RUNNING, 2, "where")))
    assert why(robot, "user", 102) == "map handles it"
    words = "eyes handles it and waits for the reply to where {5}"
    assert why(robot, "user", 104) == words
    assert robot.facts(Dropped)[-1].where == words
    assert why(robot, "user", 104) == ""


def test_a_lock_in_the_way_is_named(robot: Player) -> None:
    robot.module("arm")
    robot.receive("arm", headers.Lock(robot.number("arm"), "map"))
    robot.send("user", "where", number=101)
    robot.numbers["user"] = 101
    assert why(robot, "user", 101) == whereabouts(queued(WaitFor(WaitKind.LOCKED, module="arm")))


def test_who_waits_behind_a_lock_that_somebody_wants_is_told_of_that(robot: Player) -> None:
    robot.send("user", "where", number=100)
    robot.module("arm")
    robot.receive("arm", headers.Lock(robot.number("arm"), "map"))
    robot.send("user", "where", number=101)
    robot.numbers["user"] = 101
    keepers = WaitFor(WaitKind.RUNNING, 1, "where"), WaitFor(WaitKind.LOCK, module="arm")
    assert why(robot, "user", 101) == whereabouts(queued(*keepers))


def test_who_waits_no_longer_for_a_task_is_told_what_it_waits_for(robot: Player) -> None:
    plan = robot.task("user", "plan")
    number = robot.number("user")
    robot.receive("user", headers.AwaitPoint(number, point(plan, Moment.END_ACHIEVING)))
    assert why(robot, "user", number) == f"it waits {in_words(WaitFor(WaitKind.HANDLER, name='plan'))}"


@pytest.mark.parametrize(
    ("has_reply", "text"),
    [
        (False, "nobody replied: bad failed (blind: why); good and late have not answered"),
        (True, "bad failed (blind: why); late has not answered (1 of 2 has)"),
    ],
)
def test_who_gives_up_a_multi_query_is_told_who_failed_and_who_is_late(text: str, *, has_reply: bool) -> None:
    robot = Player.of(*(f"{name}: multi-query all" for name in ("good", "bad", "late")), "user")
    robot.send("user", "all", number=101)
    robot.numbers["user"] = 101
    robot.fail("bad/1", "blind")
    if has_reply:
        robot.reply("good/1")
    assert why(robot, "user", 101) == text


def test_a_wait_without_news_is_found_when_a_handler_returns(robot: Player) -> None:
    robot.module("legs", "goal walk")
    waiting = robot.task("user", "walk", flags=Flags.NONE)
    queued = robot.task("user", "walk", flags=Flags.NONE)
    before_its_end = before(point(queued, Moment.START_HANDLING), point(-1, Moment.END_HANDLING))
    turning = robot.task("user", "turn", flags=Flags.NONE, constraints=(before_its_end,))
    number = robot.number("legs/1")
    robot.receive("legs/1", Observe(number, task=TaskId(turning), origin=waiting))
    robot.receive("legs/1", headers.Await(number, blocking=True, origin=waiting, seen=2))
    robot.tick(10.0)
    assert not robot.facts(RequestRefused), "the handler of the task may change it"
    robot.reply("eyes/1")
    robot.tick(10.0)
    assert [fact.refusal for fact in robot.facts(RequestRefused)] == [Refusal.DEADLOCK]
