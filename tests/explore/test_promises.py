"""Each promise of central's by itself: from facts that keep it, and from facts that do not."""

from typing import Any

import pytest

from tca_tools.explore.observed.fold import Fold
from tca_wire.constraints import Constraint
from tca_wire.journal.facts import (
    Claimed,
    ClaimEnded,
    Constrained,
    Delivered,
    Fact,
    Granted,
    Killed,
    Queued,
    Reached,
    Received,
    Retried,
    Returned,
    SuspendedOrResumed,
    TapAdded,
    TapFired,
)
from tca_wire.points import ALL_MOMENTS, ROOT, Moment, Point, TaskId
from tca_wire.vocabulary import Condition, MessageClass, Outcome, Role

NIL = b"\xc0"
SH, EH = Moment.START_HANDLING, Moment.END_HANDLING
SP, EP = Moment.START_PLANNING, Moment.END_PLANNING
SA, EA = Moment.START_ACHIEVING, Moment.END_ACHIEVING


def born(number: int, *, parent: int = 0, kind: MessageClass = MessageClass.GOAL, **more: Any) -> Received:
    sender, constraints = more.pop("sender", "user"), more.pop("constraints", [])
    return Received(number, f"m{number}", kind, sender, TaskId(parent), 0, False, NIL, constraints, **more)


def given(number: int, delivery: int = 0, module: str = "legs") -> Delivered:
    return Delivered(delivery or number, number, module, module)


def reached(number: int, *moments: Moment) -> Reached:
    return Reached(TaskId(number), sum(map(int, moments)))


def ended(number: int) -> Returned:
    return Returned(number, Outcome.DONE, NIL)


def after(one: int, moment: Moment, other: int, then: Moment, delay: float = 0) -> Constraint:
    return Constraint(Point(TaskId(one), moment), Point(TaskId(other), then), delay)


def broken(*told: Fact | float) -> str:
    """What those facts, of one action, are against; a number is a time that has passed then."""
    fold = Fold()
    for one in told:
        if isinstance(one, int | float):
            fold.now = one
        else:
            fold.take([one])
    return fold.broken


INFORM, COMMAND = MessageClass.INFORM, MessageClass.COMMAND
Told = list[Fact | float]
CHILD: Told = [born(1), given(1), reached(1, SH, SP), born(2, parent=1)]
TWO: Told = [born(1), born(2)]
LOCKED: Told = [Claimed(9, "legs", "legs", False, "planner", 0), Granted(9)]
RESERVED: Told = [Claimed(9, "legs", "legs", True, "planner", 0), Granted(9)]

