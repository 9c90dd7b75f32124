"""Create and change the records of a run. Pure.

The facts of failures, wiretaps, monitors, suspensions and deadlines are folded here, all others in
fold.py.
"""

from collections.abc import Iterator
from math import inf

from tca_tools.journal.failure import NO_FAILURE, Failure
from tca_tools.journal.lives import effect_of
from tca_tools.journal.records import (
    Claim,
    Exhausted,
    HandlerWait,
    Handling,
    Hold,
    LifeChange,
    Message,
    ModuleRecord,
    PlannedEvent,
    Queueing,
    Restart,
    Retry,
    Suspension,
    Task,
    first_moment,
)
from tca_tools.journal.sequences import appended
from tca_tools.journal.whole_run import UNKNOWN, Run
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.life_cycles import Effect
from tca_wire.points import ROOT, START_HANDLING, Moment, Point, TaskId
from tca_wire.rules import CONDITIONS
from tca_wire.vocabulary import MessageClass, Refusal


class RecordFold(Run):
    """A run whose records are being created and changed."""

    def __init__(self) -> None:
        super().__init__()
        self.news: list[Task | Handling | Queueing | HandlerWait | Claim | ModuleRecord] = []
        """The records that the newest entry changed. A task is among them if its state, its
        constraints or its life cycle changed, or if it stopped watching.
        """
        self._touched: dict[int, Task] = {}
        """The tasks whose state may have changed with the newest entry."""
        self._ever_suspended: set[TaskId] = set()
        """The top-level tasks with a descendant that was suspended at some time."""
        self.asker: Handling | None = None
        """The run of a handler whose request caused the newest entry."""
        self._is_end_planned = False
        """Whether central was asked to end, and to keep the run."""
        self._called: dict[TaskId, dict[int, int]] = {}
        """For each task, the number of calls of its exception handlers by attachment."""
        self._called_for: dict[int, tuple[int, Failure]] = {}
        """For each exception handler, the failed task and its failure."""
        self._undecided: dict[int, Failure] = {}
        """For each task, the failure that its last exception handler left undecided. The next one
        is called for this failure, not for a later one.
        """
        self._replaced: dict[int, Failure] = {}
        """For each task that a fallback is to replace, the failure that the fallback resolves."""

    def _module(self, name: str) -> ModuleRecord:
        if name not in self.modules:
            self.modules[name] = ModuleRecord(name)
        return self.modules[name]

    def _task(self, task: TaskId) -> Task:
        """Return a task for a change; a task from before the journal gets a record at the root."""
        if task not in self.tasks:
            self._plant(Task(task, UNKNOWN, MessageClass.GOAL, "", 0, self.time))
        found = self._touched[task] = self.tasks[task]
        return found

    def _touch(self, message_id: int) -> None:
        """Update a task's state once all facts of the entry are applied."""
        if (task := self.tasks.get(message_id)) is not None:
            self._touched[message_id] = task

    def _hold(self, task: Task, hold: Hold) -> None:
        """Add a constraint to a task."""
        task.holds = appended(task.holds, hold)
        self.news.append(task)

    def _start_again(self, message: Message) -> None:
        """Clear the old outcome of a message that is about to be handled.

        A task that continues in spite of its failure retains the failure. An exception handler has
        dealt with it or is doing so, or the task has survived it.
        """
        continues = isinstance(message, Task) and (
            message.is_recovering or message.is_dealt_with or message.is_unhandled
        )
        if not continues:
            self._forget_outcome(message)

    def _forget_outcome(self, message: Message) -> None:
        """Clear the old outcome. A result is cleared only of a task.

        A message to many receivers retains the answers of the other receivers.
        """
        if not message.changes:  # most messages have no old outcome
            return
        self._change(message, "failure", NO_FAILURE)
        self._change(message, "failure_data", b"")
        if message.message_class.is_task:
            self._change(message, "result", b"")

    def _change(self, message: Message, name: str, value: str | bytes) -> None:
        """Overwrite a field; the old value stays known."""
        if getattr(message, name) != value:
            message.overwrite(name, value, self.time)
            self._touch(message.id)

    def _plant(self, task: Task) -> None:
        """Add a new task to the tree."""
        self.messages[task.id] = self.tasks[task.id] = self._touched[task.id] = task
        self.births.append(self.time)
        if task.parent != ROOT and 0 < task.parent < task.id:
            parent = self._task(task.parent)
            parent.children = appended(parent.children, TaskId(task.id))
            task.top = parent.top
            if parent.suspension and not task.role.runs_while_suspended:
                above = parent.suspension
                own = Suspension(TaskId(task.id), above.cause, self.time, above.handlings)
                own.by, own.since_birth = above.by, above.since_birth
                task.suspensions = appended(task.suspensions, own)
        else:
            task.parent, task.top = ROOT, TaskId(task.id)
            self.top.append(TaskId(task.id))

    def _suspend(self, top: Task, by: str) -> None:
        """Suspend a task with all its descendants."""
        self._ever_suspended.add(top.top)
        above = top.suspension  # already suspended, but descendants may have been resumed alone
        cause, handlings = TaskId(top.id), list[Handling]()
        if above:
            cause, handlings = above.cause, above.handlings
        is_created_so = top.received == self.time and top.time_of(START_HANDLING) == inf
        for task in self._open_under(top):
            if not task.suspension:
                own = Suspension(
                    TaskId(task.id), cause, self.time, handlings, by=by, since_birth=is_created_so
                )
                task.suspensions = appended(task.suspensions, own)
                self._touch(task.id)
            if task.handling and not above:
                handlings.append(task.handling)

    def _work_on(self, task: Task, handling: Handling) -> None:
        """Add a handler that starts to the suspensions of the task and its ancestors."""
        above: Task | None = task if task.top in self._ever_suspended else None
        while above is not None:
            if (suspension := above.suspension) and suspension.cause == above.id:
                suspension.handlings.append(handling)
            above = self.tasks.get(above.parent)

    def _end_suspension(self, task: Task, *, is_resumed: bool = False, by: str = "") -> None:
        if suspension := task.suspension:
            suspension.end, suspension.is_resumed, suspension.resumed_by = self.time, is_resumed, by
            self._touch(task.id)

    def _open_under(self, top: Task) -> Iterator[Task]:
        """Yield a task and its descendants that have not ended."""
        below = [top]
        for task in below:  # the list grows during the loop
            yield task
            below += [
                self.tasks[child] for child in task.children if not self.tasks[child].has_ended
            ]

    # --- each method applies all facts of one type ------------------------------------------------

    def _caught(self, fact: facts.Caught) -> None:
        calls = self._called.setdefault(fact.at, {})
        calls[fact.attachment] = calls.get(fact.attachment, 0) + 1
        task = self._task(fact.task)
        # Only the fallback of a retry policy is not attached
        self._restore_failure(task, self._undecided if fact.attachment else self._replaced)
        if not fact.attachment and task.retries:
            task.retries[-1].replaced = self.time
        self._called_for[fact.handler] = fact.task, task.failure
        task.caught_by = appended(task.caught_by, fact.handler)
        if not fact.is_beside:
            task.deciders = appended(task.deciders, fact.handler)
        task.is_recovering, task.is_dealt_with, task.is_unhandled = True, False, False

    def _unhandled(self, fact: facts.Unhandled) -> None:
        task = self._task(fact.task)
        self._pass_over(task)
        if not fact.undecided and task.top != task.id:
            self._task(task.top).fails_by_subtask = True
        self.unhandled.setdefault(fact.task, []).append(self.time)
        self._add_exhausted(fact.task)

    def _pass_over(self, task: Task) -> None:
        """Store that no exception handler decides about a task's newest failure.

        Another one may still decide about an older failure.
        """
        self._restore_failure(task, self._undecided)
        task.is_recovering = self._is_undecided(task)
        task.is_dealt_with, task.is_unhandled = False, True

    def _restore_failure(self, task: Task, failures: dict[int, Failure]) -> None:
        """Restore the failure that an exception handler left undecided, or resolves."""
        if failure := failures.pop(task.id, None):
            self._change(task, "failure", failure)

    def _reopen_search(self, handler: int) -> None:
        """Store that an exception handler left a failure undecided: killed, or passed it on."""
        if handler in self._called_for:
            task, failure = self._called_for.pop(handler)
            self._undecided[task] = failure

    def _recovered(self, fact: facts.Recovered) -> None:
        task = self._task(fact.task)
        task.is_recovering, task.is_dealt_with = self._is_undecided(task), True

    def _finish_recovery(self, handler: Task) -> None:
        """Mark a task as unhandled if its last exception handler ended without a decision."""
        if handler.id in self._called_for:
            task = self._task(TaskId(self._called_for[handler.id][0]))
            if task.is_recovering and not self._is_undecided(task):
                task.is_recovering, task.is_unhandled = False, True

    def _is_undecided(self, task: Task) -> bool:
        deciders = (self.tasks[handler] for handler in task.deciders[-1:] if handler in self.tasks)
        return any(one.id in self._called_for and not one.has_ended for one in deciders)

    def _retried(self, fact: facts.Retried) -> None:
        if ROOT < fact.failed != fact.task:  # the retry may spare it
            self._pass_over(self._task(fact.failed))
        task = self._task(fact.task)
        task.is_recovering = task.is_dealt_with = task.is_unhandled = False
        if not fact.fallback:
            self._replaced.pop(task.id, None)
        elif task.id not in self._replaced:  # a later failure changes nothing
            cause = self.tasks.get(fact.failed, task)
            words = cause.failure.words if cause is task else f"in {cause}: {cause.failure.words}"
            self._replaced[task.id] = Failure(cause.failure.name, words)
        if not fact.fallback or fact.failed != task.id:
            self._forget_outcome(task)
        has_other_data = fact.body not in (b"", task.body)
        counts = len(task.handlings), len(task.children)
        retry = Retry(
            self.time, fact.by, has_other_data, *counts, self.asker, fact.failed, fact.fallback
        )
        if fact.pause is not None:
            self._hold(task, Hold(fact.pause, self.time))
        task.retries = appended(task.retries, retry)
        self._change(task, "body", fact.body or task.body)
        self._change(task, "watched", "")

    def _suspended(self, fact: facts.SuspendedOrResumed) -> None:
        task = self._task(fact.task)
        if fact.is_suspended:
            self._suspend(task, fact.by)
        else:
            for one in self._open_under(task):
                self._end_suspension(one, is_resumed=True, by=fact.by)

    def _state_changed(self, fact: facts.StateChanged) -> None:
        task = self._task(fact.task)
        effect = effect_of(self, task, fact.transition, fact.state)
        change = LifeChange(
            self.time,
            fact.transition,
            fact.state,
            fact.serial,
            fact.by,
            fact.module,
            fact.text,
            fact.body,
            effect,
        )
        task.life = appended(task.life, change)
        self.news.append(task)
        if effect is Effect.TAKE_GOAL:
            asked = (one.body for one in reversed(task.life) if one.effect is Effect.NEW_GOAL)
            self._change(task, "body", fact.body or next(asked, task.body))

    def _restarted(self, fact: facts.CentralRestarted) -> None:
        self.restarts.append(Restart(self.time, fact.away, self._is_end_planned))
        self._is_end_planned = False

    def _central_ending(self, fact: facts.CentralEnding) -> None:
        self._is_end_planned = fact.keep

    def _refused(self, fact: facts.RequestRefused) -> None:
        if fact.refusal is Refusal.DEADLOCK:
            self.deadlocks[self.time, fact.sender] = Failure(fact.refusal, fact.text)

    def _waited_for(self, fact: facts.WaitedFor) -> None:
        self._task(fact.monitor).is_waited_for = True

    def _outlives_retry(self, fact: facts.OutlivesRetry) -> None:
        self._task(fact.monitor).outlives_retry = True

    def _tested(self, fact: facts.MonitorTested) -> None:
        self.tests.setdefault(fact.monitor, []).append((self.time, fact.holds))

    def _watched(self, fact: facts.MonitorEnded) -> None:
        self._change(self._task(fact.monitor), "watched", fact.why)
        # Reported even if the state is unchanged: the monitor's action may still run
        self.news.append(self._task(fact.monitor))

    def _timed_out(self, fact: facts.TimedOut) -> None:
        if (held := self.tasks.get(fact.constraint.after.task)) is not None:
            for hold in held.holds:
                if hold.over == inf and hold.constraint == fact.constraint:
                    hold.over = self.time
                    self._touch(held.id)

    def _attached(self, fact: facts.Attached) -> None:
        self.attached[fact.id] = fact

    def _reissued(self, fact: facts.Reissued) -> None:
        self.reissued[fact.handler] = self.time
        self._reopen_search(fact.handler)

    def _not_resolved(self, fact: facts.NotResolved) -> None:
        self.left_open[fact.handler] = self.time
        self._reopen_search(fact.handler)

    def _add_exhausted(self, task: TaskId) -> None:
        """Store the exception handlers of a task and its ancestors with no calls left."""
        failure, above = self._task(task).failure.name, [task]
        while above[-1] != ROOT:
            above.append(self.tasks[above[-1]].parent)
        counts = (self._called.get(number, {}) for number in above)
        for attachment, calls in (one for each in counts for one in each.items()):
            known = self.attached.get(attachment)
            if known is not None and 0 < known.maximum <= calls and known.failure in ("", failure):
                self.exhausted.setdefault(task, []).append(
                    Exhausted(self.time, known.handler, calls)
                )

    def _tap_added(self, fact: facts.TapAdded) -> None:
        self.taps[fact.id] = fact

    def _tap_fired(self, fact: facts.TapFired) -> None:
        """Hold a task until a listener has ended, as a constraint does."""
        tapped, listener = self.tasks.get(fact.tapped), self.tasks.get(fact.listener)
        tap = self.taps.get(fact.tap)
        rule = CONDITIONS[tap.condition] if tap is not None else None
        if tapped is None or listener is None or rule is None or not rule.holds_until:
            return
        before, after = Moment(rule.holds_until), Moment(rule.held_moment)
        # A handling may start again, so its listener holds the task each time
        is_pending = tapped.time_of(after) == inf or after is Moment.START_HANDLING
        if is_pending and listener.time_of(before) == inf:
            points = Point(TaskId(listener.id), before), Point(TaskId(tapped.id), after)
            self._hold(tapped, Hold(Constraint(*points), self.time, tap=tap))

    def _deadline(self, fact: facts.DeadlineSet) -> None:
        if (task := self.tasks.get(fact.task)) is not None:
            ahead = PlannedEvent(self.time, fact.seconds, first_moment(fact.moment))
            self.plans.setdefault(task.id, []).append(ahead)

    def _kill_planned(self, fact: facts.KillPlanned) -> None:
        if fact.task in self.tasks:
            ahead = PlannedEvent(self.time, fact.seconds, None, fact.after, fact.scope, fact.by)
            self.plans.setdefault(fact.task, []).append(ahead)
