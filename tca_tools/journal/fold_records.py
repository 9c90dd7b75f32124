"""How the records of a run are made and written over, so that it stays known from when on what was so. Pure.

fold.py and fold_reactions.py say which fact writes what.
"""

from collections.abc import Iterator
from math import inf

from tca_tools.journal.records import (
    NO_FAILURE,
    Claim,
    HandlerWait,
    Handling,
    Hold,
    Message,
    ModuleRecord,
    Queueing,
    Suspension,
    Task,
    added,
)
from tca_tools.journal.whole_run import UNKNOWN, Run
from tca_wire.points import ROOT, START_HANDLING, TaskId
from tca_wire.vocabulary import MessageClass


class RecordFold(Run):
    """Records that are being written."""

    def __init__(self) -> None:
        super().__init__()
        self.news: list[Task | Handling | Queueing | HandlerWait | Claim | ModuleRecord] = []
        """The records that the newest entry changed; a task only if its state changed, or it got a constraint."""
        self._touched: dict[int, Task] = {}
        """The tasks whose state may have changed with the newest entry."""
        self._ever_suspended: set[TaskId] = set()
        """The top-level tasks under which something was suspended."""
        self.asker: Handling | None = None
        """The run of a handler that asked for what the newest entry tells."""

    def _module(self, name: str) -> ModuleRecord:
        if name not in self.modules:
            self.modules[name] = ModuleRecord(name)
        return self.modules[name]

    def _task(self, task: TaskId) -> Task:
        """A task that something happens to; one sent before the journal begins gets a record under the root."""
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
        """It is about to be handled. A task that goes on, since its failure was dealt with or, where nobody handled it,
        since it survives what is above it, keeps that failure.
        """
        goes_on = isinstance(message, Task) and (message.is_recovering or message.is_dealt_with or message.is_unhandled)
        if not goes_on:
            self._forget_outcome(message)

    def _forget_outcome(self, message: Message) -> None:
        """It is handled anew: what came of that before is void. A message to many keeps what the others answered."""
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
                here = Suspension(TaskId(task.id), cause, self.time, still, by=by, since_birth=is_born_so)
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
            below += [self.tasks[child] for child in task.children if not self.tasks[child].has_ended]
