"""A turtle with its simulator and its task server, on a stepped clock: what a second holds is the same in every run."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from robots.turtle_sim.environment import TurtleEnvironment
from robots.turtle_sim.simulator import Simulator
from robots.turtle_sim.task_server import TASKS
from robots.turtle_sim.world import CENTRE, Pose, TurtleWorld
from tca_missions import TaskEnd, TaskServer
from tca_missions.serving.definition import ServedTask
from tca_module import Client, SentTask, connect
from tca_module.testing import LocalCentral


@dataclass
class Town:
    central: LocalCentral
    world: TurtleWorld
    server: TaskServer
    user: Client

    @property
    def pose(self) -> Pose:
        return self.world.turtle("turtle").pose

    @property
    def place(self) -> tuple[float, float]:
        return self.pose.x, self.pose.y

    def start(self, task: str, **parameters: Any) -> SentTask[TaskEnd]:
        """Start a task."""
        definition = self.server.definitions[task]
        return self.user.command(definition.message, definition.parameters(**parameters), sequential=False)

    def run(self, task: str, **parameters: Any) -> TaskEnd:
        """Run a task to its end."""
        sent = self.start(task, **parameters)
        self.until_over(sent)
        return sent.result(timeout=5)

    def until_over(self, sent: SentTask[Any], at_most: float = 100.0) -> None:
        """Let time pass until a task has ended."""
        until = self.central.now() + at_most
        self.central.until_quiet()
        while sent.info() is not None:
            assert self.central.now() < until, f"{sent} has not ended within {at_most:g} s"
            self.central.advance(0.25)


@contextmanager
def town(
    pose: Pose = CENTRE, environment: TurtleEnvironment | None = None, tasks: Sequence[type[ServedTask[Any]]] = ()
) -> Iterator[Town]:
    world = TurtleWorld()
    world.spawn("turtle", pose)
    with LocalCentral(stepped=True) as central, Simulator(world).module("turtle", central).running():
        server = TaskServer("turtle", environment or TurtleEnvironment(), tasks, folder=TASKS, central=central)
        with server.running(), connect("test", central) as user:
            central.advance(0.1)  # the turtle has told where it is
            yield Town(central, world, server, user)
