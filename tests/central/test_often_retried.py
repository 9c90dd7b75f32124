"""A task that fails again and again is not retried for ever."""

import logging
from typing import Any

import pytest
from central.player import Player

from tca_central.events import Effect, Record
from tca_central.failing.failures import MOST_ATTEMPTS
from tca_central.shell.log_lines import OFTEN, LogLines
from tca_wire.journal.facts import Retried
from tca_wire.messages.failures import HANDLER_ERROR
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment
from tca_wire.points import ROOT, TaskId
from tca_wire.vocabulary import Refusal


class Robot(Player):
    """Legs that slip, and an exception handler of moves that retries them. A further one is at the root."""

    def __init__(self) -> None:
        super().__init__(check=False)
        self.lines = LogLines(logging.getLogger("often"), self.central)

    def note(self, effects: list[Effect]) -> None:
        super().note(effects)
        for one in effects:
            if isinstance(one, Record):
                self.lines.write(one)

    def begin(self, maximum: int = 0) -> None:
        self.module("legs", "command move")
        self.module("expert", "exception handler recover", "exception handler stop")
        self.module("user")
        for wanted, of in ((Attachment("", "stop"), ""), (Attachment("slip", "recover", maximum), "move")):
            self.receive("expert", headers.Attach(self.number("expert"), wanted, ROOT, of))
        self.move = TaskId(self.task("user", "move"))

    def retry(self) -> Any:
        """The move slips; the answer to the exception handler, which wants it retried."""
        self.fail("legs/1", "slip")
        (handler,) = self.delivered("expert/1")
        *_, answer = self.receive("expert/1", headers.Retry(self.number("expert/1"), self.move, origin=handler))
        return answer


def test_retries_end_at_a_default_and_the_search_continues() -> None:
    robot = Robot()
    robot.begin()
    while not isinstance(answer := robot.retry(), headers.Refused):
        robot.reply("expert/1")
    assert (answer.refusal, len(robot.facts(Retried))) == (Refusal.OVERLOAD, MOST_ATTEMPTS - 1)
    (handler,) = robot.delivered("expert/1")
    sent = robot.receive("expert/1", headers.Fail(handler, HANDLER_ERROR, answer.text))
    (called,) = (header for header in sent if isinstance(header, headers.Deliver))
    assert called.message == "stop"
    assert f"{MOST_ATTEMPTS} times" in str(called.context)


def test_retries_end_later_with_a_maximum_of_ones_own() -> None:
    robot = Robot()
    robot.begin(MOST_ATTEMPTS + 5)
    for _ in range(MOST_ATTEMPTS + 5):
        assert isinstance(robot.retry(), headers.Accepted)
        robot.reply("expert/1")
    robot.fail("legs/1", "slip")
    assert len(robot.facts(Retried)) == MOST_ATTEMPTS + 5


def test_log_warns_once_of_a_task_that_is_retried_often(caplog: pytest.LogCaptureFixture) -> None:
    robot = Robot()
    robot.begin()
    for _ in range(2 * OFTEN):
        robot.retry()
        robot.reply("expert/1")
    warned = [record.args for record in caplog.records if "retried" in record.getMessage()]
    assert [args[1] for args in warned if isinstance(args, tuple)] == [OFTEN]
