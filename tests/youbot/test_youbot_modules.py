"""The robot's modules on a stepped clock: moves with progress, new speeds, cancels, kills, and
perception.
"""

import importlib.util
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from robots.youbot_sim import perception
from robots.youbot_sim.messages import (
    BOX_B_FREE,
    MEASURE,
    MOVE_ARM,
    MOVE_BASE,
    MOVE_GRIPPER,
    OFFER_OBJECT,
    UNKNOWN_POSE,
)
from robots.youbot_sim.motion import plan
from robots.youbot_sim.perception import updated_confidence
from robots.youbot_sim.places import POSES
from robots.youbot_sim.robot import Backend, make_robot
from robots.youbot_sim.simulator import Lid, SimulatedRobot
from robots.youbot_sim.stepped import running
from robots.youbot_sim.vocabulary import Drive, JointReadings, Move, ObjectPlace
from tca_module import Client, Outcome, Rejected, TaskFailed, connect
from tca_module.testing import LocalCentral

NO_PHYSICS = pytest.mark.skipif(
    importlib.util.find_spec("pybullet") is None, reason="PyBullet is not installed"
)


@contextmanager
def robot(
    backend: Backend = "kinematic", lid: Lid | None = None
) -> Iterator[tuple[LocalCentral, Client]]:
    """Run simulator, base, arm, gripper and perception, and a client."""
    simulated = make_robot(backend)
    with (
        closing(simulated),
        running(
            SimulatedRobot(simulated, lid or Lid()), has_steps=backend == "pybullet"
        ) as central,
        connect("user", central) as user,
    ):
        yield central, user


def arm_seconds(start: str, goal: str) -> float:
    return plan(Drive("arm", POSES["arm"][goal]), POSES["arm"][start]).seconds


def test_arm_move_reports_progress_and_ends_at_its_goal() -> None:
    with robot() as (central, user):
        moving = user.command(MOVE_ARM, Move("box B"))
        told = moving.progress(float)
        central.advance(arm_seconds("home", "box B") - 0.01)
        shares = told.arrived()
        assert moving.state == "running"
        central.advance(0.02)
        assert moving.wait(timeout=5) is Outcome.DONE
        assert user.query(MEASURE).arm == pytest.approx(POSES["arm"]["box B"])
        assert shares[0] == 0.0
        assert shares == sorted(shares)
        assert 0.99 < shares[-1] <= 1.0


def test_slow_arm_move_accepts_a_new_speed_but_no_new_goal() -> None:
    with robot() as (central, user):
        moving = user.command(MOVE_ARM, Move("box B", speed=0.2))
        central.advance(1.0)
        moving.update(Move("box B", speed=1.0))
        with pytest.raises(Rejected, match="the move goes to 'box B': cancel it first"):
            moving.update(Move("tucked"))
        central.advance(arm_seconds("home", "box B"))
        assert moving.wait(timeout=5) is Outcome.DONE


@pytest.mark.parametrize("way", ["cancel", "kill"])
def test_stopped_arm_move_comes_to_rest_before_it_ends(way: str) -> None:
    with robot() as (central, user):
        moving = user.command(MOVE_BASE, Move("B"))
        central.advance(2.5)
        before = user.query(MEASURE)
        moving.cancel() if way == "cancel" else moving.kill()
        following = user.command(MOVE_BASE, Move("A"))
        central.advance(0.1)
        assert user.query(MEASURE).base[0] > before.base[0]
        central.advance(0.9)
        assert moving.wait(timeout=5) is Outcome.KILLED
        central.advance(10.0)
        assert following.wait(timeout=5) is Outcome.DONE
        assert user.query(MEASURE).base == pytest.approx(POSES["base"]["A"])


def test_unknown_pose_fails_with_a_reason() -> None:
    with (
        robot() as (_, user),
        pytest.raises(TaskFailed, match="knows home, box B, box C, tucked, not 'lunch'") as failed,
    ):
        user.command(MOVE_ARM, Move("lunch")).result(timeout=5)
    assert failed.value.failure == UNKNOWN_POSE.name


def carried(backend: Backend, to: str, lid: Lid | None = None) -> list[JointReadings]:
    """Return the measurements after each move of a delivery."""
    found = []
    with robot(backend, lid) as (central, user):
        user.command(OFFER_OBJECT).wait(timeout=5)
        for message, goal, seconds in (
            (MOVE_GRIPPER, "closed", 1.5),
            (MOVE_BASE, to, 5.5),
            (MOVE_ARM, f"box {to}", 3.0),
            (MOVE_GRIPPER, "open", 2.0),
            (MOVE_ARM, "tucked", 4.0),
        ):
            moving = user.command(message, Move(goal))
            central.advance(seconds)
            assert moving.wait(timeout=5) is Outcome.DONE
            found.append(user.query(MEASURE))
    return found


@pytest.mark.soak
@NO_PHYSICS
@pytest.mark.slow
@pytest.mark.parametrize("to", ["B", pytest.param("C", marks=pytest.mark.soak)])
def test_backends_agree_on_carried_objects(to: str) -> None:
    without, real = carried("kinematic", to), carried("pybullet", to)
    assert [one.object for one in real] == [one.object for one in without]
    assert real[-1].object is (ObjectPlace.BOX_B if to == "B" else ObjectPlace.BOX_C)
    for a, b in zip(without, real, strict=True):
        assert a.base == pytest.approx(b.base, abs=0.005)
        assert a.arm == pytest.approx(b.arm, abs=0.01)
        assert a.gripper == pytest.approx(b.gripper, abs=0.002)


def test_object_dropped_on_a_lid_is_not_in_the_box() -> None:
    assert carried("kinematic", "B", Lid(starts_covered=True))[-1].object is ObjectPlace.FLOOR


def test_perception_gains_confidence_with_each_look() -> None:
    with robot(lid=Lid((1.0,))) as (central, user):
        central.advance(0.5)
        assert user.get_variable(BOX_B_FREE) == 1.0
        user.command(OFFER_OBJECT).wait(timeout=5)
        central.advance(1.0)
        seen = []
        for _ in range(6):
            central.advance(perception.PERIOD)
            seen.append(user.get_variable(BOX_B_FREE))
        assert seen == sorted(seen, reverse=True)
        assert 0.0 < seen[1] < 0.5
        assert seen[-1] == 0.0
    assert updated_confidence(None, is_free=False) == 0.0


@pytest.mark.parametrize(
    "backend", ["kinematic", pytest.param("pybullet", marks=[NO_PHYSICS, pytest.mark.soak])]
)
def test_youbot_picture_is_drawn(backend: Backend, tmp_path: Path) -> None:
    simulated = make_robot(backend)
    made = simulated.picture(tmp_path / "robot")
    simulated.close()
    assert made.suffix == (".svg" if backend == "kinematic" else ".png")
    assert made.stat().st_size > 1000
