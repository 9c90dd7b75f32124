"""The status codes of a run of a task, and what is said of it: while it runs, at its end, as a
failure.
"""

from enum import IntEnum

import msgspec

from tca_module import Failure


class Status(IntEnum):
    """The status of a run. The end of a run carries the mask TERMINATED beside its status: ``code &
    TERMINATED``.
    """

    NEWBORN = 0
    CONFIGURED = 1
    INITIALISED = 2
    RUNNING = 3
    COMPLETED = 4
    INTERRUPTED = 5
    FAILED = 6
    TIMEOUT = 7
    CONFIGURATION_FAILED = 8
    INITIALISATION_FAILED = 9
    TERMINATED = 128

    @classmethod
    def of(cls, code: int) -> "Status":
        """The status in a code, without the mask."""
        return cls(code & ~cls.TERMINATED) if code != cls.TERMINATED else cls.TERMINATED


class TaskEnd(msgspec.Struct, frozen=True):
    """The result of a run that was completed."""

    status: int
    """COMPLETED, with the mask TERMINATED."""
    text: str = ""
    """The last that the task said of itself."""
    overruns: int = 0
    """Number of periods that were missed, because an iteration took too long."""

    def __repr__(self) -> str:
        try:
            status = Status.of(self.status).name
        except ValueError:  # of a server that has more of them
            status = str(self.status)
        return f"TaskEnd(status={status}, text={self.text!r}, overruns={self.overruns})"


class TaskStatus(msgspec.Struct, frozen=True, omit_defaults=True):
    """The progress of a run."""

    text: str = ""
    """What it says of itself."""
    overruns: int = 0
    """Number of periods that were missed so far."""
    status: int = Status.RUNNING


MISSION_TASK_FAILED = Failure("mission task failed")
"""``iterate`` or ``terminate`` returned or reported a failure; the text says why."""
MISSION_TASK_TIMEOUT = Failure("mission task timeout", kind_of=MISSION_TASK_FAILED)
"""The task ran longer than its ``task_timeout``."""
MISSION_TASK_INITIALISATION_FAILED = Failure(
    "mission task initialisation failed", kind_of=MISSION_TASK_FAILED
)
"""``initialise`` failed; neither ``iterate`` nor ``terminate`` ran."""

_OF_FAILURES = {
    MISSION_TASK_TIMEOUT.name: Status.TIMEOUT,
    MISSION_TASK_INITIALISATION_FAILED.name: Status.INITIALISATION_FAILED,
    "timeout": Status.TIMEOUT,
    "bad data": Status.CONFIGURATION_FAILED,
}


def status_of(failure: str) -> Status:
    """The status of a run that ended with the failure of that name."""
    return _OF_FAILURES.get(failure, Status.FAILED)
