"""The tasks of one server as a mission knows them: read again when central has told of handlers
that came or went.
"""

import contextlib
import time
from typing import Any

from tca_behaviours.missions.client.errors import NotOffered, UnknownTask
from tca_behaviours.missions.client.mission_goal import MissionGoal
from tca_behaviours.missions.client.offered_task import OfferedTask, offered_tasks
from tca_module import Command, MisuseError
from tca_wire.text.nearest import nearest_or_all

_LOOK_AGAIN = 0.1  # seconds between two looks whether the server has come


class Catalogue:
    """The tasks that a server offers now."""

    def __init__(self, server: str, goal: MissionGoal) -> None:
        self.server = server  #: its name; "": the only one that there is
        self._goal = goal
        self._known: dict[str, OfferedTask] = {}
        self._known_at = -1  # the changes of which was heard before they were read
        self._messages: dict[str, Command[Any, Any]] = {}

    @property
    def tasks(self) -> dict[str, OfferedTask]:
        """By name."""
        if self._known_at != self._goal.changes:
            self._read()
        return self._known

    @property
    def names(self) -> list[str]:
        """The names of the tasks; in a thread that is not the mission's those that were known
        last.
        """
        with contextlib.suppress(MisuseError):
            return list(self.tasks)
        return list(self._known)

    def task(self, name: str) -> OfferedTask:
        """The task of that name. Raises UnknownTask; NotOffered if the server has left."""
        if (task := self.tasks.get(name)) is not None:
            return task
        if not self._known:
            raise NotOffered(f"server '{self.server}' has left: start it again")
        what = f"server '{self.server}' offers no task '{name}'"
        raise UnknownTask(f"{what}: {nearest_or_all(name, self._known, 'it offers')}")

    def message(self, task: OfferedTask) -> Command[Any, Any]:
        """The command that a task is, as its server has declared it."""
        if task.message not in self._messages:
            self._messages[task.message] = self._goal.sender.declared(task.message)
        return self._messages[task.message]

    def find_server(self, patience: float) -> None:
        """Wait until the server is there, at most so many seconds. Raises NotOffered, MisuseError
        if there are several and none was named.
        """
        until = time.monotonic() + patience
        while True:
            servers = self._read()
            if not self.server and len(servers) > 1:
                raise MisuseError(
                    f"there are several servers of tasks: say which, Mission('{servers[0]}'): {servers}"
                )
            self.server = self.server or "".join(servers)
            if self.server in servers:
                self._read()
                return
            if time.monotonic() > until:
                what = (
                    f"server '{self.server}' offers no tasks"
                    if self.server
                    else "no server offers tasks"
                )
                raise NotOffered(
                    f"{what} after {patience:g} s: {nearest_or_all(self.server, servers, 'there are')}"
                )
            time.sleep(_LOOK_AGAIN)

    def _read(self) -> list[str]:
        """Ask central for the tasks; the names of all servers."""
        self._known_at = self._goal.changes
        offered = [task for task in offered_tasks(self._goal.sender.messages()) if task.is_handled]
        self._known = {task.name: task for task in offered if task.server == self.server}
        return sorted({task.server for task in offered})
