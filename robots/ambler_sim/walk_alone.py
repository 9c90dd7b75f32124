"""Walk without any task control: perceive, plan, move a leg, move the body, again. Proves that the parts work."""

import argparse
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

from robots.ambler_sim.body import plan_body_move
from robots.ambler_sim.controller import Robot
from robots.ambler_sim.errors import AmblerError
from robots.ambler_sim.footfall import choose_foothold
from robots.ambler_sim.gait import is_finished, next_step, progress
from robots.ambler_sim.leg_recovery import plan_leg_move
from robots.ambler_sim.perception import build_elevation_map
from robots.ambler_sim.robot import make_robot
from robots.ambler_sim.snapshot import load_snapshot, save_snapshot
from robots.ambler_sim.stability import support_margin
from robots.ambler_sim.vocabulary import Arc, ElevationMap, Footfall, Step, TerrainSpec


@dataclass(frozen=True, slots=True)
class StepReport:
    """One footstep: what was planned, how the foot stands, the smallest margin (m), seconds of planning and moving."""

    step: Step
    footfall: Footfall
    margin: float
    planning: float
    moving: float
    ground: ElevationMap


def take_step(robot: Robot, arc: Arc, known: ElevationMap | None) -> StepReport:
    """One whole footstep along *arc*; *known* is the map so far."""
    began = time.perf_counter()
    stance = robot.stance()
    ground = build_elevation_map(robot.scan(), stance, known)
    step = next_step(stance, arc)
    foothold = choose_foothold(ground, step)
    leg_move = plan_leg_move(ground, step, foothold)
    planned = time.perf_counter()
    footfall = robot.move_leg(leg_move)
    swinging = support_margin(stance, step.leg)
    robot.move_body(plan_body_move(step, footfall.foot))
    margin = min(swinging, support_margin(robot.stance()))
    return StepReport(step, footfall, margin, planned - began, time.perf_counter() - planned, ground)


def walk(robot: Robot, arc: Arc, saved: str | None = None) -> list[StepReport]:
    """Walk *arc* to its end, printing a line per step and saving the robot's state to the file *saved* after each."""
    reports: list[StepReport] = []
    while not is_finished(arc, robot.stance().pose):
        known = reports[-1].ground if reports else None
        reports.append(take_step(robot, arc, known))
        print(step_line(len(reports), reports[-1]), flush=True)
        if saved:
            save_snapshot(robot.state(), saved)
    return reports


def step_line(number: int, report: StepReport) -> str:
    """A step for people to read."""
    foot = report.footfall.foot
    return (
        f"step {number:3d}  leg {foot.leg} to x {foot.x:6.2f} y {foot.y:5.2f} z {foot.z:5.2f}  "
        f"load {report.footfall.load / 1000:4.1f} kN  margin {report.margin:4.2f} m  "
        f"planned in {report.planning * 1000:4.0f} ms, walked in {report.moving * 1000:5.0f} ms"
    )


def summary(robot: Robot, arc: Arc, reports: Sequence[StepReport], seconds: float) -> str:
    """The walk in one line."""
    distance = progress(arc, robot.stance().pose)
    margin = min((report.margin for report in reports), default=math.nan)
    return (
        f"walked {distance:.2f} m in {len(reports)} steps with {robot.backend}: max tilt "
        f"{math.degrees(robot.peak_tilt):.2f} deg, min stability margin {margin:.2f} m, "
        f"{robot.time:.0f} s simulated in {seconds:.1f} s"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; exit code 1 when the robot could not walk to the end."""
    options = _parser().parse_args(arguments)
    began = time.perf_counter()
    spec = TerrainSpec(seed=options.seed, slope=options.slope, length=max(40.0, options.metres + 20.0))
    state = load_snapshot(options.state) if options.state else None
    robot = make_robot(options.backend, terrain=spec, pace=options.pace, state=state)
    try:
        arc = Arc(robot.stance().pose, options.curvature, options.metres)
        reports = walk(robot, arc, options.state)
        print(summary(robot, arc, reports, time.perf_counter() - began))
        if options.picture:
            print(f"picture: {robot.picture(options.picture)}")
    except AmblerError as error:
        print(f"walk_alone: {type(error).__name__}: {error}", file=sys.stderr)
        return 1
    finally:
        robot.close()
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m robots.ambler_sim.walk_alone", description=__doc__)
    parser.add_argument("--metres", type=float, default=5.0, help="how far to walk")
    parser.add_argument("--curvature", type=float, default=0.0, help="of the path, 1/m, positive to the left")
    parser.add_argument("--slope", type=float, default=0.10, help="steepest rise per run on the path")
    parser.add_argument("--seed", type=int, default=1, help="which hills")
    parser.add_argument("--backend", choices=("auto", "pybullet", "kinematic"), default="auto")
    parser.add_argument("--pace", type=float, default=0.0, help="times real time; 0 is as fast as possible")
    parser.add_argument("--state", help="file to go on from, if there is one, and to save to after every step")
    parser.add_argument("--picture", help="draw the robot to this file at the end")
    return parser


if __name__ == "__main__":
    sys.exit(main())
