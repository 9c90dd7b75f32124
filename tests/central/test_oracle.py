"""The oracle, a deliberately simple reference scheduler, agrees with central. Both let the same
deliveries start, in the same order.
"""

import random
from typing import Any

import msgspec
import pytest
from central.player import Player, before, point
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from properties.life import LENDING_OPERATIONS, MODULES, Life, Operations, operations
from properties.oracle import Oracle
from sampling import lives

from tca_central.events import ConfirmTasks, Effect, RequestReceived, Tick
from tca_central.outgoing.central_messages import suspend
from tca_wire.constraints import Flags
from tca_wire.journal.facts import Failed, Killed, Received, Retried
from tca_wire.messages.failures import LOCK_LOST
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment, RetryPolicy, WatchOptions
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Condition, Role

JUDGED = {
    "planner": ("goal walk", "goal step", "query where"),
    "legs": ("command move", "command lift", "inform note"),
    "map": ("query where", "multi-query all", "broadcast pose"),
    "expert": MODULES["expert"],
}
NO_SMALLER_SEED = (Phase.explicit, Phase.reuse, Phase.generate)
"""Shrinking is useless: a smaller seed gives no simpler life."""


class JudgedPlayer(Player):
    """A player whose events are all judged by the oracle."""

    def __init__(self) -> None:
        super().__init__()
        self.oracle = Oracle()

    def event(self, event: Any) -> list[Effect]:
        """Give each timer an event of its own while a deadlock is possible. Otherwise the oracle
        cannot tell the effects of a timer from those of a deadlock.
        """
        clock = self.central.clock
        header = event.header if isinstance(event, RequestReceived) else None
        begins_wait = isinstance(header, headers.AwaitPoint | headers.AwaitAny | headers.Await)
        while (
            (self.central.claims or self.central.blocked or begins_wait)
            and clock.next is not None
            and clock.next <= event.time
        ):
            self._judged(Tick(clock.next))
        return self._judged(event)

    def _judged(self, event: Any) -> list[Effect]:
        effects = super().event(event)
        self.oracle.judge(event, effects)
        return effects


class JudgedLife(Life):
    """A life without features that the oracle lacks: pending limits, variables, and timers due at
    the same time.
    """

    operations = LENDING_OPERATIONS
    modules = JUDGED
    messages = [message for handled in JUDGED.values() for message in handled] + ["command later"]
    pending = (0,)
    player_class = JudgedPlayer

    def __init__(self) -> None:
        self.timers = 0
        super().__init__(self.player_class())

    def seconds(self, number: int) -> float:
        self.timers += 1
        return number + random.Random(self.timers).random() if number else 0

    def do(self, name: str, a: int, b: int, c: int, d: int) -> None:
        if name != "set":
            super().do(name, a, b, c, d)


def test_retried_exception_handler_is_no_longer_spared() -> None:
    player = JudgedPlayer()
    player.module("legs", "command move", capacity=2)
    player.module("expert", "exception handler recover", capacity=2)
    player.module("user")
    player.declare("user", "command move", "command check")
    player.request("user", headers.Attach, Attachment("", "recover"))
    for slot in (1, 2):
        player.task("user", "move", flags=Flags.NONE)
        player.fail(f"legs/{slot}", "slipped")
    recovers = player.delivered("expert/2")[-1]
    player.receive("expert/2", headers.Bye())
    player.lose("expert")
    tapped = TaskId(recovers)  # no module handles the listener, so the task is not queued again
    player.request("user", headers.Tap, Condition.BEFORE_HANDLING, "check", "", tapped)
    assert recovers in player.central.tree.tasks
    player.request("user", headers.Retry, TaskId(recovers))
    assert recovers not in player.central.tree.tasks


