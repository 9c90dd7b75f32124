"""The cleaning robot without central: four regions per joint, limits, moves in two dimensions,
cleaning.
"""

import itertools
import math
import re
import shutil
from pathlib import Path

import pytest
from cartesian.virtual_robot import VirtualRobot

import robots
from robots.cartesian_sim.__main__ import describe_ticks
from robots.cartesian_sim.drawing import draw
from robots.cartesian_sim.generated import JointTarget
from robots.cartesian_sim.guide import PATTERN
from robots.cartesian_sim.mechanism import OVERTRAVEL, POWER_UP, Axis
from robots.cartesian_sim.messages import WallPoint
from tca_behaviours.activities import automatic, one_each, one_for_all
from tca_behaviours.activities.models.reading import read_model
from tca_behaviours.activities.models.writing import write_code


def test_generated_code_matches_the_model(tmp_path: Path) -> None:
    there = tmp_path / "robots" / "cartesian_sim"
    shutil.copytree(Path(robots.__file__).parent / "cartesian_sim", there)
    (tmp_path / "robots" / "__init__.py").touch()
    said = write_code(read_model(there / "cleaning.toml"), there)
    assert [line.partition(": ")[2] for line in said] == ["unchanged"] * 2 + [
        "yours, not changed"
    ] * 3


def test_cleaning_show_counts_missed_ticks() -> None:
    robot = VirtualRobot()
    robot.baton.run(1.005)
    due, made, rest = re.split(
        r" ticks were due in 1 s: | were made \(0 too late\), ", describe_ticks(robot.application)
    )
    assert due == made
    assert rest == "0 were left out because the next was due, none is missing"
    robot.application.remove("x.movement.machine")
    robot.baton.run(1.0)
    robot.application.move("x.movement.machine", "all")
    assert describe_ticks(robot.application).endswith(", 100 are missing")


def test_motor_follows_at_its_rate_and_its_brake_stops_it() -> None:
    axis = Axis(1.0, fastest=0.5, acceleration=1.0, position=0.5, wanted=2.0)
    axis.advance(1.0)
    assert (axis.position, axis.speed) == (0.5, 0.0)  # switched off
    axis.is_on = True
    axis.advance(POWER_UP)
    axis.advance(0.1)
    assert axis.speed == pytest.approx(0.1 + POWER_UP)
    for _ in range(50):
        axis.advance(0.01)
    assert axis.speed == 0.5
    axis.is_on = False
    before = axis.position
    axis.advance(0.1)
    assert (axis.position, axis.speed) == (before, 0.0)


def test_axis_ends_at_its_stops_behind_the_switches() -> None:
    axis = Axis(1.0, fastest=0.5, acceleration=1.0, position=0.9, wanted=0.5, is_on=True)
    for _ in range(100):
        axis.advance(0.01)
    assert axis.position == 1.0 + OVERTRAVEL
    assert axis.sensed().at_high
    assert not axis.sensed().at_low


def test_joint_moves_only_when_enabled_and_referenced() -> None:
    robot = VirtualRobot()
    x = robot.parts.x
    x.target.put(JointTarget(1.0, 0.5))
    x.command.put("reference")
    robot.baton.run(0.5)
    assert (x.movement.current, x.referencing.current) == ("standing", "unreferenced")
    robot.command_joints("enable")
    robot.run_until(lambda: x.enabling.is_in("enabled"))
    x.target.put(JointTarget(1.0, 0.5))
    robot.baton.run(0.5)
    assert x.movement.current == "standing"
    robot.make_ready()
    assert max(map(abs, robot.positions())) < 0.001  # the switches open at 0
    x.target.put(JointTarget(1.0, 0.5))
    robot.run_until(lambda: x.movement.is_in("to position"))
    robot.run_until(lambda: x.movement.is_in("standing"))
    assert robot.positions()[0] == pytest.approx(1.0, abs=0.002)
    assert robot.parts.x.position.value == pytest.approx(1.0, abs=0.001)


def test_braking_joint_accepts_its_next_target() -> None:
    robot = VirtualRobot()
    robot.make_ready()
    x = robot.parts.x
    x.target.put(JointTarget(1.0, 0.5))
    robot.run_until(lambda: robot.positions()[0] > 0.3)
    x.command.put("stop")
    robot.run_until(lambda: x.movement.is_in("braking"))
    x.target.put(JointTarget(0.5, 0.5))
    robot.run_until(lambda: robot.positions()[0] > 0.498 and x.movement.is_in("standing"))


def test_joint_stops_at_its_limit_and_moves_only_back() -> None:
    robot = VirtualRobot()
    robot.make_ready()
    y = robot.parts.y
    y.jog.put(0.8)
    robot.run_until(lambda: y.limits.is_in("at high"))
    robot.run_until(lambda: y.movement.is_in("standing"))
    assert 1.2 < robot.positions()[1] < 1.2 + OVERTRAVEL
    y.jog.put(0.8)
    robot.baton.run(0.2)
    assert y.movement.current == "standing"
    y.jog.put(-0.3)
    robot.run_until(lambda: y.limits.is_in("in range"))
    y.command.put("stop")
    robot.run_until(lambda: y.movement.is_in("standing"))
    assert robot.positions()[1] > 1.0


def test_disabled_joint_stops_at_once_and_retains_its_reference() -> None:
    robot = VirtualRobot()
    robot.make_ready()
    x = robot.parts.x
    x.target.put(JointTarget(2.0, 0.8))
    robot.run_until(lambda: robot.positions()[0] > 0.5)
    x.command.put("disable")
    robot.run_until(lambda: x.movement.is_in("standing"), 0.1)
    assert robot.positions()[0] < 0.6
    assert (x.enabling.current, x.referencing.current) == ("disabled", "referenced")


def test_stopped_search_leaves_no_reference() -> None:
    robot = VirtualRobot()
    robot.command_joints("enable")
    robot.run_until(lambda: robot.parts.x.enabling.is_in("enabled"))
    robot.command_joints("reference")
    robot.run_until(lambda: robot.parts.x.referencing.is_in("searching"))
    robot.command_joints("stop")
    robot.baton.run(0.5)
    assert robot.parts.x.referencing.current == "unreferenced"
    before = robot.positions()
    robot.baton.run(0.5)
    assert robot.positions() == before


def test_wall_is_cleaned_while_policies_change() -> None:
    robot = VirtualRobot()
    robot.make_ready()
    guide = robot.parts.guide
    guide.speed.put(0.8)
    guide.goal.put(WallPoint(0.4, 0.3))
    robot.run_until(lambda: guide.travel.is_in("travelling"))
    guide.command.put("clean")  # not while it travels
    robot.run_until(lambda: guide.travel.is_in("resting"))
    assert guide.cleaning.current == "idle"
    guide.command.put("clean")
    robot.run_until(lambda: guide.cleaning.is_in("working"))
    for policy in itertools.cycle((automatic, one_each, one_for_all)):
        if guide.cleaning.is_in("idle"):
            break
        robot.application.allocate(policy)
        robot.baton.run(1.0)
    (stroke,) = robot.scene().strokes
    for corner in PATTERN:
        assert min(math.dist(point, (corner.x, corner.y)) for point in stroke) < 0.01
    assert robot.positions()[2] < 0.002
    assert draw(robot.scene()).count('class="clean"') == 1
