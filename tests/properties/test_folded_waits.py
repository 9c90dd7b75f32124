"""The fold of the journal equals the live tree. The waits that the tools find in the journal equal
those of central's graph of needs. Both hold for each moment of each living task, after each event
of random lives.
"""

from collections.abc import Iterable

import pytest
from central.player import INTEGER, before, point
from hypothesis import example, given, settings
from hypothesis import strategies as st
from properties.blocking import Blocking, Steps
from properties.folded import FoldedPlayer
from properties.life import Life, Operations, operations
from properties.test_deadlocks import steps as blocking_steps
from sampling import lives

from tca_central.core import Central
from tca_central.model.tasks import Task
from tca_central.needs.graph import needs
from tca_central.needs.waits import Ends as CentralEnds
from tca_central.needs.waits import next_of
from tca_central.needs.waits import waits_of as told_by_central
from tca_central.order.cycles import Place
from tca_tools.explain.graph import Ends, awaited_nodes, blocking_waits, next_node
from tca_tools.explain.wait_words import reasons
from tca_tools.explain.waits import Node, waits_of
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fold import History
from tca_wire.constraints import Flags
from tca_wire.journal.facts import Caught
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment, MessageFormat, RetryPolicy, WatchOptions
from tca_wire.points import (
    ALL_MOMENTS,
    END_ACHIEVING,
    END_HANDLING,
    END_PLANNING,
    MOMENTS,
    ROOT,
    Moment,
    TaskId,
)
from tca_wire.text.waits_in_words import several_in_words
from tca_wire.vocabulary import Condition, MessageClass
from tca_wire.waits import NAMED, WaitKind

ENDS = END_HANDLING | END_PLANNING | END_ACHIEVING
"""The moments that are compared. For a start only the task is compared: the tools name the
constraint's moment, central the moment that decides the start.
"""
OF_TASKS = {WaitKind.CONSTRAINT, WaitKind.PARENT, WaitKind.SUBTASK, WaitKind.LISTENER}


class LivePlayer(FoldedPlayer):
    """A player that checks that the fold equals the live tree."""

    def compare(self) -> None:
        assert_tree(self.central, self.history)


class ComparedPlayer(LivePlayer):
    """A player that compares the waits of central and the tools after every event."""

    def __init__(self) -> None:
        super().__init__()
        self.compared = 0

    def compare(self) -> None:
        super().compare()
        at = RunAt(self.history)
        for task in self.central.tree.tasks.values():
            for moment in MOMENTS:
                if not task.reached & moment:
                    self.compared += 1
                    assert_same(self.central, at, task, int(moment))
            if not task.is_running:
                assert reasons(at, at.tasks[task.id]), f"{task} has no reason to wait"
            assert_ends(at, task.id)


def assert_same(central: Central, at: RunAt, task: Task, moment: int) -> None:
    """Compare the points of other tasks that must come before *moment*. For a suspended task the
    tools also name its constraints.
    """
    true = foreign_needs(central, task, moment)
    kept = blocking_waits(at, Node(task.id, moment))
    named, recovery = (
        {(one.on.number, one.on.moment & ENDS) for one in kept if one.kind in kinds}
        for kinds in (OF_TASKS, {WaitKind.RECOVERY})
    )
    for points in (true, named):
        points.difference_update(planned(points))
    extra = named - true - planned(recovery) if not task.suspended else set()
    # Central needs the end of a listener before a retry; the tools name the earlier moment.
    if task.retry_pending:
        extra -= {(number, END_HANDLING) for number, last in true if last == END_ACHIEVING}
    assert not extra, f"{task} before {moment}: {extra}"
    assert true <= named | recovery, f"{task} before {moment}: {true - named - recovery}"


def planned(points: set[tuple[int, int]]) -> set[tuple[int, int]]:
    """Return the end of planning for each end of achieving among *points*. It comes before that
    end.
    """
    return {(number, END_PLANNING) for number, last in points if last == END_ACHIEVING}


