"""A turtle with its simulator and its task server, on a stepped clock, so that every run is the
same.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import pytest
from module.real_central import until

from robots.turtle_sim.environment import TurtleEnvironment
from robots.turtle_sim.simulator import Simulator
from robots.turtle_sim.sync.link import StatusLink
from robots.turtle_sim.task_server import TASKS
from robots.turtle_sim.world import CENTRE, Pose, TurtleWorld
from tca_behaviours.missions import ConditionVerified, Mission, TaskEnd, TaskServer
from tca_behaviours.missions.serving.definition import ServedTask
from tca_module import Client, SentTask, connect
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Received


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
        return self.user.command(
            definition.message, definition.parameters(**parameters), sequential=False
        )

    def run(self, task: str, **parameters: Any) -> TaskEnd:
        """Run a task to its end."""
        sent = self.start(task, **parameters)
        self.until_over(sent)
        return sent.result(timeout=5)

    def until_over(self, sent: SentTask[Any], at_most: float = 100.0) -> None:
        """Advance until a task has ended."""
        until = self.central.now() + at_most
        self.central.until_quiet()
        while sent.info() is not None:
            assert self.central.now() < until, f"{sent} has not ended within {at_most:g} s"
            self.central.advance(0.25)


def carry_out(
    there: Town,
    mission: Callable[[Mission], Any],
    at_most: float = 10_000.0,
    opened: Mission | None = None,
) -> Any:
    """Carry out a mission in its own thread while time passes. Return its result."""

    def run() -> Any:
        with opened or Mission("turtle", name="test", central=there.central) as made:
            return mission(made)

    with ThreadPoolExecutor(1) as pool:
        carried_out = pool.submit(run)
        while not wait([carried_out], timeout=0.001).done:
            assert there.central.now() < at_most, "the mission does not end"
            there.central.advance(0.25)
        return carried_out.result()


def started(there: Town) -> list[str]:
    """Return the names of all started tasks, in order."""
    names = [f"{there.server.module.name}.{task}" for task in there.server.definitions]
    sent = [
        fact.message
        for fact in there.central.facts
        if isinstance(fact, Received) and fact.message in names
    ]
    return [name.partition(".")[2] for name in sent]


@contextmanager
def town(
    pose: Pose = CENTRE,
    environment: TurtleEnvironment | None = None,
    tasks: Sequence[type[ServedTask[Any]]] = (),
) -> Iterator[Town]:
    world = TurtleWorld()
    world.spawn("turtle", pose)
    with (
        LocalCentral(stepped=True) as central,
        Simulator(world).module("turtle", central).running(),
    ):
        server = TaskServer(
            "turtle", environment or TurtleEnvironment(), tasks, folder=TASKS, central=central
        )
        with server.running(), connect("test", central) as user:
            central.advance(0.1)  # the turtle has sent its pose
            yield Town(central, world, server, user)


class Enough:
    """A condition outside the mission's code that holds once a number of tasks has started."""

    def __init__(self, there: Town, tasks: int) -> None:
        self.there, self.tasks = there, tasks

    def is_verified(self) -> bool:
        return len(started(self.there)) >= self.tasks


def bounded(
    there: Town, tasks: int, endless: Callable[[Mission], object]
) -> Callable[[Mission], None]:
    """Return a mission that ends an endless one after its first tasks. A few more tasks may start
    before the end.
    """

    def carry_out(mission: Mission) -> None:
        mission.add_condition(Enough(there, tasks))
        with pytest.raises(ConditionVerified):
            endless(mission)

    return carry_out


def until_known(link: StatusLink, robot: str, status: int) -> None:
    """Wait until a link knows the status of a robot."""
    until(lambda: link.status(robot) == status, f"the status {status} of {robot}", 30.0)
