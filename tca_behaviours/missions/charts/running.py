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

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, NamedTuple

from tca_behaviours.missions.charts.statechart import Statechart
from tca_behaviours.missions.charts.states import ENDINGS, EndingArrow, MachineState
from tca_behaviours.missions.charts.user_data import FromData, log_error
from tca_behaviours.missions.client.base_mission import BaseMission
from tca_behaviours.missions.client.errors import BadParameter, MissionTaskFailed, NotOffered
from tca_behaviours.missions.client.mission import Mission
from tca_behaviours.missions.client.task_handle import TaskHandle
from tca_behaviours.missions.outcomes import (
    MISSION_TASK_FAILED,
    MISSION_TASK_TIMEOUT,
    Status,
    TaskEnd,
)
from tca_behaviours.statecharts.timers import Timers
from tca_module import CentralLost, Command, MisuseError, Module, Task, TaskKilled, TcaError
from tca_module.checks import quoted
from tca_wire.charts import ActiveStates, Ending, MachineChart, StateKind
from tca_wire.text.nearest import did_you_mean

_PATIENCE = 5.0
"""Seconds that a stopped machine waits for the ends of its tasks."""

_ENDING_OF_STATUS: dict[Status, Ending] = {
    Status.COMPLETED: "completed",
    Status.TIMEOUT: "timeout",
    Status.INTERRUPTED: "interrupted",
}
_METHODS = ("call", "concurrence", "epsilon", "machine", "sequence")
_ENDING_TEXTS = {
    "completed": "has completed",
    "failed": "has failed",
    "timeout": "was not done in time",
    "interrupted": "was interrupted",
}


class RunEnd(NamedTuple):
    """How a run ended, and the event that caused this ending."""

    ending: str
    event: str


class MachineEnd(TaskEnd, frozen=True):
    """The result of a machine that did not fail."""

    outcome: str = "completed"
    """"completed", or an outcome of its own."""

    def __repr__(self) -> str:
        return f"MachineEnd(outcome={self.outcome!r}, text={self.text!r})"


