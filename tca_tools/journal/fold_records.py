"""How the records of a run are made and written over, so that it stays known from when on what was
so. Pure.

Also the fold of failures, wiretaps, monitors, suspensions and deadlines; fold.py has that of all
other facts.
"""

from collections.abc import Iterator
from math import inf

from tca_tools.journal.lives import effect_of
from tca_tools.journal.records import (
    NO_FAILURE,
    Claim,
    EventAhead,
    Exhausted,
    Failure,
    HandlerWait,
    Handling,
    Hold,
    LifeChange,
    Message,
    ModuleRecord,
    Queueing,
    Retry,
    Suspension,
    Task,
    added,
    first_moment,
)
from tca_tools.journal.whole_run import UNKNOWN, Run
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.life_cycles import Effect
from tca_wire.points import ROOT, START_HANDLING, Moment, Point, TaskId
from tca_wire.rules import CONDITIONS
from tca_wire.vocabulary import MessageClass, Refusal


class RecordFold(Run):
    """Records that are being written."""

    def __init__(self) -> None:
        super().__init__()
        self.news: list[Task | Handling | Queueing | HandlerWait | Claim | ModuleRecord] = []
        """The records that the newest entry changed; a task only if its state changed, or it got a
        constraint.
        """
        self._touched: dict[int, Task] = {}
        """The tasks whose state may have changed with the newest entry."""
        self._ever_suspended: set[TaskId] = set()
        """The top-level tasks under which something was suspended."""
        self.asker: Handling | None = None
        """The run of a handler that asked for what the newest entry tells."""
        self._called: dict[TaskId, dict[int, int]] = {}
        """For each task whose exception handlers were called, by attachment, how often."""
        self._called_for: dict[int, tuple[int, Failure]] = {}
        """By exception handler, the task that had failed, and how."""
        self._seen_to: dict[int, Failure] = {}
        """By task, the failure whose handler could not decide: the search for the next one goes on,
        whatever else has been raised on the task meanwhile.
        """

    def _module(self, name: str) -> ModuleRecord:
        if name not in self.modules:
            self.modules[name] = ModuleRecord(name)
        return self.modules[name]

    def _task(self, task: TaskId) -> Task:
        """A task that something happens to; one sent before the journal begins gets a record under
        the root.
        """
        if task not in self.tasks:
            self._plant(Task(task, UNKNOWN, MessageClass.GOAL, "", 0, self.time))
        found = self._touched[task] = self.tasks[task]
        return found

    def _touch(self, message_id: int) -> None:
        """Look at a task's state again when all facts of the event are known."""
        if (task := self.tasks.get(message_id)) is not None:
            self._touched[message_id] = task

    def _hold(self, task: Task, hold: Hold) -> None:
        """A constraint keeps a task waiting."""
        task.holds = added(task.holds, hold)
        self.news.append(task)

    def _begin_anew(self, message: Message) -> None:
        """It is about to be handled. A task that goes on, since its failure was dealt with or,
        where nobody handled it, since it survives what is above it, keeps that failure.
        """
        goes_on = isinstance(message, Task) and (
            message.is_recovering or message.is_dealt_with or message.is_unhandled
        )
        if not goes_on:
            self._forget_outcome(message)

    def _forget_outcome(self, message: Message) -> None:
        """It is handled anew: what came of that before is void. A message to many keeps what the
        others answered.
        """
        if not message.changes:  # as most: nothing came of it
            return
        self._change(message, "failure", NO_FAILURE)
        self._change(message, "failure_data", b"")
        if message.message_class.is_task:
            self._change(message, "result", b"")

    def _change(self, message: Message, name: str, value: str | bytes) -> None:
        """Write a new value over a field, and remember from when on it is so."""
        if getattr(message, name) != value:
            message.overwrite(name, value, self.time)
            self._touch(message.id)

    def _plant(self, task: Task) -> None:
        """Put a new task into the tree."""
        self.messages[task.id] = self.tasks[task.id] = self._touched[task.id] = task
        self.births.append(self.time)
        if task.parent != ROOT and 0 < task.parent < task.id:
            parent = self._task(task.parent)
            parent.children = added(parent.children, TaskId(task.id))
            task.top = parent.top
            if parent.suspension and not task.role.leaves_safe:
                above = parent.suspension
                here = Suspension(TaskId(task.id), above.cause, self.time, above.still, by=above.by)
                here.since_birth = above.since_birth
                task.suspensions = added(task.suspensions, here)
        else:
            task.parent, task.top = ROOT, TaskId(task.id)
            self.top.append(TaskId(task.id))

    def _suspend(self, top: Task, by: str) -> None:
        """Suspend a task with all that is under it."""
        self._ever_suspended.add(top.top)
        above = top.suspension  # of which a part was resumed alone
        cause, still = (above.cause, above.still) if above else (TaskId(top.id), list[Handling]())
        is_born_so = top.received == self.time and top.time_of(START_HANDLING) == inf
        for task in self._living(top):
            if not task.suspension:
                here = Suspension(
                    TaskId(task.id), cause, self.time, still, by=by, since_birth=is_born_so
                )
                task.suspensions = added(task.suspensions, here)
                self._touch(task.id)
            if task.handling and not above:
                still.append(task.handling)

    def _work_on(self, task: Task, handling: Handling) -> None:
        """A handler begins: what it is under may be suspended all the same."""
        above: Task | None = task if task.top in self._ever_suspended else None
        while above is not None:
            if (suspension := above.suspension) and suspension.cause == above.id:
                suspension.still.append(handling)
            above = self.tasks.get(above.parent)

    def _end_suspension(self, task: Task, *, is_resumed: bool = False, by: str = "") -> None:
        if suspension := task.suspension:
            suspension.end, suspension.is_resumed, suspension.resumed_by = self.time, is_resumed, by
            self._touch(task.id)

    def _living(self, top: Task) -> Iterator[Task]:
        """A task, and what is under it and has not ended."""
        below = [top]
        for task in below:  # grows while it is walked
            yield task
            below += [
                self.tasks[child] for child in task.children if not self.tasks[child].has_ended
            ]

    # --- facts of what reacts to others: each method takes all of one type ------------------------

    def _caught(self, fact: facts.Caught) -> None:
        calls = self._called.setdefault(fact.at, {})
        calls[fact.attachment] = calls.get(fact.attachment, 0) + 1
        task = self._task(fact.task)
        self._search_on(task)
        self._called_for[fact.handler] = fact.task, task.failure
        task.caught_by = added(task.caught_by, fact.handler)
        if not fact.is_beside:
            task.deciders = added(task.deciders, fact.handler)
        task.is_recovering, task.is_dealt_with, task.is_unhandled = True, False, False

    def _unhandled(self, fact: facts.Unhandled) -> None:
        task = self._task(fact.task)
        self._search_on(task)
        task.is_recovering, task.is_dealt_with, task.is_unhandled = False, False, True
        self.unhandled.setdefault(fact.task, []).append(self.time)
        self._exhaust(fact.task)

    def _search_on(self, task: Task) -> None:
        if failure := self._seen_to.pop(task.id, None):
            self._change(task, "failure", failure)

    def _could_not_decide(self, handler: int) -> None:
        """An exception handler was killed, or gave the failure back."""
        if handler in self._called_for:
            task, failure = self._called_for.pop(handler)
            self._seen_to[task] = failure

    def _recovered(self, fact: facts.Recovered) -> None:
        task = self._task(fact.task)
        task.is_recovering, task.is_dealt_with = self._is_undecided(task), True

    def _end_recovery(self, handler: Task) -> None:
        """An exception handler has ended, perhaps of a task that is retried: then it has dealt with
        nothing.
        """
        if handler.id in self._called_for:
            task = self._task(TaskId(self._called_for[handler.id][0]))
            if task.is_recovering and not self._is_undecided(task):
                task.is_recovering, task.is_unhandled = False, True

    def _is_undecided(self, task: Task) -> bool:
        deciders = (self.tasks[handler] for handler in task.deciders[-1:] if handler in self.tasks)
        return any(one.id in self._called_for and not one.has_ended for one in deciders)

    def _retried(self, fact: facts.Retried) -> None:
        task = self._task(fact.task)
        task.is_recovering = task.is_dealt_with = task.is_unhandled = False
        self._forget_outcome(task)
        is_other = fact.body not in (b"", task.body)
        runs, sent = len(task.handlings), len(task.children)
        task.retries = added(
            task.retries, Retry(self.time, fact.by, is_other, runs, sent, self.asker)
        )
        self._change(task, "body", fact.body or task.body)
        self._change(task, "watched", "")

    def _suspended(self, fact: facts.SuspendedOrResumed) -> None:
        task = self._task(fact.task)
        if fact.is_suspended:
            self._suspend(task, fact.by)
        else:
            for one in self._living(task):
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
        task.life = added(task.life, change)
        self.news.append(task)
        if effect is Effect.TAKE_GOAL:
            asked = (one.body for one in reversed(task.life) if one.effect is Effect.NEW_GOAL)
            self._change(task, "body", next(asked, task.body))

    def _refused(self, fact: facts.RequestRefused) -> None:
        if fact.refusal is Refusal.DEADLOCK:
            self.deadlocks[self.time, fact.sender] = Failure(fact.refusal, fact.text)

    def _waited_for(self, fact: facts.WaitedFor) -> None:
        self._task(fact.monitor).is_waited_for = True

    def _spared(self, fact: facts.OutlivesRetry) -> None:
        self._task(fact.monitor).outlives_retry = True

    def _tested(self, fact: facts.MonitorTested) -> None:
        self.tests.setdefault(fact.monitor, []).append((self.time, fact.holds))

    def _watched(self, fact: facts.MonitorEnded) -> None:
        self._change(self._task(fact.monitor), "watched", fact.why)
        self.news.append(
            self._task(fact.monitor)
        )  # also where its state stays, since what it did goes on

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
        self._could_not_decide(fact.handler)

    def _not_resolved(self, fact: facts.NotResolved) -> None:
        self.left_open[fact.handler] = self.time
        self._could_not_decide(fact.handler)

    def _exhaust(self, task: TaskId) -> None:
        """Note which exception handlers of a task, or above it, had been called as often as they
        may.
        """
        failure, at, above = self._task(task).failure.name, task, [task]
        while at != ROOT:
            above.append(at := self.tasks[at].parent)
        for attachment, calls in (one for at in above for one in self._called.get(at, {}).items()):
            known = self.attached.get(attachment)
            if known is not None and 0 < known.maximum <= calls and known.failure in ("", failure):
                self.exhausted.setdefault(task, []).append(
                    Exhausted(self.time, known.handler, calls)
                )

    def _tap_added(self, fact: facts.TapAdded) -> None:
        self.taps[fact.id] = fact

    def _tap_fired(self, fact: facts.TapFired) -> None:
        """Hold a task for a listener that must end first, as a constraint does; also where it is
        handled once more.
        """
        tap, tapped, listener = (
            self.taps.get(fact.tap),
            self.tasks.get(fact.tapped),
            self.tasks.get(fact.listener),
        )
        if tap is None or tapped is None or listener is None:
            return
        rule = CONDITIONS[tap.condition]
        if not rule.holds_until:
            return
        before, after = Moment(rule.holds_until), Moment(rule.before)
        is_to_come = tapped.time_of(after) == inf or after is Moment.START_HANDLING
        if is_to_come and listener.time_of(before) == inf:
            points = Point(TaskId(listener.id), before), Point(TaskId(tapped.id), after)
            self._hold(tapped, Hold(Constraint(*points), self.time, tap=tap))

    def _deadline(self, fact: facts.DeadlineSet) -> None:
        if (task := self.tasks.get(fact.task)) is not None:
            ahead = EventAhead(self.time, fact.seconds, first_moment(fact.moment))
            self.ahead.setdefault(task.id, []).append(ahead)

    def _kill_planned(self, fact: facts.KillPlanned) -> None:
        if fact.task in self.tasks:
            ahead = EventAhead(self.time, fact.seconds, None, fact.after, fact.scope, fact.by)
            self.ahead.setdefault(fact.task, []).append(ahead)
