"""The status codes of a run of a task, and the data of its end, its progress and its failures."""

from enum import IntEnum

import msgspec

from tca_module import Failure


class Status(IntEnum):
    """The status of a run, with the numbers of ROS's ``TaskStatus.msg``. The code of an end is a
    status with the mask TERMINATED: test it with ``code & TERMINATED``.
    """

    NEWBORN = 0
    CONFIGURED = 1
    INITIALISED = 2
    RUNNING = 3
    COMPLETED = 4
    INTERRUPTED = 6
    FAILED = 7
    TIMEOUT = 8
    CONFIGURATION_FAILED = 9
    INITIALISATION_FAILED = 10
    TERMINATED = 128

    @classmethod
    def of(cls, code: int) -> "Status":
        """Return the status in a code, without the mask TERMINATED.

        Args:
            code: the code, such as ``TaskEnd.status``.

        Returns:
            The Status.

        Raises:
            ValueError: this program does not know the status.
        """
        return cls(code & ~cls.TERMINATED) if code != cls.TERMINATED else cls.TERMINATED


class TaskEnd(msgspec.Struct, frozen=True):
    """The result of a completed run."""

    status: int
    """COMPLETED, with the mask TERMINATED."""
    text: str = ""
    """The last text that the task reported."""
    overruns: int = 0
    """The number of periods that were missed because an iteration took too long."""

    def __repr__(self) -> str:
        try:
            status = Status.of(self.status).name
        except ValueError:  # a newer server may have more status codes
            status = str(self.status)
        return f"TaskEnd(status={status}, text={self.text!r}, overruns={self.overruns})"


class TaskStatus(msgspec.Struct, frozen=True, omit_defaults=True):
    """The progress of a run."""

    text: str = ""
    """The newest text that the task reported."""
    overruns: int = 0
    """The number of periods that were missed so far."""
    status: int = Status.RUNNING


MISSION_TASK_FAILED = Failure("mission task failed")
"""``iterate`` or ``terminate`` failed; the text gives the reason."""
MISSION_TASK_TIMEOUT = Failure("mission task timeout", kind_of=MISSION_TASK_FAILED)
"""The task ran longer than its ``task_timeout``."""
MISSION_TASK_INITIALISATION_FAILED = Failure(
    "mission task initialisation failed", kind_of=MISSION_TASK_FAILED
)
"""``initialise`` failed; neither ``iterate`` nor ``terminate`` ran."""

STATUS_OF_FAILURE = {
    MISSION_TASK_FAILED.name: Status.FAILED,
    "handler error": Status.FAILED,
    MISSION_TASK_TIMEOUT.name: Status.TIMEOUT,
    MISSION_TASK_INITIALISATION_FAILED.name: Status.INITIALISATION_FAILED,
    "timeout": Status.TIMEOUT,
    "bad data": Status.CONFIGURATION_FAILED,
}
"""The failures that the status names: the text of an end leaves out their names."""


def status_of(failure: str) -> Status:
    """Return the status of a run that ended with a failure.

    Args:
        failure: the failure's name.

    Returns:
        The Status; FAILED for any other failure than those that have a status of their own.
    """
    return STATUS_OF_FAILURE.get(failure, Status.FAILED)
