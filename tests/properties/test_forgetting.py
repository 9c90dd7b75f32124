"""Central holds no reference to ended tasks and messages, not even beside a task that lasts."""

from collections import Counter
from collections.abc import Callable

import pytest
from central.player import INTEGER, Player, before, point, reachable
from central.test_random_lives import end_life
from hypothesis import example, given, settings
from properties.life import Life, Operations, operations

from tca_central.control.steering import PendingDeadline, PendingKill
from tca_central.core import Central
from tca_central.model.clock import Timer
from tca_central.model.contexts import Listening
from tca_central.model.deliveries import Delivery
from tca_central.model.tasks import Clients, Recovery, Retention, Scheduled, Tapping, Watch
from tca_central.order.holds import PendingDelay
from tca_wire.constraints import Flags
from tca_wire.packets import headers
from tca_wire.packets.parts import MessageFormat, WatchOptions
from tca_wire.points import Moment, Point, TaskId
from tca_wire.vocabulary import MessageClass, Scope

END = Moment.END_ACHIEVING
TRANSIENT_CLASSES = (
    Delivery,
    Recovery,
    Tapping,
    Scheduled,
    Clients,
    Retention,
    Watch,
    PendingKill,
    PendingDeadline,
    PendingDelay,
    Timer,
    Listening,
)
"""Classes whose objects belong to living tasks and messages only."""


def retained_objects(central: Central) -> Counter[str]:
    """Count the reachable objects of ``TRANSIENT_CLASSES``, by class. Those of the root are left
    out, because the root never ends.
    """
    found, root = Counter[str](), central.tree.root
    for one in reachable(central):
        if isinstance(one, TRANSIENT_CLASSES) and one not in (
            root,
            root.recovery,
            root.tapping,
            root.scheduled,
            root.retention,
        ):
            found[type(one).__name__] += not (isinstance(one, Timer) and one.is_cancelled)
    return +found


@given(operations)
@example([("send", 0, 0, 0, 0)] * 12 + [("lose", 1, 0, 0, 0)] * 2)  # a resource without slots
@settings(max_examples=30)
def test_central_retains_no_object_of_ended_life(taken: Operations) -> None:
    life = Life().live(taken)
    end_life(life)
    assert not retained_objects(life.central)


class LongTask:
    """A task that runs for weeks, and short tasks beside it."""

    def __init__(self) -> None:
        self.player = Player(check=False)
        self.player.module("legs", "command move", "query clear", "inform note", capacity=3)
        self.player.module("user")
        self.player.declare("user", "command move")
        guard = MessageFormat("guard", MessageClass.DEMON_MONITOR, INTEGER, "", ["", "note", ""])
        self.ask(headers.Register, [guard])
        self.task = self.player.task("user", "move")

    @property
    def end(self) -> Point:
        return point(self.task, END)

    def ask(self, kind: type, *fields: object) -> None:
        answers = self.player.request("user", kind, *fields, body=b"\x07")
        assert not any(isinstance(answer, headers.Refused) for answer in answers), answers

    def move(self, **options: object) -> int:
        return self.player.task("user", "move", **{"flags": Flags.NONE, **options})

    def returns(self, task: int) -> None:
        (slot,) = (
            d.slot
            for d in self.player.central.dispatcher.running.values()
            if d.id == task and d.slot
        )
        self.player.reply(slot.id.decode(), task)

    def guard(self, duration: float = 0) -> int:
        """Send a monitor that lasts until the long task ends."""
        watch = WatchOptions(duration=duration, until=self.end)
        return self.player.task("user", "guard", flags=Flags.NONE, watch=watch)


def kill_after_it(long: LongTask) -> None:
    task = long.move()
    long.ask(headers.Kill, TaskId(task), "", Scope.TASK, long.end)
    long.returns(task)


def kill_with_delay(long: LongTask) -> None:
    task = long.move()
    long.ask(headers.Kill, TaskId(task), "", Scope.TASK, point(task, END), 1e6)
    long.ask(headers.Kill, TaskId(task), "", Scope.DESCENDANTS, None, 1e6)
    long.returns(task)


def deadlines(long: LongTask) -> None:
    task = long.move(deadline=1e6)
    long.ask(headers.Deadline, point(task, END), 1e5)
    long.returns(task)


def monitor_until_its_end(long: LongTask) -> None:
    monitor = long.guard()
    long.ask(headers.EndMonitor, TaskId(monitor))


def killed_monitor_until_its_end(long: LongTask) -> None:
    monitor = long.guard(duration=1e6)
    long.ask(headers.Kill, TaskId(monitor))


def kill_of_follower(long: LongTask) -> None:
    task = long.move(constraints=(before(long.end, point(-1, Moment.START_ACHIEVING)),))
    long.ask(headers.Kill, TaskId(task))


def kill_of_delayed_task(long: LongTask) -> None:
    later = before(point(0, Moment.START_ACHIEVING), point(-1, Moment.START_ACHIEVING), 1e6)
    task = long.move(constraints=(later,))
    long.ask(headers.Kill, TaskId(task))


def overlapping_leaders(long: LongTask) -> None:
    """Send a task that holds the end of the long task. Then end the task sent before, so that one
    always holds.
    """
    task = long.move(constraints=(before(point(-1, END), long.end),))
    older = [other for other in long.player.central.tree.tasks if long.task < other < task]
    for other in older:
        long.returns(other)


def wait_given_up(long: LongTask) -> None:
    long.ask(headers.AwaitPoint, long.end)
    long.player.receive("user", headers.GiveUp(long.player.numbers["user"]))


def kill_and_deadline_without_effect(long: LongTask) -> None:
    """Requests without effect: a kill of no descendants, a deadline of a reached point."""
    long.ask(headers.Kill, TaskId(long.task), "", Scope.DESCENDANTS, None, 1.0)
    long.ask(headers.Deadline, point(long.task, Moment.START_HANDLING), 1.0)
    long.player.tick(2.0)


@pytest.mark.parametrize(
    "do_beside",
    [
        kill_after_it,
        kill_with_delay,
        deadlines,
        monitor_until_its_end,
        killed_monitor_until_its_end,
        kill_of_follower,
        kill_of_delayed_task,
        overlapping_leaders,
        wait_given_up,
        kill_and_deadline_without_effect,
    ],
    ids=lambda do_beside: do_beside.__name__,
)
def test_central_retains_little_beside_long_task(do_beside: Callable[[LongTask], None]) -> None:
    long = LongTask()
    for _ in range(300):
        do_beside(long)
    most_retained = 100  # void entries are removed in batches
    task = long.player.central.tree.tasks[TaskId(long.task)]
    assert retained_objects(long.player.central).total() < most_retained, retained_objects(
        long.player.central
    )
    assert (
        len(task.leaders or ()) + len(task.followers or ()) + len(task.waiters or ())
        < most_retained
    )
