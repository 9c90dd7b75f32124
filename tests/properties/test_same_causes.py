"""Central tells why a task waits of its graph, the tools of the journal. After every event of lives
that are full of monitors neither names what keeps nobody as a cause, and both name the same one
first.
"""

from collections.abc import Iterator

from central.test_oracle import NO_SMALLER_SEED
from hypothesis import example, given, settings
from hypothesis import strategies as st
from properties.folded import FoldedPlayer
from properties.life import Life
from sampling import lives

from tca_central.core import Central
from tca_central.model.tasks import Task
from tca_central.needs.graph import Group, Node, needs
from tca_central.needs.waits import Ends as CentralEnds
from tca_central.needs.waits import next_of, waits_of
from tca_central.order.cycles import Place, predecessors
from tca_tools.explain.graph import Ends, next_node, waits_now
from tca_tools.explain.wait_words import told
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.records import TaskState
from tca_wire.points import END_ACHIEVING, END_HANDLING, ROOT, STARTS
from tca_wire.vocabulary import Role
from tca_wire.waits import WaitFor, WaitKind

ITS_OWN = (WaitKind.CONDITION, WaitKind.RUNNING, WaitKind.DELAY)
"""No other task is the cause: it watches, its handler is at work, time has to pass."""
ENDS = END_HANDLING | END_ACHIEVING


class AskedPlayer(FoldedPlayer):
    """After every event central and the tools are asked why each task waits."""

    def __init__(self) -> None:
        super().__init__()
        self.same = self.spared = 0

    def compare(self) -> None:
        at, last = RunAt(self.history), CentralEnds(self.central, 1_000_000)
        for task in self.central.tree.tasks.values():
            place = next_of(task)
            end = last.end_of(place)
            assert end is not None
            by_central, by_tools = (
                waits_of(self.central, place),
                told(at, waits_now(at, task.id), however=True),
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
            self.same += 1
            assert first(by_central, task) == first(by_tools, task), (
                f"{task}: {by_central} and {by_tools}"
            )

    def assert_causes(self, task: Task, named: set[int]) -> None:
        """None of those named is a monitor under the task that keeps nobody, nor the query that one
        asks. One that is kept from beginning may keep what others have put under it.
        """
        living = self.central.tree.tasks
        idle = [
            one
            for one in living.values()
            if keeps_nobody(living, one) and one is not task and one.above(task.id)
        ]
        self.spared += bool(idle)
        asked = [
            one.watch.condition
            for one in idle
            if one.watch is not None and one.watch.condition is not None
        ]
        wrong = named & {one.id for one in (*idle, *asked)}
        assert not wrong or wrong <= self.awaited(task), f"{task}: {wrong}"

    def awaited(self, task: Task) -> set[int]:
        """All that a task waits for, by way of whatever, if no monitor that keeps nobody keeps its
        parent.
        """
        way: list[Node] = [next_of(task)]
        if RunAt(self.history).tasks[task.id].state is TaskState.RECOVERING:
            way.append(Place(task, END_ACHIEVING))  # it is decided on, perhaps before it is handled
        seen = set(way)
        for node in way:  # grows while it is walked
            for one in (
                one for group in self.groups(node) for one in group or () if one not in seen
            ):
                if not (
                    isinstance(node, Place) and isinstance(one, Place) and self.is_spared(node, one)
                ):
                    way.append(one)
                    seen.add(one)
        found = (
            node.task if isinstance(node, Place) else getattr(node, "delivery", None)
            for node in way
        )
        return {one.message_id for one in found if one is not None}

    def groups(self, node: Node) -> Iterator[Group | None]:
        """What a node needs. What is suspended waits beside that for all that comes before it
        begins, and what is retried for the monitors under it that a constraint names: both only the
        tools say.
        """
        yield from needs(self.central, node)
        if isinstance(node, Place) and (
            node.task.retrying or (node.task.suspended and node.moment & STARTS)
        ):
            before = predecessors(self.central.tree, node) if not node.task.killed else ()
            yield from ([one] for one in before if not one.task.reached & one.moment)

    def is_spared(self, node: Place, other: Place) -> bool:
        """Whether it would be for a monitor that keeps nobody to end, without a constraint."""
        is_led = any(number == other.task.id for _, number, _ in node.task.leaders or ())
        is_under = other.task is not node.task and other.task.above(node.task.id) is not None
        return is_under and not is_led and keeps_nobody(self.central.tree.tasks, other.task)


def keeps_nobody(living: dict[int, Task], one: Task) -> bool:
    """Whether a monitor ends with all else under its parent: a constraint on its own end would keep
    it there.
    """
    if not one.is_watcher or one.parent is None or one.parent.id == ROOT:
        return False
    leaders = [
        (living[number], its)
        for moment, number, its in one.leaders or ()
        if moment & ENDS and number in living
    ]
    return bool(one.killed) or all(leader is one or leader.reached & its for leader, its in leaders)


def causes(central: Central, waits: list[WaitFor]) -> list[WaitFor]:
    """The waits for others. A failure raised beside its handler is decided on while a task goes
    on.
    """
    living = central.tree.tasks
    deciding = {number for number, one in living.items() if one.role is Role.EXCEPTION}
    return [wait for wait in waits if wait.kind not in ITS_OWN and wait.number not in deciding]


def first(waits: list[WaitFor], task: Task) -> int:
    """The oldest that is named; the parent after others. A constraint by a subtask, or the parent,
    may be told as either.
    """
    others = [
        wait for wait in waits if task.parent is None or wait.number != task.parent.id
    ] or waits
    return min(wait.number for wait in others)


class WatchedLife(Life):
    """Monitors wherever there is a task, constraints on them, retries and suspensions."""

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


def live(seed: int) -> AskedPlayer:
    player = AskedPlayer()
    WatchedLife(player).go_on(seed, 300)
    return player


@example(2_346_655_264)  # a constraint by the parent
@example(35_054_018)  # a monitor of others was killed before the retry
@example(298_566_280)  # a retried monitor waits for a listener before it is handled again
@example(2_953_828_283)  # a constraint by a monitor under a retried task
@example(4_106_698_539)  # a suspended task that has not begun is decided on
@example(1_065_174_457)  # retried three times, it waits once for what is under it
@example(4_026_247_230)  # a suspended task waits beside that for its parent, a monitor, to begin
@given(st.integers(0, 1 << 32))
@settings(max_examples=lives(4, soak=2_000), phases=NO_SMALLER_SEED)
def test_central_and_tools_name_the_same_first_cause(seed: int) -> None:
    live(seed)


def test_watched_life_compares_enough_waits() -> None:
    player = live(2)
    assert player.same > 100
    assert player.spared > 100
