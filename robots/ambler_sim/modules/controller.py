"""The real-time controller: owns the robot (here the simulator), moves it, and saves where it is
after every move.

The machine makes one move at a time; its range finder is a resource of its own, so that the scanner
may ask it while it locks the moves. A controller that is started on the state file of another takes
the robot over where that one left it.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from robots.ambler_sim.errors import AmblerError
from robots.ambler_sim.machine.making import make_robot
from robots.ambler_sim.machine.pacing import OnTick
from robots.ambler_sim.machine.robot import Robot
from robots.ambler_sim.machine.shared import Machine
from robots.ambler_sim.machine.terrain import scattered_rocks
from robots.ambler_sim.messages import (
    CALIBRATE,
    FAULT_BEGAN,
    FREE_JOINT,
    INJECT,
    LEVEL_BODY,
    MOTION_FAULT,
    MOVE_BODY,
    MOVE_LEG,
    PICTURE,
    RANGES,
    READINGS,
    RESET,
    STANCE,
    Reset,
)
from robots.ambler_sim.modules.display import Display
from robots.ambler_sim.options import walk_options
from robots.ambler_sim.pictures.film import FRAMES, FilmCamera
from robots.ambler_sim.vocabulary import (
    NO_LEG,
    BodyMove,
    Fault,
    Footfall,
    LegMove,
    Pose,
    Readings,
    Rock,
    Scan,
    Snapshot,
    Stance,
    TerrainSpec,
)
from tca_module import Module, Task
from tca_tools.output import write_output

STATE, RECORD = "robot.json", "footsteps.jsonl"
"""The files of a walk's folder: the robot as it now is, and its footsteps."""

ROCK_HEIGHTS = (0.6, 0.8)


class ControlledMachine(Machine):
    """The machine as tasks change it: it is saved and filmed, and it is told what has begun to go
    wrong.
    """

    def __init__(self, robot: Robot, folder: Path | None, camera: FilmCamera | None) -> None:
        super().__init__(robot)
        self._folder, self._camera = folder, camera
        self.display = Display(robot, while_moving=robot.backend == "graphical")
        self.save()

    def save(self) -> None:
        """Save the robot for another controller."""
        if self._folder is not None:
            write_output(self._folder / STATE, msgspec.json.encode(self.robot.state()))

    def record(self) -> None:
        """Write a line for those who judge the walk."""
        if self._folder is not None:
            with (self._folder / RECORD).open("ab") as file:
                file.write(msgspec.json.encode(self.robot.footstep()) + b"\n")

    @contextmanager
    def changed_by(self, task: Task, leg: int = NO_LEG) -> Iterator[OnTick]:
        """The robot is this task's, to move a leg, the body or nothing; with what is called at each
        tick of a move.
        """
        try:
            with self.moving(leg):
                yield lambda: self._goes_on(task)
        except AmblerError as error:
            raise MOTION_FAULT("body", str(error)) from error
        finally:
            self.save()
            for fault in self.robot.begun_faults():
                task.broadcast(FAULT_BEGAN, fault)

    def _goes_on(self, task: Task) -> bool:
        """Between two control ticks: scan if somebody waits for one; stop if the task was
        killed.
        """
        self.tick()
        self.display.tick(task)
        if self._camera is not None:
            self._camera.tick()
        return not task.cancelled


def make_module(robot: Robot, folder: Path | None, camera: FilmCamera | None = None) -> Module:
    """The module that moves *robot*; into the *folder*, if there is one, it saves the robot after
    each move, and writes a line for each footstep. A *camera* films the moves.
    """
    controller = Module("controller")
    machine = ControlledMachine(robot, folder, camera)

    @controller.handles(MOVE_LEG)
    def move_leg(task: Task, move: LegMove) -> Footfall:
        with machine.changed_by(task, move.leg) as goes_on:
            return robot.move_leg(move, goes_on)

    @controller.handles(MOVE_BODY)
    def move_body(task: Task, move: BodyMove) -> Pose:
        with machine.changed_by(task) as goes_on:
            pose = robot.move_body(move, goes_on)
            machine.display.made_a_footstep(task)
            machine.record()
            return pose

    _answer_questions(controller, machine)
    _care(controller, machine)
    return controller


def _answer_questions(controller: Module, machine: Machine) -> None:
    """Answer questions about the robot."""
    robot = machine.robot

    @controller.handles(STANCE)
    def stance(_: Task) -> Stance:
        with machine.moving():
            return robot.stance()

    @controller.handles(READINGS)
    def readings(_: Task) -> Readings:
        with machine.moving():
            return robot.readings()

    @controller.handles(RANGES, resource="range finder")
    def ranges(_: Task) -> Scan:
        return machine.scan()

    @controller.handles(PICTURE)
    def picture(_: Task, path: str) -> str:
        with machine.moving():
            return str(robot.picture(path))


def _care(controller: Module, machine: ControlledMachine) -> None:
    """Mend what is wrong with the machine, and spoil it."""
    robot = machine.robot

    @controller.handles(INJECT)
    def inject(task: Task, fault: Fault) -> None:
        with machine.changed_by(task):
            robot.inject(fault)

    @controller.handles(RESET)
    def reset(task: Task, reset: Reset) -> None:
        with machine.changed_by(task):
            robot.reset(reset.leg, operator=reset.operator)

    @controller.handles(FREE_JOINT)
    def free_joint(task: Task, reset: Reset) -> None:
        with machine.changed_by(task):
            robot.free_joint(reset.leg, operator=reset.operator)

    @controller.handles(CALIBRATE)
    def calibrate(task: Task, leg: int) -> None:
        with machine.changed_by(task):
            robot.calibrate(leg)

    @controller.handles(LEVEL_BODY)
    def level_body(task: Task) -> None:
        with machine.changed_by(task):
            robot.level()


def main() -> None:
    """The controller of a walk: it takes the robot over from the one before, if there was one."""
    options = walk_options(".modules.controller", __doc__).parse_args()
    state = options.out / STATE
    saved = msgspec.json.decode(state.read_bytes(), type=Snapshot) if state.exists() else None
    scattered = scattered_rocks(options.seed, options.rocks, options.metres, ROCK_HEIGHTS)
    rocks = (*scattered, *(Rock(*rock) for rock in options.rock))
    terrain = TerrainSpec(seed=options.seed, slope=options.slope, rocks=rocks, kind=options.terrain)
    robot = make_robot(
        options.backend, terrain=terrain, pace=options.pace, state=saved, window=options.gui
    )
    try:
        camera = (
            FilmCamera(robot, options.out / FRAMES, options.film_from) if options.film else None
        )
        make_module(robot, options.out, camera).run()
    finally:
        robot.close()


if __name__ == "__main__":
    main()
