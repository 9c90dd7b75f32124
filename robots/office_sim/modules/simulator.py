"""Simulates the lab and the robot in it. Nobody else knows them."""

import argparse

from robots.office_sim.messages import (
    BATTERY,
    CAMERA,
    CLOSE_FINGERS,
    DOCK,
    DRIVE,
    FLOOR_PLAN,
    HALT,
    OPEN_FINGERS,
    OPEN_LAB,
    ROBOT_SPOT,
    SCENE,
)
from robots.office_sim.vocabulary import FloorPlan, Grasped, LabScene, Spot
from robots.office_sim.world import OfficeWorld
from tca_module import Module, Task


class Lab:
    """A world whose time passes *pace* times as fast as that of the programs, from when it is opened."""

    def __init__(self, world: OfficeWorld, pace: float) -> None:
        self._world = world
        self.pace = pace
        self._began: float | None = None

    def open(self, task: Task) -> None:
        """Let its time begin."""
        self._began = task.time()

    def at(self, task: Task) -> OfficeWorld:
        """The world as it is now."""
        if self._began is not None:
            self._world.advance((task.time() - self._began) * self.pace)
        return self._world


def make_module(world: OfficeWorld, pace: float) -> Module:
    """The module."""
    simulator, lab = Module("simulator"), Lab(world, pace)
    _move(simulator, lab)
    _tell(simulator, lab)
    return simulator


def _move(simulator: Module, lab: Lab) -> None:
    """What the robot's wheels, fingers and plug are told."""
    simulator.handles(OPEN_LAB)(lab.open)

    @simulator.handles(DRIVE)
    def drive(task: Task, way: list[Spot]) -> float:
        return lab.at(task).drive(way) / lab.pace

    @simulator.handles(HALT)
    def halt(task: Task) -> Spot:
        return lab.at(task).halt()

    @simulator.handles(CLOSE_FINGERS)
    def close_fingers(task: Task, spot: Spot) -> Grasped:
        return lab.at(task).close_fingers(spot)

    @simulator.handles(OPEN_FINGERS)
    def open_fingers(task: Task) -> bool:
        return lab.at(task).open_fingers()

    @simulator.handles(DOCK)
    def dock(task: Task) -> float | None:
        seconds = lab.at(task).dock()
        return None if seconds is None else seconds / lab.pace


def _tell(simulator: Module, lab: Lab) -> None:
    """What can be seen and measured."""

    @simulator.handles(CAMERA)
    def camera(task: Task) -> list[Spot]:
        return lab.at(task).look()

    @simulator.handles(ROBOT_SPOT)
    def robot_spot(task: Task) -> Spot:
        return lab.at(task).robot

    @simulator.handles(BATTERY)
    def battery(task: Task) -> float:
        return lab.at(task).battery

    @simulator.handles(FLOOR_PLAN)
    def floor_plan(task: Task) -> FloorPlan:
        return lab.at(task).floor

    @simulator.handles(SCENE)
    def scene(task: Task) -> LabScene:
        return lab.at(task).scene()


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m robots.office_sim.modules.simulator", description=__doc__)
    parser.add_argument("--pace", type=float, default=1.0, help="how fast the lab's time passes (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="which lab, and which cups (%(default)s)")
    parser.add_argument("--shift", type=float, default=240.0, help="seconds in which cups fall (%(default)s)")
    options = parser.parse_args()
    make_module(OfficeWorld(options.seed, options.shift), options.pace).run()


if __name__ == "__main__":
    main()