def test_restarted_module_starts_its_own_sequence() -> None:
    player = JudgedPlayer.of("user")
    player.declare("user", "command nobody", "command move")
    player.task("user", "nobody")
    player.receive("user", headers.Bye())
    player.module("user")
    player.module("legs", "command move")
    player.task("user", "move", suspended=True)
    player.request("user", headers.Kill, TaskId(player.central.tree.newest))
    player.task("user", "move")
    assert player.delivered("legs/1") == [player.central.tree.newest]


def test_wiretaps_on_start_and_end_fire_in_oracle_order() -> None:
    player = JudgedLife().player
    for condition in (Condition.WHEN_ACHIEVED, Condition.WHILE_ACHIEVING):
        player.request(
            "user",
            headers.Tap,
            condition,
            "guard",
            "walk",
            body=msgspec.msgpack.encode(7),
            watch=WatchOptions(maximum=1),
        )
    task = player.task("user", "walk", flags=Flags.PLAN_FIRST)
    player.reply("planner1/1", task)
    assert [fact.message for fact in player.facts(Received) if fact.role is Role.LISTENER] == [
        "guard",
        "guard",
    ]


@pytest.mark.parametrize("is_ended", [False, True])
def test_monitor_that_ends_at_its_start_sends_its_listeners(is_ended: bool) -> None:
    player = JudgedLife().player
    for condition, listener in (
        (Condition.WHEN_ACHIEVED, "lift"),
        (Condition.WHILE_ACHIEVING, "guard"),
    ):
        player.request(
            "user", headers.Tap, condition, listener, "guard", body=msgspec.msgpack.encode(7)
        )
    past = player.task("user", "move")
    player.reply("legs2/1", past)
    options = WatchOptions() if is_ended else WatchOptions(until=point(past, Moment.END_ACHIEVING))
    guard = player.task("user", "guard", watch=options, suspended=True)
    if is_ended:
        player.request("user", headers.EndMonitor, TaskId(guard))
    player.request("user", headers.Suspend, TaskId(guard), resume=True)
    children = player.central.tree.tasks[guard].children or {}
    assert [child.message.name for child in children.values()] == ["lift", "guard"]


def with_two_handlers(module: str, message: str) -> tuple[JudgedPlayer, TaskId]:
    """Return a player, and a task that *module* handles. The task's exception handlers are
    *recover*, then *report*.
    """
    player = JudgedPlayer()
    player.module(module, message)
    player.module("expert", "exception handler recover", "exception handler report")
    player.module("user")
    player.declare("user", message)
    name = message.rsplit(maxsplit=1)[-1]
    for handler in ("report", "recover"):
        player.request("user", headers.Attach, Attachment("", handler), message=name)
    return player, TaskId(player.task("user", name))


def test_goal_stays_unplanned_while_exception_handlers_remain() -> None:
    player, task = with_two_handlers("planner", "goal walk")
    player.request("user", headers.Raise, task, "slipped")
    player.reply("planner/1", task)
    player.reply("expert/1")
    assert player.delivered("expert/1") == [player.central.tree.newest]
    assert not player.central.tree.tasks[task].reached & Moment.END_PLANNING


def test_retry_waits_for_remaining_exception_handlers() -> None:
    player, task = with_two_handlers("legs", "command move")
    player.request("user", headers.Retry, task)
    player.request("user", headers.Raise, task, "slipped")
    player.reply("legs/1")
    player.reply("expert/1")
    assert player.delivered("expert/1") == [player.central.tree.newest]
    assert not player.delivered("legs/1")
    player.resolve("expert/1")
    player.reply("expert/1")
    assert player.delivered("legs/1")


def test_suspended_monitor_can_be_ended_after_a_retry() -> None:
    player = JudgedLife().player
    guard = TaskId(player.task("user", "guard", watch=WatchOptions(), suspended=True))
    player.request("user", headers.Retry, guard)
    player.request("user", headers.EndMonitor, guard)
    player.request("user", headers.Suspend, guard, resume=True)
    assert guard not in player.central.tree.tasks


