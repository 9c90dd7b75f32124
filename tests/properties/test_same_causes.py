"""Central explains a wait from its graph, the tools from the journal. After every event of lives
full of monitors, central and the tools name the same cause first. Neither names a monitor that
holds no task.
"""

from collections.abc import Iterator

import pytest
from central.player import INTEGER, before, point
from central.test_oracle import NO_SMALLER_SEED
from hypothesis import example, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from properties.folded import FoldedPlayer
from properties.life import Life
from sampling import lives

from tca_central.core import Central
from tca_central.model.tasks import Task
from tca_central.needs.graph import Group, Node, Returning, Turn, needs
from tca_central.needs.waits import Ends as CentralEnds
from tca_central.needs.waits import next_of, waits_of
from tca_central.order.cycles import Place, predecessors
from tca_central.state import Collector
from tca_tools.explain.graph import Ends, next_node, waits_now
from tca_tools.explain.wait_words import named_waits
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.records import TaskState
from tca_wire.constraints import Flags
from tca_wire.packets import headers
from tca_wire.packets.parts import MessageFormat, WatchOptions
from tca_wire.points import END_ACHIEVING, END_HANDLING, ROOT, STARTS, Moment
from tca_wire.vocabulary import MessageClass, Role
from tca_wire.waits import WaitFor, WaitKind

OWN_WAITS = (WaitKind.CONDITION, WaitKind.RUNNING, WaitKind.DELAY)
"""Waits that no other task causes: for a condition, the own handler, or time."""
ENDS = END_HANDLING | END_ACHIEVING
WATCHING = WatchOptions(period=100, initial_wait=True)


class ComparingPlayer(FoldedPlayer):
    """A player that asks central and the tools after every event why each task waits."""

    def __init__(self) -> None:
        super().__init__()
        self.compared = self.idle_cases = 0

    def compare(self) -> None:
        at, last = RunAt(self.history), CentralEnds(self.central, 1_000_000)
        for task in self.central.tree.tasks.values():
            place = next_of(task)
            end = last.end_of(place)
            assert end is not None
            by_central, by_tools = (
                waits_of(self.central, place),
                named_waits(at, waits_now(at, task.id), any_outcome=True),
            )
            self.assert_causes(
                task,
                {wait.number for wait in (*by_central, end) if wait.kind is not WaitKind.RESUME},
            )
            ends = {
                one.number for one in Ends.at(at).of(task.id) if one.kind is not WaitKind.RESUME
            }
            self.assert_causes(
                task, ends | {wait.number for wait in by_tools if wait.kind is not WaitKind.RESUME}
            )
            is_told_alike = task.slot is None and task.queues is None and not task.suspended
            is_same_moment = (
                not place.moment & ENDS or next_node(at, task.id).moment == place.moment
            )
            if (
                is_told_alike
                and is_same_moment
                and at.tasks[task.id].state is not TaskState.RECOVERING
            ):
                self.assert_same(
                    task, causes(self.central, by_central), causes(self.central, by_tools)
                )

    def assert_same(self, task: Task, by_central: list[WaitFor], by_tools: list[WaitFor]) -> None:
        if by_central and by_tools:
            self.compared += 1
            assert first(by_central, task) == first(by_tools, task), (
                f"{task}: {by_central} and {by_tools}"
            )

    def assert_causes(self, task: Task, named: set[int]) -> None:
        """Assert that no named cause is an idle monitor under the task, or the query of such a
        monitor. Causes that ``awaited`` returns are exempt: a monitor that cannot begin may hold
        foreign tasks under it.
        """
        living = self.central.tree.tasks
        idle = [
            one
            for one in living.values()
            if is_idle(living, one) and one is not task and one.find_above(task.id)
        ]
        self.idle_cases += bool(idle)
        asked = [
            one.watch.condition
            for one in idle
            if one.watch is not None and one.watch.condition is not None
        ]
        wrong = named & {one.id for one in (*idle, *asked)}
        assert not wrong or wrong <= self.awaited(task), f"{task}: {wrong}"

    def awaited(self, task: Task) -> set[int]:
        """Return all direct and indirect causes of the wait of a task. The search does not go from
        a task to an idle monitor under it.
        """
        path: list[Node] = [next_of(task)]
        # The tools name all that a task waits for at its end, perhaps before it is handled.
        if (moment := next_node(RunAt(self.history), task.id).moment) & ENDS:
            path.append(Place(task, moment))
        seen = set(path)
        for node in path:  # grows while it is walked
            for one in (
                one for group in self.groups(node) for one in group or () if one not in seen
            ):
                if not (
                    isinstance(node, Place)
                    and isinstance(one, Place)
                    and self.is_via_idle_monitor(node, one)
                ):
                    path.append(one)
                    seen.add(one)
        found = (
            node.task if isinstance(node, Place) else getattr(node, "delivery", None)
            for node in path
        )
        return {one.message_id for one in found if one is not None}

    def groups(self, node: Node) -> Iterator[Group | None]:
        """Yield the needs of a node, and more that the tools name. A suspended task also waits for
        the predecessors of its start. A retried task also waits for constrained monitors under it.
        A handler also waits for a multi-query, which central's search for deadlocks leaves out.
        """
        yield from needs(self.central, node)
        if isinstance(node, Returning) and (slot := node.delivery.slot) is not None:
            for due in map(slot.outstanding.get, slot.unchecked_waits):
                copies = due.pending.values() if isinstance(due, Collector) else ()
                yield [Returning(one) if one.slot else Turn(one) for one in copies]
        if isinstance(node, Place) and (
            node.task.retry_pending or (node.task.suspended and node.moment & STARTS)
        ):
            before = predecessors(self.central.tree, node) if not node.task.killed else ()
            yield from ([one] for one in before if not one.task.reached & one.moment)

    def is_via_idle_monitor(self, node: Place, other: Place) -> bool:
        """Whether *other* belongs to an idle monitor under the task of *node*, and no constraint
        connects the two.
        """
        is_led = any(number == other.task.id for _, number, _ in node.task.leaders or ())
        is_under = other.task is not node.task and other.task.find_above(node.task.id) is not None
        return is_under and not is_led and is_idle(self.central.tree.tasks, other.task)


