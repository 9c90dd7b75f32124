"""The real-time controller: owns the robot (here the simulator), moves it, and saves its state
after every move.

The robot makes one move at a time. Its range finder is a separate resource, so that the scanner can
query it while moves are locked. A new controller takes over the robot from the state file of the
earlier one.
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
"""The files of a walk's folder: the robot's present state, and its footsteps."""

ROCK_HEIGHTS = (0.6, 0.8)


class ControlledMachine(Machine):
    """A machine that films moves, saves the robot after each change by a task, and broadcasts the
    faults that have begun.
    """

    def __init__(self, robot: Robot, folder: Path | None, camera: FilmCamera | None) -> None:
        super().__init__(robot)
        self._folder, self._camera = folder, camera
        self.display = Display(robot, while_moving=robot.backend == "graphical")
        self.save()

    def save(self) -> None:
        """Save the robot's state for the next controller."""
        if self._folder is not None:
            write_output(self._folder / STATE, msgspec.json.encode(self.robot.state()))

    def record(self) -> None:
        """Append the last footstep to the record by which the walk is judged."""
        if self._folder is not None:
            with (self._folder / RECORD).open("ab") as file:
                file.write(msgspec.json.encode(self.robot.footstep()) + b"\n")

    @contextmanager
    def changed_by(self, task: Task, leg: int = NO_LEG) -> Iterator[OnTick]:
        """Keep other threads from the robot while a task changes it. Yields the function to call
        at each tick of a move.
        """
        try:
            with self.exclusive(leg):
                yield lambda: self._on_tick(task)
        except AmblerError as error:
            raise MOTION_FAULT("body", str(error)) from error
        finally:
            self.save()
            for fault in self.robot.pop_begun_faults():
                task.broadcast(FAULT_BEGAN, fault)

    def _on_tick(self, task: Task) -> bool:
        """Take waiting scans between control ticks. Returns False if the task was killed."""
        self.tick()
        self.display.tick(task)
        if self._camera is not None:
            self._camera.tick()
        return not task.cancelled


def make_module(robot: Robot, folder: Path | None, camera: FilmCamera | None = None) -> Module:
    """Make the module that moves *robot*. With a *folder* it saves the robot after each move, and
    records each footstep. A *camera* films the moves.
    """
    controller = Module("controller")
    machine = ControlledMachine(robot, folder, camera)

    @controller.handles(MOVE_LEG)
    def move_leg(task: Task, move: LegMove) -> Footfall:
        with machine.changed_by(task, move.leg) as on_tick:
            return robot.move_leg(move, on_tick)

    @controller.handles(MOVE_BODY)
    def move_body(task: Task, move: BodyMove) -> Pose:
        with machine.changed_by(task) as on_tick:
            pose = robot.move_body(move, on_tick)
            machine.display.after_footstep(task)
            machine.record()
            return pose

    _add_queries(controller, machine)
    _add_repairs(controller, machine)
    return controller


def _add_queries(controller: Module, machine: Machine) -> None:
    """Add handlers for queries about the robot."""
    robot = machine.robot

    @controller.handles(STANCE)
    def stance(_: Task) -> Stance:
        with machine.exclusive():
            return robot.stance()

    @controller.handles(READINGS)
    def readings(_: Task) -> Readings:
        with machine.exclusive():
            return robot.readings()

    @controller.handles(RANGES, resource="range finder")
    def ranges(_: Task) -> Scan:
        return machine.scan()

    @controller.handles(PICTURE)
    def picture(_: Task, path: str) -> str:
        with machine.exclusive():
            return str(robot.picture(path))


def _add_repairs(controller: Module, machine: ControlledMachine) -> None:
    """Add handlers that repair the machine or inject faults."""
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
    """Run the controller of a walk. It takes over the robot of an earlier controller."""
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
