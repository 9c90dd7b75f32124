"""What a running monitor is doing, and how it stops. The rules are in monitors.py."""

from tca_central.clock import Timer
from tca_central.intervals import RETURNED
from tca_central.making import make
from tca_central.registry import Delivery, MessageType
from tca_central.state import State, involved
from tca_central.task_tree import Task
from tca_wire import facts
from tca_wire.parts import Watching, WatchOptions
from tca_wire.points import TaskId
from tca_wire.vocabulary import MessageClass, Role

_ACTION = 1  # which part of a monitor
_CANCEL = 2  # of a demon monitor


class Watch:
    """A monitor from its birth to its end."""

    __slots__ = ("began", "condition", "count", "fires", "is_over", "options", "parts", "task", "timers")

    def __init__(self, task: Task, options: WatchOptions, parts: list[MessageType | None]) -> None:
        self.task = task
        self.options = options
        self.parts = parts  #: condition and action; of a demon: set-up, action and cancel
        self.began: float | None = None  #: when it began to watch
        self.condition: Delivery | None = None  #: the test under way
        self.count = 0  #: how often its condition held, or it was fired
        self.fires = 0  #: how many actions it has sent
        self.timers: list[Timer] = []
        self.is_over = False

    @property
    def is_on(self) -> bool:
        """Whether it watches now."""
        return self.began is not None and not self.is_over

    @property
    def header(self) -> Watching:
        """What the handlers of its messages are told."""
        action = self.parts[_ACTION]
        return Watching(involved(self.task), action.name if action is not None else "")

    def met(self, central: State, _: Task) -> None:
        """The point at which it ends is reached."""
        end_watch(central, self, "its end point is reached")


def stop(central: State, watch: Watch, why: str) -> None:
    """Watch no longer; what the monitor has sent comes to its own end."""
    if watch.is_over:
        return
    watch.is_over = True
    for timer in watch.timers:
        central.clock.cancel(timer)
    if (condition := watch.condition) is not None:
        watch.condition = None
        if condition.queues is not None:
            central.dispatcher.withdraw(condition)
            central.facts.append(facts.Dropped(condition.id, "its monitor has ended"))
        del central.asked[condition.id]
    if watch.began is None:
        return
    central.facts.append(facts.MonitorEnded(TaskId(watch.task.id), why))
    central.agenda.happened.append((watch.task, RETURNED))
    if watch.task.message.message_class is MessageClass.DEMON_MONITOR and (cancel := watch.parts[_CANCEL]) is not None:
        make(central, cancel, watch.task.body, watch.task, Role.CANCEL, context=watch)


def end_watch(central: State, watch: Watch, why: str) -> None:
    """A monitor is done: its task is handled, and achieved when what it has sent is."""
    if not watch.is_over:
        stop(central, watch, why)
        if not watch.task.killed:
            central.agenda.returned(watch.task)
