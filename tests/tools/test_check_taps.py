"""What ``tca check`` finds of wiretaps: a task goes on, and has not passed all that are there by then."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from central.player import Player
from central.transcript import Transcript
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import Life
from properties.test_late_taps import CheckedLife
from tools.runs import OPENED, checked

from tca_central.order.holds import Holds
from tca_central.requests import joining
from tca_central.watching import taps
from tca_tools.check import rules
from tca_wire.points import START_HANDLING

TRANSCRIPTS = Path(__file__).parent.parent / "central" / "transcripts"
Patch = pytest.MonkeyPatch


class PlayedLife(CheckedLife):
    """Such lives without the reference scheduler."""

    def __init__(self) -> None:
        self.timers = 0
        Life.__init__(self, Player(check=False))


@given(st.integers(0, 1 << 32))
@settings(max_examples=40)
def test_lives_full_of_wiretaps_that_come_late_keep_the_rules_from_wherever_the_journal_begins(seed: int) -> None:
    life = PlayedLife()
    life.go_on(seed, 200)
    assert checked([OPENED, *life.player.entries]) == []
    for start in (30, 120):
        assert checked(life.player.entries[start:]) == []


def what_waits_is_left_alone(patch: Patch) -> None:
    patch.setattr(taps, "_ask_waiting", lambda *_: None)


def what_was_passed_over_is_forgotten(patch: Patch) -> None:
    patch.setattr(joining, "listeners_come", lambda *_: None)


def what_is_handled_once_more_is_not_held(patch: Patch) -> None:
    hold = Holds.hold

    def hold_less(holds: Holds, leader: Any, at: int, task: Any, moment: int, delay: float = 0) -> None:
        if moment != START_HANDLING:
            hold(holds, leader, at, task, moment, delay)

    patch.setattr(Holds, "hold", hold_less)


@pytest.mark.parametrize(
    ("mistake", "transcript", "what"),
    [
        (what_waits_is_left_alone, "taps_that_come_late_hold_what_waits_for_a_slot",
         "move {3} went on, and wiretap {5} (check before handling) was not fired"),
        (what_waits_is_left_alone, "taps_that_come_late_on_what_is_locked_out_or_suspended",
         "move {2} went on, and wiretap {4} (check before handling) was not fired"),
        (what_was_passed_over_is_forgotten, "taps_whose_listener_is_handled_late",
         "move {2} went on, and wiretap {3} (check before handling) was passed over, though somebody handles it"),
        (what_is_handled_once_more_is_not_held, "taps_that_come_late_on_what_is_handled_once_more",
         "move {1} was given to a handler once more before end handling of check {3}"),
    ],
)  # fmt: skip
def test_what_goes_on_unchecked_is_found(
    monkeypatch: Patch, mistake: Callable[[Patch], None], transcript: str, what: str
) -> None:
    mistake(monkeypatch)
    played = Transcript()
    played.player.check = False
    blocks = (TRANSCRIPTS / f"{transcript}.txt").read_text().strip().split("\n\n")[1:]
    for command in blocks[0].split("\n----")[0].splitlines() + blocks[1].split("\n----")[0].splitlines():
        played.play(command)
    for block in blocks[2:]:
        for command in block.split("\n----")[0].splitlines():
            if command.startswith(("legs/1: reply", "module", "user: resume")):
                played.play(command)
    found = checked([OPENED, *played.player.entries])
    assert what in [one.what for one in found]
    assert {one.rule for one in found} == {rules.TAPPED.text}
