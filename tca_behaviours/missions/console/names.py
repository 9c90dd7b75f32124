"""The names of the console: the tasks, ``mission``, ``index``, ``status`` and ``help``."""

import pydoc
from collections.abc import Callable
from typing import Any

from tca_behaviours.missions.client.errors import UnknownTask
from tca_behaviours.missions.client.mission import Mission
from tca_module import MisuseError, TcaError
from tca_wire.text.nearest import nearest_or_all


class ConsoleNames:
    """The functions of a console, for one mission."""

    def __init__(self, mission: Mission, show: Callable[[str], object] = print) -> None:
        self.mission = mission
        self._show = show

    @property
    def names(self) -> dict[str, Any]:
        """All names, with their values."""
        tasks = {name: getattr(self.mission, name) for name in self.mission.offered()}
        return {
            **tasks,
            "mission": self.mission,
            "index": self.index,
            "status": self.status,
            "help": self.help,
        }

    def describe(self, error: BaseException) -> str:
        """Describe the error of a typed line in one line, with advice.

        A name that is not known, and a call with the wrong arguments, are described as the errors
        of missions are.
        """
        kind, text = type(error), str(error)
        if isinstance(error, KeyboardInterrupt):
            text = "status() shows the tasks that still run"
        elif isinstance(error, NameError) and not isinstance(error, TcaError):
            known = nearest_or_all(error.name or "", self.names, "there are")
            kind, text = UnknownTask, f"there is no task '{error.name}': {known}"
        elif isinstance(error, TypeError):
            kind, text = MisuseError, f"{text}: help() explains the calls"
        return f"{kind.__name__}: {text}"

    def index(self) -> None:
        """List the tasks of the server."""
        tasks = sorted(self.mission.offered().values(), key=lambda task: task.name)
        width = max((len(task.name) for task in tasks), default=0)
        for task in tasks:
            self._show(f"{task.name:{width}}  {task.help.partition(chr(10))[0]}")

    def status(self) -> None:
        """Show the server's running tasks, and the last ended tasks of this console."""
        running = self.mission.running_tasks()
        for task in running:
            self._show(str(task))
        if not running:
            self._show("nothing runs")
        for handle in self.mission.ended:
            self._show(f"{handle} {handle.end_in_words}")

    def help(self, task: Any = None) -> None:
        """Explain a task and its parameters: ``help(GoTo)``. Without a task: list the names."""
        if task is None:
            self._show(
                "index() lists the tasks, status() the running ones, help(TASK) explains one."
            )
            self._show("TASK(..., foreground=False) runs in the background.")
            self._show("mission.stop_task(NUMBER) stops a task that status() shows.")
            self._show("mission.idle() stops all tasks of the server.")
            self._show("Ctrl-C stops the task that you wait for. Ctrl-D leaves.")
            return
        name = task if isinstance(task, str) else getattr(task, "__name__", "")
        offered = self.mission.offered().get(name)
        if offered is None:
            pydoc.help(task)
            return
        self._show(f"{offered.name}: {offered.help_text}")
