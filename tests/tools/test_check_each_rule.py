"""Each rule of the checker with a minimal journal, whose last fact breaks that rule."""

from typing import Any

import pytest

from tca_tools.check import rules
from tca_tools.check.events import check_event
from tca_tools.check.world import JournalWorld
from tca_wire.constraints import Constraint
from tca_wire.journal.facts import (
    Caught,
    Claimed,
    Constrained,
    Delivered,
    Entry,
    Fact,
    Failed,
    FormatDefined,
    Granted,
    HandlerAdded,
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
from tca_wire.life_cycles import ROS_GOAL
from tca_wire.points import ROOT, Moment, Point, TaskId
from tca_wire.vocabulary import Condition, MessageClass, Outcome, Role

NIL = b"\xc0"
SH, EH = Moment.START_HANDLING, Moment.END_HANDLING
SP, EP = Moment.START_PLANNING, Moment.END_PLANNING
SA, EA = Moment.START_ACHIEVING, Moment.END_ACHIEVING


def born(
    number: int, *, parent: int = 0, kind: MessageClass = MessageClass.GOAL, **more: Any
) -> Received:
    sender, constraints = more.pop("sender", "user"), more.pop("constraints", [])
    return Received(
        number, f"m{number}", kind, sender, TaskId(parent), 0, False, NIL, constraints, **more
    )


def given(number: int, delivery: int = 0, module: str = "legs") -> Delivered:
    return Delivered(delivery or number, number, module, module)


def reached(number: int, *moments: Moment) -> Reached:
    return Reached(TaskId(number), sum(map(int, moments)))


def ended(number: int) -> Returned:
    return Returned(number, Outcome.DONE, NIL)


def after(one: int, moment: Moment, other: int, then: Moment, delay: float = 0) -> Constraint:
    return Constraint(Point(TaskId(one), moment), Point(TaskId(other), then), delay)


def broken(*events: Fact | float) -> set[str]:
    """Return the rules that the last fact breaks. Each fact is an event. A number sets a time."""
    world, now = JournalWorld([], is_whole=True), 0.0
    for number, one in enumerate(events):
        if isinstance(one, int | float):
            now = one
        else:
            world.violations.clear()
            check_event(world, Entry(number, now, [one]))
    return {violation.rule for violation in world.violations}


INFORM, COMMAND = MessageClass.INFORM, MessageClass.COMMAND
Events = list[Fact | float]
CHILD: Events = [born(1), given(1), reached(1, SH, SP), born(2, parent=1)]
TWO: Events = [born(1), born(2)]
FAILED: Events = [
    born(1),
    given(1),
    reached(1, SH, SP),
    Returned(1, Outcome.FAILED, NIL),
    Failed(1, "slipped", "ice"),
]
LOCKED: Events = [Claimed(9, "legs", "legs", False, "planner", 0), Granted(9)]
RESERVED: Events = [Claimed(9, "legs", "legs", True, "planner", 0), Granted(9)]

BROKEN: dict[str, tuple[Events, rules.Rule]] = {
    "child achieving before parent": (
        [*CHILD, reached(2, SA)], rules.FAMILY),
    "child planning before parent": (
        [born(1), born(2, parent=1), reached(2, SP)], rules.FAMILY),
    "parent planned before child": (
        [*CHILD, reached(1, EP)], rules.FAMILY),
    "parent achieved before child": (
        [*CHILD, reached(2, EP), reached(1, EA)], rules.FAMILY),
    "killed parent achieved before child": (
        [*CHILD, Killed(TaskId(1), "why"), reached(1, EA)], rules.FAMILY),
    "task ends before its handler": (
        [born(1), given(1), reached(1, SH, EH, SP, EP, SA, EA)], rules.ONE_HANDLER),
    "constraint": (
        [*TWO, Constrained([after(1, EA, 2, SA)]), reached(1, EP), reached(2, SA)], rules.CONSTRAINT),
    "constraint of the message": (
        [born(1), born(2, constraints=[after(1, EA, 2, SA)]), reached(2, SA)], rules.CONSTRAINT),
    "delay not begun": (
        [*TWO, Constrained([after(1, EA, 2, SA, 2.0)]), 9.0, reached(2, SA)], rules.CONSTRAINT),
    "delay not over": (
        [*TWO, Constrained([after(1, EA, 2, SA, 2.0)]), 1.0, reached(1, EA), 2.9, reached(2, SA)], rules.CONSTRAINT),
    "delay after a killed task": (
        [*TWO, Constrained([after(1, EA, 2, SA, 2.0)]), reached(1, SA), Killed(TaskId(1), "why"), reached(1, EA),
         reached(2, SA)], rules.CONSTRAINT),
    "delay from now not over": (
        [born(1, constraints=[after(ROOT, EA, 1, SA, 2.0)]), 1.5, reached(1, SA)], rules.CONSTRAINT),
    "delivery before its leader": (
        [*TWO, Constrained([after(1, EA, 2, SH)]), given(2)], rules.CONSTRAINT),
    "delivery before the listener": (
        [TapAdded(7, Condition.BEFORE_HANDLING, "m2", "m1", ROOT, "safety"), born(1), born(2, role=Role.LISTENER, about=1),
         TapFired(7, 1, 2), given(1)], rules.CONSTRAINT),
    "planning before the listener": (
        [TapAdded(7, Condition.BEFORE_PLANNING, "m2", "m1", ROOT, "safety"), born(1), born(2, role=Role.LISTENER, about=1),
         TapFired(7, 1, 2), reached(1, SP)], rules.CONSTRAINT),
    "achieving before the listener": (
        [TapAdded(7, Condition.BEFORE_ACHIEVING, "m2", "m1", ROOT, "safety"), born(1), born(2, role=Role.LISTENER, about=1),
         TapFired(7, 1, 2), reached(1, SA)], rules.CONSTRAINT),
    "delivery despite a lock": (
        [*LOCKED, born(1), given(1)], rules.LOCKED),
    "delivery to the lock holder": (
        [*LOCKED, born(1, sender="planner"), given(1)], rules.LOCKED),
    "delivery despite a reservation": (
        [*RESERVED, born(1), given(1)], rules.LOCKED),
    "second delivery of a message": (
        [born(1), given(1), given(1, delivery=3)], rules.ONE_HANDLER),
    "suspended task started": (
        [born(1), SuspendedOrResumed(TaskId(1), True), given(1)], rules.SUSPENDED),
    "descendant of a suspended task started": (
        [*CHILD, SuspendedOrResumed(TaskId(1), True), given(2)], rules.SUSPENDED),
    "new child of a suspended task started": (
        [born(1), SuspendedOrResumed(TaskId(1), True), born(2, parent=1), given(2)], rules.SUSPENDED),
    "killed task started": (
        [born(1), Killed(TaskId(1), "why"), given(1)], rules.KILLED),
    "second return of a delivery": (
        [born(1), given(1), ended(1), ended(1)], rules.RETURNED),
    "return of an unknown delivery": (
        [ended(5)], rules.KNOWN),
    "two messages in one slot": (
        [born(1), born(2), Delivered(1, 1, "legs", "legs", 1), Delivered(2, 2, "legs", "legs", 1)], rules.CAPACITY),
    "within a wait of another slot": (
        [born(1), born(2), Delivered(1, 1, "legs", "legs", 1), Delivered(2, 2, "legs", "legs", 2, is_nested=True)],
        rules.CAPACITY),
    "attempt in place of the fallback": (
        [*FAILED, Retried(TaskId(1), NIL, "central", failed=TaskId(1), fallback="m2"), given(1, delivery=3)], rules.REPLACED),
    "another message in place of the fallback": (
        [*FAILED, Retried(TaskId(1), NIL, "central", failed=TaskId(1), fallback="help"),
         born(2, parent=1, role=Role.EXCEPTION, about=1), Caught(TaskId(1), TaskId(2), TaskId(1), 0)], rules.REPLACED),
    "end that the life cycle lacks": (
        [FormatDefined("m1", MessageClass.GOAL, "", "", "legs", ROS_GOAL.text), born(1), given(1), reached(1, SH),
         Returned(1, Outcome.DONE, NIL, transition="skip")], rules.LIFE),
    "end in a state without one": (
        [FormatDefined("m1", MessageClass.GOAL, "", "", "legs", ROS_GOAL.text), HandlerAdded("m1", "legs", "legs", True),
         born(1), given(1), reached(1, SH), ended(1)], rules.LIFE),
    "return of a queued message": (
        [born(1, kind=INFORM), Queued(1, 1, "legs", "legs"), ended(1)], rules.RETURNED),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_breach_of_each_rule_is_found(case: str) -> None:
    events, rule = BROKEN[case]
    assert rule.text in broken(*events)
