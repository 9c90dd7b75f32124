"""The tasks of a server, as a mission knows them.

The tasks are read again only after central has reported a change of handlers.
"""

import contextlib
import time
from typing import Any

from tca_behaviours.missions.client.errors import NotOffered, UnknownTask
from tca_behaviours.missions.client.mission_goal import MissionGoal
from tca_behaviours.missions.client.offered_task import OfferedTask, offered_tasks
from tca_module import Command, MisuseError
from tca_wire.text.nearest import nearest_or_all

_RETRY_PERIOD = 0.1  # seconds between two searches for the server


class Catalogue:
    """The tasks that a server offers now."""

    def __init__(self, server: str, goal: MissionGoal) -> None:
        self.server = server  #: its name; "" until the only server is found
        self._goal = goal
        self._known: dict[str, OfferedTask] = {}
        self._read_at = -1  # the count of changes when the tasks were read
        self._messages: dict[str, Command[Any, Any]] = {}

    @property
    def tasks(self) -> dict[str, OfferedTask]:
        """The tasks, by name."""
        if self._read_at != self._goal.handler_changes:
            self._read()
        return self._known

    @property
    def names(self) -> list[str]:
        """The names of the tasks.

        Only the mission's thread may ask central. Other threads get the names that the mission's
        thread read last.
        """
        with contextlib.suppress(MisuseError):
            return list(self.tasks)
        return list(self._known)

    def task(self, name: str) -> OfferedTask:
        """Return the task of that name. Raises UnknownTask; NotOffered if the server has left."""
        if (task := self.tasks.get(name)) is not None:
            return task
        if not self._known:
            raise NotOffered(f"server '{self.server}' offers no task now: start it, or wait for it")
        known = nearest_or_all(name, self._known, "it offers")
        raise UnknownTask(f"server '{self.server}' offers no task '{name}': {known}")

    def message(self, task: OfferedTask) -> Command[Any, Any]:
        """Return the command of a task, as its server has declared it."""
        if task.message not in self._messages:
            self._messages[task.message] = self._goal.sender.declared(task.message)
        return self._messages[task.message]

    def find_server(self, patience: float) -> None:
        """Wait until the server offers tasks, at most *patience* seconds.

        Raises:
            NotOffered: the server did not appear in time.
            MisuseError: there are several servers, and the mission names none.
        """
        until = time.monotonic() + patience
        while True:
            servers = self._read()
            if not self.server and len(servers) > 1:
                raise MisuseError(
                    f"several servers offer tasks: {servers}; "
                    f"name one, such as Mission('{servers[0]}')"
                )
            self.server = self.server or "".join(servers)
            if self.server in servers:
                self._read()
                return
            if time.monotonic() > until:
                problem = (
                    f"server '{self.server}' offers no tasks"
                    if self.server
                    else "no server offers tasks"
                )
                known = nearest_or_all(self.server, servers, "there are")
                raise NotOffered(f"{problem} after {patience:g} s: {known}")
            time.sleep(_RETRY_PERIOD)

    def _read(self) -> list[str]:
        """Ask central for the tasks. Returns the names of all servers."""
        self._read_at = self._goal.handler_changes
        offered = [task for task in offered_tasks(self._goal.sender.messages()) if task.is_handled]
        self._known = {task.name: task for task in offered if task.server == self.server}
        return sorted({task.server for task in offered})
