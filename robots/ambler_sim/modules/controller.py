"""The real-time controller: owns the robot (here the simulator), moves it, and saves where it is after every move.

The machine makes one move at a time; its range finder is a resource of its own, so that the scanner may ask it while it
locks the moves. A controller that is started on the state file of another takes the robot over where that one left it.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import cast

import msgspec

from robots.ambler_sim.errors import AmblerError, AmplifierTripped, JointFault, TerrainContact, Tilting
from robots.ambler_sim.machine.graphical import GraphicalPlant
from robots.ambler_sim.machine.making import BACKENDS, Backend, make_robot
from robots.ambler_sim.machine.robot import Robot
from robots.ambler_sim.machine.shared import Machine
from robots.ambler_sim.machine.snapshot import load_snapshot, save_snapshot
from robots.ambler_sim.machine.terrain import TERRAINS
from robots.ambler_sim.messages import (
    AMPLIFIER_TRIPPED,
    CALIBRATE,
    FAULT_BEGAN,
    FREE_JOINT,
    INJECT,
    JOINT_FAULT,
    LEVEL_BODY,
    MOTION_FAULT,
    MOVE_BODY,
    MOVE_LEG,
    NEEDS_OPERATOR,
    PICTURE,
    RANGES,
    READINGS,
    RESET,
    STANCE,
    TERRAIN_COLLISION,
    TIP_OVER_RISK,
    MotionError,
    Reset,
)
from robots.ambler_sim.modules.display import Display
from robots.ambler_sim.pictures.film import FilmCamera
from robots.ambler_sim.vocabulary import (
    BodyMove,
    Fault,
    Footfall,
    LegMove,
    Pose,
    Readings,
    Rock,
    Scan,
    Stance,
    TerrainSpec,
)
from tca_module import FailureRaised, Module, Task


def make_module(
    robot: Robot, state_file: Path | None, record: Path | None = None, camera: FilmCamera | None = None
) -> Module:
    """The module that moves *robot*; it saves the robot after each move, and a line for each footstep for those who
    judge the walk. A *camera* films the moves.
    """
    controller = Module("controller")
    controller.resource("range finder")
    machine = Machine(robot)
    display = Display(robot, while_moving=robot.backend == GraphicalPlant.name)

    def save(task: Task) -> None:
        """Save the robot, and tell what has begun to go wrong."""
        write_state(robot, state_file)
        for fault in robot.begun_faults():
            task.broadcast(FAULT_BEGAN, fault)

    @controller.handles(MOVE_LEG)
    def move_leg(task: Task, move: LegMove) -> Footfall:
        try:
            with machine.moving(move.leg):
                return robot.move_leg(move, on_tick=lambda _: goes_on(task, machine, display, camera))
        except AmblerError as error:
            raise failure_of(error) from error
        finally:
            save(task)

    @controller.handles(MOVE_BODY)
    def move_body(task: Task, move: BodyMove) -> Pose:
        try:
            with machine.moving():
                pose = robot.move_body(move, lambda _: goes_on(task, machine, display, camera))
                display.made_a_footstep(task)
            write_footstep(robot, record)
        except AmblerError as error:
            raise failure_of(error) from error
        else:
            return pose
        finally:
            save(task)

    _answer_questions(controller, machine)
    _care(controller, machine, save)
    write_state(robot, state_file)
    return controller


def write_state(robot: Robot, path: Path | None) -> None:
    """Save the robot for another controller, if there is a file for it."""
    if path is not None:
        save_snapshot(robot.state(), path)


def write_footstep(robot: Robot, path: Path | None) -> None:
    """A line for those who judge the walk, if there is a file for it."""
    if path is not None:
        with path.open("ab") as file:
            file.write(msgspec.json.encode(robot.footstep()) + b"\n")


def goes_on(task: Task, machine: Machine, display: Display, camera: FilmCamera | None) -> bool:
    """Between two control ticks: scan if somebody waits for one; stop if the task was killed."""
    machine.tick()
    display.tick(task)
    if camera is not None:
        camera.tick()
    return not task.cancelled


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


def _care(controller: Module, machine: Machine, save: Callable[[Task], None]) -> None:
    """Mend what is wrong with the machine, and spoil it."""
    robot = machine.robot

    @controller.handles(INJECT)
    def inject(task: Task, fault: Fault) -> None:
        with machine.moving():
            robot.inject(fault)
        save(task)

    @controller.handles(RESET)
    def reset(task: Task, reset: Reset) -> None:
        with machine.moving():
            is_on = robot.reset(reset.leg, operator=reset.operator)
        save(task)
        if not is_on:
            raise NEEDS_OPERATOR(reset.leg, f"the amplifier of leg {reset.leg} trips again: an operator must reset it")

    @controller.handles(FREE_JOINT)
    def free_joint(task: Task, reset: Reset) -> None:
        with machine.moving():
            is_free = robot.free_joint(reset.leg, operator=reset.operator)
        save(task)
        if not is_free:
            raise NEEDS_OPERATOR(reset.leg, f"a joint of leg {reset.leg} stays stuck: an operator must free it")

    @controller.handles(CALIBRATE)
    def calibrate(task: Task, leg: int) -> None:
        with machine.moving():
            robot.calibrate(leg)
        save(task)

    @controller.handles(LEVEL_BODY)
    def level_body(task: Task) -> None:
        with machine.moving():
            robot.level()
        save(task)


def failure_of(error: AmblerError) -> FailureRaised:
    """The failure by which others hear of an error."""
    match error:
        case TerrainContact():
            return TERRAIN_COLLISION(error.contact, str(error))
        case AmplifierTripped():
            return AMPLIFIER_TRIPPED(error.leg, str(error))
        case Tilting():
            return TIP_OVER_RISK(error.tilt, str(error))
        case JointFault():
            return JOINT_FAULT(MotionError(error.leg, error.error), str(error))
        case _:
            return MOTION_FAULT("body", str(error))


def robot_options() -> argparse.ArgumentParser:
    """What can be said of the simulated robot and its ground."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--backend", choices=BACKENDS, default="auto")
    parser.add_argument("--gui", action="store_true", help="show physics in PyBullet's own window")
    parser.add_argument("--pace", type=float, default=0.0, help="times real time; 0 is as fast as possible")
    parser.add_argument("--seed", type=int, default=1, help="which hills")
    parser.add_argument("--slope", type=float, default=0.30, help="steepest rise per run of hills")
    parser.add_argument("--terrain", choices=TERRAINS, default="rolling", help="what kind of ground")
    parser.add_argument("--rock", nargs=4, type=float, action="append", default=[],
                        metavar=("X", "Y", "RADIUS", "HEIGHT"),
                        help="a rock that the scanner does not see; may be given several times")  # fmt: skip
    return parser


def main() -> None:
    """The command line."""
    name = "python -m robots.ambler_sim.modules.controller"
    parser = argparse.ArgumentParser(prog=name, description=__doc__, parents=[robot_options()])
    parser.add_argument("--state", type=Path, help="file to save the robot in, and to go on from")
    parser.add_argument("--record", type=Path, help="file for a line for each footstep: what is believed, what is true")
    parser.add_argument("--film", nargs=2, metavar=("FOLDER", "FIRST"), help="photographs of moves, from a footstep on")
    options = parser.parse_args()
    saved = load_snapshot(options.state) if options.state else None
    rocks = tuple(Rock(*rock) for rock in options.rock)
    terrain = TerrainSpec(seed=options.seed, slope=options.slope, rocks=rocks, kind=options.terrain)
    robot = make_robot(
        cast("Backend", options.backend), terrain=terrain, pace=options.pace, state=saved, window=options.gui
    )
    try:
        camera = FilmCamera(robot, Path(options.film[0]), int(options.film[1])) if options.film else None
        make_module(robot, options.state, options.record, camera).run()
    finally:
        robot.close()


if __name__ == "__main__":
    main()
