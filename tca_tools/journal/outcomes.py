"""What became of a run: how long it lasted, and how its top-level tasks ended. Pure; keeps nothing
of other tasks.
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
    """As far as the entries went that it has taken in."""

    def __init__(self) -> None:
        self.lasted = 0.0
        """The time of the last entry."""
        self.is_closed = False
        """Whether central ended of its own will."""
        self.tasks = 0
        """How many there were, monitors apart."""
        self.why = ""
        """Why the first top-level task was killed, if one was."""
        self._states: dict[int, TaskState] = {}
        self._ends: dict[int, TaskState] = {}
        """The ends of top-level tasks that are not just achieved."""

    @property
    def top(self) -> Counter[TaskState]:
        """How many top-level tasks ended in which state; those that have not ended are
        "achieving".
        """
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

    def _was_killed(self, fact: facts.Killed) -> None:
        if fact.task in self._states:
            self._ends[fact.task] = (
                TaskState.FAILED if fact.failed == fact.task else TaskState.KILLED
            )
            self.why = self.why or kill_reason(fact.why, fact.by)

    def _recovered(self, fact: facts.Recovered) -> None:
        if fact.task in self._states:
            self._ends.setdefault(fact.task, TaskState.RESOLVED)

    def _retried(self, fact: facts.Retried) -> None:
        self._ends.pop(fact.task, None)

    def _closed(self, fact: facts.Closed) -> None:
        del fact
        self.is_closed = True

    def take(self, entries: Iterable[Entry]) -> None:
        """Take in what happened next."""
        for entry in entries:
            self.lasted, self.is_closed = entry.time, False
            for fact in entry.facts:
                if take := _TAKE.get(type(fact)):
                    take(self, fact)


_TAKE = takers(RunOutcome)


def outcome_of(entries: Iterable[Entry]) -> RunOutcome:
    """The outcome of a run."""
    found = RunOutcome()
    found.take(entries)
    return found