def test_newly_held_monitor_dies_when_all_else_has_ended() -> None:
    player = JudgedLife().player
    move = player.task("user", "move")
    held = before(point(move, Moment.END_ACHIEVING), point(-1, Moment.START_ACHIEVING))
    parent = TaskId(player.task("user", "guard", watch=WatchOptions(), constraints=(held,)))
    child = player.task("user", "guard", watch=WatchOptions(), under=parent)
    player.request("user", headers.EndMonitor, parent)
    assert child in player.central.tree.tasks
    second_constraint = before(
        point(move, Moment.END_ACHIEVING), point(child, Moment.START_ACHIEVING)
    )
    player.request("user", headers.Constrain, [second_constraint])
    assert child not in player.central.tree.tasks


@pytest.mark.parametrize("is_parent_first", [False, True])
def test_retried_monitor_with_listener_dies_when_all_else_ends(is_parent_first: bool) -> None:
    player = JudgedLife().player
    walk = player.task("user", "walk")
    guard = TaskId(player.task("user", "guard", watch=WatchOptions(), under=walk))
    set_up = player.central.tree.newest
    player.request(
        "user",
        headers.Tap,
        Condition.BEFORE_HANDLING,
        "lift",
        "guard",
        body=msgspec.msgpack.encode(7),
    )
    if is_parent_first:
        player.reply("planner1/1", walk)
    player.request("user", headers.Retry, guard)
    player.reply("legs2/1", set_up)
    if not is_parent_first:
        assert guard not in [fact.task for fact in player.facts(Killed)]
        player.reply("planner1/1", walk)
    assert guard in [fact.task for fact in player.facts(Killed)]


def test_timers_due_together_ring_in_the_order_they_were_set() -> None:
    player = JudgedLife().player
    busy, _, first, _ = [
        player.task("user", "move", flags=Flags.NONE, priority=urgent) for urgent in (0, 0, 0, 1)
    ]
    watch = WatchOptions(period=10, initial_wait=True, duration=5, waited_for=True)
    player.request("user", headers.Tap, Condition.BEFORE_HANDLING, "watch", "move", watch=watch)
    player.reply("legs2/1", busy)
    assert not player.delivered("legs2/1")
    player.tick(6)
    assert player.delivered("legs2/1") == [first]


def test_task_resumed_in_the_same_event_keeps_its_place() -> None:
    player = Player.of("legs: command move", "user")
    _, second, _ = (player.task("user", "move", flags=Flags.NONE) for _ in range(3))
    task = player.central.tree.tasks[TaskId(second)]
    for resume in (False, True):  # in one event, like a kill of an ancestor
        suspend(player.central, task, resume=resume)
    player.event(ConfirmTasks(player.time))
    player.reply("legs/1")
    assert task.slot is not None


def test_lost_lock_is_reported_after_wiretaps_of_the_return() -> None:
    player = JudgedPlayer()
    player.module("legs", "command move", "inform note", capacity=2)
    player.module("arm", "command lift")
    player.module("user")
    player.declare("user", "command move")
    player.request("user", headers.Tap, Condition.AFTER_HANDLED, "note", "move")
    task = player.task("user", "move")
    player.request("legs/1", headers.Lock, "arm", origin=task)
    player.lose("arm/1")
    player.lose("arm")
    player.reply("legs/1")
    assert player.facts(Failed)[-1].failure == LOCK_LOST
    assert len(player.delivered("legs/2")) == 1


def test_query_of_a_free_slot_to_itself_keeps_the_slot() -> None:
    player = JudgedPlayer.of("planner: query where", "user")
    player.request("user", headers.Lock, "planner", "planner", reserve=True)
    player.send("planner/1", "where", blocking=True)
    player.send("user", "where")
    player.send("user", "where")
    own, first = player.delivered("planner/1")
    player.reply("planner/1", first)
    assert player.delivered("planner/1") == [own]
    player.reply("planner/1", own)
    assert len(player.delivered("planner/1")) == 1


