"""A small robot for the tests of missions: a rover whose tasks end when the test wants."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

from tca_behaviours.missions import (
    Environment,
    Mission,
    OnceTask,
    PeriodicTask,
    Status,
    TaskServer,
    parameter,
)
from tca_module import Failure
from tca_module.testing import LocalCentral

ROCK = Failure("rock", str)


class Rover(Environment):
    def __init__(self) -> None:
        super().__init__()
        self.done: list[str] = []
        self.arrived = threading.Event()

    def note(self, what: str) -> None:
        self.done.append(what)


class Drive(PeriodicTask[Rover]):
    """Drive to a place.

    It goes straight on.
    """

    x: float = parameter(0.0, "East, in metres", minimum=0, maximum=10)
    gear: Literal["slow", "fast"] = parameter("slow", "How fast")
    fails: str = parameter("", "What goes wrong")
    says: str = parameter("", "The text of its status")

    def initialise(self) -> None:
        self.env.note(f"to {self.x:g}")
        if self.fails == "initialise":
            raise self.failed("no wheels")

    def iterate(self) -> Status:
        if self.fails == "rock":
            raise ROCK("big", "hit a rock")
        if self.fails == "python":
            raise ValueError("a slip")
        self.report(self.says)
        return Status.RUNNING if self.fails == "never" else Status.COMPLETED

    def terminate(self) -> None:
        self.env.note(f"stands at {self.x:g}")


class Watch(PeriodicTask[Rover]):
    """Wait until the rover has arrived."""

    foreground: bool = False

    def iterate(self) -> Status:
        return Status.COMPLETED if self.env.arrived.is_set() else Status.RUNNING

    def terminate(self) -> None:
        self.env.note("watched")


class Weigh(OnceTask[Rover]):
    """Weigh a sample."""

    grams: list[int]

    def iterate(self) -> None:
        self.report(f"{sum(self.grams)} g")


TASKS = [Drive, Watch, Weigh]


@contextmanager
def rover() -> Iterator[tuple[LocalCentral, Rover]]:
    """Run a central, and a rover that serves at 100 Hz."""
    with LocalCentral() as central:
        environment = Rover()
        with TaskServer("rover", environment, tasks=TASKS, rate=100.0, central=central).running():
            yield central, environment


@contextmanager
def mission_of_rover() -> Iterator[tuple[Mission, Rover]]:
    """Run a rover and a mission on it."""
    with (
        rover() as (central, environment),
        Mission("rover", name="test", central=central) as mission,
    ):
        yield mission, environment
