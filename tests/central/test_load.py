"""What central tells of its load: counters that only grow, and who waits longest, for what, how long."""

from typing import Any

from central.player import ANY, Player

from tca_central.status.load import SHOWN_WAITS, load
from tca_wire.constraints import Constraint, Flags
from tca_wire.packets import headers
from tca_wire.packets.parts import MessageFormat, WatchOptions
from tca_wire.packets.routes import Note, Noted
from tca_wire.points import Moment, Point, TaskId
from tca_wire.text.waits_in_words import several_in_words, waiter_in_words
from tca_wire.vocabulary import MessageClass, Outcome
from tca_wire.waits import CommonEnd, WaitFor, WaitKind


def resource(told: dict[str, Any], module: str) -> dict[str, Any]:
    (found,) = [one for one in told["modules"] if one["module"] == module]
    first: dict[str, Any] = found["resources"][0]
    return first


def message(told: dict[str, Any], name: str) -> dict[str, Any]:
    (found,) = [one for one in told["messages"] if one["message"] == name]
    return dict(found)


def waits(told: dict[str, Any]) -> list[tuple[str, str, float]]:
    return [(waiter_in_words(one), several_in_words(one.waits), one.seconds) for one in told["waits"]]


def test_messages_are_counted_and_their_time_added_up() -> None:
    robot = Player.of("legs: command step", "user")
    for fails in (False, True):
        robot.task("user", "step")
        robot.tick(4.0)
        if fails:
            robot.fail("legs/1", "slip")
        else:
            robot.reply("legs/1", value=1)
    told = load(robot.central)
    assert message(told, "step") | {"class": ""} == {
        "message": "step", "class": "", "delivered": 2, "failed": 1, "dropped": 0, "waiting": 0,
    }  # fmt: skip
    assert (resource(told, "legs")["delivered"], resource(told, "legs")["busy"]) == (2, 10.0)  # 4 s, and 1 s to say so
    assert told["time"] == robot.time


def test_what_is_handled_now_counts_until_now() -> None:
    robot = Player.of("legs: command step", "user")
    step = robot.task("user", "step")
    robot.tick(2.5)
    legs = resource(load(robot.central), "legs")
    assert legs["handling"] == [{"id": step, "message": "step", "state": "", "seconds": 2.5}]
    assert legs["busy"] == 2.5


def test_the_time_of_a_module_that_is_lost_is_counted() -> None:
    robot = Player()
    robot.module("legs", "command step", capacity=2)
    robot.module("user")
    robot.task("user", "step")
    robot.lose("legs/1")
    assert resource(load(robot.central), "legs")["busy"] == 1.0
    assert message(load(robot.central), "step")["failed"] == 1


def test_the_longest_waits_come_first() -> None:
    robot = Player.of("legs: command step", "user: query where")
    robot.send("user", "where")  # its handler does not answer
    robot.module("other")
    robot.declare("other", "command dance")
    robot.task("other", "dance", flags=0)
    first, *_ = [robot.task("user", "step", flags=0) for _ in range(3)]
    robot.send("other", "where", origin=0, blocking=True)
    robot.tick(10.0)
    told = load(robot.central)
    assert waits(told) == [
        ("dance {2}", "for a module that handles dance", 14.0),
        (f"step {{{first + 1}}} and 1 more", f"for legs, busy with step {{{first}}}", 12.0),
        ("where {6}", "for user, busy with where {1}", 10.0),
        ("module other", "for the reply to where {6}, which is queued for user, busy with where {1}", 10.0),
    ]
    assert resource(told, "legs")["oldest"] == 12.0


def test_claims_and_who_holds_a_resource() -> None:
    robot = Player()
    robot.module("legs", "command step")
    for name in ("first", "second"):
        robot.module(name)
        robot.receive(name, headers.Lock(robot.number(name), "legs", blocking=True))
    robot.tick(3.0)
    told = load(robot.central)
    legs = resource(told, "legs")
    assert (legs["held_by"], legs["is_reserved"], legs["claims"]) == ("first", False, 1)
    assert waits(told) == [("module second", "for the lock of legs {2}, which first has locked", 3.0)]


