"""A small robot for the tests of servers: a gripper that records the actions of its tasks."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tca_behaviours.missions import (
    Environment,
    OnceTask,
    PeriodicTask,
    Status,
    TaskEnd,
    TaskServer,
    parameter,
)
from tca_module import Client, SentTask, connect
from tca_module.testing import LocalCentral


class Gripper(Environment):
    def __init__(self) -> None:
        super().__init__()
        self.notes: list[str] = []

    def note(self, task: PeriodicTask[Any] | OnceTask[Any], what: str) -> None:
        """Record an action of a task, with its time."""
        self.notes.append(f"{task.task.time():.2f} {type(task).__name__} {what}")

    def read(self) -> list[str]:
        """Return the records since the last call."""
        notes, self.notes = self.notes, []
        return notes


class Turn(PeriodicTask[Gripper]):
    """Turn the wrist."""

    angle: float = parameter(1.0, "How far, in radians", minimum=-3, maximum=3)
    steps: int = parameter(3, "In so many steps", minimum=1)
    fails_in: str = parameter("", "What goes wrong")

    def initialise(self) -> None:
        self.env.note(self, "initialises")
        self.step = 0
        if self.fails_in == "initialise":
            raise ValueError("the wrist is stuck")

    def iterate(self) -> Status:
        self.step += 1
        self.env.note(self, f"step {self.step}")
        if self.fails_in == "iterate":
            self.report("halfway")
            raise self.failed("the wrist is stuck")
        if self.fails_in == "status":
            return Status.FAILED
        return Status.COMPLETED if self.step == self.steps else Status.RUNNING

    def terminate(self) -> None:
        self.env.note(self, "terminates")
        if self.fails_in == "terminate":
            raise self.failed("the brake does not hold")


class Grasp(OnceTask[Gripper]):
    """Close the fingers."""

    force: float = parameter(description="In newtons", minimum=0)

    def iterate(self) -> None:
        self.env.note(self, "closes")
        self.sleep(1.0)
        self.env.note(self, "has closed")
        self.report("closed")

    def terminate(self) -> None:
        self.env.note(self, "terminates")


class Brake(PeriodicTask[Gripper]):
    """Brake slowly."""

    seconds: float = 1.0

    def iterate(self) -> Status:
        return Status.RUNNING

    def terminate(self) -> None:
        self.env.note(self, "brakes")
        self.sleep(self.seconds)
        self.env.note(self, "stands")


class Robot:
    """A gripper with its server and a client."""

    def __init__(
        self, central: LocalCentral, user: Client, server: TaskServer, gripper: Gripper
    ) -> None:
        self.central = central
        self.user = user
        self.server = server
        self.gripper = gripper

    def send(self, task: str, **parameters: Any) -> SentTask[TaskEnd]:
        """Start a task."""
        definition = self.server.definitions[task]
        return self.user.command(
            definition.message, definition.parameters(**parameters), sequential=False
        )

    def after(self, seconds: float) -> list[str]:
        """Advance the clock. Return the records since the last call."""
        self.central.advance(seconds)
        return self.gripper.read()


@contextmanager
def serving(*tasks: Any, **options: Any) -> Iterator[Robot]:
    """Run a robot's server on a stepped clock."""
    gripper = Gripper()
    with LocalCentral(stepped=True) as central:
        server = TaskServer("gripper", gripper, tasks or (Turn, Grasp), central=central, **options)
        with server.running(), connect("user", central) as user:
            yield Robot(central, user, server, gripper)
