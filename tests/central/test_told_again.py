"""What may have been lost on a line that broke is said again to who comes back before his loss was noticed."""

import pytest
from central.player import Player

from tca_wire import headers
from tca_wire.points import TaskId


@pytest.mark.parametrize("steer", [headers.Kill, headers.Retry])
def test_a_handler_is_told_again_that_it_is_to_end(steer: type) -> None:
    robot = Player()
    robot.module("legs", "command step")
    robot.module("user")
    step = robot.task("user", "step")
    back = headers.Hello(1, 1, "legs", "run of legs", 1, "legs", "here:1")
    assert headers.Cancelled(step) not in robot.receive("new line", back)
    robot.receive("user", steer(robot.number("user"), TaskId(step)))
    assert headers.Cancelled(step) in robot.receive("newer line", back)
