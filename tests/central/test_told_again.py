"""What may have been lost on a line that broke is said again to who comes back before his loss was noticed."""

from collections.abc import Callable

import pytest
from central.player import Player

from tca_wire.journal.facts import Ignored, RequestRefused
from tca_wire.packets import headers
from tca_wire.packets.headers import PROTOCOL_VERSION
from tca_wire.points import TaskId
from tca_wire.vocabulary import Refusal

BACK = headers.Hello(1, PROTOCOL_VERSION, "legs", "run of legs", 1, "legs", "here:1")


@pytest.mark.parametrize(("steer", "why"), [(headers.Kill, "by user"), (headers.Retry, "it is to be handled again")])
def test_a_handler_is_told_again_that_it_is_to_end(steer: type, why: str) -> None:
    robot = Player()
    robot.module("legs", "command step")
    robot.module("user")
    step = robot.task("user", "step")
    assert headers.Cancelled(step, why) not in robot.receive("new line", BACK)
    robot.receive("user", steer(robot.number("user"), TaskId(step)))
    assert headers.Cancelled(step, why) in robot.receive("newer line", BACK)


@pytest.mark.parametrize("answer", [headers.Reply, lambda delivery: headers.Fail(delivery, "slipped")])
def test_who_comes_back_after_its_loss_is_told_why_its_answer_is_too_late(
    answer: Callable[[int], headers.Reply | headers.Fail],
) -> None:
    """It could not know: nothing is refused, and no number is told that says nothing to anybody."""
    robot = Player()
    robot.module("legs", "command step")
    robot.module("user")
    step = robot.task("user", "step")
    robot.lose("legs/1")
    assert headers.Cancelled(step, "its connection to central was lost") in robot.receive("new line", BACK)
    late = f"the answer of task {step} 'step' came too late: the module had been lost (its connection closed)"
    assert robot.receive("new line", answer(step)) == [headers.Refused(0, Refusal.TOO_LATE, late)]
    assert robot.facts(Ignored) == [Ignored("legs", late)]
    assert robot.facts(RequestRefused) == []
