"""Times at which floating-point numbers are less round than they look."""

import pytest
from central.player import Player

from tca_central.events import Tick
from tca_wire.packets.headers import Register
from tca_wire.packets.parts import MessageFormat, WatchOptions
from tca_wire.vocabulary import Due, MessageClass


@pytest.mark.parametrize("began", [6.3, 8.7, 12345.6])
@pytest.mark.parametrize("period", [0.1, 0.02, 1 / 3])
def test_a_monitor_tests_once_a_period_and_never_twice_at_once(began: float, period: float) -> None:
    """To a computer 0.6 - 0.3 is less than 3 * 0.1: the next test was due at once, again and again, for ever."""
    player = Player()
    player.module("eye", "query seen")
    player.module("user")
    watch = MessageFormat("watch", MessageClass.POLLING_MONITOR, "", parts=["seen", ""])
    player.receive("user", Register(player.number("user"), [watch]))
    player.time = began - 1
    player.send("user", "watch", watch=WatchOptions(period=period))
    for number in range(1, 30):
        (test,) = (timer for timer in player.central.clock.pending() if timer.due is Due.TEST)
        assert test.time == pytest.approx(began + number * period)
        player.event(Tick(test.time))
