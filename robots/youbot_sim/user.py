"""The user: starts the machine, gives the robot one object after the other, and posts the end."""

from collections.abc import Iterator

from robots.youbot_sim.coordination import make_coordinator
from robots.youbot_sim.delivery import ENOUGH, GIVEN, WAITING
from robots.youbot_sim.messages import CARRY_OBJECTS, OFFER_OBJECT
from tca_behaviours.coordination import COORDINATION_EVENT, Coordinator, MachineEvent
from tca_module import Module, Task
from tca_wire.coordination import CoordinationReport


def make_module(coordinator: Coordinator) -> Module:
    """Make the module. It sends the command of *coordinator*, which runs elsewhere."""
    user = Module("user")
    chart = coordinator.chart
    waiting = next(number for number, state in enumerate(chart.states) if state.label == WAITING)

    @user.handles(CARRY_OBJECTS)
    def carry_objects(task: Task, count: int) -> None:
        delivering = task.command(coordinator.message, chart)
        ready = _entries(delivering.progress(CoordinationReport), waiting)
        for _ in range(count):
            next(ready)
            task.command(OFFER_OBJECT, sequential=False).result()
            task.broadcast(COORDINATION_EVENT, MachineEvent(chart.name, GIVEN))
        next(ready)
        task.broadcast(COORDINATION_EVENT, MachineEvent(chart.name, ENOUGH))
        delivering.result()

    return user


def _entries(reports: Iterator[CoordinationReport], state: int) -> Iterator[None]:
    """Yield each time that the machine enters this state."""
    previous = -1
    for report in reports:
        if report.current == state != previous:
            yield
        previous = report.current


if __name__ == "__main__":
    make_module(make_coordinator()).run()
