"""A started activity: its tasks, their progress, and their role in the machine."""

from collections.abc import Callable
from functools import partial
from typing import Any

from tca_behaviours.coordination.model.activities import Activity, Do
from tca_behaviours.coordination.model.mistakes import Mistakes
from tca_behaviours.coordination.model.situation import Fact
from tca_behaviours.coordination.running.failures import RecordedFailure, RecordedFailures
from tca_module import Change, Command, MisuseError, Refused, SentTask, Task
from tca_wire.coordination import RoleChange, TaskRole

OnChange = Callable[["ActivityTask", Change], object]
"""Called with each change of a task."""


class ActivityTask:
    """A task of a started activity."""

    def __init__(
        self, under: Task, do: Do, data: Any, activity: Activity, rank: int, on_change: OnChange
    ) -> None:
        """Send the task.

        Args:
            under: the coordinator's task.
            do: the task, as it is written.
            data: the data of the task: as written, or for another speed.
            activity: its activity.
            rank: the place of the activity in the preview list; 0 if its state is entered.
            on_change: called with each change of the task.
        """
        self.do = do
        self.progress = 0.0
        self.has_begun = False
        """Whether a handler has received the task."""
        self.is_over = False
        self.failure: RecordedFailure | None = None
        self.killed = ""
        """Why the task was killed; "" if it was not."""
        self._activity = activity
        self._data = data
        send: Any = under.command if isinstance(do.message, Command) else under.goal
        self.sent: SentTask[Any] = send(do.message, data, sequential=False, priority=-rank)
        self.sent.on_change(lambda change: on_change(self, change))
        self._reports = self.sent.progress() if do.has_progress else None

    @property
    def has_failed(self) -> bool:
        """Whether the task has failed or was killed."""
        return self.failure is not None or bool(self.killed)

    def process_change(
        self, change: Change, failures: RecordedFailures, mistakes: Mistakes
    ) -> None:
        """Process a change of the task's state or progress.

        *mistakes* receives the errors of the function that reads the progress.
        """
        if self._reports is not None:
            consequence = f"the progress of {self._activity!r} does not change"
            for report in self._reports.arrived():
                read = partial(self._activity.progress, report)
                self.progress = mistakes.value_or(self.progress, consequence, read)
        if change.state != self.do.message.life_cycle.initial:
            # A kill by central or a request of the client needs no handler. If other changes may
            # have been missed, assume that a handler has made one.
            is_killed = change.is_over and change.by == "central"
            self.has_begun |= (
                change.is_late or change.missed > 0 or not (is_killed or change.by == "client")
            )
        if not change.is_over or self.is_over:
            return
        self.is_over, self.progress = True, 1.0
        self.failure = failures.pop(self.sent.id)
        if change.state not in self.do.message.life_cycle.successes:
            self.killed = change.text or "its end was not seen"

    def update(self, data: Any) -> None:
        """Send new data to the task's handler. A handler that refuses the data continues as
        before.
        """
        if self.is_over or data is self._data:
            return
        encode = self.do.message.encode_data
        try:
            if encode(data) != encode(self._data):  # == of arrays gives no bool: compare bytes
                self.sent.update_send(data)
        except Refused:  # try again later: the task has not begun, or still applies the last update
            return
        self._data = data

    def request_end(self, why: str) -> None:
        """Ask the handler to end the task."""
        if self.is_over:
            return
        try:
            self.sent.cancel(why)
        except MisuseError:  # the life cycle of the task has no cancel
            self.sent.kill(why)


class StartedActivity:
    """A started activity: the current one, early work, or one that undoes wasted work."""

    def __init__(
        self, state: int, activity: Activity, role: TaskRole, facts_before: dict[str, Fact]
    ) -> None:
        self.state = state
        self.activity = activity
        self.role = role
        self.facts_before = facts_before
        """The facts that the activity makes, with their values before it started."""
        self.spoilt = set[str]()
        """The facts that wasted work has changed, and that no task has set or restored since. Empty
        for other work.
        """
        self.share = 1.0
        """The share of its full speed."""
        self.rank = 0
        """Its place in the preview list; 0 once its state is entered."""
        self.data = activity.data_at(self.share, self.rank)
        """The data of its tasks, for that share and rank."""
        self.tasks: list[ActivityTask] = []
        self.kill_at: float | None = None
        """The time at which the activity is killed if it still runs; None if it was not asked to
        end.
        """
        self.is_killed = False
        self.has_set_facts = False
        """Whether the activity was done, so that the facts that it makes were set."""

    def start(self, under: Task, on_change: OnChange) -> None:
        """Send its tasks."""
        self.tasks = [
            ActivityTask(under, do, data, self.activity, self.rank, on_change)
            for do, data in zip(self.activity.tasks, self.data, strict=True)
        ]

    @property
    def is_over(self) -> bool:
        """Whether all of its tasks have ended."""
        return all(task.is_over for task in self.tasks)

    @property
    def has_begun(self) -> bool:
        """Whether a handler has received any of its tasks."""
        return any(task.has_begun for task in self.tasks)

    @property
    def failed_task(self) -> ActivityTask | None:
        """A task that has failed or was killed, if any."""
        return next((task for task in self.tasks if task.has_failed), None)

    @property
    def is_done(self) -> bool:
        """Whether all of its tasks are done."""
        return self.is_over and self.failed_task is None

    @property
    def progress(self) -> float:
        """The least progress of its tasks that can report progress."""
        return min(
            (task.progress for task in self.tasks if task.do.has_progress),
            default=float(self.is_over),
        )

    def update_tasks(self) -> None:
        """Send the tasks their new data if the data have changed."""
        for task, data in zip(self.tasks, self.data, strict=True):
            task.update(data)

    def request_end(self, why: str, kill_at: float) -> None:
        """Ask its tasks to end. Tasks that have not ended at *kill_at* are killed."""
        if self.kill_at is None and not self.is_over:
            self.kill_at = kill_at
            for task in self.tasks:
                task.request_end(why)

    def kill(self, why: str) -> None:
        """Kill its tasks."""
        self.is_killed = True
        for task in self.tasks:
            if not task.is_over:
                task.sent.kill(why)

    def roles(self) -> list[RoleChange]:
        """Return the present roles of the activity's tasks in the machine."""
        return [
            RoleChange(
                task.sent.id, self.state, "+".join(each.name for each in task.do.agents), self.role
            )
            for task in self.tasks
        ]

    def conflicts_with(self, activity: Activity) -> bool:
        """Return whether another activity must wait for the end of this one.

        It must wait if both need the same agent, and that agent takes one task at a time. It must
        also wait if either makes a fact that the other makes or needs.
        """
        running = [task.do for task in self.tasks if not task.is_over]
        busy = {agent for do in running for agent in do.agents if agent.tasks == 1}
        wanted = {agent for do in activity.tasks for agent in do.agents}
        makes, needs = self.activity.makes.keys(), self.activity.needs.keys()
        shared = makes & activity.needs.keys() | (makes | needs) & activity.makes.keys()
        return bool(running and (busy & wanted or shared))
