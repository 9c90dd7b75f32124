"""The robot on both backends: walking, stopping, restoring from a snapshot, pictures."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ambler.builders import an_arc, take_steps, the_first_leg_move
from PIL import Image

from robots.ambler_sim.errors import OutOfReach
from robots.ambler_sim.machine.making import make_robot, pybullet_is_installed
from robots.ambler_sim.machine.robot import Robot
from robots.ambler_sim.options import Backend
from robots.ambler_sim.planning.elevation import build_elevation_map
from robots.ambler_sim.planning.gait import next_leg, plan_shift
from robots.ambler_sim.planning.leg_recovery import plan_swing
from robots.ambler_sim.planning.stability import WEIGHT
from robots.ambler_sim.vocabulary import BodyMove, Stance, TerrainSpec

NO_PHYSICS = pytest.mark.skipif(not pybullet_is_installed(), reason="PyBullet is not installed")
BACKENDS = ["kinematic", pytest.param("pybullet", marks=NO_PHYSICS)]
on_both = pytest.mark.parametrize("robot", BACKENDS, indirect=True)
"""Physics on every run; other tests use physics only in the soak."""

HILLS = TerrainSpec(seed=2, slope=0.15)


@pytest.fixture(
    params=["kinematic", pytest.param("pybullet", marks=[NO_PHYSICS, pytest.mark.soak])]
)
def robot(request: pytest.FixtureRequest) -> Iterator[Robot]:
    backend: Backend = request.param
    made = make_robot(backend, terrain=HILLS)
    yield made
    made.close()


def greatest_shift(before: Stance, after: Stance, *, without: int = -1) -> float:
    """Return the greatest distance (m) of any foot from its earlier place."""
    pairs = zip(before.feet, after.feet, strict=True)
    return max(math.dist((a.x, a.y, a.z), (b.x, b.y, b.z)) for a, b in pairs if a.leg != without)


@on_both
def test_robot_stands_level_on_six_feet(robot: Robot) -> None:
    readings = robot.readings()
    assert sum(readings.loads) == pytest.approx(WEIGHT, rel=0.1)
    assert min(readings.loads) > 1000
    assert math.degrees(max(abs(readings.roll), abs(readings.pitch))) < 0.3


@pytest.mark.soak
@on_both
def test_restored_robot_continues_the_walk(robot: Robot) -> None:
    reports = take_steps(robot, an_arc(), 2)
    other = make_robot(state=robot.state())
    assert other.backend == robot.backend
    assert greatest_shift(robot.stance(), other.stance()) < 0.02
    assert other.stance().last_leg == 5
    reports += take_steps(other, an_arc(), 1, reports[-1].ground)
    pose = other.stance().pose
    assert [report.step.leg for report in reports] == [2, 5, 1]
    assert (pose.x, pose.y, pose.heading) == pytest.approx((1.5, 0.0, 0.0), abs=0.06)
    assert all(report.footfall.load > 1000 for report in reports)
    assert min(report.margin for report in reports) > 0.4
    assert math.degrees(max(robot.peak_tilt, other.peak_tilt)) < 1.5
    assert other.time > max(robot.time, 15)
    other.close()


@on_both
def test_foot_lands_where_sent_and_the_others_stay(robot: Robot) -> None:
    before, move = robot.stance(), the_first_leg_move(robot)
    footfall = robot.move_leg(move, lambda: True)
    assert footfall.reached
    assert (footfall.foot.x, footfall.foot.y) == pytest.approx(
        (move.foothold.x, move.foothold.y), abs=0.05
    )
    assert footfall.foot.z == pytest.approx(
        robot.terrain.height(footfall.foot.x, footfall.foot.y), abs=0.05
    )
    assert greatest_shift(before, robot.stance(), without=move.leg) < 0.05
    assert robot.stance().last_leg == move.leg


def test_turning_body_keeps_its_feet_in_place(robot: Robot) -> None:
    before = robot.stance()
    goal = replace(before.pose, x=before.pose.x + 0.2, heading=0.1)
    reached = robot.move_body(plan_shift(before, goal))
    assert (reached.x, reached.heading) == pytest.approx((goal.x, goal.heading), abs=0.02)
    assert greatest_shift(before, robot.stance()) < 0.05


def test_stopped_leg_is_lowered_and_steps_again(robot: Robot) -> None:
    move = the_first_leg_move(robot)
    footfall = robot.move_leg(move, lambda: robot.stance().feet[move.leg].x < 0.0)
    stance = robot.stance()
    assert not footfall.reached
    assert footfall.load > 300
    assert math.dist((footfall.foot.x, footfall.foot.y), (move.foothold.x, move.foothold.y)) > 1.0
    assert next_leg(stance) == move.leg
    again = plan_swing(build_elevation_map(robot.scan(), stance), stance, move.foothold, move.sense)
    landed = robot.move_leg(again)
    assert landed.reached
    assert landed.foot.x == pytest.approx(move.foothold.x, abs=0.05)


def test_stopped_body_comes_to_rest_on_its_way(robot: Robot) -> None:
    before = robot.stance()
    move = plan_shift(before, replace(before.pose, x=before.pose.x + 0.4))
    half_way = robot.time + move.duration / 2
    reached = robot.move_body(move, lambda: robot.time < half_way)
    assert 0.1 < reached.x - before.pose.x < 0.36
    assert greatest_shift(before, robot.stance()) < 0.05


def test_body_move_out_of_reach_is_refused_before_moving(robot: Robot) -> None:
    before, time = robot.stance(), robot.time
    with pytest.raises(OutOfReach):
        robot.move_body(BodyMove(replace(before.pose, x=3.0), 2.0))
    assert (robot.stance(), robot.time) == (before, time)


def test_leg_is_lowered_until_it_stands_despite_a_wrong_map() -> None:
    robot = make_robot("kinematic", terrain=HILLS)
    move = the_first_leg_move(robot)
    above = replace(
        move, foothold=replace(move.foothold, z=move.foothold.z + 0.8), lift=move.lift + 0.8
    )
    footfall = robot.move_leg(above)
    assert footfall.load > 1000
    assert footfall.foot.z == pytest.approx(move.foothold.z, abs=0.1)


def test_kinematic_robot_is_drawn_as_svg(tmp_path: Path) -> None:
    robot = make_robot("kinematic", terrain=HILLS)
    written = robot.picture(tmp_path / "ambler.png")
    assert written == tmp_path / "ambler.svg"
    drawing = ET.fromstring(written.read_text(encoding="utf-8"))
    feet = [
        circle
        for circle in drawing.iter("{http://www.w3.org/2000/svg}circle")
        if circle.get("class") == "dark"
    ]
    assert len(feet) == 6 + 2


def test_photograph_shows_ground_sky_and_robot(tmp_path: Path) -> None:
    pytest.importorskip("pybullet")
    robot = make_robot("pybullet", terrain=HILLS)
    written = robot.picture(tmp_path / "ambler.png", (320, 200))
    robot.close()
    pixels = np.asarray(Image.open(written)).astype(int)
    red, blue = pixels[..., 0], pixels[..., 2]
    assert pixels.shape == (200, 320, 3)
    assert (blue[:20] > red[:20]).mean() > 0.9
    assert (red[-20:] > blue[-20:]).mean() > 0.7
    assert len(np.unique(pixels[50:166, 100:233].reshape(-1, 3), axis=0)) > 500