class MachineRun:
    """One run of the machine *root*. It calls *publish* when the active states change."""

    def __init__(
        self,
        root: MachineState,
        mission: BaseMission,
        publish: Callable[[ActiveStates], object],
        *,
        data: MutableMapping[str, Any] | None = None,
        others: Mapping[str, BaseMission] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """*data*: the user data. *others*: missions of other servers, by server."""
        self._root = root
        self._mission = mission
        self._publish = publish
        self._data: MutableMapping[str, Any] = {} if data is None else data
        self._others = others or {}
        self._clock = clock
        self._timers = Timers[EndingArrow]()
        self._calls = deque[MachineState]()
        """The active Python states, which are to be called in this order."""
        self._chart = Statechart(root, self._on_enter, self._on_exit)
        self._running: dict[MachineState, TaskHandle] = {}
        self._stopping: list[TaskHandle] = []
        """The tasks that are being stopped, and may still run."""

    def run_to_end(self) -> RunEnd:
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
        return RunEnd(ending, self._chart.cause)

    def _step(self) -> str:
        """Wait for an event, and leave its state. Returns a description of the event.

        The event is the end of a task, or else a time that is over, or else a Python state.
        """
        while True:
            tasks = list(self._running.values())
            if tasks and (ended := self._mission.first_ended(tasks, self._patience())):
                return self._leave_ended(ended[0])
            if (due := self._timers.due(self._clock())) is not None:
                event = f"{due.source.label}: {due.symbol}"
                self._chart.record_time(due.source, event)
                return event
            if self._calls:
                return self._call(self._calls[0])

    def _patience(self) -> float | None:
        """Return the seconds until a time is over; 0 if there is a state to call."""
        if self._calls:
            return 0.0
        due = self._timers.next
        return None if due is None else max(0.0, due - self._clock())

    def _leave_ended(self, task: TaskHandle) -> str:
        """Leave the state of a task that has ended. Returns a description of the event."""
        state = next(state for state, running in self._running.items() if running is task)
        end = task.end
        assert end is not None
        if state.end_name:
            setattr(state.data(self._data), state.end_name, end)
        ending = _ENDING_OF_STATUS.get(Status.of(end.status), "failed")
        return self._leave(state, ending, end.text if ending != "completed" else "")

    def _leave(self, state: MachineState, ending: str, text: str) -> str:
        event = f"{state.label} {_ENDING_TEXTS.get(ending, f'has ended as {ending}')}"
        event = f"{event}: {text}" if text else event
        self._chart.record_end(state, ending, event)
        return event

    def _call(self, state: MachineState) -> str:
        """Call the function of a Python state, and leave the state."""
        assert state.function is not None
        try:
            returned = state.function(state.data(self._data))
        except (CentralLost, TaskKilled):
            raise
        except Exception as error:
            log_error(f"state {state!r} of {self._root!r}", error)
            if isinstance(error, MisuseError):
                raise
            return self._leave(state, "failed", f"{type(error).__name__}: {error}")
        outcome = "completed" if returned is None else returned
        if outcome not in (*state.outcomes, "failed"):
            raise MisuseError(
                f"{state!r} returned {returned!r:.60}, which is not one of its outcomes: "
                f"return one of {quoted(state.outcomes)}, or add it to @state(outcomes=[...])"
            )
        return self._leave(state, outcome, "")

    def _on_enter(self, state: MachineState) -> None:
        # First let the tasks of earlier states leave the robot safe.
        if state.kind is StateKind.TASK:
            self._wait_for_stopping()
            parameters = state.parameters_from(self._data)
            mission = self._others.get(state.server, self._mission)
            self._running[state] = mission.start(state.task, **parameters)
        elif state.kind is StateKind.CALL:
            self._wait_for_stopping()
            self._calls.append(state)
        self._timers.enter(state, self._clock())

    def _on_exit(self, state: MachineState) -> None:
        self._timers.leave(state)
        if state in self._calls:
            self._calls.remove(state)
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


def run_as_task(
    root: MachineState,
    chart: MachineChart,
    mission: BaseMission,
    data: MutableMapping[str, Any],
) -> MachineEnd:
    """Run a machine as a task of *mission*, until it has ended."""
    # The name must be unique: the newest handler of a message gets all of them.
    name = f"{chart.name} of {mission.name}"
    servers = {state.server for state in root.all()} - {"", mission.server}
    central, endings = mission.central, list[str]()
    with _open_missions(servers, mission) as others:
        _check_tasks(root, mission, others, data)
    command = Command(f"machine {name}", MachineChart, result=TaskEnd, progress=ActiveStates)
    module = Module(command.name, central)

    @module.handles(command)
    def run(task: Task, _: MachineChart) -> TaskEnd:
        def publish(states: ActiveStates) -> None:
            task.report(states)
            task.sleep(0)  # a machine of Python states waits nowhere else: notice a kill

        with (
            Mission(mission.server, name=name, central=central, under=task) as inner,
            _open_missions(servers, inner) as others,
        ):
            run = MachineRun(root, inner, publish, data=data, others=others, clock=task.time)
            try:
                end = run.run_to_end()
            except (MisuseError, BadParameter, NotOffered) as error:
                raise MISSION_TASK_FAILED(text=str(error)) from None
        endings.append(end.ending)
        return _result(task, end)

    with module.running():
        end = mission.finish(mission.start_command(command, chart, chart.name))
    if not endings:  # in a dry run: each task of the machine completes at once

        def count_call(now: ActiveStates) -> object:  # also ends a loop of Python states
            return now.running or mission.start_command(command, chart, chart.name)

        with _open_missions(servers, mission) as others:
            checked = MachineRun(root, mission, count_call, data=data, others=others).run_to_end()
        if checked.ending in ENDINGS[1:]:
            status = Status[checked.ending.upper()] | Status.TERMINATED
            raise MissionTaskFailed(chart.name, TaskEnd(status, checked.event))
        endings.append(checked.ending)
    return MachineEnd(end.status, end.text, end.overruns, endings[0])


@contextmanager
def _open_missions(
    servers: Iterable[str], mission: BaseMission
) -> Iterator[dict[str, BaseMission]]:
    """Open a mission beside *mission* for each server."""
    with ExitStack() as stack:
        yield {
            server: stack.enter_context(Mission(server, beside=mission))
            for server in sorted(servers)
        }


def _check_tasks(
    root: MachineState,
    mission: BaseMission,
    others: Mapping[str, BaseMission],
    data: MutableMapping[str, Any],
) -> None:
    """Check the tasks and parameters, except those that wait for user data of a later state."""
    for state in root.all():
        if state.kind is StateKind.TASK:
            view = state.data(data)
            wanted = [one.name for one in state.parameters.values() if isinstance(one, FromData)]
            if not all(hasattr(view, name) for name in wanted):
                continue
            try:
                offering = others.get(state.server, mission)
                offering.check(state.task, **state.parameters_from(data))
            except TcaError as error:
                other = did_you_mean(state.task, _METHODS, " For a state of another kind, ")
                error.add_note(f"The task belongs to state {state!r} of {root!r}.{other}")
                raise


def _result(task: Task, end: RunEnd) -> TaskEnd:
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
