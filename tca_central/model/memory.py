"""The memory of ended tasks: outcomes, for a while, and the records that modules retain."""

from tca_central.errors import RequestError
from tca_central.model.stored import Stored
from tca_central.model.tasks import TaskOutcome, TaskRecord
from tca_wire.packets.large import held_size
from tca_wire.vocabulary import Outcome, Refusal

REMEMBERED_OUTCOMES = 10_000
"""Ended tasks whose failure or result can still be requested."""

_DONE = Outcome.DONE, "", "", b""


class Memory(Stored):
    """The outcomes and records of ended tasks, within bounds."""

    __slots__ = (
        "ends",
        "forgotten",
        "outcome_bytes",
        "outcomes",
        "record_bytes",
        "records",
        "retentions",
    )

    def __init__(self) -> None:
        #: By task id, oldest first: all outcomes but "done" without a result.
        self.outcomes: dict[int, TaskOutcome] = {}
        #: By task id: the final states that do not follow from the outcomes.
        self.ends: dict[int, str] = {}
        self.outcome_bytes = 0  #: bytes of all outcomes
        self.forgotten = 0  #: the highest id of a task whose outcome was forgotten
        #: By task id, oldest first: records that modules retain.
        self.records: dict[int, TaskRecord] = {}
        self.record_bytes = 0  #: bytes of all records
        #: Number of tasks, living or ended, that modules retain. A task that two modules retain
        #: counts twice.
        self.retentions = 0

    def outcome_of(self, task_id: int) -> TaskOutcome | None:
        """Return the outcome of an ended task; None if it was forgotten.

        A task without an entry was done without a result, if its id is above ``forgotten``.
        """
        if (record := self.records.get(task_id)) is not None:
            return record.outcome
        if task_id <= self.forgotten and task_id not in self.outcomes:
            return None
        return self.outcomes.get(task_id, _DONE)

    def end_of(self, task_id: int) -> str:
        """Return the final state of an ended task; "" if it follows from the outcome."""
        record = self.records.get(task_id)
        return record.end if record is not None else self.ends.get(task_id, "")

    def known_outcome(self, task_id: int) -> TaskOutcome:
        """Return the outcome of an ended task. Raise RequestError if it was forgotten."""
        if (outcome := self.outcome_of(task_id)) is not None:
            return outcome
        raise RequestError(
            Refusal.TOO_LATE, f"task {{{task_id}}} ended too long ago to know how: see the journal"
        )

    def remember(self, task_id: int, outcome: TaskOutcome, end: str, most_bytes: int) -> list[int]:
        """Store an outcome, and the final state if the outcome does not tell it.

        Return the ids of tasks whose outcomes were forgotten to make room.
        """
        self.outcomes[task_id] = outcome
        if end:
            self.ends[task_id] = end
        self.outcome_bytes += _size(outcome)
        displaced = []
        while len(self.outcomes) > REMEMBERED_OUTCOMES or self.outcome_bytes > most_bytes:
            oldest = next(iter(self.outcomes))
            self.outcome_bytes -= _size(self.outcomes.pop(oldest))
            self.ends.pop(oldest, None)
            self.forgotten = max(self.forgotten, oldest)
            displaced.append(oldest)
        return displaced


def _size(outcome: TaskOutcome) -> int:
    """Return the bytes that an outcome holds."""
    return len(outcome[2]) + held_size(outcome[3])
