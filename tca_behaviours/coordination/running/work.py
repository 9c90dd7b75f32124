"""An activity that was started: its tasks, how far they are, and what they are to the machine."""

from collections.abc import Callable
from functools import partial
from typing import Any

from tca_behaviours.coordination.model.activities import Activity, Do
from tca_behaviours.coordination.model.mistakes import Mistakes
from tca_behaviours.coordination.model.situation import Fact
from tca_behaviours.coordination.running.failures import FailureNotes, NotedFailure
from tca_module import Change, Command, MisuseError, Refused, SentTask, Task
from tca_wire.coordination import RoleChange, TaskRole

Heard = Callable[["ActivityTask", Change], object]
"""Is called with each change of a task."""


class ActivityTask:
    """A task of an activity that was started."""

    def __init__(
        self, under: Task, do: Do, data: Any, activity: Activity, rank: int, heard: Heard
    ) -> None:
        """*data*: its own, or what they are at another speed. *rank*: its place in the preview
        list, or 0.
        """
        self.do = do
        self.progress = 0.0
        self.has_begun = False
        """A handler has got it."""
        self.is_over = False
        self.failure: NotedFailure | None = None
        self.killed = ""
        """By whom and why, in words; "" if it was not."""
        self._activity = activity
        self._data = data
        send: Any = under.command if isinstance(do.message, Command) else under.goal
        self.sent: SentTask[Any] = send(do.message, data, sequential=False, priority=-rank)
        self.sent.on_change(lambda change: heard(self, change))
        self._reports = self.sent.progress() if do.has_progress else None

    @property
    def has_failed(self) -> bool:
        """Whether it ended otherwise than done."""
        return self.failure is not None or bool(self.killed)

    def note(self, change: Change, failures: FailureNotes, mistakes: Mistakes) -> None:
        """Its state has changed, or it has told of its progress. *mistakes*: takes what raises
        where that is read.
        """
        if self._reports is not None:
            what = f"the progress of {self._activity!r} stays as it was"
            for report in self._reports.arrived():
                read = partial(self._activity.progress, report)
                self.progress = mistakes.otherwise(self.progress, what, read)
        if change.state != self.do.message.life_cycle.initial:
            is_killed = change.is_over and change.by == "central"
            self.has_begun |= (
                change.is_late or change.missed > 0 or not (is_killed or change.by == "client")
            )
        if not change.is_over or self.is_over:
            return
        self.is_over, self.progress = True, 1.0
        self.failure = failures.take(self.sent.id)
        if change.state != self.do.message.life_cycle.done:
            self.killed = change.text or "its end was not seen"

    def update(self, data: Any) -> None:
        """Have it run with other data. A handler that does not agree goes on as before."""
        if self.is_over or data is self._data:
            return
        encode = self.do.message.encode_data
        try:
            if encode(data) != encode(self._data):  # arrays have no equality that is true or false
                self.sent.update_send(data)
        except Refused:  # not now: it has yet to begin, or to take over the speed before
            return
        self._data = data

    def request_end(self, why: str) -> None:
        """Ask its handler to end it."""
        if self.is_over:
            return
        try:
            self.sent.cancel(why)
        except MisuseError:  # its life cycle has no such transition
            self.sent.kill(why)


class StartedActivity:
    """An activity that was started: when its state was entered, ahead of that, or to undo what
    another has changed.
    """

    def __init__(
        self, state: int, activity: Activity, role: TaskRole, before: dict[str, Fact]
    ) -> None:
        self.state = state
        self.activity = activity
        self.role = role
        self.before = before
        """What it changes, as it was."""
        self.spoilt = set[str]()
        """The facts that it has changed in vain, and that have not been made anew or restored
        since.
        """
        self.share = 1.0
        """Of its full speed."""
        self.rank = 0
        """Its place in the preview list; 0: its state is entered."""
        self.data = activity.data_at(self.share, self.rank)
        """Of its tasks, for that share and rank."""
        self.tasks: list[ActivityTask] = []
        self.kill_at: float | None = None
        """It has been asked to end; at that moment it is killed."""
        self.is_killed = False
        self.is_finished = False
        """What it makes is known to hold."""

    def start(self, under: Task, heard: Heard) -> None:
        """Send its tasks."""
        self.tasks = [
            ActivityTask(under, do, data, self.activity, self.rank, heard)
            for do, data in zip(self.activity.tasks, self.data, strict=True)
        ]

    @property
    def is_over(self) -> bool:
        """Whether all of its tasks have ended."""
        return all(task.is_over for task in self.tasks)

    @property
    def has_begun(self) -> bool:
        """Whether a handler has got any of its tasks."""
        return any(task.has_begun for task in self.tasks)

    @property
    def failed_task(self) -> ActivityTask | None:
        """A task that ended otherwise than done."""
        return next((task for task in self.tasks if task.has_failed), None)

    @property
    def is_done(self) -> bool:
        """Whether all of its tasks are done."""
        return self.is_over and self.failed_task is None

    @property
    def progress(self) -> float:
        """The least progress of those tasks that can report any."""
        return min(
            (task.progress for task in self.tasks if task.do.has_progress),
            default=float(self.is_over),
        )

    def update_tasks(self) -> None:
        """Tell its tasks of their data, where these have changed."""
        for task, data in zip(self.tasks, self.data, strict=True):
            task.update(data)

    def request_end(self, why: str, kill_at: float) -> None:
        """Ask for the end of its tasks; those that go on are killed at that moment."""
        if self.kill_at is None and not self.is_over:
            self.kill_at = kill_at
            for task in self.tasks:
                task.request_end(why)

    def kill(self, why: str) -> None:
        """End its tasks, whatever their handlers say."""
        self.is_killed = True
        for task in self.tasks:
            if not task.is_over:
                task.sent.kill(why)

    def roles(self) -> list[RoleChange]:
        """What its tasks are to the machine, from now on."""
        return [
            RoleChange(
                task.sent.id,
                self.state,
                "+".join(agent.name for agent in task.do.agents),
                self.role,
            )
            for task in self.tasks
        ]

    def conflicts_with(self, activity: Activity) -> bool:
        """Whether an activity may not begin before this one has ended: they share an agent or a
        fact.
        """
        busy = {
            agent
            for task in self.tasks
            if not task.is_over
            for agent in task.do.agents
            if agent.tasks == 1
        }
        wanted = {agent for do in activity.tasks for agent in do.agents}
        makes, needs = self.activity.makes.keys(), self.activity.needs.keys()
        facts = (makes & (activity.needs.keys() | activity.makes.keys())) | (
            needs & activity.makes.keys()
        )
        return not self.is_over and bool(busy & wanted or facts)
