"""A task that a mission has started."""

from typing import Any, Protocol

import msgspec

from tca_behaviours.missions.client.errors import MissionTaskFailed, describe_end
from tca_behaviours.missions.outcomes import STATUS_OF_FAILURE, Status, TaskEnd, status_of
from tca_module import BadData, MisuseError, SentTask, TaskFailed, TaskKilled


class TaskOwner(Protocol):
    """The tasks of a mission."""

    def on_task_end(self, task: "TaskHandle") -> None:
        """Forget a task that has ended."""


class TaskHandle:
    """A task that a mission has started: ``watch = mission.WaitForROI(foreground=False, ...)``.

    Attributes:
        name: the task's name, such as "WaitForROI".
        sent: the task as the library knows it: for constraints, wiretaps, ``info()``.
        parameters: the parameters that it was given.
        failure: the name of the failure that ended the task; "" if there was none.
    """

    def __init__(self, name: str, sent: SentTask[Any], owner: TaskOwner) -> None:
        """*owner*: the tasks of the mission that waits for this one."""
        self.name = name
        self.sent = sent
        self.parameters: dict[str, Any] = {}
        self.failure = ""
        self.owner = owner
        self._end: TaskEnd | None = None

    def __repr__(self) -> str:
        return f"{self.name} {{{self.sent.id}}}"

    @property
    def id(self) -> int:
        """The task's number, as in the tree and in the journal."""
        return self.sent.id

    @property
    def is_over(self) -> bool:
        """Whether it has ended. Asks central, and does not wait for the end."""
        return self.end is not None

    @property
    def is_known_over(self) -> bool:
        """Whether the mission has learned that the task has ended. Does not ask central."""
        return self._end is not None

    @property
    def end(self) -> TaskEnd | None:
        """Its outcome; None while it runs. Asks central, and does not wait for the end."""
        if self._end is None and self.sent.info() is None:
            self.record_end()
        return self._end

    @property
    def is_interrupted(self) -> bool:
        """Whether the mission has learned that the task was killed. Does not ask central."""
        return self._end is not None and Status.of(self._end.status) is Status.INTERRUPTED

    @property
    def end_in_words(self) -> str:
        """Its outcome, as far as the mission knows: "completed", "timeout: it ran for 2 s"; ""
        while it runs.
        """
        return describe_end(self._end) if self._end is not None else ""

    def record_end(self) -> None:
        """Record how the task has ended. Called after the end."""
        if self._end is None:
            self._end = self._read_end()
            self.owner.on_task_end(self)

    def result(self) -> TaskEnd:
        """Return the outcome of a task that has ended.

        Returns:
            The TaskEnd.

        Raises:
            MissionTaskFailed: the task did not complete.
        """
        end = self.end
        assert end is not None
        if Status.of(end.status) is not Status.COMPLETED:
            raise MissionTaskFailed(str(self), end, self.failure)
        return end

    @property
    def is_being_stopped(self) -> bool:
        """Whether it was killed and has not ended yet. Asks central."""
        info = self.sent.info()
        return info is not None and bool(info.killed)

    def stop(self, why: str = "the mission has stopped it") -> bool:
        """Stop the task, and do not wait for its end.

        Args:
            why: the reason, for people. Default: "the mission has stopped it".

        Returns:
            False if it had ended.
        """
        return not self.is_over and self.sent.kill(why)

    def _read_end(self) -> TaskEnd:
        try:
            return msgspec.convert(self.sent.result(), TaskEnd)
        except BadData:  # central does not retain the result of a task that ended long ago
            return TaskEnd(Status.COMPLETED | Status.TERMINATED)
        except TaskKilled as error:
            return TaskEnd(Status.INTERRUPTED | Status.TERMINATED, error.why)
        except TaskFailed as error:
            self.failure = error.failure
            named = "" if error.failure in STATUS_OF_FAILURE else error.failure
            text = ": ".join(filter(None, (named, error.text.partition("\n")[0])))
            return TaskEnd(status_of(error.failure) | Status.TERMINATED, text)


def check_handles(*tasks: object, owner: TaskOwner | None = None) -> None:
    """Raise MisuseError unless all are tasks that a mission has started: the mission of *owner*."""
    for task in tasks:
        if not isinstance(task, TaskHandle):
            advice = "give the TaskHandle that start(), or a call with foreground=False, returned"
            raise MisuseError(f"{task!r:.60} is not a started task: {advice}")
        if owner is not None and task.owner is not owner:
            advice = "open one with Mission(..., beside=other), or use find_task()"
            raise MisuseError(f"{task} belongs to another mission: {advice}")
