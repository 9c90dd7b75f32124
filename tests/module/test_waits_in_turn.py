"""A handler waits again and again while central is away. It keeps its period, and gives up once."""

from collections.abc import Iterator

import pytest
from module.scripted_central import HELLO, ScriptedCentral, accept_all

from tca_module.errors import CentralLost
from tca_module.link.connection import Connection
from tca_module.session.session import Session
from tca_wire.packets.changes import ChangeState
from tca_wire.points import TaskId

PATIENCE, PERIOD = 10.0, 0.1


class Loop:
    """A handler's periodic work, on the clock of a scripted central."""

    def __init__(self) -> None:
        self.central = ScriptedCentral(accept_all)
        self.link = Connection(
            self.central, Session(HELLO), patience=PATIENCE, clock=lambda: self.central.now
        )
        self.link.open()
        self.due = self.central.now

    def turn(self, works: float = 0.0, *, reports: bool = False, waits: float = PERIOD) -> float:
        """Work, then wait until the next due time. Return by how much the wait ended late."""
        self.due = max(self.due, self.central.now + works) + waits
        self.central.now += works
        if reports:
            self.link.send_change(ChangeState(0, TaskId(7), "report", 1), b"", "a report")
        self.link.wait_until(lambda: False, "the wait", self.due)
        return self.central.now - self.due

    def turns(
        self, seconds: float, works: float = 0.0, *, reports: bool = False, waits: float = PERIOD
    ) -> Iterator[float]:
        """Take turns for a while."""
        until = self.central.now + seconds
        while self.central.now < until:
            yield self.turn(works, reports=reports, waits=waits)


@pytest.fixture
def loop() -> Loop:
    return Loop()


@pytest.mark.parametrize("reports", [False, True])
def test_period_is_kept_until_central_is_lost(loop: Loop, *, reports: bool) -> None:
    list(loop.turns(5.0, reports=reports))
    heard, loop.central.is_present, late = loop.link.session.heard, False, list[float]()
    with pytest.raises(CentralLost, match="does not answer"):
        late.extend(loop.turns(2 * PATIENCE, reports=reports))
    assert max(late) == pytest.approx(0)
    assert loop.central.now - heard <= PATIENCE + 3 * PERIOD


def test_always_late_loop_raises_central_lost(loop: Loop) -> None:
    loop.turn()
    loop.central.is_present = False
    with pytest.raises(CentralLost):
        list(loop.turns(2 * PATIENCE, works=0.3, waits=0.0))


def test_slow_loop_raises_central_lost(loop: Loop) -> None:
    loop.turn()
    loop.central.is_present = False
    with pytest.raises(CentralLost):
        list(loop.turns(5 * PATIENCE, works=4.0))


def test_cleanup_after_central_lost_has_patience_again(loop: Loop) -> None:
    loop.turn()
    loop.central.is_present = False
    with pytest.raises(CentralLost):
        list(loop.turns(2 * PATIENCE))
    list(loop.turns(PATIENCE - 2 * PERIOD))
    with pytest.raises(CentralLost):
        list(loop.turns(3 * PERIOD))


@pytest.mark.parametrize("works", [0.3, 20.0])
def test_present_central_is_never_lost(loop: Loop, works: float) -> None:
    loop.central.now += 29  # central had nothing to send
    assert loop.turn(works) == pytest.approx(0)
    assert max(loop.turns(8 * works + PATIENCE, works=works)) == pytest.approx(0)


def test_returning_central_is_not_lost(loop: Loop) -> None:
    for _ in range(3):
        loop.central.is_present = False
        list(loop.turns(PATIENCE / 2))
        loop.central.is_present = True
        assert max(loop.turns(PATIENCE / 2)) == pytest.approx(0)
