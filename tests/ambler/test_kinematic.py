"""The kinematic plant: equilibrium, no slip, ray marching, and repeatable walks."""

import math

import numpy as np
import pytest
from ambler.builders import ORIGIN, an_arc, take_steps

from robots.ambler_sim.geometry import Array
from robots.ambler_sim.machine.kinematic import KinematicPlant
from robots.ambler_sim.machine.making import make_robot
from robots.ambler_sim.machine.plant import standing_posture
from robots.ambler_sim.machine.terrain import Terrain
from robots.ambler_sim.planning.stability import WEIGHT, centre_of_gravity
from robots.ambler_sim.vocabulary import TerrainSpec

HILLS = Terrain(TerrainSpec(seed=3, slope=0.3))


def a_plant() -> KinematicPlant:
    return KinematicPlant(HILLS, standing_posture(HILLS, ORIGIN))


def lengthened(plant: KinematicPlant, *changes: float) -> Array:
    joints = plant.joints()
    joints[:, 2] += changes
    return joints


def test_foot_loads_balance_weight_and_moments() -> None:
    plant = a_plant()
    plant.drive(lengthened(plant, 0.02, 0, 0.01, -0.01, 0, 0), np.zeros((6, 3)))
    loads, joints = plant.loads(), plant.joints()
    feet = np.stack(
        [joints[:, 1] * np.cos(joints[:, 0]), joints[:, 1] * np.sin(joints[:, 0])], axis=1
    )
    feet[:, 1] += [1, 1, 1, -1, -1, -1]
    assert loads.sum() == pytest.approx(WEIGHT)
    assert loads @ feet / WEIGHT == pytest.approx(centre_of_gravity(joints)[:2], abs=1e-6)


def test_lifted_leg_bears_no_load() -> None:
    plant = a_plant()
    plant.drive(lengthened(plant, 0, 0, -0.5, 0, 0, 0), np.zeros((6, 3)))
    assert plant.loads()[2] == 0
    assert plant.loads().sum() == pytest.approx(WEIGHT)


def test_turning_standing_legs_back_moves_the_body_forward() -> None:
    plant = a_plant()
    joints = plant.joints()
    feet_x, feet_y = joints[:, 1] * np.cos(joints[:, 0]) - 0.1, joints[:, 1] * np.sin(joints[:, 0])
    joints[:, 0], joints[:, 1] = np.arctan2(feet_y, feet_x), np.hypot(feet_x, feet_y)
    plant.drive(joints, np.zeros((6, 3)))
    pose = plant.attitude().pose
    assert (pose.x, pose.y, pose.heading) == pytest.approx((0.1, 0.0, 0.0), abs=1e-9)


def test_kinematic_rays_end_on_the_ground() -> None:
    directions = np.array([[0.6, 0.0, -0.8], [0.0, 0.6, -0.8], [0.0, 0.0, -1.0]])
    origin = np.array([1.0, 0.5, 5.0])
    hits = origin + a_plant().cast(origin, directions, 12.0)[:, None] * directions
    assert hits[:, 2] == pytest.approx(HILLS.heights_at(hits[:, 0], hits[:, 1]), abs=0.005)


def test_rays_into_the_sky_or_out_of_range_hit_nothing() -> None:
    origin = np.array([0.0, 0.0, 5.0])
    directions = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [math.sqrt(0.99), 0.0, -0.1]])
    assert np.isnan(a_plant().cast(origin, directions, 12.0)).all()


@pytest.mark.soak
def test_walks_over_the_same_ground_are_identical() -> None:
    def walked() -> object:
        robot = make_robot("kinematic", terrain=TerrainSpec(seed=5, slope=0.2))
        take_steps(robot, an_arc(0.05), 2)
        return robot.state()

    assert walked() == walked()


def test_straining_feet_do_not_move_the_body() -> None:
    plant = a_plant()
    start, joints = plant.attitude().pose, plant.joints()
    for leg, turn in ((0, 0.1), (1, -0.2), (0, -0.1), (4, 0.2), (1, 0.2), (4, -0.2)):
        joints[leg, 0] += turn
        plant.drive(joints, np.zeros((6, 3)))
    pose = plant.attitude().pose
    assert (pose.x, pose.y, pose.heading) == pytest.approx(
        (start.x, start.y, start.heading), abs=1e-9
    )


def test_longer_left_legs_roll_the_body_to_the_right() -> None:
    plant = a_plant()
    plant.drive(lengthened(plant, 0.1, 0.1, 0.1, 0, 0, 0), np.zeros((6, 3)))
    assert plant.attitude().roll == pytest.approx(0.1 / 4.6, rel=0.2)
