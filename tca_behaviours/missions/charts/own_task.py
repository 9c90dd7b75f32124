"""A machine as a task: a command that this process handles, with the machine's structure as data and the active states
as progress. So it stands in the tree with its tasks under it, can be watched, cancelled and killed, and ends if the
process dies.
"""

from tca_behaviours.missions.charts.running import MachineEnd, MachineRun
from tca_behaviours.missions.charts.states import MachineState
from tca_behaviours.missions.client.mission import BaseMission, Mission
from tca_behaviours.missions.outcomes import MISSION_TASK_FAILED, MISSION_TASK_TIMEOUT, Status, TaskEnd
from tca_module import Command, Module, Task, TcaError
from tca_wire.charts import ActiveStates, MachineChart, StateKind


def run_as_task(root: MachineState, chart: MachineChart, mission: BaseMission) -> TaskEnd:
    """Run a machine as a task of *mission*, until it has ended."""
    _check_tasks(root, mission)
    name = f"{chart.name} of {mission.name}"  # nobody else's: the newest handler of a name gets all
    command = Command(f"machine {name}", MachineChart, result=TaskEnd, progress=ActiveStates)
    module = Module(command.name, mission.central)

    @module.handles(command)
    def run(task: Task, _: MachineChart) -> TaskEnd:
        with Mission(mission.server, name=name, central=mission.central, under=task) as inner:
            end = MachineRun(root, inner, task.report).until_end()
        return _told(task, end)

    with module.running():
        return mission.finish(mission.start_command(command, chart, chart.name))


def _check_tasks(root: MachineState, mission: BaseMission) -> None:
    for state in root.all():
        if state.kind is StateKind.TASK:
            try:
                mission.check(state.task, **state.parameters)
            except TcaError as error:
                error.add_note(f"It is state {state!r} of {root!r}.")
                raise


def _told(task: Task, end: MachineEnd) -> TaskEnd:
    """The result of the machine's own task; one that did not complete fails, as a mission's tasks do."""
    if end.ending == "failed":
        raise MISSION_TASK_FAILED(text=end.text)
    if end.ending == "timeout":
        raise MISSION_TASK_TIMEOUT(text=end.text)
    if end.ending == "interrupted":
        task.kill(end.text)
    return TaskEnd(Status.COMPLETED | Status.TERMINATED, end.text)
