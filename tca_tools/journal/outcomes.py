"""The outcome of a run: its duration, and how its top-level tasks ended. Pure; it retains nothing
about other tasks.
"""

from collections import Counter
from collections.abc import Iterable

from tca_tools.journal.records import TaskState
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry
from tca_wire.journal.takers import takers
from tca_wire.points import ROOT, Moment
from tca_wire.text.facts_in_words import kill_reason


class RunOutcome:
    """The outcome of a run according to the entries passed to ``update``."""

    def __init__(self) -> None:
        self.lasted = 0.0
        """The time of the last entry."""
        self.is_closed = False
        """Whether central closed the run."""
        self.tasks = 0
        """The number of tasks, without monitors."""
        self.why = ""
        """Why the first top-level task failed or was killed, if one did."""
        self._unhandled = ROOT  #: the task whose failure fails the task that is killed next
        self._states: dict[int, TaskState] = {}
        self._ends: dict[int, TaskState] = {}
        """By top-level task whose end state will be another than *achieved*: that end state."""

    @property
    def top(self) -> Counter[TaskState]:
        """The number of top-level tasks by state; tasks that have not ended are "achieving"."""
        return Counter(self._states.values())

    def _received(self, fact: facts.Received) -> None:
        kind = fact.message_class
        if kind.is_task and not kind.is_monitor:
            self.tasks += 1
            if fact.parent == ROOT:
                self._states[fact.id] = TaskState.ACHIEVING

    def _reached(self, fact: facts.Reached) -> None:
        if fact.task in self._states and fact.moments & Moment.END_ACHIEVING:
            self._states[fact.task] = self._ends.get(fact.task, TaskState.ACHIEVED)

    def _found_unhandled(self, fact: facts.Unhandled) -> None:
        self._unhandled = ROOT if fact.undecided else fact.task

    def _was_killed(self, fact: facts.Killed) -> None:
        # The top-level task comes first: listeners and others are killed after it.
        has_failed, self._unhandled = fact.failed == self._unhandled != ROOT, ROOT
        if fact.task in self._states:
            self._ends[fact.task] = TaskState.FAILED if has_failed else TaskState.KILLED
            self.why = self.why or kill_reason(fact.why, fact.by)

    def _recovered(self, fact: facts.Recovered) -> None:
        if fact.task in self._states:
            self._ends.setdefault(fact.task, TaskState.RESOLVED)

    def _retried(self, fact: facts.Retried) -> None:
        self._ends.pop(fact.task, None)

    def _closed(self, fact: facts.Closed) -> None:
        del fact
        self.is_closed = True

    def update(self, entries: Iterable[Entry]) -> None:
        """Apply the next entries."""
        for entry in entries:
            self.lasted, self.is_closed = entry.time, False
            for fact in entry.facts:
                if apply_fact := _METHODS.get(type(fact)):
                    apply_fact(self, fact)


_METHODS = takers(RunOutcome)


def outcome_of(entries: Iterable[Entry]) -> RunOutcome:
    """Return the outcome of a run."""
    outcome = RunOutcome()
    outcome.update(entries)
    return outcome