KEPT: dict[str, Told] = {
    "a child starts after its parent": [*CHILD, reached(1, SA), reached(2, SP, SA)],
    "an exception handler starts while its parent has not": [
        born(1), born(2, parent=1, kind=MessageClass.EXCEPTION, role=Role.EXCEPTION, about=1), reached(2, SP, SA),
    ],
    "a parent ends after its child": [*CHILD, reached(2, EP, EA), reached(1, EP, EA)],
    "a command does not wait for what was sent under it": [
        born(1, kind=COMMAND), born(2, parent=1, kind=COMMAND), reached(1, EP, EA)
    ],
    "what is killed needs no order": [
        *TWO, Constrained([after(1, EA, 2, SA)]), Killed(TaskId(2), "why"), reached(2, SA),
    ],
    "a constraint": [*TWO, Constrained([after(1, EA, 2, SA)]), reached(1, EA), reached(2, SA)],
    "a constraint that came with the message": [
        born(1), born(2, constraints=[after(1, EA, 2, SA)]), reached(1, EA), reached(2, SA)
    ],
    "another moment is not constrained": [*TWO, Constrained([after(1, EA, 2, SA)]), reached(2, SP)],
    "a delay": [*TWO, Constrained([after(1, EA, 2, SA, 2.0)]), 1.0, reached(1, EA), 3.0, reached(2, SA)],
    "a delay after what was killed before it began": [
        *TWO, Constrained([after(1, EA, 2, SA, 2.0)]), Killed(TaskId(1), "why"), reached(1, SA, EA), reached(2, SA),
    ],
    "a delay from now": [born(1, constraints=[after(ROOT, EA, 1, SA, 2.0)]), 2.0, reached(1, SA)],
    "a moment before one whose delay has not begun": [*TWO, Constrained([after(1, EA, 2, SA, 2.0)]), reached(2, SP)],
    "another moment is not delayed": [born(1, constraints=[after(ROOT, EA, 1, SA, 2.0)]), reached(1, SP)],
    "what has ended is past": [
        *TWO, Constrained([after(1, EA, 2, SA)]), Constrained([after(1, EP, 2, SP)]),
        reached(1, *(moment for moment in Moment if moment & ALL_MOMENTS)), reached(2, SA, SP),
    ],
    "a wiretap's listener comes first": [
        TapAdded(7, Condition.BEFORE_HANDLING, "m2", "m1", ROOT, "safety"), born(1), born(2, role=Role.LISTENER, about=1),
        TapFired(7, 1, 2), reached(2, EH), given(1),
    ],
    "the owner's, and those of the module itself, come into what he reserved": [
        *RESERVED, born(1, sender="planner", kind=INFORM), given(1), ended(1), born(2, sender="legs", kind=INFORM), given(2)
    ],
    "a lock that has ended": [*LOCKED, ClaimEnded(9, "why"), born(1), given(1)],
    "a lock of another resource": [*LOCKED, born(1), given(1, module="arm")],
    "a lock that is only wanted": [LOCKED[0], born(1), given(1)],
    "a retried task is given to a handler again": [
        born(1), given(1), ended(1), Retried(TaskId(1), b"", "user"), given(1, delivery=3), ended(3)
    ],
    "what is resumed": [
        born(1), SuspendedOrResumed(TaskId(1), True), SuspendedOrResumed(TaskId(1), False), given(1)
    ],
    "what leaves things safe goes on while all else is suspended": [
        born(1), SuspendedOrResumed(TaskId(1), True), born(2, parent=1, role=Role.TERMINATION), given(2)
    ],
}  # fmt: skip

