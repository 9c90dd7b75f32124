"""The rules of moments and wiretaps, as tables.

Central applies these rules. The tools use them to explain and check runs.

Theory of operation (TCA 8.5 and TCM: intra-node rules). A goal's handling and planning start
together, as soon as planning may start. Its achievement may still be held back then: this is
planning ahead. A command has no planning: its planning interval is over when it is created. Its
handling and achieving start together. Both kinds of task end achieving last.

    goal      start handling = start planning ─► start achieving ─────────────► end achieving
                     └─► end handling ─► end planning ─────────────────────────────┘
    command   start handling = start achieving ─► end handling ─► end achieving
"""

from typing import NamedTuple

from tca_wire.points import (
    END_ACHIEVING,
    END_HANDLING,
    END_PLANNING,
    MOMENTS,
    START_ACHIEVING,
    START_HANDLING,
    START_PLANNING,
)
from tca_wire.vocabulary import Condition, MessageClass

# --- moments of one task --------------------------------------------------------------------------


Order = tuple[tuple[int, int], ...]


class TaskRules(NamedTuple):
    """The moments of a task: one set of rules for goals, one for all other tasks."""

    at_birth: int
    """The moments that a task has reached when it is created."""
    delivery: int
    """The moments that it reaches together when a handler gets it."""
    order: Order
    """Pairs of a moment and the moments directly before it."""
    up_to: dict[int, int]
    """By moment: all moments up to it, itself included, as bits; 0 if it is reached at creation."""


def _rules(*, at_birth: int, delivery: int, order: Order) -> TaskRules:
    """Build the rules; ``up_to`` follows from the others."""

    def moments_up_to(moment: int) -> int:
        if moment & at_birth:
            return 0
        found = moment | (delivery if moment & delivery else 0)
        for later, earlier in reversed(order):
            if found & later:
                found |= earlier
        return found | (delivery if found & START_HANDLING else 0)

    up_to = {moment: moments_up_to(moment) for moment in map(int, MOMENTS)}
    return TaskRules(at_birth, delivery, order, up_to)


GOAL = _rules(
    at_birth=0,
    delivery=START_HANDLING | START_PLANNING,
    order=(
        (START_ACHIEVING, START_HANDLING),
        (END_HANDLING, START_HANDLING),
        (END_PLANNING, END_HANDLING),
        (END_ACHIEVING, START_ACHIEVING | END_PLANNING),
    ),
)
NO_GOAL = _rules(
    at_birth=START_PLANNING | END_PLANNING,
    delivery=START_HANDLING | START_ACHIEVING,
    order=(
        (END_HANDLING, START_HANDLING),
        (END_ACHIEVING, END_HANDLING),
    ),
)


RULES = (NO_GOAL, GOAL)
"""The rules of a task, by whether it is a goal: ``RULES[task.is_goal]``."""


# --- parents and children -------------------------------------------------------------------------

PARENT_FIRST = START_PLANNING | START_ACHIEVING
"""The moments that a task reaches only after its parent has reached the same moment.

Messages that central makes (with a role) are exempt.
"""


# --- wiretaps -------------------------------------------------------------------------------------

DELIVERED, RETURNED, SENT, SUCCESS, FAILURE, REPLIED, KILLED = (64 << i for i in range(7))
"""Events of a message beside its moments, as further bits: wiretaps may fire at them."""

_ANY = frozenset(MessageClass)
_REPLIES = frozenset(one for one in MessageClass if one.has_reply)
_TASKS = frozenset(one for one in MessageClass if one.is_task)
_HANDLED = frozenset(one for one in _TASKS if not one.is_monitor)
_GOALS = frozenset(one for one in _TASKS if one.is_goal)


class TapRule(NamedTuple):
    """The meaning of a wiretap's condition."""

    classes: frozenset[MessageClass]
    """The message classes that can be tapped with this condition."""
    held_moment: int = 0
    """The moment of the tapped task before which the listener is sent (0: none)."""
    at: int = 0
    """The event at which the listener is sent: a moment, or an event such as ``SENT``."""
    holds_until: int = 0
    """The moment of the listener until which *held_moment* stays held (0: none)."""
    is_child: bool = False
    """The listener is a child of the tapped task: it fails and is killed like other children."""
    lasts_until: int = 0
    """The moment of the tapped task at which its listeners end."""

    @property
    def is_before_end(self) -> bool:
        """Whether the listener is sent before the tapped task ends.

        A listener that is a polling or demon monitor becomes a child of the tapped task. That task
        must therefore still live.
        """
        return self.is_child or bool(self.lasts_until) or self.at == SENT


CONDITIONS = {
    Condition.WHEN_SENT: TapRule(_ANY, at=SENT),
    Condition.BEFORE_HANDLING: TapRule(
        _ANY, held_moment=START_HANDLING, holds_until=END_HANDLING, is_child=True
    ),
    Condition.WHILE_HANDLING: TapRule(_ANY, at=DELIVERED, lasts_until=END_HANDLING),
    Condition.AFTER_HANDLED: TapRule(_ANY, at=RETURNED),
    Condition.AFTER_REPLIED: TapRule(_REPLIES, at=REPLIED),
    Condition.AFTER_SUCCESS: TapRule(_HANDLED, at=SUCCESS),
    Condition.AFTER_FAILURE: TapRule(_HANDLED, at=FAILURE),
    Condition.WHEN_SUCCESS: TapRule(_HANDLED, at=SUCCESS, is_child=True),
    Condition.WHEN_FAILURE: TapRule(_HANDLED, at=FAILURE, is_child=True),
    Condition.BEFORE_PLANNING: TapRule(
        _GOALS, held_moment=START_PLANNING, holds_until=END_PLANNING, is_child=True
    ),
    Condition.WHILE_PLANNING: TapRule(_GOALS, at=START_PLANNING, lasts_until=END_PLANNING),
    Condition.AFTER_PLANNED: TapRule(_GOALS, at=END_PLANNING),
    Condition.WHEN_PLANNED: TapRule(_GOALS, held_moment=END_PLANNING, is_child=True),
    Condition.BEFORE_ACHIEVING: TapRule(
        _TASKS, held_moment=START_ACHIEVING, holds_until=END_ACHIEVING, is_child=True
    ),
    Condition.WHILE_ACHIEVING: TapRule(_TASKS, at=START_ACHIEVING, lasts_until=END_ACHIEVING),
    Condition.AFTER_ACHIEVED: TapRule(_TASKS, at=END_ACHIEVING),
    Condition.WHEN_ACHIEVED: TapRule(_TASKS, held_moment=END_ACHIEVING, is_child=True),
    Condition.WHEN_KILLED: TapRule(_TASKS, at=KILLED),
}
"""One row per condition.

A condition that holds an end, such as WHEN_PLANNED, needs no ``holds_until``. Its listener is a
child of the tapped task, and a task ends only after its children.
"""

LISTENERS = frozenset(one for one in MessageClass if one.may_react or one.is_monitor)
"""The classes of messages that a wiretap may send."""


def recurs_on_retry(condition: Condition) -> bool:
    """Whether a condition is met again each time that the tapped task is retried."""
    rule = CONDITIONS[condition]
    return bool(
        (rule.held_moment | rule.at) & (START_HANDLING | DELIVERED | RETURNED | SUCCESS | FAILURE)
    )
