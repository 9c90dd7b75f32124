"""A dry run of a mission: ``python patrol.py --check``.

Names and parameters of tasks are checked as always, but no task is sent. Each counts as completed
at once. So the program reaches its later lines, and the robot does not move.
"""

import itertools
import sys
from typing import Any

from tca_behaviours.missions.client.conditions import ActiveConditions
from tca_behaviours.missions.client.task_handle import TaskHandle, TaskOwner
from tca_behaviours.missions.outcomes import Status, TaskEnd
from tca_wire.text.measures import counted

OPTION = "--check"
_MOST_CALLS = 1000  # calls of tasks after which a dry run ends: many missions are endless loops
_CALLS_UNTIL_VERIFIED = 20  # calls of tasks after which the conditions of a mission are verified


def is_asked_for() -> bool:
    """Return whether the program's command line has ``--check``."""
    return OPTION in sys.argv[1:]


class CheckedTask(TaskHandle):
    """A task of a dry run. It was not sent, and has completed."""

    _numbers = itertools.count(1)

    def __init__(self, name: str, owner: TaskOwner) -> None:
        unsent: Any = None
        super().__init__(name, unsent, owner)
        self._number = next(self._numbers)
        self._end = TaskEnd(Status.COMPLETED | Status.TERMINATED, "checked, and not run")

    @property
    def id(self) -> int:
        """A number that no task in central has."""
        return -self._number


class DryRun:
    """Counts the calls of tasks in a dry run, and ends endless loops."""

    def __init__(self) -> None:
        self.calls = 0
        self._calls_with_conditions = 0

    def report(self, mission: str) -> None:
        """Print the result of a dry run without an error."""
        loop = ", the most that one check covers" if self.calls == _MOST_CALLS else ""
        print(f"mission '{mission}': checked {counted(self.calls, 'call')} of tasks{loop}")

    def count_call(self, conditions: ActiveConditions) -> None:
        """Count the call of a task.

        Raises:
            ConditionVerified: the mission has had conditions for many calls. So the program's
                answer to them is checked, too.
            SystemExit: the mission seems to be an endless loop.
        """
        if self.calls == _MOST_CALLS:
            raise SystemExit
        self.calls += 1
        self._calls_with_conditions += 1
        if not conditions.are_given:
            self._calls_with_conditions = 0
        elif self._calls_with_conditions > _CALLS_UNTIL_VERIFIED:
            self._calls_with_conditions = 0
            raise conditions.take_all_as_verified()