BROKEN: dict[str, tuple[Told, str]] = {
    "a child's achieving starts before its parent's": (
        [*CHILD, reached(2, SA)], "start achieving 2 ('m2') came before the start of m1 {1}"),
    "a child's planning starts before its parent's": (
        [born(1), born(2, parent=1), reached(2, SP)], "start planning 2 ('m2') came before the start of m1 {1}"),
    "a parent's planning ends before its child's": (
        [*CHILD, reached(1, EP)], "end planning 1 ('m1') came before the end of m2 {2}"),
    "a parent's achieving ends before its child's": (
        [*CHILD, reached(2, EP), reached(1, EA)], "end achieving 1 ('m1') came before the end of m2 {2}"),
    "also where the parent was killed": (
        [*CHILD, Killed(TaskId(1), "why"), reached(1, EA)], "end achieving 1 ('m1') came before the end of m2 {2}"),
    "a task ends before its handler": (
        [born(1), given(1), reached(1, SH, EH, SP, EP, SA, EA)], "came before the end of its handler"),
    "a constraint": (
        [*TWO, Constrained([after(1, EA, 2, SA)]), reached(1, EP), reached(2, SA)],
        "start achieving 2 ('m2') came before end achieving 1"),
    "a constraint that came with the message": (
        [born(1), born(2, constraints=[after(1, EA, 2, SA)]), reached(2, SA)], "came before end achieving 1"),
    "a delay that has not begun": (
        [*TWO, Constrained([after(1, EA, 2, SA, 2.0)]), 9.0, reached(2, SA)], "came before end achieving 1"),
    "a delay that is not over": (
        [*TWO, Constrained([after(1, EA, 2, SA, 2.0)]), 1.0, reached(1, EA), 2.9, reached(2, SA)],
        "came before 0.1 s were over"),
    "a delay after what was killed when it had begun": (
        [*TWO, Constrained([after(1, EA, 2, SA, 2.0)]), reached(1, SA), Killed(TaskId(1), "why"), reached(1, EA),
         reached(2, SA)], "came before 2 s were over"),
    "a delay from now that is not over": (
        [born(1, constraints=[after(ROOT, EA, 1, SA, 2.0)]), 1.5, reached(1, SA)], "came before 0.5 s were over"),
    "a handler comes before what its handling comes after": (
        [*TWO, Constrained([after(1, EA, 2, SH)]), given(2)], "m2 {2} was given to a handler before end achieving 1"),
    "a wiretap's listener is not waited for": (
        [TapAdded(7, Condition.BEFORE_HANDLING, "m2", "m1", ROOT, "safety"), born(1), born(2, role=Role.LISTENER, about=1),
         TapFired(7, 1, 2), given(1)], "m1 {1} was given to a handler before end handling 2"),
    "nor before the planning": (
        [TapAdded(7, Condition.BEFORE_PLANNING, "m2", "m1", ROOT, "safety"), born(1), born(2, role=Role.LISTENER, about=1),
         TapFired(7, 1, 2), reached(1, SP)], "start planning 1 ('m1') came before end planning 2"),
    "nor before the achieving": (
        [TapAdded(7, Condition.BEFORE_ACHIEVING, "m2", "m1", ROOT, "safety"), born(1), born(2, role=Role.LISTENER, about=1),
         TapFired(7, 1, 2), reached(1, SA)], "start achieving 1 ('m1') came before end achieving 2"),
    "somebody gets in where others have locked": (
        [*LOCKED, born(1), given(1)], "m1 {1} was given to 'legs' while planner has it locked"),
    "also he who has locked": (
        [*LOCKED, born(1, sender="planner"), given(1)], "while planner has it locked"),
    "somebody gets in where others have reserved": (
        [*RESERVED, born(1), given(1)], "m1 {1} was given to 'legs' while planner has it reserved"),
    "somebody gets a message twice": (
        [born(1), given(1), given(1, delivery=3)], "m1 {1} was given to a handler while one has it"),
    "what is suspended is started": (
        [born(1), SuspendedOrResumed(TaskId(1), True), given(1)],
        "m1 {1} was given to a handler though it is suspended"),
    "what is under what is suspended is started": (
        [*CHILD, SuspendedOrResumed(TaskId(1), True), given(2)], "m2 {2} was given to a handler though it is suspended"),
    "what is sent under what is suspended is started": (
        [born(1), SuspendedOrResumed(TaskId(1), True), born(2, parent=1), given(2)], "though it is suspended"),
    "what was killed is started": (
        [born(1), Killed(TaskId(1), "why"), given(1)], "m1 {1} was given to a handler though it is killed"),
    "a handler ends twice": (
        [born(1), given(1), ended(1), ended(1)], "a handler of m1 {1} ended, and none had it"),
    "a handler ends of what there is not": ([ended(5)], "a handler of 5 ended, and none had it"),
    "a handler ends of what only waits": (
        [born(1, kind=INFORM), Queued(1, 1, "legs", "legs"), ended(1)], "a handler of m1 {1} ended, and none had it"),
}  # fmt: skip


@pytest.mark.parametrize("promise", KEPT)
def test_a_promise_that_is_kept(promise: str) -> None:
    assert broken(*KEPT[promise]) == ""


@pytest.mark.parametrize("promise", BROKEN)
def test_a_promise_that_is_not_kept(promise: str) -> None:
    told, words = BROKEN[promise]
    assert words in broken(*told).replace("task ", "")


def test_the_first_that_is_broken_is_told() -> None:
    twice = broken(*LOCKED, born(1), given(1), given(1, delivery=3))
    assert "has it locked" in twice


def test_what_was_broken_is_told_once() -> None:
    fold = Fold()
    fold.take([Claimed(9, "legs", "legs", False, "planner", 0), Granted(9), born(1), given(1)])
    assert fold.broken
    fold.forget_what_is_over()
    assert not fold.broken
