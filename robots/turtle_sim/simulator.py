"""The turtles as modules, each connected to its own central. All draw on one sheet."""

import argparse
import threading

from robots.turtle_sim.messages import (
    CHANGE_PEN,
    CLEAR_SHEET,
    POSE,
    SHEET,
    VELOCITY,
    SeenTurtle,
    Sheet,
    Velocity,
)
from robots.turtle_sim.world import CENTRE, Pen, Pose, Stroke, TurtleWorld
from tca_module import Callback, Module, Task
from tca_module.link.opening import CentralAddress

PERIOD = 1 / 32
"""Seconds between two poses that a turtle publishes."""


class Simulator:
    """One world, and a module for each of its turtles."""

    def __init__(self, world: TurtleWorld, pace: float = 1.0) -> None:
        """Simulate *world*, with time that passes *pace* times as fast as that of the modules."""
        self._world = world
        self._pace = pace
        self._lock = threading.Lock()  # the modules have threads of their own

    def sheet(self) -> Sheet:
        """Return the visible state of the sheet."""
        with self._lock:
            strokes = [Stroke(stroke.pen, stroke.points[:]) for stroke in self._world.strokes]
            turtles = self._world.turtles.items()
            return Sheet(
                strokes, {name: SeenTurtle(turtle.pose, turtle.pen) for name, turtle in turtles}
            )

    def module(self, name: str, central: CentralAddress = None) -> Module:
        """Return the module that moves the turtle of this name. Raises NoSuchTurtle."""
        world, lock = self._world, self._lock
        simulator = Module(f"{name} simulator", central)
        world.turtle(name)  # raises NoSuchTurtle

        published: list[Pose] = []

        @simulator.every(PERIOD)
        def move(callback: Callback) -> None:
            with lock:
                world.advance(PERIOD * self._pace, name)
                pose = world.turtle(name).pose
            if published != [pose]:  # a turtle that stands still publishes nothing
                published[:] = [pose]
                callback.set_variable(POSE, pose, wait=False)

        @simulator.handles(VELOCITY)
        def velocity(_: Task, wanted: Velocity) -> None:
            with lock:
                world.command(name, wanted.linear, wanted.angular)

        @simulator.handles(CHANGE_PEN)
        def change_pen(_: Task, pen: Pen) -> None:
            with lock:
                world.set_pen(name, pen)

        @simulator.handles(CLEAR_SHEET)
        def clear_sheet(_: Task) -> None:
            with lock:
                world.clear()

        @simulator.handles(SHEET)
        def sheet(_: Task) -> Sheet:
            return self.sheet()

        return simulator


def main() -> None:
    """Simulate one turtle until the program is stopped."""
    parser = argparse.ArgumentParser(description="One turtle on a sheet of its own.")
    parser.add_argument(
        "name", nargs="?", default="turtle", help="name of the turtle (default: %(default)s)"
    )
    parser.add_argument(
        "--at",
        type=float,
        nargs=2,
        default=(CENTRE.x, CENTRE.y),
        metavar=("X", "Y"),
        help="its start",
    )
    options = parser.parse_args()
    world = TurtleWorld()
    world.spawn(options.name, Pose(*options.at))
    Simulator(world).module(options.name).run()


if __name__ == "__main__":
    main()
