"""The simulated robot and its boxes, as a module: drives to command, sensors to read."""

from collections.abc import Sequence
from typing import cast

from robots.youbot_sim.drives import Drives
from robots.youbot_sim.mechanism import MobileManipulator
from robots.youbot_sim.messages import DRIVE, HALT, LOOK, MEASURE, OFFER_OBJECT
from robots.youbot_sim.vocabulary import Group
from tca_module import Callback, Module, Task

STEP = 1 / 30
"""Seconds between two steps of a simulator that needs them."""


class Lid:
    """Box B is free, and covered, in turns: at first free, or covered if *starts_covered*; after each of the *changes*,
    seconds after the object was offered, the other way round.
    """

    def __init__(self, changes: Sequence[float] = (), *, starts_covered: bool = False) -> None:
        self._changes = changes
        self._starts_covered = starts_covered
        self._offered_at: float | None = None

    def offered(self, now: float) -> None:
        """The object is offered."""
        self._offered_at = now

    def is_on(self, now: float) -> bool:
        """Whether it covers the box."""
        passed = 0.0 if self._offered_at is None else now - self._offered_at
        turns = sum(change <= passed for change in self._changes)
        return self._starts_covered != bool(turns % 2)


class SimulatedRobot:
    """A robot with its drives, and the lid of box B, at a time that only grows."""

    def __init__(self, robot: MobileManipulator, lid: Lid) -> None:
        self.robot = robot
        self.lid = lid
        self.drives = Drives()

    def follow(self, now: float) -> None:
        """Let time pass until *now*."""
        self.robot.cover(is_covered=self.lid.is_on(now))
        self.robot.follow(self.drives, now)


def make_module(simulated: SimulatedRobot, *, has_steps: bool) -> Module:
    """The module that simulates a robot; one that *has_steps* also while nobody asks for anything."""
    simulator = Module("simulator")

    def now(sender: Task | Callback) -> SimulatedRobot:
        """The robot as it is now."""
        simulated.follow(sender.time())
        return simulated

    def offer_object(task: Task) -> None:
        now(task).lid.offered(task.time())
        simulated.robot.offer()

    if has_steps:
        simulator.every(STEP)(now)
    simulator.handles(DRIVE)(lambda task, wanted: now(task).drives.drive(wanted, task.time()))
    simulator.handles(HALT)(lambda task, group: now(task).drives.halt(cast("Group", group), task.time()))
    simulator.handles(OFFER_OBJECT)(offer_object)
    simulator.handles(MEASURE)(lambda task: now(task).robot.measured())
    simulator.handles(LOOK)(lambda task: not simulated.lid.is_on(task.time()))
    return simulator
