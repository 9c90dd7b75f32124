"""The activities that a run has started: the current one, early work, and wasted work to undo.

There are two sets of facts. Only activities of entered states change the *plain* facts. Guards and
likelihoods read the plain facts, so that the machine moves as it would without a preview. The
*actual* facts are those of the robot now. Early work, too, changes them.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from tca_behaviours.coordination.model.activities import Activity
from tca_behaviours.coordination.model.mistakes import Mistakes
from tca_behaviours.coordination.model.situation import Fact, Situation
from tca_behaviours.coordination.preview.decide import EarlyWork, Present, WorkPhase
from tca_behaviours.coordination.running.facts import KnownFacts
from tca_behaviours.coordination.running.failures import RecordedFailures
from tca_behaviours.coordination.running.work import ActivityTask, StartedActivity
from tca_module import Change, SentTask, Task
from tca_module.log import log_of
from tca_wire.coordination import RoleChange, TaskRole

_LOG = log_of("coordination")


class ActivitiesAtWork:
    """The activities of a run that are running, or that must still be undone."""

    def __init__(
        self,
        facts: Mapping[str, Fact],
        task: Task,
        failures: RecordedFailures,
        patience: float,
        enqueue: Callable[[Callable[[], object]], object],
        mistakes: Mistakes,
    ) -> None:
        """Start without activities.

        Args:
            facts: the facts at the start.
            task: the coordinator's task.
            failures: the recorded failures of its tasks.
            patience: seconds that a task may take to end after a request; then it is killed.
            enqueue: enqueues a change for the thread of the run.
            mistakes: receives the errors of functions that read the progress of early work.
        """
        self.current: StartedActivity | None = None
        """The activity of the current state, if it has started."""
        self.kept = self.wasted = 0
        """The number of early tasks that were kept, and the number of wasted early tasks."""
        self._plain = KnownFacts(facts)
        self._actual = KnownFacts(facts)
        self._task = task
        self._failures = failures
        self._patience = patience
        self._enqueue = enqueue
        self._mistakes = mistakes
        self._early: dict[int, StartedActivity] = {}
        self._stopping: list[StartedActivity] = []
        """The activities that were stopped and have not ended."""
        self._restoring: tuple[StartedActivity, StartedActivity] | None = None
        """The activity that undoes wasted work, and the wasted work."""
        self._spoilers: list[StartedActivity] = []
        """Wasted activities with ``spoilt`` facts, oldest first."""
        self._role_changed: list[StartedActivity] = []
        """The activities whose role has changed since the last report."""

    # --- the present state ------------------------------------------------------------------------

    @property
    def plain_facts(self) -> Mapping[str, Fact]:
        """The facts as the activities of entered states have changed them."""
        return dict(self._plain.known)

    @property
    def is_over(self) -> bool:
        """Whether nothing runs, and nothing must be undone."""
        return all(work.is_over for work in self._all()) and not any(self._undoable())

    @property
    def running_tasks(self) -> list[SentTask[Any]]:
        """The tasks that have not ended."""
        return [task.sent for work in self._all() for task in work.tasks if not task.is_over]

    def present(self, state: int, situation: Situation, *, is_new: bool) -> Present:
        """Return the state of the run in a machine state. *is_new*: no decision was made in that
        machine state yet.
        """
        phases = [(each, _phase(each)) for each in self._early.values()]
        phases += [(each, WorkPhase.STOPPING) for each in self._stopping]
        work = [EarlyWork(each.state, phase, each.progress, each.share) for each, phase in phases]
        if self._restoring is not None:
            work.append(EarlyWork(self._restoring[1].state, WorkPhase.RESTORING))
        spoilt = frozenset().union(*(each.spoilt for each in self._spoilers))
        is_done = self.current is not None and self.current.is_done
        return Present(state, dict(self._actual.known), situation, is_done, is_new, work, spoilt)

    def _all(self) -> Iterator[StartedActivity]:
        if self.current is not None:
            yield self.current
        yield from self._early.values()
        yield from self._stopping
        if self._restoring is not None:
            yield self._restoring[0]

    def role_changes(self) -> list[RoleChange]:
        """Return the roles that have changed since the last call."""
        found = [change for work in self._role_changed for change in work.roles()]
        self._role_changed.clear()
        return found

    # --- the current activity ---------------------------------------------------------------------

    def begin(self, state: int, activity: Activity) -> str:
        """Start the activity of the current state, unless it must wait.

        The activity waits until conflicting work has ended and spoilt facts are restored. Returns
        "" if the activity has started or waits. Returns the unmet needs if the activity can never
        start.
        """
        if unmet := self._plain.unmet(activity):
            return unmet
        running = [each for each in self._all() if not each.is_over]
        if self._restoring is not None or any(
            each.state == state or each.conflicts_with(activity) for each in running
        ):
            return ""
        if (spoiler := self._first_to_undo(activity)) is not None:
            self._undo(spoiler)
            return ""
        if unmet := self._actual.unmet(activity):
            return unmet
        self.current = work = StartedActivity(
            state, activity, TaskRole.CURRENT, self._actual.begin(activity)
        )
        self._begin_entered(activity)
        self._start(work)
        return ""

    def undo_next(self) -> None:
        """Start to undo the newest wasted work, if no other work is being undone."""
        if self._restoring is None and (spoiler := next(self._undoable(), None)) is not None:
            self._undo(spoiler)

    def leave(self, why: str) -> None:
        """Leave the current state: stop the tasks of its activity that still run."""
        if self.current is not None and not self.current.is_over:
            self._stop(self.current, why)
        self.current = None

    def enter(self, state: int) -> bool:
        """Enter a state, and make its early work, if any, the current activity.

        Early work is dropped if it has failed, or if the plain facts do not meet its needs. Returns
        whether early work was kept.
        """
        work = self._early.get(state)
        if work is None:
            return False
        if work.failed_task is not None or self._plain.unmet(work.activity):
            self.drop(state, "its state can't use it")
            return False
        self.current = self._early.pop(state)
        self.kept += len(work.tasks)
        self._set_role(work, TaskRole.KEPT)
        work.share, work.rank, work.data = 1.0, 0, work.activity.data_at(1.0, 0)
        self._begin_entered(work.activity)
        if work.has_set_facts:
            self._plain.finish(work.activity)
        return True

    def _begin_entered(self, activity: Activity) -> None:
        """Apply the start of an entered state's activity to the facts. Facts that the activity
        makes are not spoilt any more.
        """
        self._plain.begin(activity)
        for spoiler in self._spoilers:
            spoiler.spoilt -= activity.makes.keys()

    # --- early work -------------------------------------------------------------------------------

    def begin_early(
        self, state: int, activity: Activity, share: float, rank: int, data: list[Any]
    ) -> None:
        """Start the activity of a foreseen state at a share of full speed. *data* are its tasks'
        data for that share.
        """
        work = StartedActivity(state, activity, TaskRole.AHEAD, self._actual.begin(activity))
        work.share, work.rank, work.data = share, rank, data
        self._early[state] = work
        self._start(work)

    def early_work(self, state: int) -> StartedActivity | None:
        """Return the early work of a state, if any."""
        return self._early.get(state)

    def update_tasks(self) -> None:
        """Send new data, for another speed, to the handlers that can take them now."""
        for work in (*self._early.values(), self.current):
            if work is not None and work.activity.adapt is not None:
                work.update_tasks()

    def drop(self, state: int, why: str) -> None:
        """Count the early work of a state as wasted, and stop it."""
        work = self._early.pop(state)
        self._waste(work)
        if not work.is_over:
            self._stop(work, why)

    def _waste(self, work: StartedActivity) -> None:
        if work.role is TaskRole.WASTED:
            return
        self.wasted += len(work.tasks)
        self._set_role(work, TaskRole.WASTED)
        work.spoilt = set(work.activity.makes)
        self._spoilers = [*(each for each in self._spoilers if each.spoilt), work]

    def _first_to_undo(self, activity: Activity) -> StartedActivity | None:
        """Return the newest wasted work that must be undone before an activity, if any.

        Such work has spoilt a fact that the activity needs. Or it has spoilt several facts, and the
        activity makes only some of them. To undo the other facts later would undo the activity's
        facts, too.
        """
        needs, makes = activity.needs.keys(), activity.makes.keys()
        for spoiler in self._undoable():
            if spoiler.spoilt & needs or (spoiler.spoilt & makes and spoiler.spoilt - makes):
                return spoiler
        return None

    def _undoable(self) -> Iterator[StartedActivity]:
        """Wasted work that can be undone, the newest first."""
        return (each for each in reversed(self._spoilers) if each.activity.undo and each.spoilt)

    def _undo(self, spoiler: StartedActivity) -> None:
        """Start to undo wasted work, unless running work conflicts with the tasks that undo it."""
        makes = spoiler.activity.makes
        activity = Activity(*spoiler.activity.undo, makes=makes, progress=_no_progress)
        if any(each.conflicts_with(activity) for each in self._all()):
            return
        before = self._actual.begin(activity)
        work = StartedActivity(spoiler.state, activity, TaskRole.RESTORING, before)
        self._restoring = work, spoiler
        self._start(work)

    # --- tasks ------------------------------------------------------------------------------------

    def _start(self, work: StartedActivity) -> None:
        work.start(self._task, self._on_change)
        self._role_changed.append(work)

    def _set_role(self, work: StartedActivity, role: TaskRole) -> None:
        work.role = role
        self._role_changed.append(work)

    def _on_change(self, task: ActivityTask, change: Change) -> None:
        """Enqueue a change of a task, because this is called in the middle of other work."""
        self._enqueue(lambda: self._process_change(task, change))

    def _process_change(self, task: ActivityTask, change: Change) -> None:
        is_current = self.current is not None and task in self.current.tasks
        task.process_change(change, self._failures, Mistakes() if is_current else self._mistakes)
        if not change.is_over:
            return
        for work in list(self._all()):
            if task in work.tasks:
                self._on_task_end(work)

    def _on_task_end(self, work: StartedActivity) -> None:
        """Process the end of a task of an activity."""
        if self._restoring is not None and work is self._restoring[0]:
            if work.is_over:
                self._on_undo_end(*self._restoring)
            return
        if work.is_done and not work.has_set_facts:
            work.has_set_facts = True
            self._actual.finish(work.activity)
            if work is self.current:
                self._plain.finish(work.activity)
        if work.failed_task is not None and work.kill_at is None:  # stop its other tasks, too
            if work is not self.current:
                self._waste(work)
            work.request_end(
                "another task of its activity has failed", self._task.time() + self._patience
            )
        if work.is_over and work in self._stopping:
            self._stopping.remove(work)
        if work.is_over and work.spoilt and not work.has_begun:
            self._restore_facts(work)

    def _on_undo_end(self, work: StartedActivity, spoiler: StartedActivity) -> None:
        self._restoring = None
        if work.failed_task is None:
            self._restore_facts(spoiler)
        else:
            text = "%r did not undo wasted early work: its changes stay"
            _LOG.warning(text, work.failed_task.sent)
            spoiler.spoilt.clear()

    def _restore_facts(self, spoiler: StartedActivity) -> None:
        """Restore the spoilt facts of wasted work, because the robot is as it was before that
        work.
        """
        for name in spoiler.spoilt & spoiler.facts_before.keys():
            self._actual.known[name] = spoiler.facts_before[name]
        spoiler.spoilt.clear()

    # --- ends -------------------------------------------------------------------------------------

    def _stop(self, work: StartedActivity, why: str) -> None:
        self._stopping.append(work)
        work.request_end(why, self._task.time() + self._patience)

    @property
    def next_kill_at(self) -> float | None:
        """The time at which the next stopped task is killed, if any."""
        times = [
            each.kill_at
            for each in self._all()
            if each.kill_at is not None and not (each.is_over or each.is_killed)
        ]
        return min(times, default=None)

    def kill_late(self) -> None:
        """Kill the tasks that have not ended in time after they were stopped."""
        now = self._task.time()
        for work in self._all():
            if work.kill_at is not None and work.kill_at <= now and not work.is_killed:
                work.kill(f"it has not ended within {self._patience:g} s")

    def kill_all(self, why: str) -> None:
        """Kill all tasks."""
        for work in self._all():
            work.kill(why)


def _phase(work: StartedActivity) -> WorkPhase:
    if work.failed_task is not None:
        return WorkPhase.FAILED if work.is_over else WorkPhase.STOPPING
    return WorkPhase.DONE if work.is_done else WorkPhase.RUNNING


def _no_progress(_report: object) -> float:
    """Return 0 for an activity that undoes another one: nothing depends on its progress."""
    return 0.0
