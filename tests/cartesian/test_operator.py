"""Commands of users. Each command ends when its work is done, or reports why it failed."""

from collections.abc import Iterator

import pytest
from cartesian.virtual_robot import VirtualRobot

from robots.cartesian_sim.messages import (
    CLEAN,
    DISABLE,
    ENABLE,
    INTERRUPTED,
    MOVE_JOINT,
    MOVE_TO,
    NO_SUCH_JOINT,
    NOT_READY,
    REFERENCE,
    SET_JOINT_SPEED,
    STOP,
    JointMove,
    JointSpeed,
    WallPoint,
)
from robots.cartesian_sim.operator import Operator
from tca_module import Client, SentTask, TaskFailed, TaskKilled, connect
from tca_module.testing import LocalCentral


class Town:
    """A robot in virtual time, and a central on the same clock."""

    def __init__(self, central: LocalCentral, user: Client) -> None:
        self.robot, self.central, self.user = VirtualRobot(), central, user

    def pass_time(self, seconds: float) -> None:
        """Advance robot and central in turn, in short steps."""
        for _ in range(round(seconds / 0.1)):
            self.robot.baton.run(0.1)
            self.central.advance(0.1)

    def carried_out(self, sent: SentTask[None], within: float = 30.0) -> None:
        """Advance until a command has ended. Raise TaskFailed if it failed."""
        end = self.central.now() + within
        while sent.info() is not None and self.central.now() < end:
            self.pass_time(0.1)
        sent.result(timeout=5)


@pytest.fixture
def town() -> Iterator[Town]:
    with LocalCentral(stepped=True) as central, connect("user", central) as user:
        town = Town(central, user)
        with Operator(town.robot.parts).module(central).running():
            yield town


def make_ready(town: Town) -> None:
    town.carried_out(town.user.command(ENABLE))
    town.carried_out(town.user.command(REFERENCE))


def moving(town: Town) -> list[str]:
    return [joint.movement.current for joint in town.robot.joints]


def test_operator_command_is_refused_when_the_robot_is_not_ready(town: Town) -> None:
    user = town.user
    with pytest.raises(TaskFailed, match="joint x is not enabled: disabled") as failed:
        town.carried_out(user.command(MOVE_TO, WallPoint(1.0, 0.5)))
    assert failed.value.failure == NOT_READY.name
    with pytest.raises(TaskFailed, match="joint x is not enabled: enable the joints first"):
        town.carried_out(user.command(SET_JOINT_SPEED, JointSpeed("x", 0.1)))
    town.carried_out(user.command(ENABLE))
    assert [joint.enabling.current for joint in town.robot.joints] == ["enabled"] * 3
    with pytest.raises(TaskFailed, match="joint x is not referenced: unreferenced"):
        town.carried_out(user.command(CLEAN))
    with pytest.raises(TaskFailed, match="there is no joint 'z': use one of x, y, tool") as failed:
        town.carried_out(user.command(MOVE_JOINT, JointMove("z", 0.1)))
    assert failed.value.failure == NO_SUCH_JOINT.name


def test_cleaning_robot_moves_by_position_and_by_speed(town: Town) -> None:
    make_ready(town)
    user, robot = town.user, town.robot
    town.carried_out(user.command(MOVE_JOINT, JointMove("y", 0.4)))
    town.carried_out(user.command(MOVE_TO, WallPoint(0.5, 0.5)))
    assert robot.positions()[:2] == pytest.approx([0.5, 0.5], abs=0.002)
    town.carried_out(user.command(SET_JOINT_SPEED, JointSpeed("x", 0.2)))
    town.pass_time(0.5)
    assert moving(town) == ["at speed", "standing", "standing"]
    town.carried_out(user.command(SET_JOINT_SPEED, JointSpeed("x", 0.0)))
    town.pass_time(0.5)
    assert moving(town) == ["standing"] * 3


def test_stop_interrupts_the_operators_commands(town: Town) -> None:
    make_ready(town)
    cleaning = town.user.command(CLEAN)
    town.pass_time(2.0)
    assert town.robot.parts.guide.cleaning.is_in("working")
    town.user.inform(STOP)
    with pytest.raises(TaskFailed) as failed:
        town.carried_out(cleaning)
    assert failed.value.failure == INTERRUPTED.name

    far = town.user.command(MOVE_TO, WallPoint(2.0, 1.2))
    town.pass_time(0.5)
    far.kill("enough")
    town.pass_time(0.5)
    with pytest.raises(TaskKilled):
        far.result(timeout=5)
    assert moving(town) == ["standing"] * 3

    far = town.user.command(MOVE_TO, WallPoint(2.0, 1.2))
    town.pass_time(0.5)
    town.user.inform(DISABLE)
    with pytest.raises(TaskFailed, match="a joint disabled"):
        town.carried_out(far)
    town.pass_time(0.1)
    assert [joint.enabling.current for joint in town.robot.joints] == ["disabled"] * 3