def test_slot_without_handler_is_not_lent() -> None:
    player = JudgedPlayer.of("arm: command lift", "user")
    player.task("user", "lift")
    player.module("legs", "command lift")
    top = player.task("user", "lift", flags=Flags.NONE)
    player.task("user", "lift", under=top)
    player.receive("legs", headers.Bye())
    player.receive("legs/1", headers.Postpone(top, False))
    assert player.delivered("legs/1") == [top]


def test_slot_is_lent_after_its_place_was_passed_on_twice() -> None:
    player = JudgedPlayer.of("planner: goal walk", "user")
    top = player.task("user", "walk")
    for task in (top, top + 1):
        player.receive("planner/1", headers.Postpone(task, False))
        player.task("planner/1", "walk", under=task)
    player.reply("planner/1", top)
    waiting = player.task("planner/1", "walk", under=top + 1)
    player.reply("planner/1", top + 2)
    assert waiting in player.delivered("planner/1")


def test_slot_is_lent_for_the_wait_of_a_program_with_a_lock() -> None:
    player = JudgedPlayer.of("legs: command move", "arm: command lift", "user")
    player.declare("user", "command move")
    player.request("user", headers.Lock, "arm")
    first, second = (player.task("user", "move", flags=Flags.NONE) for _ in range(2))
    player.request("user", headers.AwaitPoint, point(second, Moment.END_ACHIEVING), blocking=True)
    player.request("legs/1", headers.Lock, "arm", origin=first, blocking=True)
    assert player.delivered("legs/1") == [first, second]


def test_retried_task_is_lent_the_slot_before_less_urgent_ones() -> None:
    player = JudgedPlayer.of("planner: goal walk", "user")
    top = player.task("user", "walk")
    player.receive("planner/1", headers.Postpone(top, False))
    first, second = (
        player.task("user", "walk", under=top, flags=Flags.NONE, priority=urgent)
        for urgent in (1, 0)
    )
    player.request("user", headers.Retry, TaskId(first))
    player.reply("planner/1", first)
    _, again = player.delivered("planner/1")
    player.reply("planner/1", again)
    assert player.delivered("planner/1") == [top, second]


def test_kill_by_a_start_precedes_a_lent_slot() -> None:
    player = JudgedPlayer.of("planner: goal walk", "arm: command lift", "user")
    top = player.task("user", "walk")
    player.receive("planner/1", headers.Postpone(top, False))
    first, second = (player.task("user", "walk", under=top, flags=Flags.NONE) for _ in range(2))
    then = before(point(first, Moment.END_ACHIEVING), point(-1, Moment.START_ACHIEVING))
    lift = player.task("user", "lift", flags=Flags.NONE, constraints=(then,))
    after = point(lift, Moment.START_HANDLING)
    player.request("user", headers.Kill, TaskId(second), after=after)
    player.reply("planner/1", first)
    assert second not in player.central.tree.tasks


def test_newer_wait_of_coroutine_replaces_the_older() -> None:
    player = JudgedPlayer.of("planner: goal walk, command lift", "legs: command move", "user")
    walk = player.task("user", "walk")
    below = player.task("user", "move", under=walk)
    for moment in (Moment.END_ACHIEVING, Moment.END_PLANNING):  # the second is reached already
        player.request("planner/1", headers.AwaitPoint, point(below, moment), walk)
        player.receive("planner/1", headers.AwaitAny(walk, [player.numbers["planner/1"]]))
    player.task("user", "lift", under=below)
    assert player.delivered("planner/1") == [walk]


def test_planned_kill_precedes_the_next_fallback() -> None:
    player = JudgedPlayer.of("legs: command move", "arm: command lift", "user")
    player.task("user", "lift")
    once = RetryPolicy(attempts=1, fallback="lift")
    task = TaskId(player.task("user", "move", flags=Flags.NONE, retry=once))
    player.fail("legs/1", "slipped")
    fallback = player.central.tree.newest
    player.request("user", headers.Raise, task, "slipped")
    after = point(fallback, Moment.START_HANDLING)
    player.request("user", headers.Kill, task, after=after)
    player.request("user", headers.Kill, TaskId(fallback))
    assert task not in player.central.tree.tasks


