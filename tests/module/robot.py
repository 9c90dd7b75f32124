"""A small walking robot: its vocabulary, a planner and legs."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from tca_module import Broadcast, Command, Failure, Goal, Inform, Module, MultiQuery, Query, Task
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Reached, Received
from tca_wire.points import Moment


@dataclass
class Arc:
    radius: float
    steps: int


@dataclass
class Footfall:
    leg: int
    height: float


WALK = Goal("walk", Arc)
STEP = Goal("step", int)
REST = Goal("rest")
MOVE_LEG = Command("move leg", int, result=Footfall)
STOP = Command("stop")
STANCE = Query("stance", float, reply=list[int])
TEMPERATURE = Query("temperature", reply=float)
HEALTH = MultiQuery("health", reply=str)
POSITION = Inform("position", Arc)
ALARM = Broadcast("alarm", str)
COLLISION = Failure("collision", Footfall)
EXHAUSTED = Failure("exhausted")


# --- A planner and legs, for tests of tasks -------------------------------------------------------


class Robot:
    """A planner and legs. Their actions are in ``done``, in order."""

    def __init__(self, central: LocalCentral) -> None:
        self.central = central
        self.planner = Module("planner", central)
        self.legs = Module("legs", central)
        self.done: list[str] = []
        self.legs.handles(MOVE_LEG)(self.move_leg)

    def move_leg(self, task: Task, leg: int) -> Footfall:
        self.done.append(f"leg {leg}")
        return Footfall(leg, 0.5)

    @contextmanager
    def running(self) -> Iterator[None]:
        with ExitStack() as stack:
            for module in (self.legs, self.planner):
                stack.enter_context(module.running())
            yield

    def received(self, name: str) -> list[Received]:
        return [
            fact
            for fact in self.central.facts
            if isinstance(fact, Received) and fact.message == name
        ]

    def order_of(self, moment: Moment) -> list[int]:
        """Return the tasks that reached a moment, in the order in which they reached it."""
        return [
            fact.task
            for fact in self.central.facts
            if isinstance(fact, Reached) and fact.moments & moment
        ]