def foreign_needs(central: Central, task: Task, moment: int) -> set[tuple[int, int]]:
    """Return the points of other tasks that a moment needs according to central, directly or
    through the task's own moments. Groups of alternatives are left out, because no journal has the
    end of a monitor.
    """
    path, found = [Place(task, moment)], set[tuple[int, int]]()
    for place in path:  # grows while it is walked
        needed = [group[0] for group in needs(central, place) if group and len(group) == 1]
        for node in (node for node in needed if isinstance(node, Place)):
            if node.task is not task:
                found.add((node.task.id, int(node.moment) & ENDS))
            elif node not in path:
                path.append(node)
    return found


def assert_ends(at: RunAt, number: int) -> None:
    """Assert that the ends are the reachable nodes without a further wait. If there are none, the
    ends are circles.
    """
    path = reached(at, [next_node(at, number)])
    last = {
        node.number for node in path if awaited_nodes(at, node)[1] or not awaited_nodes(at, node)[0]
    }
    found = Ends.at(at).of(number)
    assert {end.number for end in found if end.kind is not WaitKind.CIRCLE} == last
    assert list(found) == sorted(set(found))


def reached(at: RunAt, start: Iterable[Node]) -> set[Node]:
    """Return all nodes to which the waits lead."""
    path = list(start)
    seen = set(path)
    for node in path:  # grows while it is walked
        new = [one for one in awaited_nodes(at, node)[0] if one not in seen]
        path += new
        seen.update(new)
    return seen