def test_fallback_that_reissued_is_killed_with_its_task() -> None:
    player = JudgedPlayer.of("planner: goal walk", "legs: command move", "arm: command lift")
    player.declare("arm", "goal walk", "command move", "command nobody")
    walk = player.task("arm", "walk", retry=RetryPolicy(attempts=2))
    task = player.task("arm", "move", under=walk, retry=RetryPolicy(attempts=1, fallback="lift"))
    player.fail("legs/1", "slipped")
    fallback = player.central.tree.newest
    player.task("arm", "nobody", under=fallback, origin=0)
    player.fail("arm/1", "slipped", fallback, reissue=True)
    assert not {task, fallback} & player.central.tree.tasks.keys()


def test_retry_is_pending_while_stranded_handlers_are_skipped() -> None:
    player = JudgedLife().player
    player.module("arm", "command lift")
    player.request("user", headers.Attach, Attachment("", "recover"), message="lift")
    move = TaskId(player.task("user", "move", retry=RetryPolicy(attempts=1)))
    options = WatchOptions(period=100, initial_wait=True)
    foreign = player.task("user", "watch", watch=options, under=move)
    player.task("user", "lift", under=foreign)
    player.request("user", headers.Suspend, move)
    player.fail("arm/1", "slipped")
    player.receive("expert4", headers.Unregister(player.number("expert4"), ["recover"]))
    player.request("user", headers.Retry, move)
    player.reply("legs2/1")
    player.request("user", headers.Suspend, move, resume=True)
    assert [fact.by for fact in player.facts(Retried)] == ["user", "central"]
    assert player.delivered("legs2/2")


def test_handlers_resumed_together_start_before_a_monitor() -> None:
    player = JudgedLife().player
    options = WatchOptions(period=100, initial_wait=True)
    watch = TaskId(player.task("user", "watch", watch=options, suspended=True))
    player.request("user", headers.Attach, Attachment("", "recover"), watch)
    player.request("user", headers.Raise, watch, "slipped")
    recover = TaskId(player.central.tree.newest)
    player.request("user", headers.Raise, recover, "slipped")
    second = player.central.tree.newest
    until = WatchOptions(until=point(second, Moment.START_PLANNING))
    guard = player.task("user", "guard", watch=until, under=recover)
    player.request("user", headers.Kill, watch)
    assert guard not in player.central.tree.tasks


@pytest.mark.parametrize("is_retried", [False, True])
def test_queued_handling_has_its_number_already(is_retried: bool) -> None:
    player = JudgedLife().player
    player.module("arm", "command lift")
    busy = player.task("user", "lift", flags=Flags.NONE)
    lift = TaskId(player.task("user", "lift", flags=Flags.NONE))
    if is_retried:
        player.reply("arm/1", busy)
        player.request("user", headers.Retry, lift)
        player.task("user", "lift", flags=Flags.NONE, priority=1)
        player.reply("arm/1")
    own = player.central.tree.tasks[lift].handling_id
    guard = player.task("user", "guard", watch=WatchOptions(), under=lift, origin=own)
    player.reply("arm/1")
    assert player.delivered("arm/1") == [own]
    player.request("user", headers.Retry, lift)
    assert guard in [fact.task for fact in player.facts(Killed)]


@given(operations)
@settings(max_examples=45)
def test_oracle_agrees_with_central_in_short_lives(taken: Operations) -> None:
    JudgedLife().live(taken)


@given(st.integers(0, 1 << 32))
@settings(max_examples=lives(2, soak=30), phases=NO_SMALLER_SEED)
def test_oracle_agrees_with_central_in_long_lives(seed: int) -> None:
    JudgedLife().go_on(seed, lives(400, soak=10_000))
