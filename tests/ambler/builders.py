"""Small robots, stances and maps for the tests of the Ambler."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from robots.ambler_sim.geometry import Array
from robots.ambler_sim.machine.robot import Robot
from robots.ambler_sim.planning.elevation import RESOLUTION, build_elevation_map, make_map
from robots.ambler_sim.planning.footfall import choose_foothold
from robots.ambler_sim.planning.gait import body_height, next_step, plan_body_move, standard_feet
from robots.ambler_sim.planning.leg_recovery import plan_leg_move
from robots.ambler_sim.planning.stability import support_margin
from robots.ambler_sim.vocabulary import Arc, ElevationMap, Footfall, LegMove, Pose, Stance, Step

ORIGIN = Pose(0.0, 0.0, 0.0, 2.7)

Ground = Callable[[Array, Array], Array]


def flat(x: Array, y: Array) -> Array:
    return 0.0 * (x + y)


def a_map(ground: Ground = flat, size: float = 12.0) -> ElevationMap:
    """Return a map without unknown cells. *ground* gives the heights of the cells."""
    side = round(size / RESOLUTION)
    x, y = -size / 2 + RESOLUTION * np.indices((side, side))
    return make_map(-size / 2, -size / 2, ground(x, y), np.ones((side, side), dtype=bool))


def a_stance(pose: Pose = ORIGIN, height: float = 0.0) -> Stance:
    """Return the standard configuration on level ground."""
    feet = standard_feet(pose, height)
    return Stance(Pose(pose.x, pose.y, pose.heading, body_height(feet)), feet)


def an_arc(curvature: float = 0.0, length: float = 6.0, start: Pose = ORIGIN) -> Arc:
    return Arc(start, curvature, length)


def a_step(curvature: float = 0.0) -> Step:
    return next_step(a_stance(), an_arc(curvature))


class StepReport(NamedTuple):
    step: Step
    footfall: Footfall
    margin: float  #: the least margin of stability, in m
    ground: ElevationMap


def take_step(robot: Robot, arc: Arc, known: ElevationMap | None) -> StepReport:
    """Perceive, plan, move a leg, move the body. *known* is the map of the earlier steps."""
    stance = robot.stance()
    ground = build_elevation_map(robot.scan(), stance, known)
    step = next_step(stance, arc)
    footfall = robot.move_leg(plan_leg_move(ground, step, choose_foothold(ground, step)))
    robot.move_body(plan_body_move(step, footfall.foot))
    margin = min(support_margin(stance, step.leg), support_margin(robot.stance()))
    return StepReport(step, footfall, margin, ground)


def take_steps(
    robot: Robot, arc: Arc, count: int, known: ElevationMap | None = None
) -> list[StepReport]:
    reports: list[StepReport] = []
    for _ in range(count):
        reports.append(take_step(robot, arc, known))
        known = reports[-1].ground
    return reports


def the_first_leg_move(robot: Robot) -> LegMove:
    """Return a leg move planned from a scan at the robot's place."""
    stance = robot.stance()
    ground = build_elevation_map(robot.scan(), stance)
    step = next_step(stance, an_arc())
    return plan_leg_move(ground, step, choose_foothold(ground, step))
