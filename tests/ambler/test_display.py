"""The published picture of the robot, and how often it is drawn. The walk does not depend on the
picture.
"""

from typing import Any

import pytest
from ambler.builders import the_first_leg_move

from robots.ambler_sim.machine.making import make_robot
from robots.ambler_sim.messages import ROBOT_PICTURE
from robots.ambler_sim.modules.display import BETWEEN_PICTURES, WHILE_MOVING, Display
from robots.ambler_sim.vocabulary import TerrainSpec
from tca_module import CentralLost, TcaError

HILLS = TerrainSpec(seed=2, slope=0.3)


class FakeSender:
    """A sender that stores the values of variables, or fails."""

    def __init__(self, error: TcaError | None = None) -> None:
        self.values: list[Any] = []
        self.error = error

    def set_variable(self, variable: Any, value: Any, *, wait: bool) -> None:
        assert (variable, wait) == (ROBOT_PICTURE, False)
        self.values.append(value)
        if self.error:
            raise self.error


class FakeClock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_footsteps_are_drawn_at_most_once_a_period() -> None:
    clock, sender = FakeClock(), FakeSender()
    robot = make_robot("kinematic", terrain=HILLS)
    display: Any = Display(robot, while_moving=False, clock=clock)
    for pause in (0.0, BETWEEN_PICTURES / 2, BETWEEN_PICTURES / 2):
        clock.now += pause
        display.after_footstep(sender)
        display.tick(sender)
    assert sender.values == [robot.drawing()] * 2


@pytest.mark.parametrize(
    ("ours", "of_robot", "drawn"), [(1.0, 0.5, 1), (0.5, 1.0, 1), (1.0, 1.0, 2)]
)
def test_moves_are_drawn_after_both_real_and_robot_time_passed(
    ours: float, of_robot: float, drawn: int
) -> None:
    clock, sender = FakeClock(), FakeSender()
    robot = make_robot("kinematic", terrain=HILLS)
    display: Any = Display(robot, while_moving=True, clock=clock)
    display.tick(sender)
    clock.now += ours * WHILE_MOVING
    robot.time += of_robot * WHILE_MOVING
    display.tick(sender)
    assert len(sender.values) == drawn


def test_move_continues_when_central_is_lost() -> None:
    robot = make_robot("graphical", terrain=HILLS)
    sender = FakeSender(CentralLost("away"))
    display: Any = Display(robot, while_moving=True)
    move = the_first_leg_move(robot)
    assert robot.move_leg(move, lambda: display.tick(sender) is None).reached
    assert sender.values


@pytest.mark.soak
def test_graphical_backend_moves_like_the_kinematic_one() -> None:
    quick, graphical = (
        make_robot("kinematic", terrain=HILLS),
        make_robot("graphical", terrain=HILLS),
    )
    assert graphical.backend == "graphical"
    pictures = [graphical.drawing()]

    def draw() -> bool:
        pictures.append(graphical.drawing())
        return True

    move = the_first_leg_move(quick)
    assert quick.move_leg(move) == graphical.move_leg(move, draw)
    assert quick.true_stance() == graphical.true_stance()
    assert len(set(pictures)) > 10


def test_graphical_backend_restores_from_and_to_snapshots() -> None:
    quick = make_robot("kinematic", terrain=HILLS)
    graphical = make_robot("graphical", state=quick.state())
    back = make_robot(state=graphical.state())
    again = make_robot("kinematic", state=make_robot("kinematic", state=quick.state()).state())
    assert (graphical.backend, back.backend) == ("graphical", "graphical")
    assert back.true_stance() == again.true_stance()