def is_idle(living: dict[int, Task], one: Task) -> bool:
    """Whether a background monitor ends with its last sibling: no constraint holds its end, except
    by the ends of its children.
    """
    if not one.is_background or one.parent is None or one.parent.id == ROOT:
        return False
    leaders = [
        (moment, living[number], moment_of_leader)
        for moment, number, moment_of_leader in one.leaders or ()
        if moment & ENDS and number in living
    ]
    return bool(one.killed) or all(
        leader is one
        or leader.reached & moment_of_leader
        or (leader.parent is one and moment == moment_of_leader)
        for moment, leader, moment_of_leader in leaders
    )


def causes(central: Central, waits: list[WaitFor]) -> list[WaitFor]:
    """Return the waits for other tasks, except for exception handlers."""
    living = central.tree.tasks
    deciding = {number for number, one in living.items() if one.role is Role.EXCEPTION}
    return [wait for wait in waits if wait.kind not in OWN_WAITS and wait.number not in deciding]


def first(waits: list[WaitFor], task: Task) -> int:
    """Return the oldest named cause. The parent counts only if it is the only cause, because a
    constraint may be named for the subtask or for the parent.
    """
    others = [
        wait for wait in waits if task.parent is None or wait.number != task.parent.id
    ] or waits
    return min(wait.number for wait in others)


class WatchedLife(Life):
    """A life with monitors under all tasks, constraints on them, retries and suspensions."""

    crowded = 25
    operations = (
        ["send"] * 8
        + ["monitor"] * 6
        + ["reply"] * 5
        + ["fire"] * 4
        + [
            "fail",
            "kill",
            "constrain",
            "constrain",
            "attach",
            "raise",
            "retry",
            "retry",
            "suspend",
            "suspend",
            "tap",
            "end monitor",
            "remove",
            "pass",
            "pass",
            "lock",
            "unclaim",
            "lose",
            "join",
            "join",
        ]
    )


def live(seed: int) -> ComparingPlayer:
    player = ComparingPlayer()
    WatchedLife(player).go_on(seed, 300)
    return player


@example(2_346_655_264)  # a constraint by the parent
@example(35_054_018)  # a foreign monitor was killed before the retry
@example(298_566_280)  # a retried monitor waits for a listener before it is handled again
@example(2_953_828_283)  # a constraint by a monitor under a retried task
@example(4_106_698_539)  # an exception handler decides on a suspended task before its start
@example(1_065_174_457)  # a task retried three times waits once for its subtasks
@example(4_026_247_230)  # a suspended task also waits for the start of its parent, a monitor
@example(13_327)  # the handler before a monitor's subtask sent a multi-query
@example(974)  # a monitor waits for a delay after the end of an idle monitor under it
@example(2_071_405)  # a failure of a task that has not begun, with a constraint on its end
@example(155)  # a retry policy spared a foreign monitor that had failed
@given(st.integers(0, 1 << 32))
@settings(max_examples=lives(2, soak=2_000), phases=NO_SMALLER_SEED)
def test_central_and_tools_name_the_same_first_cause(seed: int) -> None:
    live(seed)


def player_with_monitor() -> ComparingPlayer:
    player = ComparingPlayer.of("planner: goal walk", "legs: command move", "user: query where")
    watch = MessageFormat("watch", MessageClass.POLLING_MONITOR, INTEGER, "", ["where", ""])
    player.request("user", headers.Register, [watch])
    return player


@pytest.mark.parametrize("is_waited_for", [False, True])
def test_idle_child_is_no_cause_by_a_constraint_on_its_end(is_waited_for: bool) -> None:
    player = player_with_monitor()
    walk = player.task("user", "walk")
    move = player.task("user", "move", under=walk)
    held = replace(WATCHING, waited_for=is_waited_for)
    monitor = player.task("user", "watch", watch=held, under=walk, flags=Flags.NONE)
    child = player.task("user", "watch", watch=WATCHING, under=monitor)
    first, then = (point(one, Moment.END_ACHIEVING) for one in (child, monitor))
    player.request("user", headers.Constrain, [before(first, then, delay=2)])
    player.reply("planner/1")
    at = RunAt(player.history)
    named = {wait.number for wait in named_waits(at, waits_now(at, walk), any_outcome=True)}
    assert named == ({move, monitor} if is_waited_for else {move})
    assert child not in {end.number for end in Ends.at(at).of(walk)}


def test_child_is_a_cause_rather_than_the_monitor_it_holds() -> None:
    player = player_with_monitor()
    walk = player.task("user", "walk")
    monitor = player.task("user", "watch", watch=WATCHING, under=walk, flags=Flags.NONE)
    move = player.task("user", "move", under=monitor)
    first, then = (point(one, Moment.END_HANDLING) for one in (move, monitor))
    player.request("user", headers.Constrain, [before(first, then)])
    player.reply("planner/1")
    at = RunAt(player.history)
    assert [wait.on.number for wait in waits_now(at, walk)] == [move]
    assert [end.number for end in Ends.at(at).of(walk)] == [move]


def test_watched_life_compares_enough_waits() -> None:
    player = live(1)
    assert player.compared > 100
    assert player.idle_cases > 100
