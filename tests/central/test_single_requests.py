"""Single requests in rare situations: suspended and killed tasks, rounded times, notices, waits for
handlers.
"""

import pytest
from central.player import INTEGER, Player

from tca_central.events import Tick
from tca_wire.messages.notices import MODULE_LEFT, NOTICES
from tca_wire.packets import headers
from tca_wire.packets.headers import Refused, Register
from tca_wire.packets.parts import MessageFormat, WatchOptions
from tca_wire.points import TaskId
from tca_wire.vocabulary import Due, MessageClass


def test_termination_message_is_sent_after_kill_suspend_and_kill() -> None:
    robot = Player()
    robot.module("planner", "goal walk", capacity=2)
    robot.module("legs", "command stop")
    robot.module("user")
    busy = robot.task("user", "stop", flags=0)
    above = robot.task("user", "walk", flags=0)
    below = robot.task("planner/1", "walk", under=above)
    robot.send("planner/2", "stop", under=below, when_killed=True)
    for header, task in ((headers.Kill, below), (headers.Suspend, above), (headers.Kill, above)):
        robot.request("user", header, TaskId(task))
    robot.reply("legs/1", busy)
    assert not any(task.suspended for task in robot.central.tree.tasks.values())
    assert robot.delivered("legs/1")  # the termination message arrives


@pytest.mark.parametrize("began", [6.3, 8.7, 12345.6])
@pytest.mark.parametrize("period", [0.1, 0.02, 1 / 3])
def test_polling_monitor_tests_once_a_period_despite_rounding(began: float, period: float) -> None:
    """In floating point, 0.6 - 0.3 is less than 3 * 0.1. A naive rule would make the next test due
    at once, again and again.
    """
    player = Player.of("eye: query seen", "user")
    watch = MessageFormat("watch", MessageClass.POLLING_MONITOR, "", parts=["seen", ""])
    player.request("user", Register, [watch])
    player.time = began - 1
    player.send("user", "watch", watch=WatchOptions(period=period))
    for number in range(1, 30):
        (test,) = (timer for timer in player.central.clock.pending() if timer.due is Due.TEST)
        assert test.time == pytest.approx(began + number * period)
        player.event(Tick(test.time))


def declare(player: Player, *formats: MessageFormat) -> Refused:
    (answer,) = player.request("user", headers.Register, list(formats))
    assert isinstance(answer, Refused)
    return answer


@pytest.fixture
def player() -> Player:
    return Player.of("user")


def test_notice_must_be_declared_in_centrals_format(player: Player) -> None:
    other_class = MessageFormat(MODULE_LEFT.name, MessageClass.INFORM, MODULE_LEFT.format.data)
    assert declare(player, other_class).text == (
        "two formats for message 'tca: module left': a inform here, a broadcast there "
        "(here = module 'user', there = central): declare it once, in a file that all programs import"
    )
    other_data = MessageFormat(MODULE_LEFT.name, MessageClass.BROADCAST, INTEGER)
    assert "data $: integer here, " in declare(player, other_data).text


def test_unknown_name_with_notice_prefix_is_refused(player: Player) -> None:
    refused = declare(player, MessageFormat("tca: module slept", MessageClass.INFORM, INTEGER))
    assert refused.text == (
        "'tca: module slept': names that begin with 'tca: ' are central's own, and it sends no such notice"
    )


@pytest.mark.parametrize("number", [0, 7])
def test_only_central_sends_notices(player: Player, number: int) -> None:
    player.request("user", headers.Register, [notice.format for notice in NOTICES.values()])
    for name in NOTICES:
        (answer,) = player.receive("user", headers.Send(number and player.number("user"), name))
        assert answer.text == f"'{name}' is a notice: only central sends it"


def test_awaited_messages_per_request_are_limited(player: Player) -> None:
    (answer,) = player.request("user", headers.WaitUntilHandled, ["a"] * 1001)
    assert answer.text == "1,001 messages in one wait: 1,000 are allowed, send several requests"
    (answer,) = player.request("user", headers.WaitUntilHandled, [])
    assert isinstance(answer, headers.Answer)
