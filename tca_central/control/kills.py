"""Kills: at once, some time from now, or after a point."""

import msgspec

from tca_central.control.pending import check_pending
from tca_central.failing.failures import kill
from tca_central.model.clock import checked_seconds
from tca_central.model.deliveries import Connection
from tca_central.model.intervals import checked_moment
from tca_central.model.task_tree import Task, Verdict
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.packets.headers import Accepted
from tca_wire.points import ROOT, Point, TaskId
from tca_wire.vocabulary import Due, Scope


class PendingKill:
    """A kill that is carried out when a point is reached, or some time after."""

    __slots__ = ("delay", "scope", "task", "verdict")

    def __init__(self, task: Task, scope: Scope, delay: float, verdict: Verdict) -> None:
        self.task, self.scope, self.delay, self.verdict = task, scope, delay, verdict

    def on_reached(self, central: State, _: Task) -> None:
        """The point is reached."""
        if not self.delay:
            self.carry_out(central)
        elif self._is_there(central):
            self.task.more.pending[self] = central.clock.after(self.delay, Due.KILL, self)

    def carry_out(self, central: State) -> None:
        """It is time."""
        if self.task.rare is not None:
            self.task.rare.pending.pop(self, None)
        if self._is_there(central):
            self._kill(central)

    def _kill(self, central: State) -> None:
        doomed = [self.task]
        if self.scope is not Scope.TASK:
            parent = self.task if self.scope is Scope.DESCENDANTS else self.task.parent
            assert parent is not None
            children = (parent.children or {}).values()
            doomed = [child for child in children if child is not self.task and not child.survives]
        for task in doomed:
            kill(central, task, self.verdict)

    def _is_there(self, central: State) -> bool:
        """Whether the task has not ended, perhaps by what let the point be reached."""
        return self.task.id == ROOT or self.task.id in central.tree.tasks


def on_kill(central: State, connection: Connection, header: headers.Kill, _: bytes) -> None:
    """A module ends a task, its descendants or its siblings; now, some time from now, or after a point."""
    if header.request:
        header = msgspec.structs.replace(header, task=_sent_with(connection, header.request))
        if not header.task:  # it has not come, and never will: it would have come before this
            central.accept(connection, header.number)
            return
    checked_seconds(header.delay, f"a kill of task {header.task} with a delay")
    is_all = header.task == ROOT and header.scope is Scope.DESCENDANTS
    task = central.tree.root if is_all else central.tree.task(header.task)
    if task is None:
        central.ignore(connection, header.number, f"task {header.task} has ended: it can't be killed")
        return
    by = connection.module.name
    verdict = Verdict(header.why, by, central.origin)
    pending = PendingKill(task, header.scope, header.delay, verdict)
    at = central.tree.task(header.after.task) if header.after is not None else None
    if header.after is not None and at is not None and not at.reached & checked_moment(header.after):
        check_pending(task)
        task.more.pending[pending] = at
        central.facts.append(_planned(pending, header.after))
        central.agenda.wait(at, checked_moment(header.after), pending)
    else:
        if header.delay:
            check_pending(task)
            central.facts.append(_planned(pending, None))
        pending.on_reached(central, task)
    central.accept(connection, header.number, header.task)


def _planned(pending: PendingKill, after: Point | None) -> facts.KillPlanned:
    why, by = pending.verdict.why, pending.verdict.by
    return facts.KillPlanned(TaskId(pending.task.id), pending.scope, after, pending.delay, why, by)


def _sent_with(connection: Connection, request: int) -> TaskId:
    """The task that came with a request of a connection; 0: none did."""
    answer, _ = connection.answers.get(request, (None, b""))
    return TaskId(answer.id if isinstance(answer, Accepted) else 0)
