"""Losses that come in floods: a line a second for each thing, with how many."""

import logging

import pytest

from tca_central.shell.loss_log import LossLog, loss_in
from tca_wire.journal import facts
from tca_wire.vocabulary import Dropping, Refusal


def test_a_flood_is_a_line_a_second(caplog: pytest.LogCaptureFixture) -> None:
    log = LossLog(logging.getLogger("t"))
    for number in range(3000):
        log.note("dropped 'pose'", f"{number} wait", 1, number / 1000)
    log.note("dropped 'map'", "2 wait", 1, 3.0)
    log.tell(3.1)
    log.tell()
    assert caplog.messages == [
        "dropped 'pose': 0 wait",
        "dropped 'pose' 1,000 times: 1000 wait",
        "dropped 'pose' 1,000 times: 2000 wait",
        "dropped 'map': 2 wait",
        "dropped 'pose' 999 times: 2999 wait",
    ]


def test_nothing_is_told_twice_and_quiet_is_forgotten(caplog: pytest.LogCaptureFixture) -> None:
    log = LossLog(logging.getLogger("t"))
    log.note("dropped 'pose'", "10 wait", 1, 0.0)
    for time in (1.0, 2.0, 3.0):
        log.tell(time)
    log.note("dropped 'pose'", "10 wait", 1, 3.1)
    assert caplog.messages == ["dropped 'pose': 10 wait"] * 2


@pytest.mark.parametrize(
    ("fact", "loss"),
    [
        (facts.Dropped(7, "pose", "10 wait", dropping=Dropping.OVERLOAD), ("dropped 'pose'", "10 wait", 1)),
        (facts.Dropped(7, "pose", "a newer one", dropping=Dropping.DISPLACED), None),
        (facts.Dropped(7, "pose", "nobody listens"), None),
        (
            facts.LostDirectly("user", "pose", 9),
            ("module 'user' lost direct 'pose'", "its handler is too slow, left or died", 9),
        ),
        (facts.RequestRefused("user", Refusal.OVERLOAD, "10 wait"), ("refused module 'user'", "10 wait", 1)),
        (facts.RequestRefused("user", Refusal.CYCLE, "it waits for itself"), None),
    ],
)
def test_what_is_warned_of(fact: facts.Fact, loss: object) -> None:
    assert loss_in(fact) == loss
