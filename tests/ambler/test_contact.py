"""Rocks that the scanner does not see. Legs detect the rocks by contact, stop, and stand again."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ambler.builders import the_first_leg_move

from robots.ambler_sim.machine.making import make_robot, pybullet_is_installed
from robots.ambler_sim.machine.motion import BACK_OFF
from robots.ambler_sim.machine.robot import Robot
from robots.ambler_sim.machine.terrain import scattered_rocks
from robots.ambler_sim.messages import TERRAIN_COLLISION
from robots.ambler_sim.options import Backend
from robots.ambler_sim.planning.stability import WEIGHT
from robots.ambler_sim.vocabulary import NO_LEG, BodyMove, Contact, LegMove, Rock, TerrainSpec
from tca_module import FailureRaised

NO_PHYSICS = pytest.mark.skipif(not pybullet_is_installed(), reason="PyBullet is not installed")
BACKENDS = [
    "kinematic",
    pytest.param(
        "pybullet",
        marks=[NO_PHYSICS, pytest.mark.soak],
    ),
]
IN_THE_WAY = Rock(1.1, 1.85, 0.25, 0.7)
ON_THE_FOOTHOLD = Rock(1.4, 2.2, 0.25, 0.3)


def a_robot(backend: Backend, *rocks: Rock) -> Robot:
    return make_robot(backend, terrain=TerrainSpec(seed=1, slope=0.1, rocks=rocks))


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Backend:
    name: Backend = request.param
    return name


def contact_of(robot: Robot, move: LegMove | BodyMove) -> Contact:
    with pytest.raises(FailureRaised, match=TERRAIN_COLLISION.name) as raised:
        robot.move_leg(move) if isinstance(move, LegMove) else robot.move_body(move)
    contact: Contact = TERRAIN_COLLISION.data.decode(raised.value.body)
    return contact


def test_leg_that_meets_a_rock_passes_when_lifted_higher(
    backend: Backend,
) -> None:
    robot = a_robot(backend, IN_THE_WAY)
    before, move = robot.stance(), the_first_leg_move(robot)
    contact = contact_of(robot, move)
    after = robot.stance()
    foot = after.feet[move.leg]
    assert contact.leg == move.leg == 2
    assert math.dist((contact.x, contact.y), (IN_THE_WAY.x, IN_THE_WAY.y)) == pytest.approx(
        0.37, abs=0.06
    )
    assert contact.z == pytest.approx(move.lift, abs=0.05)
    assert contact.force > 800
    assert math.dist((contact.x, contact.y), (foot.x, foot.y)) == pytest.approx(BACK_OFF, abs=0.06)
    assert min(robot.readings().loads) > 1000
    assert math.degrees(robot.peak_tilt) < 1.0
    assert (after.pose.x, after.pose.y) == pytest.approx((before.pose.x, before.pose.y), abs=0.02)
    assert after.last_leg == before.last_leg
    footfall = robot.move_leg(replace(move, lift=contact.z + 0.4))
    assert footfall.reached
    assert (footfall.foot.x, footfall.foot.y) == pytest.approx(
        (move.foothold.x, move.foothold.y), abs=0.05
    )
    robot.close()


def test_rock_on_the_foothold_is_felt_while_lowering(backend: Backend) -> None:
    robot = a_robot(backend, ON_THE_FOOTHOLD)
    contact = contact_of(robot, the_first_leg_move(robot))
    foot = robot.stance().feet[2]
    assert contact.z == pytest.approx(robot.terrain.top(ON_THE_FOOTHOLD), abs=0.1)
    assert foot.z == pytest.approx(robot.terrain.top(ON_THE_FOOTHOLD), abs=0.1)
    assert sum(robot.readings().loads) == pytest.approx(WEIGHT, rel=0.1)
    robot.close()


def test_scanner_does_not_see_rocks(backend: Backend) -> None:
    with_rocks, without = a_robot(backend, IN_THE_WAY, ON_THE_FOOTHOLD), a_robot(backend)
    assert np.allclose(
        with_rocks.scan(), without.scan(), atol=1e-3
    )  # the physics engine is never quite still


def test_picture_shows_rocks(tmp_path: Path) -> None:
    with_rocks, without = a_robot("kinematic", IN_THE_WAY), a_robot("kinematic")
    drawn = with_rocks.picture(tmp_path / "with").read_text().count('class="rock"')
    assert (drawn, without.picture(tmp_path / "without").read_text().count('class="rock"')) == (
        2,
        0,
    )


def test_scattered_rocks_are_repeatable_and_lie_along_the_path() -> None:
    rocks = scattered_rocks(4, 5, 10.0, (0.6, 0.8))
    assert (
        rocks == scattered_rocks(4, 5, 10.0, (0.6, 0.8)) != scattered_rocks(5, 5, 10.0, (0.6, 0.8))
    )
    assert [int(rock.x / 2.0) for rock in rocks] == [0, 1, 2, 3, 4]
    assert all(0.6 <= rock.height <= 0.8 and 1.2 <= abs(rock.y) <= 1.7 for rock in rocks)


def test_body_that_meets_a_rock_backs_off_and_stands(backend: Backend) -> None:
    robot = a_robot(backend, Rock(0.9, 0.0, 0.2, 4.0))
    start = robot.stance().pose
    contact = contact_of(robot, BodyMove(replace(start, x=start.x + 0.45), 2.0))
    assert contact.leg == NO_LEG
    assert contact.dx == pytest.approx(1.0)
    assert contact.x == pytest.approx(0.7, abs=0.1)
    assert robot.true_stance().pose.x == pytest.approx(start.x, abs=0.05)
    assert min(robot.readings().loads) > 1000


@pytest.mark.parametrize("backend", ["kinematic", pytest.param("pybullet", marks=NO_PHYSICS)])
def test_leg_beam_contact_is_detected(backend: Backend) -> None:
    robot = a_robot(backend, Rock(0.9, 0.6, 0.1, 6.0))
    foot = robot.stance().feet[2]
    move = LegMove(
        2, replace(foot, x=1.3, y=2.3, z=robot.terrain.height(1.3, 2.3)), foot.z + 0.6, 1.6, 1
    )
    assert contact_of(robot, move).force > 800
