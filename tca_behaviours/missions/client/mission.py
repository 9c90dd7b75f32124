"""Missions: the tasks of a server as functions, in plain Python."""

from collections.abc import Callable
from typing import Any

from tca_behaviours.missions.client.base_mission import BaseMission
from tca_behaviours.missions.client.errors import BadParameter
from tca_behaviours.missions.client.offered_task import OfferedTask
from tca_behaviours.missions.outcomes import TaskEnd


class Mission(BaseMission):
    """A mission: the tasks of a server as functions, for use in one thread.

    A call of a task runs the task to its end and returns its TaskEnd, or raises MissionTaskFailed.
    With ``foreground=False`` it starts the task and returns a TaskHandle at once. The end of the
    block, or of the process, stops all tasks that still run. Args: see ``BaseMission``.

    Example::

        with Mission("turtle") as mission:
            mission.GoTo(goal_x=1.0, goal_y=1.0)
    """

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("_"):
            raise AttributeError(name, name=name, obj=self)
        return self._function(self._task(name))

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *(self._catalogue.names if self._is_open else ())]

    def _function(self, task: OfferedTask) -> Callable[..., Any]:
        """Make the function that runs a task, with the task's name, help and parameters."""

        def function(*values: Any, **parameters: Any) -> Any:
            if values:
                names = ", ".join(f"{p.name}=..." for p in task.parameters[: len(values)])
                raise BadParameter(
                    f"{task.name}() takes its parameters by name: {task.name}({names})"
                )
            return self.run(task.name, **parameters)

        function.__name__ = function.__qualname__ = task.name
        function.__annotations__ = {"return": TaskEnd}
        function.task_of_mission = task.name  # type: ignore[attr-defined]  # steps read it
        function.__doc__ = task.help_text
        function.__module__ = self.server
        function.__signature__ = task.signature  # type: ignore[attr-defined]  # inspect reads it
        return function