def test_a_handler_that_waits_is_named_with_what_it_waits_for() -> None:
    robot = Player.of("planner: goal walk", "user")
    walk = robot.task("user", "walk")
    robot.declare("planner/1", "command dance")
    dance = robot.task("planner/1", "dance", under=walk)
    end = Point(TaskId(dance), Moment.END_ACHIEVING)
    robot.receive("planner/1", headers.AwaitPoint(robot.number("planner/1"), end, walk, blocking=True))
    robot.tick(1.0)
    told = load(robot.central)
    assert ("walk {1} in planner", "until dance {2} is achieved", 1.0) in waits(told)
    assert resource(told, "planner")["blocked"] == 1


def test_held_tasks_say_what_they_wait_for_the_longest_first() -> None:
    robot = Player.of("planner: goal walk", "legs: command step", "user")
    walk = robot.task("user", "walk")
    first = robot.task("planner/1", "step", under=walk)
    second = robot.task("planner/1", "step", under=walk, flags=Flags.SEQ_ACH)
    robot.tick(4.0)
    third = robot.task("planner/1", "step", under=walk, flags=Flags.SEQ_ACH)
    later = Point(TaskId(third), Moment.START_HANDLING)
    also = Constraint(Point(TaskId(first), Moment.END_ACHIEVING), later)
    robot.receive("planner/1", headers.Constrain(robot.number("planner/1"), [also]))
    told = load(robot.central)
    one, two = (WaitFor(WaitKind.CONSTRAINT, task, "step", Moment.END_ACHIEVING) for task in (first, second))
    assert [(held.number, held.waits) for held in told["held"]] == [(second, (one,)), (third, (two, one))]
    assert told["held"][0].seconds > told["held"][1].seconds
    end = WaitFor(WaitKind.RUNNING, first, "step", module="legs", resource="legs")
    assert [held.end for held in told["held"]] == [end, end]
    assert told["ends"] == [CommonEnd(2, end)]
    assert load(robot.central)["waits"] == told["waits"]  # they stand in no queue
    robot.reply("legs/1", value=1)
    assert [held.number for held in load(robot.central)["held"]] == [third]


def test_what_is_kept_from_its_end_is_held() -> None:
    robot = Player.of("planner: goal walk", "user")
    robot.declare("user", "command rest")
    walk, rest = robot.task("user", "walk"), robot.task("user", "rest", flags=0)
    last = Point(TaskId(walk), Moment.END_ACHIEVING)
    after = Constraint(Point(TaskId(rest), Moment.END_ACHIEVING), last)
    robot.receive("user", headers.Constrain(robot.number("user"), [after]))
    assert load(robot.central)["held"] == []  # it is still planned
    robot.reply("planner/1")
    (held,) = load(robot.central)["held"]
    assert (held.number, held.waits) == (walk, (WaitFor(WaitKind.CONSTRAINT, rest, "rest", Moment.END_ACHIEVING),))


def test_a_monitor_that_its_parent_waits_for_is_told() -> None:
    robot = Player.of("planner: goal walk", "map: query is low", "user")
    robot.declare("user", "inform warn")
    monitors = [
        MessageFormat(name, MessageClass.POLLING_MONITOR, ANY, "", ["is low", "warn"])
        for name in ("guard", "until low")
    ]
    robot.receive("user", headers.Register(robot.number("user"), monitors))
    walk = robot.task("user", "walk")
    robot.task("planner/1", "guard", under=walk, watch=WatchOptions(100.0))
    until_low = robot.task("planner/1", "until low", under=walk, watch=WatchOptions(100.0, maximum=1, waited_for=True))
    robot.reply("map/1", value=False)
    robot.reply("map/1", value=False)
    robot.reply("planner/1")
    (held,) = load(robot.central)["held"]
    assert (held.number, held.waits) == (until_low, (WaitFor(WaitKind.CONDITION, 0, "is low", holds=False),))


def test_what_is_suspended_and_held_is_told_once() -> None:
    robot = Player.of("legs: command step", "user")
    second = [robot.task("user", "step"), robot.task("user", "step")][1]
    robot.receive("user", headers.Suspend(robot.number("user"), TaskId(second)))
    told = load(robot.central)
    assert told["held"] == []
    assert [one.number for one in told["suspended"]] == [second]


