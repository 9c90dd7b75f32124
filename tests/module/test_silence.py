"""A central that says nothing: waits end in time all the same, and say why."""

import pytest
from module.test_connection import connected

from tca_module.session.session import QUIET
from tca_wire.packets.headers import Beat, Send


@pytest.mark.parametrize("timeout", [0.0, 0.1, 0.2, 1.0, 5.0])
def test_a_wait_is_not_late_when_central_has_died(timeout: float) -> None:
    """Neither because what was asked can't be sent, nor because what is given up can't be said."""
    connection, central = connected()
    central.is_there = False
    for _ in range(3):
        began = central.now
        request = connection.request(Send(0, "stance"), wants_answer=True, is_awaited=True)
        assert not connection.wait(request, timeout, "query 'stance'")
        assert connection.silence.startswith("central at ipc://scripted has said nothing for ")
        connection.abandon(request)
        assert central.now == pytest.approx(began + timeout)


def test_a_central_that_answers_is_not_silent() -> None:
    connection, central = connected()
    assert not connection.silence
    central.now += QUIET
    assert connection.silence.startswith("central at ipc://scripted has said nothing for 2.5 s")
    central.say(Beat())
    connection.tend(central.now)
    assert not connection.silence
