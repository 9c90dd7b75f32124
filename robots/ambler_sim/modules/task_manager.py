"""The task manager: takes a path apart into arcs, and tells a person how the walk goes."""

import math
from collections.abc import Callable

from robots.ambler_sim.messages import CONFIRM_ARC, TRAVERSE_ARC, TRAVERSE_PATH, WALKED, Path
from robots.ambler_sim.vocabulary import Pose
from tca_module import Module, Task


def make_module(on_walked: Callable[[float], None], confirm: Callable[[int], None]) -> Module:
    """The module. *on_walked* is told the metres walked so far; *confirm* is asked before an arc (1, 2, ...)."""
    manager = Module("task manager")
    manager.resource("operator")
    manager.resource("display")
    odometer = Odometer()

    @manager.handles(TRAVERSE_PATH)
    def traverse_path(task: Task, path: Path) -> None:
        with task.sequence():
            for number, bend in enumerate(path.bends):
                if number and path.ask:
                    task.command(CONFIRM_ARC, number)
                task.goal(TRAVERSE_ARC, bend, delay_planning=True)

    @manager.handles(CONFIRM_ARC, resource="operator")
    def confirm_arc(_: Task, number: int) -> None:
        confirm(number)

    @manager.handles(WALKED, resource="display")
    def walked(_: Task, pose: Pose) -> None:
        on_walked(odometer.add(pose))

    return manager


class Odometer:
    """The length of the way between the poses it was shown, from the origin on."""

    def __init__(self) -> None:
        self.metres = 0.0
        self._last: Pose | None = None

    def add(self, pose: Pose) -> float:
        """The robot is here now; the metres so far."""
        x, y = (self._last.x, self._last.y) if self._last else (0.0, 0.0)
        self.metres += math.hypot(pose.x - x, pose.y - y)
        self._last = pose
        return self.metres
