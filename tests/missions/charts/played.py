"""A mission whose tasks end as a script says, and a machine that runs on this mission until the
script ends.
"""

from contextlib import suppress
from typing import Any, get_args

from tca_behaviours.missions.charts import StateMachine
from tca_behaviours.missions.charts.running import MachineRun, RunEnd
from tca_behaviours.missions.outcomes import Status, TaskEnd
from tca_wire.charts import ActiveStates, Ending

ENDINGS: tuple[Ending, ...] = get_args(Ending)


STATUSES = dict(
    zip(ENDINGS, (Status.COMPLETED, Status.FAILED, Status.TIMEOUT, Status.INTERRUPTED), strict=True)
)


class PlayedTask:
    def __init__(self, mission: "PlayedMission", name: str) -> None:
        self.mission, self.name = mission, name
        self.end: TaskEnd | None = None

    def stop(self, why: str = "") -> None:
        self.mission.happened.append(f"stop {self.name}")
        self.mission.stopping.append(self)


class EndOfPlay(Exception):
    """The end of the script."""


class PlayedMission:
    """A mission whose tasks end as the script says. The script has a line for each wait: ``"GoTo
    failed"``, or several joined by ``+``; ``"time"`` passes the time until the wait's end.
    """

    def __init__(self, *script: str) -> None:
        self.script = list(script)
        self.now = 0.0
        self.happened: list[str] = []
        self.running: list[PlayedTask] = []
        self.stopping: list[PlayedTask] = []

    def start(self, task: str, /, **parameters: Any) -> PlayedTask:
        given = ",".join(f"{value}" for value in parameters.values())
        started = PlayedTask(self, f"{task}({given})" if given else task)
        if task == "Broken":
            raise ZeroDivisionError
        self.happened.append(f"start {started.name}")
        self.running.append(started)
        return started

    def first_ended(
        self, tasks: list[PlayedTask], timeout: float | None = None
    ) -> list[PlayedTask]:
        assert tasks, "a machine waits for nothing"
        if self.stopping and all(task in self.stopping for task in tasks):
            for task in self.stopping:
                self._end(task, "interrupted", "stopped")
            self.stopping = []
        if ended := [task for task in tasks if task.end is not None]:
            return ended
        if timeout == 0:
            return []
        if not self.script:
            raise EndOfPlay
        for line in self.script.pop(0).split(" + "):
            if line == "Ctrl-C":
                raise KeyboardInterrupt
            if line == "time":
                assert timeout is not None
                self.now += timeout
                return []
            name, ending = line.split(" ")
            found = next(
                task
                for task in self.running
                if task.name.partition("(")[0] == name and task.end is None
            )
            self._end(found, next(one for one in ENDINGS if one == ending), "")
        return [task for task in tasks if task.end is not None]

    def _end(self, task: PlayedTask, ending: Ending, text: str) -> None:
        task.end = TaskEnd(STATUSES[ending], text)
        self.running.remove(task)
        self.happened.append(f"{task.name} {ending}")


class Played:
    """A run of a machine, with its events."""

    def __init__(
        self,
        machine: StateMachine,
        *script: str,
        on: PlayedMission | None = None,
        data: dict[str, Any] | None = None,
    ) -> None:
        self.mission = on or PlayedMission(*script)
        self.published: list[ActiveStates] = []
        self.end: RunEnd | None = None
        mission: Any = self.mission
        self.data: dict[str, Any] = dict(data or {})
        run = MachineRun(
            machine.root,
            mission,
            self.published.append,
            data=self.data,
            others={"arm": mission},
            clock=lambda: self.mission.now,
        )
        with suppress(EndOfPlay):
            self.end = run.run_to_end()
        labels = [state.label for state in machine.chart.states]
        self.active = [
            [labels[number] for number in one.active if number] for one in self.published
        ]

    @property
    def happened(self) -> list[str]:
        return self.mission.happened
