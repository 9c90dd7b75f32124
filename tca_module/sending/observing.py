"""Observing the states of tasks, whoever sends and handles them; and cancelling those that a Sender has sent."""

from collections import deque
from collections.abc import Collection
from typing import Any

from tca_module import checks
from tca_module.checks import LateText, check
from tca_module.errors import MisuseError
from tca_module.following.followed_task import life_cycle_of
from tca_module.following.observation import Observation
from tca_module.following.stream import Stream
from tca_module.link.connection import Connection
from tca_module.sending.central_services import CentralServices
from tca_module.sending.task_ref import Change, TaskRef, change_of, node_of
from tca_module.session.epoch_numbers import EpochNumber
from tca_module.session.sent_tasks import SentId
from tca_wire.life_cycles import LifeCycle
from tca_wire.messages.declarations import Message
from tca_wire.packets.changes import Observe
from tca_wire.points import ROOT, TaskId
from tca_wire.vocabulary import Party

MOST_SENT = 10_000
"""Tasks that a Sender knows to have sent: the newest."""

_STATES = checks.ArgumentKind(
    "a list of states, such as ['running']",
    lambda value: isinstance(value, list | tuple | set | frozenset) and all(map(checks.NAME.fits, value)),
)
_TASK_OR_NONE = checks.ArgumentKind(
    "a task that was sent or found, or None", lambda task: task is None or isinstance(task, TaskRef)
)


def checked_states(call: str, message: object, states: Collection[str]) -> list[str]:
    """The states of which an observer wants to hear. Raises MisuseError for one that the message's tasks never have."""
    check(call, _STATES, states=states)
    check(call, checks.MESSAGE_OR_NAME, message=message)
    if isinstance(message, Message):
        cycle = life_cycle_of(message)
        if unknown := sorted(set(states) - set(cycle.states)):
            listed = ", ".join(f"'{one}'" for one in cycle.states)
            raise MisuseError(f"{call}: {message.title} is never '{unknown[0]}': {cycle} has {listed}")
    return list(states)


class SentTasks:
    """The newest tasks that a Sender has sent, with the times."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, str, TaskId]] = deque(maxlen=MOST_SENT)

    def add(self, time: float, message: str, task: TaskId) -> None:
        """One more was sent."""
        self._sent.append((time, message, task))

    def named(self, message: str, before: float | None) -> list[tuple[str, TaskId]]:
        """Those of a message ("": of all), sent before a moment."""
        return [
            (name, task) for time, name, task in self._sent
            if message in ("", name) and (before is None or time < before)
        ]  # fmt: skip


class ObservingServices(CentralServices):
    """The part of a Sender that observes tasks."""

    @property
    def _sent(self) -> SentTasks:
        """What it has sent."""
        raise NotImplementedError

    def tasks(self, message: Message[Any, Any] | str | None = None) -> list[TaskRef]:
        """The living tasks (of one *message*, or its name), parents first, at most 10,000 (TCA 8.5: ChildByName)."""
        return TaskRef(self._connection(), "root", ROOT, self._origin).descendants(message)

    def time(self) -> float:
        """The seconds of the clock on which callbacks are due and handlers sleep: it never jumps, and a test may step
        it.
        """
        return self._connection().transport.time()

    def observe(
        self, message: Message[Any, Any] | str | None = None, *, states: Collection[str] = (),
        below: TaskRef | None = None, timeout: float | None = None,
    ) -> Stream[Change]:  # fmt: skip
        """The changes of state of tasks, whoever sends and handles them: those of a *message*, or of what is *below* a
        task, or of all. First comes how each living one stands (``is_late``), then each change as it happens; and so
        again after a restart of central. It ends with the task *below* which it observes. With *states*, only changes
        to one of these come, and none is counted as missed.

        ::

            with user.observe(GRASP) as changes:
                for change in changes:
                    print(change.task, change.state)
        """
        wanted = checked_states("observe()", message, states)
        check("observe()", _TASK_OR_NONE, below=below)
        connection = self._declare(message) if isinstance(message, Message) else self._connection()
        name = message.name if isinstance(message, Message) else message or ""
        under = node_of(below) if below is not None else ROOT
        what = LateText(lambda: f"the states of '{name}'" if name else "the states of tasks")
        header = Observe(0, TaskId(0), name, under, wanted, self._origin)
        observation, origin = Observation(connection, header, what), self._origin
        return Stream(
            observation, lambda news: change_of(connection, news, origin), lambda _: True, "a change of state", timeout,
            is_owner=True,
        )  # fmt: skip

    def cancel_all(
        self, message: Message[Any, Any] | None = None, *, before: float | None = None, why: str = ""
    ) -> int:
        """Cancel the living tasks that this Sender has sent, as ``cancel()`` of each does: of one *message*, or sent
        *before* that moment of ``time()``; the number of them. It knows the newest 10,000 that it has sent. Tasks whose
        life cycle has no such transition are left alone.
        """
        if message is not None:
            check("cancel_all()", checks.MESSAGE, message=message)
        check("cancel_all()", checks.SECONDS_OR_NONE, before=before)
        check("cancel_all()", checks.TEXT, why=why)
        connection = self._connection()
        name = message.name if message is not None else ""
        sent = self._sent.named(name, before)
        living = {int(task.id) for task in self.tasks(message)} if sent else set()
        number = 0
        for kind, task in sent:
            if _may_live(task, living, connection) and _can_be_cancelled(life_cycle_of(connection.declared(kind))):
                TaskRef(connection, kind, task, self._origin).cancel(why)
                number += 1
        return number


def _may_live(task: TaskId, living: set[int], connection: Connection) -> bool:
    """Whether a task that was sent lives, or central has said nothing of it yet."""
    if isinstance(task, SentId):
        if not task.request.is_over:
            return True
        if task.request.has_failed:
            return False
    is_foreign = isinstance(task, EpochNumber) and task.epoch != connection.session.epoch
    return not is_foreign and int(task) in living


def _can_be_cancelled(cycle: LifeCycle) -> bool:
    return any(row.by is Party.CLIENT and cycle.ends_on_request(row.target) for row in cycle.transitions)
