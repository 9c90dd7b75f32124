"""A running machine.

When the statechart enters a state, the state's task is started. When the statechart leaves the
state, the task is stopped.

One thread runs the machine and waits for its tasks. If a kill, Ctrl-C, or an error ends the wait,
all tasks of the machine are stopped.

The machine is itself a task: a command that this process handles. The command's data is the
machine's structure; its progress is the active states. The task stands in the tree with the
machine's tasks below it. This task can be watched, cancelled and killed, and ends if the process
dies.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

from tca_behaviours.missions.charts.statechart import Statechart
from tca_behaviours.missions.charts.states import MachineState
from tca_behaviours.missions.client.base_mission import BaseMission
from tca_behaviours.missions.client.mission import Mission
from tca_behaviours.missions.client.task_handle import TaskHandle
from tca_behaviours.missions.outcomes import (
    MISSION_TASK_FAILED,
    MISSION_TASK_TIMEOUT,
    Status,
    TaskEnd,
)
from tca_module import Command, Module, Task, TcaError
from tca_wire.charts import ActiveStates, Ending, MachineChart, StateKind

_PATIENCE = 5.0
"""Seconds that a stopped machine waits for the ends of its tasks."""

_ENDING_OF_STATUS: dict[Status, Ending] = {
    Status.COMPLETED: "completed",
    Status.TIMEOUT: "timeout",
    Status.INTERRUPTED: "interrupted",
}
_ENDING_TEXTS: dict[Ending, str] = {
    "completed": "has completed",
    "failed": "has failed",
    "timeout": "was not done in time",
    "interrupted": "was interrupted",
}


class MachineEnd(NamedTuple):
    """How a machine ended, and the event that led to it."""

    ending: Ending
    event: str


class MachineRun:
    """One run of the machine *root*. It calls *publish* when the active states change."""

    def __init__(
        self, root: MachineState, mission: BaseMission, publish: Callable[[ActiveStates], object]
    ) -> None:
        self._root = root
        self._mission = mission
        self._publish = publish
        self._chart = Statechart(root, self._on_enter, self._on_exit)
        self._running: dict[MachineState, TaskHandle] = {}
        self._stopping: list[TaskHandle] = []
        """The tasks that are being stopped, and may still run."""

    def run_to_end(self) -> MachineEnd:
        """Run the machine to its end. No task of the machine outlives this call."""
        try:
            self._chart.begin()
            event = ""
            while (ending := self._chart.ending) is None:
                running = [state.label for state in self._running]
                active = [state.number for state in self._chart.active]
                self._publish(ActiveStates(running, event, active))
                event = self._step()
            self._wait_for_stopping()
        except BaseException:
            self._stop_all()
            raise
        return MachineEnd(ending, event)

    def _step(self) -> str:
        """Wait until a task has ended, and leave its state. Returns a description of the event."""
        ended = self._mission.first_ended(list(self._running.values()))[0]
        state = next(state for state, task in self._running.items() if task is ended)
        end = ended.end
        assert end is not None
        ending = _ENDING_OF_STATUS.get(Status.of(end.status), "failed")
        event = f"{state.label} {_ENDING_TEXTS[ending]}"
        self._chart.record_end(state, ending)
        return f"{event}: {end.text}" if end.text and ending != "completed" else event

    def _on_enter(self, state: MachineState) -> None:
        if state.kind is StateKind.TASK:
            # First let the tasks of earlier states leave the robot safe.
            self._wait_for_stopping()
            self._running[state] = self._mission.start(state.task, **state.parameters)

    def _on_exit(self, state: MachineState) -> None:
        task = self._running.pop(state, None)
        if task is not None:
            self._stop(task, f"{self._root!r} has left {state!r}")

    def _stop(self, task: TaskHandle, why: str) -> None:
        if task.end is None:
            task.stop(why)
            self._stopping.append(task)

    def _wait_for_stopping(self, timeout: float | None = None) -> None:
        while remaining := [task for task in self._stopping if task.end is None]:
            if not self._mission.first_ended(remaining, timeout):
                break
        self._stopping.clear()

    def _stop_all(self) -> None:
        # Without central no task can be stopped; central kills them when the module is lost.
        with suppress(TcaError):
            for task in self._running.values():
                self._stop(task, f"{self._root!r} is stopped")
            self._wait_for_stopping(_PATIENCE)


# --- the machine as a task ------------------------------------------------------------------------


def run_as_task(root: MachineState, chart: MachineChart, mission: BaseMission) -> TaskEnd:
    """Run a machine as a task of *mission*, until it has ended."""
    _check_tasks(root, mission)
    # The name must be unique: the newest handler of a message gets all of them.
    name = f"{chart.name} of {mission.name}"
    command = Command(f"machine {name}", MachineChart, result=TaskEnd, progress=ActiveStates)
    module = Module(command.name, mission.central)

    @module.handles(command)
    def run(task: Task, _: MachineChart) -> TaskEnd:
        with Mission(mission.server, name=name, central=mission.central, under=task) as inner:
            end = MachineRun(root, inner, task.report).run_to_end()
        return _result(task, end)

    with module.running():
        return mission.finish(mission.start_command(command, chart, chart.name))


def _check_tasks(root: MachineState, mission: BaseMission) -> None:
    for state in root.all():
        if state.kind is StateKind.TASK:
            try:
                mission.check(state.task, **state.parameters)
            except TcaError as error:
                error.add_note(f"The task belongs to state {state!r} of {root!r}.")
                raise


def _result(task: Task, end: MachineEnd) -> TaskEnd:
    """Return the result of the machine's own task. If the machine did not complete, fail or kill
    that task.

    The machine's task ends as a task of a server would.
    """
    if end.ending == "failed":
        raise MISSION_TASK_FAILED(text=end.event)
    if end.ending == "timeout":
        raise MISSION_TASK_TIMEOUT(text=end.event)
    if end.ending == "interrupted":
        task.kill(end.event)
    return TaskEnd(Status.COMPLETED | Status.TERMINATED, end.event)
