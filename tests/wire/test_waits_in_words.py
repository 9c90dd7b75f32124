"""Each kind of wait has words, and several of one kind are told together."""

import pytest

from tca_wire.points import Moment
from tca_wire.text.measures import counted, duration, listed, numbered, percent, run_time, times
from tca_wire.text.waits_in_words import in_words, several_in_words
from tca_wire.waits import WaitFor as Wait
from tca_wire.waits import WaitKind as Kind

WALK = Wait(Kind.RUNNING, 3, "walk")
STEP = Wait(Kind.RUNNING, 5, "step")
BUSY = (WALK, Wait(Kind.RUNNING, 4, "turn", more=2))


@pytest.mark.parametrize(
    ("wait", "text"),
    [
        (Wait(Kind.CONSTRAINT, 4, "move leg", Moment.END_ACHIEVING), "until move leg {4} is achieved"),
        (Wait(Kind.CONSTRAINT, 4, "move leg", Moment.END_PLANNING, more=7), "until move leg {4} and 7 more are planned"),
        (
            Wait(Kind.CONSTRAINT, 4, "move leg", Moment.END_HANDLING, seconds=1.5),
            "until 1.5 s after move leg {4} has been handled",
        ),
        (Wait(Kind.PARENT, 2, "walk", Moment.START_ACHIEVING), "until its parent walk {2} is being achieved"),
        (Wait(Kind.DELAY, seconds=12.3), "until 12.300 s"),
        (
            Wait(Kind.LISTENER, 9, "check", Moment.END_ACHIEVING, module="legs"),
            "until check {9}, the listener of a wiretap by legs, is achieved",
        ),
        (Wait(Kind.SUBTASK, 4, "move leg"), "until move leg {4} has ended"),
        (Wait(Kind.RESOURCE, module="arm", resource="arm"), "for arm"),
        (Wait(Kind.RESOURCE, module="arm", resource="hand", because=BUSY), "for arm / hand, busy with walk {3}, turn {4} and 2 more"),
        (
            Wait(Kind.RESOURCE, module="arm", more=1, because=(Wait(Kind.LOCKED, name="lock", module="panel", because=(WALK,)),)),
            "for arm (or 1 more), which panel has locked while handling walk {3}",
        ),
        (
            Wait(Kind.RESOURCE, module="arm", because=(WALK, Wait(Kind.LOCK, name="reservation", module="panel"))),
            "for arm, busy with walk {3}, and which panel waits to reserve first",
        ),
        (Wait(Kind.RESOURCE, module="arm", because=(Wait(Kind.HANDLER),)), "for arm, which has no handler now"),
        (Wait(Kind.HANDLER, name="grip"), "for a module that handles grip"),
        (Wait(Kind.REPLY, 7, "next stance"), "for the reply to next stance {7}"),
        (
            Wait(Kind.REPLY, 7, "next stance", because=(Wait(Kind.HANDLER),)),
            "for the reply to next stance {7}, which no module handles",
        ),
        (
            Wait(Kind.REPLY, 7, "next stance", because=(Wait(Kind.RESOURCE, module="arm", because=(WALK,)),)),
            "for the reply to next stance {7}, which is queued for arm, busy with walk {3}",
        ),
        (
            Wait(Kind.REPLY, 7, "poll", answered=1, because=(
                Wait(Kind.RUNNING, module="arm"), Wait(Kind.RESOURCE, module="leg", because=(WALK,)))),
            "for the reply to poll {7}, which arm and leg (queued, busy with walk {3}) have not answered (1 of 3 has)",
        ),
        (
            Wait(Kind.REPLY, 7, "next stance", because=(
                Wait(Kind.RUNNING, module="arm", because=(Wait(Kind.TASK, 8, "grip", Moment.END_ACHIEVING),)),)),
            "for the reply to next stance {7}, which arm handles and waits until grip {8} is achieved",
        ),
        (
            Wait(Kind.LOCK, 8, "lock", module="legs", because=(Wait(Kind.LOCKED, module="panel"),)),
            "for the lock of legs {8}, which panel has locked",
        ),
        (Wait(Kind.RESUME, 2, "walk", module="panel"), "until walk {2}, suspended by panel, is resumed"),
        (Wait(Kind.RESUME, module="panel"), "until it is resumed (suspended by panel)"),
        (Wait(Kind.RECOVERY, 5, "recover"), "until recover {5} has dealt with its failure"),
        (Wait(Kind.RECOVERY), "until somebody has dealt with its failure"),
        (Wait(Kind.PRESENCE, name="grip"), "for a module that handles grip"),
        (Wait(Kind.CONDITION), "until it is fired"),
        (Wait(Kind.CONDITION, name="is hot"), "for its condition is hot, which has not been tested"),
        (Wait(Kind.CONDITION, name="is hot", holds=False), "for its condition is hot, which did not hold"),
        (WALK, "until the handler of walk {3} returns"),
        (
            Wait(Kind.RUNNING, because=(Wait(Kind.REPLY, 7, "next stance"),)),
            "until its handler returns, which waits for the reply to next stance {7}",
        ),
        (Wait(Kind.LOCKED, module="panel", resource="arm"), "until panel releases arm"),
        (Wait(Kind.CIRCLE, 7, "walk"), "for itself, by way of walk {7}"),
    ],
)  # fmt: skip
def test_a_wait_in_words(wait: Wait, text: str) -> None:
    assert in_words(wait) == text


def test_a_suspension_says_how_long_ago() -> None:
    assert in_words(Wait(Kind.RESUME, 2, "walk", seconds=3.0), 5.0) == "until walk {2}, suspended 2 s ago, is resumed"
    wait = Wait(Kind.RESUME, module="panel", seconds=3.0)
    assert in_words(wait, 5.0) == "until it is resumed (suspended by panel 2 s ago)"


def test_every_kind_has_words() -> None:
    for kind in Kind:
        assert in_words(Wait(kind, 1, "walk", module="arm"))


def test_waits_of_one_kind_and_moment_are_one_clause() -> None:
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


def test_a_delay_is_told_as_what_is_left_where_it_is_read_at_once() -> None:
    assert in_words(Wait(Kind.DELAY, seconds=12.5), now=10.0) == "for another 2.5 s"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0 s"), (7.42e-4, "742 µs"), (9.996e-4, "1 ms"), (0.0123, "12.3 ms"), (0.32, "320 ms"), (1.5, "1.5 s"),
        (119.4, "119 s"), (119.6, "2:00 min"), (725, "12:05 min"), (119346, "33:09:06 h"),
    ],
)  # fmt: skip
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_counts_and_lists() -> None:
    assert [counted(1, "task"), counted(105_061, "task")] == ["1 task", "105,061 tasks"]
    assert [times(1), times(2), times(1200)] == ["once", "twice", "1,200 times"]
    assert [listed(["a"]), listed(["a", "b"]), listed(["a", "b", "c"])] == ["a", "a and b", "a, b and c"]
    assert listed(list("abcde"), 50) == "a, b, c and 52 more"
    assert [numbered("grip", 24), percent(0.041), run_time(1.5)] == ["grip {24}", "4.1%", "1.500 s"]
