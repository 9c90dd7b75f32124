"""A robot goes on and on, and central stays as big as it is. What central remembers on purpose (outcomes of ended tasks,
answers of lost connections) is bounded, and full when the first look is taken.
"""

import pytest
from soak.robot import ROUNDS_AN_HOUR, Robot, size_of

from tca_central.core import REMEMBERED_OUTCOMES
from tca_central.model.registry import REMEMBERED_CONNECTIONS


def check_that_it_does_not_grow(hours: list[int], restart_after: int, slack: int) -> None:
    """Looks after so many hours each, from the end of the time before; all must be in the same place of the round."""
    robot, sizes = Robot(), []
    for more in hours:
        robot.live(more, restart_after)
        assert not robot.is_busy
        assert len(robot.central.outcomes) == REMEMBERED_OUTCOMES
        assert len(robot.central.registry.lost) == REMEMBERED_CONNECTIONS
        sizes.append(size_of(robot.central))
    (objects, size), (objects_then, size_then) = sizes
    assert abs(objects_then - objects) <= slack, sizes
    assert size_then <= size * 1.1, sizes


@pytest.mark.soak
def test_central_does_not_grow_in_a_morning_whose_modules_die_every_five_minutes() -> None:
    # 5 killed tasks in 4 h stay in a list that is swept when it has 64 such entries: some 20 objects. One object for
    # each of the 48 restarts would come on top of that.
    check_that_it_does_not_grow([4, 4], ROUNDS_AN_HOUR // 12, slack=40)


@pytest.mark.soak
def test_central_does_not_grow_in_a_month_whose_modules_die_every_hour() -> None:
    check_that_it_does_not_grow([4 * 24, 26 * 24], ROUNDS_AN_HOUR, slack=100)
