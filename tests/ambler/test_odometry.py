"""Dead reckoning: the robot estimates its pose from its own legs."""

import math
from dataclasses import replace

import pytest
from ambler.builders import an_arc, take_steps

from robots.ambler_sim.machine.making import make_robot, pybullet_is_installed
from robots.ambler_sim.options import Backend
from robots.ambler_sim.vocabulary import BodyMove, Fault, TerrainSpec


def test_odometry_error_is_about_one_percent() -> None:
    robot = make_robot("kinematic", terrain=TerrainSpec(seed=4, slope=0.3))
    take_steps(robot, an_arc(0.05), 4)
    believed, true = robot.stance().pose, robot.true_stance().pose
    assert true.x > 1.8
    assert math.hypot(believed.x - true.x, believed.y - true.y) < 0.02
    assert believed != true


def test_believed_pose_survives_in_a_snapshot() -> None:
    robot = make_robot("kinematic", terrain=TerrainSpec(seed=4, slope=0.3))
    take_steps(robot, an_arc(), 1)
    other = make_robot(state=robot.state())
    assert other.footsteps == robot.footsteps == 1
    assert (other.stance().pose.x, other.stance().pose.y) == pytest.approx(
        (robot.stance().pose.x, robot.stance().pose.y), abs=1e-3
    )


def test_footstep_records_believed_and_true_pose() -> None:
    robot = make_robot("kinematic", terrain=TerrainSpec(seed=4, slope=0.3))
    (report,) = take_steps(robot, an_arc(), 1)
    step = robot.footstep()
    assert (step.number, step.leg) == (1, report.step.leg)
    assert step.pose == robot.stance().pose
    assert step.true_pose == robot.true_stance().pose
    assert 0 < step.tilt < math.radians(2)
    assert step.margin > 0.3


@pytest.mark.parametrize(
    "backend",
    [
        "kinematic",
        pytest.param(
            "pybullet", marks=pytest.mark.skipif(not pybullet_is_installed(), reason="no PyBullet")
        ),
    ],
)
def test_leg_lowered_into_a_hole_does_not_lift_the_robot(backend: Backend) -> None:
    robot = make_robot(backend, terrain=TerrainSpec(seed=3, slope=0.3))
    pose = robot.stance().pose
    robot.inject(Fault("soft spot", leg=1))
    robot.move_body(BodyMove(replace(pose, x=pose.x + 0.1), 1.0))
    assert robot.readings().loads[1] < 500.0
    robot.level()
    assert robot.readings().loads[1] > 1000.0
    assert robot.stance().pose.height == pytest.approx(robot.true_stance().pose.height, abs=0.02)
