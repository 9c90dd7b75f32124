"""What is known of tasks that have ended: outcomes, for a while, and the records that modules
keep.
"""

from tca_central.errors import RequestError
from tca_central.model.stored import Stored
from tca_central.model.tasks import KeptTask, TaskOutcome
from tca_wire.vocabulary import Outcome, Refusal

REMEMBERED_OUTCOMES = 10_000
"""Ended tasks whose failure or result can still be asked for."""

_DONE = Outcome.DONE, "", "", b""


class Memory(Stored):
    """Outcomes and records of ended tasks, within bounds."""

    __slots__ = ("forgotten", "kept", "kept_bytes", "outcome_bytes", "outcomes", "promises")

    def __init__(self) -> None:
        self.outcomes: dict[
            int, TaskOutcome
        ] = {}  #: of those that did not just end well, oldest first
        self.outcome_bytes = 0  #: that these hold
        self.forgotten = 0  #: the highest id of a task whose outcome was known, and is no more
        self.kept: dict[
            int, KeptTask
        ] = {}  #: records of ended tasks that modules keep, by id, oldest first
        self.kept_bytes = 0  #: that these hold
        self.promises = 0  #: number of tasks, living or ended, that each module keeps, added up

    def outcome_of(self, task_id: int) -> TaskOutcome | None:
        """The outcome of an ended task; None if it is forgotten."""
        if (record := self.kept.get(task_id)) is not None:
            return record.outcome
        if task_id <= self.forgotten and task_id not in self.outcomes:
            return None
        return self.outcomes.get(task_id, _DONE)

    def known_outcome(self, task_id: int) -> TaskOutcome:
        """The outcome of an ended task. Raises RequestError if it is forgotten."""
        if (outcome := self.outcome_of(task_id)) is not None:
            return outcome
        raise RequestError(
            Refusal.TOO_LATE, f"task {task_id} ended too long ago to know how: see the journal"
        )

    def remember(self, task_id: int, outcome: TaskOutcome, most_bytes: int) -> list[int]:
        """Note an outcome of which there is more to tell than that the task is done; the tasks that
        give way.
        """
        self.outcomes[task_id] = outcome
        self.outcome_bytes += _size(outcome)
        gone = []
        while len(self.outcomes) > REMEMBERED_OUTCOMES or self.outcome_bytes > most_bytes:
            oldest = next(iter(self.outcomes))
            self.outcome_bytes -= _size(self.outcomes.pop(oldest))
            self.forgotten = max(self.forgotten, oldest)
            gone.append(oldest)
        return gone


def _size(outcome: TaskOutcome) -> int:
    return len(outcome[2]) + len(outcome[3])
