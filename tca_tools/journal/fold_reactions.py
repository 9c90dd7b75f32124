"""The fold of failures, wiretaps, monitors, suspensions and deadlines into the records of a run. Pure.

Each method that takes a ``fact`` takes all of that type.
"""

from math import inf

from tca_tools.journal.fold_records import RecordFold
from tca_tools.journal.lives import effect_of
from tca_tools.journal.records import EventAhead, Exhausted, Failure, Hold, LifeChange, Retry, Task, added
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.life_cycles import Effect
from tca_wire.points import ROOT, Moment, Point, TaskId
from tca_wire.rules import CONDITIONS
from tca_wire.vocabulary import Refusal


class ReactionFold(RecordFold):
    """Records that are being written, of what reacts to others."""

    def __init__(self) -> None:
        super().__init__()
        self._called: dict[TaskId, dict[int, int]] = {}
        """For each task whose exception handlers were called, by attachment, how often."""
        self._called_for: dict[int, tuple[int, Failure]] = {}
        """By exception handler, the task that had failed, and how."""
        self._seen_to: dict[int, Failure] = {}
        """By task, the failure whose handler could not decide: the search for the next one goes on, whatever else has
        been raised on the task meanwhile.
        """

    def _caught(self, fact: facts.Caught) -> None:
        calls = self._called.setdefault(fact.at, {})
        calls[fact.attachment] = calls.get(fact.attachment, 0) + 1
        if fact.task > 0:
            task = self._task(fact.task)
            self._search_on(task)
            self._called_for[fact.handler] = fact.task, task.failure
            task.caught_by = added(task.caught_by, fact.handler)
            if not fact.is_beside:
                task.deciders = added(task.deciders, fact.handler)
            task.is_recovering, task.is_dealt_with, task.is_unhandled = True, False, False

    def _unhandled(self, fact: facts.Unhandled) -> None:
        if fact.task > 0:
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
        if fact.task > 0:
            task = self._task(fact.task)
            task.is_recovering, task.is_dealt_with = self._is_undecided(task), True

    def _end_recovery(self, handler: Task) -> None:
        """An exception handler has ended, perhaps of a task that is retried: then it has dealt with nothing."""
        if handler.id in self._called_for:
            task = self._task(TaskId(self._called_for[handler.id][0]))
            if task.is_recovering and not self._is_undecided(task):
                task.is_recovering, task.is_unhandled = False, True

    def _is_undecided(self, task: Task) -> bool:
        deciders = (self.tasks[handler] for handler in task.deciders[-1:] if handler in self.tasks)
        return any(one.id in self._called_for and not one.has_ended for one in deciders)

    def _retried(self, fact: facts.Retried) -> None:
        if fact.task > 0:
            task = self._task(fact.task)
            task.is_recovering = task.is_dealt_with = task.is_unhandled = False
            self._forget_outcome(task)
            is_other = fact.body not in (b"", task.body)
            runs, sent = len(task.handlings), len(task.children)
            task.retries = added(task.retries, Retry(self.time, fact.by, is_other, runs, sent, self.asker))
            self._change(task, "body", fact.body or task.body)
            self._change(task, "watched", "")

    def _suspended(self, fact: facts.SuspendedOrResumed) -> None:
        if fact.task > 0:
            task = self._task(fact.task)
            if fact.is_suspended:
                self._suspend(task, fact.by)
            else:
                for one in self._living(task):
                    self._end_suspension(one, is_resumed=True, by=fact.by)

    def _state_changed(self, fact: facts.StateChanged) -> None:
        if fact.task > 0:
            task = self._task(fact.task)
            effect = effect_of(self, task, fact.transition, fact.state)
            change = LifeChange(
                self.time, fact.transition, fact.state, fact.serial, fact.by, fact.module, fact.text, fact.body, effect
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
        if fact.monitor > 0:
            self._task(fact.monitor).is_waited_for = True

    def _spared(self, fact: facts.OutlivesRetry) -> None:
        if fact.monitor > 0:
            self._task(fact.monitor).outlives_retry = True

    def _tested(self, fact: facts.MonitorTested) -> None:
        self.tests.setdefault(fact.monitor, []).append((self.time, fact.holds))

    def _watched(self, fact: facts.MonitorEnded) -> None:
        if fact.monitor > 0:
            self._change(self._task(fact.monitor), "watched", fact.why)
            self.news.append(self._task(fact.monitor))  # also where its state stays, since what it did goes on

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
        """Note which exception handlers of a task, or above it, had been called as often as they may."""
        failure, at, above = self._task(task).failure.name, task, [task]
        while at != ROOT:
            above.append(at := self.tasks[at].parent)
        for attachment, calls in (one for at in above for one in self._called.get(at, {}).items()):
            known = self.attached.get(attachment)
            if known is not None and 0 < known.maximum <= calls and known.failure in ("", failure):
                self.exhausted.setdefault(task, []).append(Exhausted(self.time, known.handler, calls))

    def _tap_added(self, fact: facts.TapAdded) -> None:
        self.taps[fact.id] = fact

    def _tap_fired(self, fact: facts.TapFired) -> None:
        """Hold a task for a listener that must end first, as a constraint does; also where it is handled once more."""
        tap, tapped, listener = self.taps.get(fact.tap), self.tasks.get(fact.tapped), self.tasks.get(fact.listener)
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
            moment = next((moment for moment in Moment if fact.moment & moment), None)
            self.ahead.setdefault(task.id, []).append(EventAhead(self.time, fact.seconds, moment))

    def _kill_planned(self, fact: facts.KillPlanned) -> None:
        if fact.task in self.tasks:
            ahead = EventAhead(self.time, fact.seconds, None, fact.after, fact.scope, fact.by)
            self.ahead.setdefault(fact.task, []).append(ahead)
