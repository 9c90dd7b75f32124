"""A planner and legs, for stories about tasks."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from module.gait_messages import MOVE_LEG, Footfall

from tca_module import Module, Task
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Reached, Received
from tca_wire.points import Moment


class Robot:
    """A planner and legs; what they did is in ``done``, in order."""

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
        return [fact for fact in self.central.facts if isinstance(fact, Received) and fact.message == name]

    def order_of(self, moment: Moment) -> list[int]:
        """The tasks that reached a moment, in that order."""
        return [fact.task for fact in self.central.facts if isinstance(fact, Reached) and fact.moments & moment]
