"""Descriptions of waits. Each kind of wait has words, and waits of one kind are joined."""

from collections.abc import Callable

import pytest

from tca_wire.points import Moment
from tca_wire.text.measures import counted, duration, listed, numbered, percent, run_time, times
from tca_wire.text.waits_in_words import in_words, several_in_words
from tca_wire.waits import WaitFor as Wait
from tca_wire.waits import WaitKind as Kind

WALK = Wait(Kind.RUNNING, 3, "walk")
STEP = Wait(Kind.RUNNING, 5, "step")
BUSY = (WALK, Wait(Kind.RUNNING, 4, "turn", more=2))


def test_wait_is_described_in_words(approve: Callable[..., None]) -> None:
    approve("waits_in_words.txt", lambda wait: in_words(eval(wait)))


def test_suspension_is_described_with_its_age() -> None:
    assert (
        in_words(Wait(Kind.RESUME, 2, "walk", seconds=3.0), 5.0)
        == "until walk {2} is resumed (suspended 2 s ago)"
    )
    wait = Wait(Kind.RESUME, module="panel", seconds=3.0)
    assert in_words(wait, 5.0) == "until it is resumed (suspended by panel 2 s ago)"


def test_every_wait_kind_has_words() -> None:
    for kind in Kind:
        assert in_words(Wait(kind, 1, "walk", module="arm"))


def test_waits_of_one_kind_are_joined_in_one_clause() -> None:
    end, planned = Moment.END_ACHIEVING, Moment.END_PLANNING
    waits = [
        *(Wait(Kind.CONSTRAINT, number, "bake", end) for number in range(1, 6)),
        Wait(Kind.CONSTRAINT, 9, "mix", planned),
        Wait(Kind.RESOURCE, module="oven", because=(WALK,)),
        Wait(Kind.CONSTRAINT, 9, "mix", planned),
    ]
    assert several_in_words(waits) == (
        "until bake {1}, bake {2}, bake {3} and 2 more are achieved, and until mix {9} is planned,"
        " and for oven, busy with walk {3}"
    )


def test_delay_is_described_as_remaining_time() -> None:
    assert in_words(Wait(Kind.DELAY, seconds=12.5), now=10.0) == "for another 2.5 s"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0 s"),
        (7.42e-4, "742 µs"),
        (9.996e-4, "1 ms"),
        (0.0123, "12.3 ms"),
        (0.32, "320 ms"),
        (1.5, "1.5 s"),
        (119.4, "119 s"),
        (119.6, "2:00 min"),
        (725, "12:05 min"),
        (119346, "33:09:06 h"),
    ],
)
def test_duration_is_written_with_a_fitting_unit(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_counts_and_lists_are_written_in_words() -> None:
    assert [counted(1, "task"), counted(105_061, "task")] == ["1 task", "105,061 tasks"]
    assert [times(1), times(2), times(1200)] == ["once", "twice", "1,200 times"]
    assert [listed(["a"]), listed(["a", "b"]), listed(["a", "b", "c"])] == [
        "a",
        "a and b",
        "a, b and c",
    ]
    assert listed(list("abcde"), 50) == "a, b, c and 52 more"
    assert [numbered("grip", 24), percent(0.041), run_time(1.5)] == ["grip {24}", "4.1%", "1.500 s"]
