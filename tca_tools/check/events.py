"""Check one event by the rules: each of its facts, then the state after all of them."""

from collections.abc import Callable
from operator import attrgetter
from typing import Any

from tca_tools.check import births, failing, handling, lives, moments, presence, taps
from tca_tools.check.records import MessageRecord
from tca_tools.check.world import JournalWorld
from tca_wire.journal import facts
from tca_wire.journal.takers import takers


def check_event(world: JournalWorld, entry: facts.Entry) -> None:
    """Check a whole event."""
    world.begin(entry)
    for fact in entry.facts:
        apply_fact(world, fact)
    finish_event(world)


def apply_fact(world: JournalWorld, fact: facts.Fact) -> None:
    """Check the next fact of an event."""
    if apply := _METHODS.get(type(fact)):
        apply(world, fact)


def finish_event(world: JournalWorld) -> None:
    """Check the state after all facts of an event."""
    world.end()
    handling.check_places(world)
    moments.check_settled(world)


Apply = Callable[[JournalWorld, Any], None]


def _with_message(
    find: Callable[[JournalWorld, int, str], MessageRecord | None],
    number: str,
    what: str,
    apply: Callable[[JournalWorld, MessageRecord, Any], None],
) -> Apply:
    """Return the function for a fact about one message, which is found by a number in the fact.

    Args:
        find: Returns the message, or reports an error.
        number: The attribute of the fact with the number.
        what: The event, as text for the error.
        apply: The function to call with the message.
    """
    number_of = attrgetter(number)

    def apply_if_known(world: JournalWorld, fact: Any) -> None:
        if (item := find(world, number_of(fact), what)) is not None:
            apply(world, item, fact)

    return apply_if_known


_ITEM, _TASK = JournalWorld.item, JournalWorld.task

_METHODS: dict[type, Apply] = {
    **takers(presence, births, handling, moments, failing, taps),
    facts.TimedOut: _with_message(
        _TASK, "constraint.after.task", "got past a delay", births.timed_out
    ),
    facts.Unqueued: _with_message(_ITEM, "id", "left a queue", handling.unqueued),
    facts.Postponed: _with_message(_ITEM, "id", "is replied to later", handling.postponed),
    facts.Returned: _with_message(_ITEM, "id", "was returned", handling.returned),
    facts.Answered: _with_message(_ITEM, "id", "was answered", handling.answered),
    facts.Awaited: _with_message(_ITEM, "id", "was waited for", handling.awaited),
    facts.Killed: _with_message(_TASK, "task", "was killed", failing.killed),
    facts.SuspendedOrResumed: _with_message(
        _TASK, "task", "was suspended or resumed", failing.suspended
    ),
    facts.StateChanged: _with_message(_TASK, "task", "changed its state", lives.changed),
    facts.Caught: _with_message(_TASK, "task", "was caught", failing.caught),
    facts.Reissued: _with_message(_TASK, "handler", "reissued its failure", failing.reissued),
    facts.Resolved: _with_message(_TASK, "handler", "resolved its failure", failing.resolved),
    facts.NotResolved: _with_message(_ITEM, "task", "failed on", failing.not_resolved),
    facts.Unhandled: _with_message(_TASK, "task", "failed, unhandled,", failing.unhandled),
    facts.Recovered: _with_message(_ITEM, "task", "recovered", failing.recovered),
    facts.WaitedFor: _with_message(
        taps.monitor, "monitor", "was sent to be waited for", taps.waited_for
    ),
    facts.OutlivesRetry: _with_message(_TASK, "monitor", "was spared", taps.outlives_retry),
    facts.MonitorTested: _with_message(taps.monitor, "monitor", "was tested", taps.tested),
    facts.MonitorEnded: _with_message(taps.monitor, "monitor", "ended", taps.monitor_ended),
}
"""The function for each kind of fact that the rules concern."""
