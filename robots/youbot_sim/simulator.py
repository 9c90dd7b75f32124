"""The simulated robot and its boxes, as a module and as a program."""

from dataclasses import dataclass
from typing import cast

from robots.options import program_parser
from robots.youbot_sim.drives import Drives
from robots.youbot_sim.messages import DRIVE, HALT, LOOK, MEASURE, OFFER_OBJECT
from robots.youbot_sim.robot import BACKENDS, MobileManipulator, make_robot
from robots.youbot_sim.vocabulary import Group
from tca_module import Callback, Module, Task

STEP = 1 / 30
"""Seconds between two steps of a simulator that needs steps between requests."""


@dataclass(frozen=True, slots=True)
class Lid:
    """The lid of box B. With *starts_covered* it is on at first. It is put on or taken off at each
    of the *changes*, in seconds after the object was offered.
    """

    changes: tuple[float, ...] = ()
    starts_covered: bool = False

    def is_on(self, passed: float) -> bool:
        """Return whether the lid covers the box *passed* seconds after the object was offered."""
        return self.starts_covered != bool(sum(change <= passed for change in self.changes) % 2)

    def __str__(self) -> str:
        changes = ((self.is_on(change), f" {change:.1f}") for change in self.changes)
        states = [(self.starts_covered, ""), *changes]
        return ", ".join(("covered" if is_on else "free") + since for is_on, since in states)


class SimulatedRobot:
    """A robot with its drives, and the lid of box B. Its time only grows."""

    def __init__(self, robot: MobileManipulator, lid: Lid) -> None:
        self.robot = robot
        self.drives = Drives()
        self._lid = lid
        self._offered_at: float | None = None

    def follow(self, now: float) -> None:
        """Let time pass until *now*."""
        self.robot.cover(is_covered=self.is_covered(now))
        self.robot.follow(self.drives, now)

    def offer(self, now: float) -> None:
        """Put the object between the fingers."""
        self._offered_at = now
        self.robot.offer()

    def is_covered(self, now: float) -> bool:
        """Return whether box B is covered."""
        return self._lid.is_on(0.0 if self._offered_at is None else now - self._offered_at)


def make_module(simulated: SimulatedRobot, *, has_steps: bool) -> Module:
    """Make the module of a simulated robot. With *has_steps* it also simulates between requests."""
    simulator = Module("simulator")

    def now(sender: Task | Callback) -> SimulatedRobot:
        """Return the robot, advanced to the present time."""
        simulated.follow(sender.time())
        return simulated

    if has_steps:
        simulator.every(STEP)(now)
    simulator.handles(DRIVE)(lambda task, wanted: now(task).drives.drive(wanted, task.time()))
    simulator.handles(HALT)(
        lambda task, group: now(task).drives.halt(cast("Group", group), task.time())
    )
    simulator.handles(OFFER_OBJECT)(lambda task: now(task).offer(task.time()))
    simulator.handles(MEASURE)(lambda task: now(task).robot.measured())
    simulator.handles(LOOK)(lambda task: not simulated.is_covered(task.time()))
    return simulator


def main() -> None:
    """Run the simulator."""
    parser = program_parser("youbot_sim.simulator", __doc__)
    parser.add_argument("--backend", choices=BACKENDS, default="auto")
    parser.add_argument("--covered", action="store_true", help="box B has its lid on at first")
    parser.add_argument(
        "--change",
        type=float,
        action="append",
        default=[],
        metavar="SECONDS",
        help="put the lid on, or take it off, this long after the object was offered;"
        " may be repeated",
    )
    options = parser.parse_args()
    robot = make_robot(options.backend)
    lid = Lid(tuple(options.change), starts_covered=options.covered)
    try:
        make_module(SimulatedRobot(robot, lid), has_steps=robot.name == "pybullet").run()
    finally:
        robot.close()


if __name__ == "__main__":
    main()
