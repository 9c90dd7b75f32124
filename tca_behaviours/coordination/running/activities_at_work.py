"""The activities that a run has started: the current one, those ahead of their states, and what
they leave behind.

Two accounts of facts are kept. The plain ones are changed by activities whose states were entered:
guards and likelihoods see these, as they would without a preview. The present ones are how the
robot is now.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from tca_behaviours.coordination.model.activities import Activity
from tca_behaviours.coordination.model.mistakes import Mistakes
from tca_behaviours.coordination.model.situation import Fact, Situation
from tca_behaviours.coordination.preview.decide import EarlyWork, Present, WorkPhase
from tca_behaviours.coordination.running.facts import KnownFacts
from tca_behaviours.coordination.running.failures import FailureNotes
from tca_behaviours.coordination.running.work import ActivityTask, StartedActivity
from tca_module import Change, SentTask, Task
from tca_module.log import log_of
from tca_wire.coordination import RoleChange, TaskRole

_LOG = log_of("coordination")


class ActivitiesAtWork:
    """All activities of a run that were started and are not over, or have left something behind."""

    def __init__(
        self,
        facts: Mapping[str, Fact],
        task: Task,
        failures: FailureNotes,
        patience: float,
        put: Callable[[Callable[[], object]], object],
        mistakes: Mistakes,
    ) -> None:
        """*put*: takes what has happened, for the thread of the run. *mistakes*: takes what raises
        where the progress of early work is read.
        """
        self.current: StartedActivity | None = None
        """The activity of the current state, if it has begun."""
        self.kept = self.wasted = 0
        """Tasks that were ahead: kept, and wasted."""
        self._plain = KnownFacts(facts)
        self._now = KnownFacts(facts)
        self._task = task
        self._failures = failures
        self._patience = patience
        self._put = put
        self._mistakes = mistakes
        self._ahead: dict[int, StartedActivity] = {}
        self._ending: list[StartedActivity] = []
        """Told to stop, and not over yet."""
        self._restoring: tuple[StartedActivity, StartedActivity] | None = None
        """The tasks that undo something, and the activity that has changed it."""
        self._spoilers: list[StartedActivity] = []
        """Wasted activities, oldest first: what they have ``spoilt`` was not made anew or
        restored.
        """
        self._news: list[StartedActivity] = []
        """Those whose role has changed, and nobody has been told."""

    # --- how things are ---------------------------------------------------------------------------

    @property
    def plain_facts(self) -> Mapping[str, Fact]:
        """What holds as far as entered states have changed it."""
        return dict(self._plain.known)

    @property
    def is_over(self) -> bool:
        """Whether nothing runs any more, and nothing is to be undone."""
        return all(work.is_over for work in self._all()) and not any(self._undoable())

    @property
    def living(self) -> list[SentTask[Any]]:
        """The tasks that have not ended."""
        return [task.sent for work in self._all() for task in work.tasks if not task.is_over]

    def present(self, state: int, situation: Situation, *, is_new: bool) -> Present:
        """How the run stands in that state. *is_new*: nothing has been decided in it."""
        work = [
            EarlyWork(one.state, _phase(one), one.progress, one.share)
            for one in self._ahead.values()
        ]
        work += [
            EarlyWork(one.state, WorkPhase.STOPPING, one.progress, one.share)
            for one in self._ending
        ]
        if self._restoring is not None:
            work.append(EarlyWork(self._restoring[1].state, WorkPhase.RESTORING))
        spoilt = frozenset().union(*(one.spoilt for one in self._spoilers))
        is_done = self.current is not None and self.current.is_done
        return Present(state, dict(self._now.known), situation, is_done, is_new, work, spoilt)

    def _all(self) -> Iterator[StartedActivity]:
        if self.current is not None:
            yield self.current
        yield from self._ahead.values()
        yield from self._ending
        if self._restoring is not None:
            yield self._restoring[0]

    def role_changes(self) -> list[RoleChange]:
        """The roles that have changed since this was asked last."""
        found = [change for work in self._news for change in work.roles()]
        self._news.clear()
        return found

    # --- the current activity ---------------------------------------------------------------------

    def begin(self, state: int, activity: Activity) -> str:
        """Start the activity of the current state, unless something is in its way: work that is
        about to end, or something to be restored first. Why it can never begin, in words; or "".
        """
        if unmet := self._plain.unmet(activity):
            return unmet
        others = [one for one in self._all() if not one.is_over]
        if self._restoring is not None or any(
            one.state == state or one.conflicts_with(activity) for one in others
        ):
            return ""
        if (spoiler := self._to_undo(activity)) is not None:
            self._undo(spoiler)
            return ""
        if unmet := self._now.unmet(activity):
            return unmet
        self.current = work = StartedActivity(
            state, activity, TaskRole.CURRENT, self._now.begin(activity)
        )
        self._begin_entered(activity)
        self._start(work)
        return ""

    def restore(self) -> None:
        """The machine has ended: begin to undo what was changed in vain, the newest first."""
        if self._restoring is None and (spoiler := next(self._undoable(), None)) is not None:
            self._undo(spoiler)

    def leave(self, why: str) -> None:
        """The current state is left: what still runs of its activity has to end."""
        if self.current is not None and not self.current.is_over:
            self._end(self.current, why)
        self.current = None

    def enter(self, state: int) -> bool:
        """A state is entered. Work ahead of it is its activity now, unless it has failed or would
        not begin without a preview. Whether there is such work.
        """
        work = self._ahead.get(state)
        if work is None:
            return False
        if work.failed_task is not None or self._plain.unmet(work.activity):
            self.drop(state, "its state can't go on with it")
            return False
        self.current = self._ahead.pop(state)
        self.kept += len(work.tasks)
        self._set_role(work, TaskRole.KEPT)
        work.share, work.rank, work.data = 1.0, 0, work.activity.data_at(1.0, 0)
        self._begin_entered(work.activity)
        if work.is_finished:
            self._plain.finish(work.activity)
        return True

    def _begin_entered(self, activity: Activity) -> None:
        """The activity of an entered state begins: what it makes was changed in vain no more."""
        self._plain.begin(activity)
        for spoiler in self._spoilers:
            spoiler.spoilt -= activity.makes.keys()

    # --- ahead ------------------------------------------------------------------------------------

    def begin_ahead(
        self, state: int, activity: Activity, share: float, rank: int, data: list[Any]
    ) -> None:
        """Start the activity of a state that is foreseen, at a share of its full speed, with the
        data for that.
        """
        work = StartedActivity(state, activity, TaskRole.AHEAD, self._now.begin(activity))
        work.share, work.rank, work.data = share, rank, data
        self._ahead[state] = work
        self._start(work)

    def ahead(self, state: int) -> StartedActivity | None:
        """The work ahead of a state, if there is any."""
        return self._ahead.get(state)

    def adapt_speeds(self) -> None:
        """Tell handlers of new speeds, where they can be told now."""
        for work in (*self._ahead.values(), *([self.current] if self.current is not None else [])):
            if work.activity.adapt is not None:
                work.update_tasks()

    def drop(self, state: int, why: str) -> None:
        """What was done ahead of a state is of no use."""
        work = self._ahead.pop(state)
        self._waste(work)
        if not work.is_over:
            self._end(work, why)

    def _waste(self, work: StartedActivity) -> None:
        if work.role is TaskRole.WASTED:
            return
        self.wasted += len(work.tasks)
        self._set_role(work, TaskRole.WASTED)
        work.spoilt = set(work.activity.makes)
        self._spoilers = [*(one for one in self._spoilers if one.spoilt), work]

    def _to_undo(self, activity: Activity) -> StartedActivity | None:
        """The newest wasted work to be undone before an activity: it has changed what this needs,
        or more than this makes anew.
        """
        needs, makes = activity.needs.keys(), activity.makes.keys()
        for spoiler in self._undoable():
            if spoiler.spoilt & needs or (spoiler.spoilt & makes and spoiler.spoilt - makes):
                return spoiler
        return None

    def _undoable(self) -> Iterator[StartedActivity]:
        """Wasted work that can be undone, the newest first."""
        return (one for one in reversed(self._spoilers) if one.activity.undo and one.spoilt)

    def _undo(self, spoiler: StartedActivity) -> None:
        """Undo wasted work, if nothing that runs is in the way of that."""
        if any(one.conflicts_with(_undoing(spoiler)) for one in self._all()):
            return
        work = StartedActivity(
            spoiler.state, _undoing(spoiler), TaskRole.RESTORING, self._now.begin(spoiler.activity)
        )
        self._restoring = work, spoiler
        self._start(work)

    # --- tasks ------------------------------------------------------------------------------------

    def _start(self, work: StartedActivity) -> None:
        work.start(self._task, self._heard)
        self._news.append(work)

    def _set_role(self, work: StartedActivity, role: TaskRole) -> None:
        work.role = role
        self._news.append(work)

    def _heard(self, task: ActivityTask, change: Change) -> None:
        """A task has changed; this is called in the midst of other things."""
        self._put(lambda: self._note(task, change))

    def _note(self, task: ActivityTask, change: Change) -> None:
        is_current = self.current is not None and task in self.current.tasks
        task.note(change, self._failures, Mistakes() if is_current else self._mistakes)
        if not change.is_over:
            return
        for work in list(self._all()):
            if task in work.tasks:
                self._note_end(work)

    def _note_end(self, work: StartedActivity) -> None:
        """A task of an activity has ended."""
        if self._restoring is not None and work is self._restoring[0]:
            self._note_restored(*self._restoring)
            return
        if work.is_done and not work.is_finished:
            work.is_finished = True
            self._now.finish(work.activity)
            if work is self.current:
                self._plain.finish(work.activity)
        if work.failed_task is not None and work.kill_at is None:  # the others have to end, too
            if work is not self.current:
                self._waste(work)
            work.request_end(
                "another task of its activity has failed", self._task.time() + self._patience
            )
        if work.is_over and work in self._ending:
            self._ending.remove(work)
        if work.is_over and work.spoilt and not work.has_begun:
            self._forget(work)

    def _note_restored(self, work: StartedActivity, spoiler: StartedActivity) -> None:
        if not work.is_over:
            return
        self._restoring = None
        if work.is_done:
            self._forget(spoiler)
        elif work.failed_task is not None:
            _LOG.warning(
                "%r did not undo what was done ahead in vain: that stays", work.failed_task.sent
            )
        spoiler.spoilt.clear()

    def _forget(self, spoiler: StartedActivity) -> None:
        """What it would have changed is as it was before."""
        self._now.known |= {
            name: value for name, value in spoiler.before.items() if name in spoiler.spoilt
        }
        spoiler.spoilt.clear()

    # --- ends -------------------------------------------------------------------------------------

    def _end(self, work: StartedActivity, why: str) -> None:
        self._ending.append(work)
        work.request_end(why, self._task.time() + self._patience)

    @property
    def kill_due(self) -> float | None:
        """When the patience with something that is to end is over."""
        waited = [
            one.kill_at
            for one in self._all()
            if one.kill_at is not None and not (one.is_over or one.is_killed)
        ]
        return min(waited, default=None)

    def kill_late(self) -> None:
        """Kill what was asked to end, and has not ended in time."""
        for work in self._all():
            if (
                work.kill_at is not None
                and work.kill_at <= self._task.time()
                and not work.is_killed
            ):
                work.kill(f"it has not ended within {self._patience:g} s")

    def kill_all(self, why: str) -> None:
        """Kill everything."""
        for work in self._all():
            work.kill(why)


def _phase(work: StartedActivity) -> WorkPhase:
    if work.failed_task is not None:
        return WorkPhase.FAILED if work.is_over else WorkPhase.STOPPING
    return WorkPhase.DONE if work.is_done else WorkPhase.RUNNING


def _undoing(work: StartedActivity) -> Activity:
    """What undoes an activity, as an activity whose progress nobody asks for."""
    return Activity(*work.activity.undo, makes=work.activity.makes, progress=lambda _: 0.0)
