"""A task that a mission has started."""

from collections.abc import Callable
from typing import Any

import msgspec

from tca_behaviours.missions.client.errors import MissionTaskFailed, in_words
from tca_behaviours.missions.outcomes import Status, TaskEnd, status_of
from tca_module import BadData, MisuseError, SentTask, TaskFailed, TaskKilled


class TaskHandle:
    """A task that a mission has started: ``watch = mission.WaitForROI(foreground=False, ...)``."""

    def __init__(
        self, name: str, sent: SentTask[Any], on_end: "Callable[[TaskHandle], None]"
    ) -> None:
        self.name = name
        self.sent = sent  #: as the library knows it: for constraints, wiretaps, ``info()``
        self.parameters: dict[str, Any] = {}  #: those that it was given
        self.failure = ""  #: the name of the failure that it ended with
        self._on_end = on_end
        self._end: TaskEnd | None = None

    def __repr__(self) -> str:
        return f"{self.name} {{{self.sent.id}}}"

    @property
    def id(self) -> int:
        """The task's number, as in the tree and in the journal."""
        return self.sent.id

    @property
    def is_over(self) -> bool:
        """Whether it has ended. Asks central, and doesn't wait for the end."""
        return self.end is not None

    @property
    def is_known_over(self) -> bool:
        """Whether it has ended, as far as this mission has heard."""
        return self._end is not None

    @property
    def end(self) -> TaskEnd | None:
        """How it ended; None while it runs. Asks central, and doesn't wait for the end."""
        if self._end is None and self.sent.info() is None:
            self.note_end()
        return self._end

    @property
    def is_interrupted(self) -> bool:
        """Whether it was killed, as far as this mission has heard."""
        return self._end is not None and Status.of(self._end.status) is Status.INTERRUPTED

    @property
    def end_in_words(self) -> str:
        """How it ended, as far as this mission has heard: "completed", "timeout: it ran for 2 s";
        "" while it runs.
        """
        return in_words(self._end) if self._end is not None else ""

    def note_end(self) -> None:
        """It has ended: ask how."""
        if self._end is None:
            self._end = self._read_end()
            self._on_end(self)

    def result(self) -> TaskEnd:
        """The end of a task that has ended. Raises MissionTaskFailed unless it completed."""
        end = self.end
        assert end is not None
        if Status.of(end.status) is not Status.COMPLETED:
            raise MissionTaskFailed(str(self), end, self.failure)
        return end

    @property
    def is_being_stopped(self) -> bool:
        """Whether it was killed and has yet to end."""
        info = self.sent.info()
        return info is not None and bool(info.killed)

    def stop(self, why: str = "the mission has stopped it") -> bool:
        """Ask for its end, and don't wait for that. False if it had ended."""
        return not self.is_over and self.sent.kill(why)

    def _read_end(self) -> TaskEnd:
        try:
            return msgspec.convert(self.sent.result(), TaskEnd)
        except BadData:  # the result of one that ended long ago is not kept
            return TaskEnd(Status.COMPLETED | Status.TERMINATED)
        except TaskKilled as error:
            return TaskEnd(Status.INTERRUPTED | Status.TERMINATED, error.why)
        except TaskFailed as error:
            self.failure = error.failure
            return TaskEnd(
                status_of(error.failure) | Status.TERMINATED, error.text.partition("\n")[0]
            )


def check_handles(*tasks: object) -> None:
    """Raise MisuseError for what is no task that a mission has started."""
    for task in tasks:
        if not isinstance(task, TaskHandle):
            advice = "give what a call with foreground=False, or start(), has returned"
            raise MisuseError(f"{task!r:.60} is no task that goes on: {advice}")
