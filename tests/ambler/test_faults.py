"""Injected faults wait until they can occur. They are not lost with the controller."""

import math
from dataclasses import replace

import numpy as np
import pytest
from ambler.builders import the_first_leg_move

from robots.ambler_sim.geometry import feet_of, joints_of
from robots.ambler_sim.machine.making import make_robot
from robots.ambler_sim.machine.terrain import HOLE_RADIUS
from robots.ambler_sim.messages import TERRAIN_COLLISION
from robots.ambler_sim.vocabulary import BodyMove, Fault
from tca_module import FailureRaised


def test_pending_fault_survives_controller_loss() -> None:
    robot = make_robot("kinematic")
    rock = Fault("unseen rock", leg=2)
    robot.inject(rock)
    assert robot.pop_begun_faults() == []
    another = make_robot("kinematic", state=robot.state())
    with pytest.raises(FailureRaised, match=TERRAIN_COLLISION.name):
        another.move_leg(the_first_leg_move(another))
    assert another.pop_begun_faults() == [rock]
    assert another.state().armed == ()


def test_unseen_rock_lies_in_the_leg_path_despite_pose_error() -> None:
    state = make_robot("kinematic").state()
    robot = make_robot("kinematic", state=replace(state, pose=replace(state.pose, x=3.0)))
    robot.inject(Fault("unseen rock", leg=2))
    with pytest.raises(FailureRaised, match=TERRAIN_COLLISION.name):
        robot.move_leg(the_first_leg_move(robot))


def test_soft_spot_does_not_take_two_supporting_feet() -> None:
    """Foot 1 stands close to foot 0, so both could fall."""
    state = make_robot("kinematic").state()
    joints = np.array(state.posture.joints)
    feet = feet_of(joints)
    feet[1] = feet[0] - (HOLE_RADIUS / 2, 0.0, 0.0)
    beside = replace(
        state.posture, joints=tuple(map(tuple, joints_of(feet, near=joints[:, 0]).tolist()))
    )
    robot = make_robot("kinematic", state=replace(state, posture=beside))
    robot.inject(Fault("soft spot", leg=0))
    pose = robot.stance().pose
    robot.move_body(BodyMove(replace(pose, x=pose.x + 0.05), 1.0))
    (hole,) = robot.terrain.present.holes
    for foot in robot.true_stance().feet[:2]:
        assert math.dist(hole, (foot.x, foot.y)) > HOLE_RADIUS