def test_direct_messages_count_like_others() -> None:
    robot = Player()
    robot.module("map", "query where", direct=True)
    note = Note("where", "user", 0, 10, 0.0, 0.5, Outcome.DONE)
    robot.receive("map/1", Noted([note, note]))
    told = load(robot.central)
    assert message(told, "where")["delivered"] == 2
    assert (resource(told, "map")["delivered"], resource(told, "map")["busy"]) == (2, 1.0)


def test_suspended_tasks_say_since_when_the_longest_first() -> None:
    robot = Player.of("planner: goal walk", "legs: command step", "user")
    walk = robot.task("user", "walk")
    step = robot.task("planner/1", "step", under=walk)
    other = robot.task("user", "step", flags=0)

    def suspend(task: int, *, resume: bool = False) -> None:
        robot.receive("user", headers.Suspend(robot.number("user"), TaskId(task), resume))

    suspend(other)
    robot.tick(5.0)
    suspend(step)
    suspend(walk)
    suspend(walk)  # it is already
    robot.tick(1.0)
    told = load(robot.central)
    assert [one.number for one in told["suspended"]] == [other, walk]  # and all under it, for as long as it is
    assert [one.seconds for one in told["suspended"]] == [9.0, 2.0]
    since = robot.time - 2.0
    assert told["suspended"][1].waits == (WaitFor(WaitKind.RESUME, module="user", seconds=since),)
    assert told["totals"]["suspended"] == 2
    suspend(walk, resume=True)
    robot.receive("user", headers.Kill(robot.number("user"), TaskId(other), "enough"))
    told = load(robot.central)
    assert (told["suspended"], told["totals"]["suspended"], robot.central.tree.suspended) == ([], 0, {})


def test_what_only_a_suspended_parent_holds_is_held() -> None:
    robot = Player.of("planner: goal walk", "legs: command step", "user")
    walk = robot.task("user", "walk")
    robot.tick(7.0)
    robot.receive("user", headers.Suspend(robot.number("user"), TaskId(walk)))
    since = robot.time
    step, later = (robot.task("planner/1", "step", under=walk, flags=flags) for flags in (0, int(Flags.SEQ_ACH)))
    told = load(robot.central)
    resumed = WaitFor(WaitKind.RESUME, walk, "walk", module="user", seconds=since)
    assert [(one.number, resumed in one.waits) for one in told["held"]] == [(step, True), (later, True)]
    assert told["ends"] == [CommonEnd(2, resumed)]
    assert [one.number for one in told["suspended"]] == [walk]


def test_all_that_wait_and_are_held_and_suspended_are_counted_also_where_not_all_are_told() -> None:
    robot = Player()
    robot.module("user", "goal walk")
    robot.declare("user", "command step")
    for _ in range(SHOWN_WAITS + 20):
        robot.task("user", "step", flags=int(Flags.SEQ_ACH))
    for _ in range(SHOWN_WAITS + 10):
        suspended = robot.task("user", "step", flags=0)
        robot.receive("user", headers.Suspend(robot.number("user"), TaskId(suspended)))
    told = load(robot.central)
    assert (len(told["held"]), len(told["suspended"])) == (SHOWN_WAITS, SHOWN_WAITS)
    assert told["totals"] == {"waits": 1, "held": SHOWN_WAITS + 19, "suspended": SHOWN_WAITS + 10}
    assert told["looked_at"] == told["tasks"]


def test_killed_tasks_whose_handlers_still_run_say_what_these_wait_for() -> None:
    robot = Player.of("planner: goal walk", "user")
    walk = robot.task("user", "walk")
    robot.declare("planner/1", "query where", "multi-query heights")
    robot.send("planner/1", "where", origin=walk)
    assert load(robot.central)["killed"] == []
    robot.receive("user", headers.Kill(robot.number("user"), TaskId(walk), "enough"))
    (killed,) = load(robot.central)["killed"]
    assert (killed.number, killed.killed, killed.waits[0].module) == (walk, "enough (by user)", "planner")
    nobody = WaitFor(WaitKind.HANDLER, name="where")
    assert killed.waits[0].because == (WaitFor(WaitKind.REPLY, walk + 1, "where", because=(nobody,)),)
    robot.receive("planner/1", headers.WaitUntilHandled(robot.number("planner/1"), ["where"]))
    (killed,) = load(robot.central)["killed"]
    assert killed.waits[0].because == (WaitFor(WaitKind.PRESENCE, name="where"),)
    robot.reply("planner/1")
    assert load(robot.central)["killed"] == []
