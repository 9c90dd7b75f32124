"""The arm's closed-form kinematics, and motions within their limits."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.youbot_sim.drives import Drives
from robots.youbot_sim.kinematics import (
    LIMITS,
    Grip,
    PoseUnreachable,
    grip_of,
    joints_for,
    tip_in_world,
)
from robots.youbot_sim.motion import ACCELERATIONS, SPEEDS, change_speed, halt, plan
from robots.youbot_sim.places import BOXES, POSES
from robots.youbot_sim.vocabulary import GROUPS, Drive, Group, Joints, Motion, ObjectPlace

TICK = 0.01


@given(
    azimuth=st.floats(-2.9, 2.9),
    reach=st.floats(0.1, 0.5),
    height=st.floats(0.05, 0.7),
    lean=st.floats(0.0, math.pi),
)
def test_inverse_kinematics_brings_the_fingers_to_the_pose(
    azimuth: float, reach: float, height: float, lean: float
) -> None:
    wanted = Grip(azimuth, reach, height, lean)
    try:
        joints = joints_for(wanted)
    except PoseUnreachable:
        return
    found = grip_of(joints)
    assert (found.azimuth, found.reach, found.height, found.lean) == pytest.approx(
        (azimuth, reach, height, lean)
    )
    assert all(low <= angle <= high for angle, (low, high) in zip(joints, LIMITS, strict=True))


def test_pose_out_of_reach_is_refused_with_a_reason() -> None:
    with pytest.raises(PoseUnreachable, match=r"the wrist would be 0\.864 m from the shoulder"):
        joints_for(Grip(0.0, 1.1, 0.4, math.pi / 2))
    with pytest.raises(PoseUnreachable, match="joint 2 can't turn to 139 degrees"):
        joints_for(Grip(0.0, 0.2, 0.2, 0.3))


@pytest.mark.parametrize(
    ("place", "pose", "box"), [("B", "box B", BOXES[0]), ("C", "box C", BOXES[1])]
)
def test_arm_reaches_its_box_at_each_place(place: str, pose: str, box: object) -> None:
    x, y, height = tip_in_world(POSES["base"][place], POSES["arm"][pose])
    found = next(one for one in BOXES if one == box)
    assert math.hypot(x - found.x, y - found.y) < 0.005
    assert height > found.height + 0.05


def steps(motion: Motion) -> list[Joints]:
    return [motion.joints(number * TICK) for number in range(math.ceil(motion.seconds / TICK) + 2)]


def differences(rows: list[Joints]) -> list[Joints]:
    return [
        tuple((b - a) / TICK for a, b in zip(*pair, strict=True))
        for pair in itertools.pairwise(rows)
    ]


def check_limits(group: Group, joints: list[Joints], share: float = 1.0) -> None:
    """Check speeds and accelerations by differences of the drives' set points."""
    speeds = differences(joints)
    changes = differences(speeds)
    for rows, limits in (
        (speeds, tuple(share * one for one in SPEEDS[group])),
        (changes, ACCELERATIONS[group]),
    ):
        for row in rows:
            assert all(
                abs(value) <= limit * 1.001 + 1e-6 for value, limit in zip(row, limits, strict=True)
            )


@pytest.mark.parametrize("group", GROUPS)
@pytest.mark.parametrize("share", [1.0, 0.3])
def test_motions_stay_within_their_limits(group: Group, share: float) -> None:
    poses = list(POSES[group].values())
    motion = plan(Drive(group, poses[1], share), poses[0])
    joints = steps(motion)
    check_limits(group, joints, share)
    assert joints[0] == poses[0]
    assert joints[-1] == pytest.approx(poses[1])


def test_motion_changes_speed_without_a_jerk() -> None:
    start, goal = POSES["arm"]["home"], POSES["arm"]["tucked"]
    for before, after in ((0.3, 1.0), (1.0, 0.3)):
        first = plan(Drive("arm", goal, before), start)
        at = round(first.seconds * 0.4 / TICK) * TICK
        second = change_speed(first, at, Drive("arm", goal, after))
        joints = [first.joints(number * TICK) for number in range(round(at / TICK))] + steps(second)
        check_limits("arm", joints)
        assert joints[-1] == pytest.approx(goal)


def test_halted_motion_brakes_within_its_limits() -> None:
    motion = plan(Drive("base", POSES["base"]["B"]), POSES["base"]["A"])
    stopping = halt(motion, 2.0, "base")
    check_limits("base", [motion.joints(number * TICK) for number in range(200)] + steps(stopping))
    assert 0.5 < stopping.seconds < 1.5
    assert halt(motion, motion.seconds, "base").seconds == 0.0
    assert plan(Drive("base", motion.goal), motion.goal).seconds == 0.0


def test_objects_fall_into_the_box_below() -> None:
    b, c = BOXES
    assert (b.place, c.place) == (ObjectPlace.BOX_B, ObjectPlace.BOX_C)
    assert b.holds(b.x + 0.05, b.y)
    assert not b.holds(b.x + 0.2, b.y)
    assert not b.holds(c.x, c.y)


def test_drive_brakes_before_a_new_goal() -> None:
    drives = Drives()
    drives.drive(Drive("base", POSES["base"]["B"]), 0.0)
    way = [drives.joints("base", number * TICK) for number in range(200)]
    answer = drives.drive(Drive("base", POSES["base"]["A"]), 2.0)
    way += [
        drives.joints("base", 2.0 + number * TICK)
        for number in range(math.ceil(answer.seconds / TICK) + 1)
    ]
    check_limits("base", way)
    assert way[-1] == pytest.approx(POSES["base"]["A"])
    assert not drives.is_moving("base", 2.0 + answer.seconds + TICK)
    assert answer.joints(0.5 * answer.seconds) == pytest.approx(
        drives.joints("base", 2.0 + 0.5 * answer.seconds)
    )