def assert_lists(history: History) -> None:
    """Assert that at each tried instant, the wait lists contain what holds the task then."""
    for time in history.times[:: max(len(history.times) // 20, 1)]:
        at = RunAt(history, time)
        for number, task in at.tasks.items():
            named = {one.on for one in waits_of(history, number) if one.start <= time < one.end}
            node = next_node(at, number)
            assert {one.on for one in blocking_waits(at, node)} <= named, (time, str(task))


@given(operations)
@settings(max_examples=lives(20, soak=500))
def test_tool_waits_match_needs_graph(taken: Operations) -> None:
    player = ComparedPlayer()
    Life(player).live(taken)
    assert_lists(player.history)


@given(st.integers(0, 1 << 32))
@example(2625034)  # a listener of a task that had returned before it was retried
@settings(max_examples=lives(1, soak=75))
def test_tool_waits_match_needs_graph_in_long_life(seed: int) -> None:
    player = ComparedPlayer()
    Life(player).go_on(seed, 300)
    assert player.compared > 100
    assert_lists(player.history)


@given(st.integers(0, 1 << 32))
@example(122582)  # a failure is raised on a retried task whose handler then fails
@settings(max_examples=lives(1, soak=24))
def test_folded_journal_matches_live_tree_in_long_life(seed: int) -> None:
    Life(LivePlayer()).go_on(seed, lives(1_000, soak=5_000))


def assert_tree(central: Central, history: History) -> None:
    live = central.tree.tasks
    unended = {task.id for task in history.tasks.values() if sum(task.reached) != ALL_MOMENTS}
    assert unended == set(live)
    for task_id, task in live.items():
        folded = history.tasks[task_id]
        assert sum(folded.reached) == task.reached
        assert folded.parent == (task.parent.id if task.parent else ROOT)
        assert (folded.why_killed or "") == task.killed
        assert task.killed or bool(folded.suspension) == task.suspended
        assert bool(folded.handling) == task.is_running
        if (
            folded.parent != ROOT and not task.killed and not task.retry_pending
        ):  # a top-level task has failures of its subtasks, too
            assert folded.failure.partition(":")[0] == (task.failure[0] if task.failure else "")
            assert not task.failure or folded.is_dealt_with == task.is_dealt_with
        assert folded.is_queued == (task.queues is not None)
        assert {child for child in folded.children if child in live} == set(task.children or {})
    attended = {delivery.message_id for delivery in central.dispatcher.running.values()}
    assert {
        handling.message_id for handling in history.handlings if handling.end is None
    } == attended


def test_retried_task_is_queued_in_folded_history() -> None:
    player = LivePlayer()
    player.module("legs", "command move")
    player.module("user")
    player.declare("user", "command move")
    first = player.task("user", "move")
    player.send("user", "move", flags=Flags.NONE, priority=1)
    player.request("user", headers.Retry, TaskId(first))
    player.reply("legs/1")
    assert player.history.tasks[TaskId(first)].is_queued


@pytest.mark.parametrize("later", [True, False])
def test_fallback_resolves_the_failure_that_planned_it(*, later: bool) -> None:
    player = LivePlayer()
    player.module("legs", "goal walk", "command move", "command lift", capacity=3)
    player.module("expert", "exception handler recover")
    player.module("user")
    player.declare("user", "goal walk", "command move", "command lift", "exception handler recover")
    walk = player.task("user", "walk")
    policy = RetryPolicy(attempts=1, failures=["slip", "stumble"], fallback="lift")
    move = TaskId(player.task("legs", "move", under=walk, retry=policy))
    player.request("user", headers.Attach, Attachment("", "recover"), task=move)
    if later:  # the policy also deals with the other failure
        player.request("user", headers.Raise, move, "slip")
        player.request("user", headers.Raise, move, "stumble")
        player.reply("legs/2")
    else:  # an exception handler leaves the other failure undecided
        player.request("user", headers.Raise, move, "burn")
        player.fail("legs/2", "slip")
        player.fail("expert/1", "burn", reissue=True)
    assert player.facts(Caught)[-1].attachment == 0
    failure = player.central.tree.tasks[move].failure
    assert failure is not None
    assert (failure[0], player.history.tasks[move].failure.name) == ("slip", "slip")


@pytest.fixture
def player() -> ComparedPlayer:
    """Legs with two slots handle move, lift and walk; step and later have no handler."""
    player = ComparedPlayer()
    player.module("legs", "command move", "command lift", "goal walk", capacity=2)
    player.module("expert", "exception handler recover", capacity=2)
    player.module("user")
    player.declare(
        "user",
        "command move",
        "command lift",
        "goal walk",
        "command later",
        "goal step",
        "inform note",
    )
    guard = MessageFormat("guard", MessageClass.DEMON_MONITOR, INTEGER, "", ["", "note", ""])
    player.request("user", headers.Register, [guard])
    return player


def retry(player: ComparedPlayer, task: int) -> None:
    player.request("user", headers.Retry, TaskId(task))


def test_task_killed_before_retry_does_not_wait_for_subtasks(
    player: ComparedPlayer,
) -> None:
    move = player.task("user", "move")
    player.send("user", "lift", under=move, when_killed=True)
    retry(player, move)
    player.request("user", headers.Kill, TaskId(move))
    assert len(player.central.tree.tasks) == 2


def test_retried_task_does_not_wait_for_foreign_monitor(
    player: ComparedPlayer,
) -> None:
    move = player.task("user", "move")
    retry(player, move)
    player.send("user", "guard", under=move, origin=0, watch=WatchOptions())
    assert len(player.central.tree.tasks) == 2


def test_retried_task_waits_for_running_setup_of_killed_monitor(
    player: ComparedPlayer,
) -> None:
    player.module("arm", "command grip")
    careful = MessageFormat(
        "careful", MessageClass.DEMON_MONITOR, INTEGER, "", ["grip", "note", ""]
    )
    player.request("user", headers.Register, [careful])
    move = player.task("user", "move")
    player.task("legs/1", "careful", under=move, watch=WatchOptions())
    retry(player, move)
    assert len(player.central.tree.tasks) == 3


def test_immediately_retried_task_does_not_wait_for_new_subtask(
    player: ComparedPlayer,
) -> None:
    walk = player.task("user", "walk")
    player.task("user", "step", under=walk)
    player.reply("legs/1")
    retry(player, walk)
    player.task("user", "later", under=walk)
    assert len(player.central.tree.tasks) == 2


def test_task_queued_for_retry_does_not_wait_for_new_subtask(
    player: ComparedPlayer,
) -> None:
    walk = player.task("user", "walk")
    player.task("user", "move", flags=Flags.NONE)  # takes the other slot
    player.task("user", "lift", flags=Flags.NONE)  # is queued
    player.task("user", "step", under=walk)
    player.reply("legs/1")
    retry(player, walk)
    assert player.history.tasks[TaskId(walk)].is_queued
    player.task("user", "later", under=walk)


def test_retried_monitor_waits_for_its_earlier_setup(player: ComparedPlayer) -> None:
    guard = MessageFormat("careful", MessageClass.DEMON_MONITOR, INTEGER, "", ["move", "note", ""])
    player.request("user", headers.Register, [guard])
    careful = player.task("user", "careful", watch=WatchOptions())
    retry(player, careful)
    player.reply("legs/1")
    assert len(player.central.tree.tasks) == 2
    player.reply("legs/2")
    retry(player, careful)  # restarts at once


def test_suspended_monitor_on_retry_waits_for_exception_handler(
    player: ComparedPlayer,
) -> None:
    player.request("user", headers.Attach, Attachment("", "recover"))
    guard = TaskId(player.task("user", "guard", watch=WatchOptions()))
    player.request("user", headers.Raise, guard, "cold")
    player.request("user", headers.Suspend, guard)
    player.request("expert/1", headers.Retry, guard)
    player.request("user", headers.Raise, guard, "cold")
    player.reply("expert/1")
    assert player.central.tree.tasks[guard].retry_pending
    player.request("user", headers.Suspend, guard, resume=True)
    player.resolve("expert/2")
    player.reply("expert/2")
    assert not player.central.tree.tasks[guard].retry_pending


def test_retried_task_does_not_wait_for_ended_exception_handler(
    player: ComparedPlayer,
) -> None:
    player.request("user", headers.Attach, Attachment("", "recover"))
    walk = player.task("user", "walk")
    move = player.task("user", "move", under=walk)
    player.request("user", headers.Raise, TaskId(move), "cold")
    player.request("expert/1", headers.Retry, TaskId(walk))
    player.reply("expert/1")
    player.tick(1)
    assert_lists(player.history)


@pytest.mark.parametrize("is_later", [False, True])
def test_retry_spares_killed_foreign_monitor(player: ComparedPlayer, is_later: bool) -> None:
    careful = MessageFormat(
        "careful", MessageClass.DEMON_MONITOR, INTEGER, "", ["move", "note", ""]
    )
    player.request("user", headers.Register, [careful])
    guard = player.task("user", "guard", watch=WatchOptions(waited_for=True))
    spared = player.task("user", "careful", under=guard, origin=0, watch=WatchOptions())
    if is_later:
        retry(player, guard)
    player.request("user", headers.Kill, TaskId(spared))
    if not is_later:
        player.task(
            "user", "move", under=guard, flags=Flags.NONE
        )  # the only task that the retry waits for
        retry(player, guard)
    player.task("user", "later", under=guard)
    assert player.central.tree.tasks[TaskId(spared)].killed


def test_retry_spares_monitor_of_wiretap_not_met_again(
    player: ComparedPlayer,
) -> None:
    player.request("user", headers.Tap, Condition.WHILE_ACHIEVING, "guard", "walk")
    walk = player.task("user", "walk")
    retry(player, walk)
    assert len(player.central.tree.tasks) == 2


def test_task_handled_again_waits_for_listener_before_handling(
    player: ComparedPlayer,
) -> None:
    move = TaskId(player.task("user", "move"))
    player.request("user", headers.Tap, Condition.BEFORE_HANDLING, "lift", task=move)
    player.task("user", "move", flags=Flags.NONE)  # takes the other slot
    player.receive("legs/1", headers.Bye())
    assert len(player.central.tree.tasks) == 3


def test_task_waits_for_constrained_monitor_alone(player: ComparedPlayer) -> None:
    walk = player.task("user", "walk")
    guard = player.task("user", "guard", under=walk, watch=WatchOptions())
    player.task("user", "later", under=guard)
    later = player.task("user", "later", flags=Flags.NONE)
    after = before(point(later, Moment.END_ACHIEVING), point(guard, Moment.END_ACHIEVING))
    player.request("user", headers.Constrain, [after])
    assert len(player.central.tree.tasks) == 4


def test_constraint_on_end_handling_holds_monitor(player: ComparedPlayer) -> None:
    walk = player.task("user", "walk")
    guard = player.task("user", "guard", under=walk, watch=WatchOptions())
    later = player.task("user", "later", flags=Flags.NONE)
    after = before(point(later, Moment.END_HANDLING), point(guard, Moment.END_HANDLING))
    player.request("user", headers.Constrain, [after])


def test_killed_task_does_not_wait_for_planning_of_subtasks(player: ComparedPlayer) -> None:
    walk = player.task("user", "walk")
    for message in ("step", "later"):
        player.send("user", message, under=walk, when_killed=True)
    player.task("user", "step", under=walk)
    player.reply("legs/1")
    player.request("user", headers.Kill, TaskId(walk))
    assert len(player.central.tree.tasks) == 3


def test_failed_task_waits_until_exception_handler_is_achieved(
    player: ComparedPlayer,
) -> None:
    attachment = Attachment("", "recover")
    player.request("user", headers.Attach, attachment)
    player.task("user", "walk")
    player.fail("legs/1", "slipped")
    player.task("expert/1", "step", under=player.delivered("expert/1")[0])
    player.fail("expert/1", "lost")
    assert len(player.central.tree.tasks) == 4


def test_failed_task_waits_for_handler_of_its_own_failure(
    player: ComparedPlayer,
) -> None:
    player.request("user", headers.Attach, Attachment("", "recover"))
    walk = player.task("user", "walk")
    player.fail("legs/1", "slipped")
    player.request("user", headers.Raise, TaskId(walk), "cold")
    assert player.history.tasks[TaskId(walk)].is_recovering
    player.resolve("expert/2")
    player.reply("expert/2")  # handles the raised failure
    assert player.history.tasks[TaskId(walk)].is_recovering
    player.resolve("expert/1")
    player.reply("expert/1")
    assert not player.central.tree.tasks


def test_retried_task_ends_recovery_with_its_exception_handler(
    player: ComparedPlayer,
) -> None:
    player.request("user", headers.Attach, Attachment("", "recover"))
    walk = player.task("user", "walk")
    retry(player, walk)
    player.request("user", headers.Raise, TaskId(walk), "cold")
    assert player.history.tasks[TaskId(walk)].is_recovering
    player.reply("expert/1")
    assert not player.history.tasks[TaskId(walk)].is_recovering


def test_killed_task_is_not_held_by_plan_first(
    player: ComparedPlayer,
) -> None:
    walk = player.task("user", "walk", flags=Flags.PLAN_FIRST)
    player.send("user", "step", under=walk, when_killed=True)
    player.request("user", headers.Kill, TaskId(walk))


class ComparedBlocking(Blocking):
    def compare(self) -> None:
        ends = CentralEnds(self.central, 100_000)
        for task in self.central.tree.tasks.values():
            place = next_of(task)
            named = told_by_central(self.central, place)
            assert not named or several_in_words(named)
            assert ends.end_of(place) is not None
            if task.slot is None and task.queues is None:
                self.compare_with_graph(
                    place, {wait.number for wait in named}, sum(wait.more for wait in named)
                )
                assert named or not self.awaited(place)

    def compare_with_graph(self, place: Place, named: set[int], more: int) -> None:
        awaited = self.awaited(place)
        suspended = set(self.central.tree.suspended)
        assert named - {0} <= awaited | suspended
        assert awaited <= named or (more and len(named) >= NAMED), (
            f"{place}: {awaited} and not {named}"
        )

    def awaited(self, place: Place) -> set[int]:
        """Return the other tasks that the graph names, through the points of the task itself."""
        places, found = [place], set[int]()
        for own in places:  # grows while it is walked
            for one in (one for group in needs(self.central, own) for one in group or ()):
                if isinstance(one, Place) and one.task is not place.task:
                    found.add(one.task.id)
                elif isinstance(one, Place) and one not in places:
                    places.append(one)
        return found


@given(blocking_steps)
@settings(max_examples=lives(20, soak=500))
def test_waits_of_central_match_its_needs_graph(taken: Steps) -> None:
    life = ComparedBlocking(looks=True)
    for step in taken:
        life.do(*step)
        life.compare()
