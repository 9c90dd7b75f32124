"""Checks and recoveries around the real modules, in one process."""

import math
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from dev.invariants import check_invariants
from robots.ambler_sim.layers import footfall, planners, stability, terrain_contact, tip_over
from robots.ambler_sim.layers.footfall import FOOTFALL_CHECK
from robots.ambler_sim.layers.stability import STABILITY_CHECK, UNSTABLE_MOVE
from robots.ambler_sim.layers.tip_over import STEADY
from robots.ambler_sim.machine.making import make_robot
from robots.ambler_sim.machine.robot import Robot
from robots.ambler_sim.messages import (
    ACQUIRE_IMAGE,
    IMAGES,
    LEVEL_BODY,
    MOVE_BODY,
    MOVE_LEG,
    TIP_OVER_RISK,
    TRAVERSE_PATH,
    Bend,
    Path,
)
from robots.ambler_sim.modules import (
    controller,
    error_recovery,
    gait_planner,
    mapper,
    scanner,
)
from robots.ambler_sim.modules.planners import PLANNERS
from robots.ambler_sim.modules.task_manager import make_module as make_task_manager
from robots.ambler_sim.recovery import REPLAN_MOVE
from robots.ambler_sim.vocabulary import BodyMove, Fault, Readings
from tca_module import Client, TaskFailed, connect
from tca_module.testing import LocalCentral
from tca_tools.journal.fold import History
from tca_wire.journal.facts import Failed, Received

WALKERS = [
    f"robots.ambler_sim.modules.{name}"
    for name in (
        "controller",
        "scanner",
        "mapper",
        "gait_planner",
        "planners",
        "task_manager",
    )
]

LAYERS = [each.layer for each in (footfall, planners, stability, terrain_contact, tip_over)]


@pytest.fixture
def robot() -> Robot:
    return make_robot("kinematic")


@pytest.fixture
def central(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> Iterator[LocalCentral]:
    """Run all modules of a walk."""
    walkers = (
        gait_planner.planner,
        *PLANNERS.values(),
        scanner.scanner,
        mapper.mapper,
        controller.make_module(robot, None),
        make_task_manager(lambda _: None, lambda _: None),
    )
    for program in (gait_planner, scanner, mapper):
        monkeypatch.setattr(program, "memory", type(program.memory)())
    with LocalCentral(check=check_invariants) as local, ExitStack() as stack:
        for module in (*walkers, *LAYERS, error_recovery.recovery):
            monkeypatch.setattr(module, "central", local)
            stack.enter_context(module.running())
        yield local


@pytest.fixture
def user(central: LocalCentral) -> Iterator[Client]:
    with connect("user", central) as client:
        yield client


def sent(central: LocalCentral, name: str) -> list[Received]:
    return [fact for fact in central.facts if isinstance(fact, Received) and fact.message == name]


def test_walking_modules_do_not_import_checks_or_recoveries() -> None:
    code = f"import sys; from importlib import import_module; [*map(import_module, {WALKERS})]; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    added = (
        "recovery",
        "layers",
        "planning.checks",
        "planning.replanning",
        "modules.error_recovery",
    )
    assert set(WALKERS) <= set(done.stdout.split())
    assert not {f"robots.ambler_sim.{name}" for name in added} & set(done.stdout.split())


def test_unstable_body_move_fails_before_it_starts(
    robot: Robot, user: Client, central: LocalCentral
) -> None:
    before = robot.stance()
    too_far = BodyMove(replace(before.pose, x=before.pose.x + 1.2), 2.0)
    with pytest.raises(TaskFailed) as failed:
        user.command(MOVE_BODY, too_far).result(timeout=10)
    assert failed.value.failure == UNSTABLE_MOVE.name
    assert failed.value.data_as(UNSTABLE_MOVE).support < 0.3
    assert robot.stance() == before
    assert len(sent(central, STABILITY_CHECK.name)) == 1


def test_stability_check_returns_its_margins(
    user: Client, robot: Robot, central: LocalCentral
) -> None:
    pose = robot.stance().pose
    user.command(MOVE_BODY, BodyMove(replace(pose, x=pose.x + 0.1), 1.0)).result(timeout=10)
    (check,) = sent(central, STABILITY_CHECK.name)
    margins = STABILITY_CHECK.decode_reply(History.until(central.entries).tasks[check.id].result)
    assert margins.support > 0.5
    assert margins.energy > 0.05


@pytest.mark.soak
def test_foot_without_measured_load_is_placed_elsewhere(
    robot: Robot, user: Client, central: LocalCentral, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A force sensor reads zero once after a move. The check cannot know that the foot is safe."""
    truth, believed = robot.readings, iter([True, False])

    def readings() -> Readings:
        now = truth()
        return now if next(believed, True) else replace(now, loads=(0.0,) * 6)

    monkeypatch.setattr(robot, "readings", readings)
    user.goal(TRAVERSE_PATH, Path((Bend(0.0, 1.0),))).result(timeout=30)
    (replan,) = sent(central, REPLAN_MOVE.name)
    moves = [
        (move.parent, MOVE_LEG.decode_data(move.body)) for move in sent(central, MOVE_LEG.name)
    ]
    first, again = moves[0][1], next(move for parent, move in moves if parent == replan.id)
    assert first.leg == again.leg == 2
    assert (
        math.dist((first.foothold.x, first.foothold.y), (again.foothold.x, again.foothold.y)) > 0.2
    )
    assert len(sent(central, FOOTFALL_CHECK.name)) == 3
    assert robot.stance().pose.x == pytest.approx(1.0, abs=0.05)


def test_leg_over_collapsed_ground_is_lowered_before_a_move(
    robot: Robot, user: Client, central: LocalCentral
) -> None:
    robot.inject(Fault("soft spot", leg=4))
    pose = robot.stance().pose
    user.command(MOVE_BODY, BodyMove(replace(pose, x=pose.x + 0.1), 1.0)).result(timeout=10)
    assert robot.readings().loads[4] < 500.0
    user.command(MOVE_BODY, BodyMove(pose, 1.0)).result(timeout=10)
    assert len(sent(central, LEVEL_BODY.name)) == 1
    assert min(robot.readings().loads) > 1000.0


def test_image_numbers_increase_after_footstep_count_reset(
    user: Client,
) -> None:
    """The gait planner counts footsteps, and begins again after its loss."""
    user.command(ACQUIRE_IMAGE, 5).result(timeout=10)
    (first,) = user.query(IMAGES, 0)
    user.command(ACQUIRE_IMAGE, 0).result(timeout=10)
    (second,) = user.query(IMAGES, first.number)
    assert second.number > first.number


def test_tilting_move_restarts_after_levelling(
    robot: Robot, user: Client, central: LocalCentral, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All legs of one side are a little short. This is not noticed before the move."""
    monkeypatch.setattr(tip_over, "MOST_TILT", 1.0)
    shorter = np.zeros((6, 3))
    shorter[:3, 2] = -0.16
    robot._drive(robot._command + shorter)
    pose = robot.stance().pose
    user.command(MOVE_BODY, BodyMove(replace(pose, x=pose.x + 0.1), 1.0)).result(timeout=10)
    (steadied,) = sent(central, STEADY.name)
    assert TIP_OVER_RISK.name in [
        fact.failure for fact in central.facts if isinstance(fact, Failed)
    ]
    assert steadied.parent == sent(central, MOVE_BODY.name)[0].id
    assert robot.stance().pose.x == pytest.approx(pose.x + 0.1, abs=0.03)
