"""One event by the rules: each of its facts, and what must be so when all of them are known."""

from collections.abc import Callable
from operator import attrgetter
from typing import Any

from tca_tools.check import births, failing, handling, lives, moments, presence, taps
from tca_tools.check.records import MessageRecord
from tca_tools.check.world import JournalWorld
from tca_wire.journal import facts
from tca_wire.journal.takers import takers


def check_event(world: JournalWorld, entry: facts.Entry) -> None:
    """A whole event."""
    world.begin(entry)
    for fact in entry.facts:
        take_fact(world, fact)
    end_event(world)


def take_fact(world: JournalWorld, fact: facts.Fact) -> None:
    """The next fact of an event."""
    if take := _TAKE.get(type(fact)):
        take(world, fact)


def end_event(world: JournalWorld) -> None:
    """All facts of an event are known."""
    world.end()
    handling.check_places(world)
    moments.check_settled(world)


Take = Callable[[JournalWorld, Any], None]


def _of(
    find: Callable[[JournalWorld, int, str], MessageRecord | None],
    number: str,
    what: str,
    take: Callable[[JournalWorld, MessageRecord, Any], None],
) -> Take:
    """The handler for a fact about one message: *find* it by *number*, or report that *what*
    happened to none.
    """
    number_of = attrgetter(number)

    def take_if_known(world: JournalWorld, fact: Any) -> None:
        if (item := find(world, number_of(fact), what)) is not None:
            take(world, item, fact)

    return take_if_known


_ITEM, _TASK = JournalWorld.item, JournalWorld.task

_TAKE: dict[type, Take] = {
    **takers(presence, births, handling, moments, failing, taps),
    facts.TimedOut: _of(_TASK, "constraint.after.task", "got past a delay", births.timed_out),
    facts.Unqueued: _of(_ITEM, "id", "left a queue", handling.unqueued),
    facts.Returned: _of(_ITEM, "id", "was returned", handling.returned),
    facts.Answered: _of(_ITEM, "id", "was answered", handling.answered),
    facts.Awaited: _of(_ITEM, "id", "was waited for", handling.awaited),
    facts.Killed: _of(_TASK, "task", "was killed", failing.killed),
    facts.SuspendedOrResumed: _of(_TASK, "task", "was suspended or resumed", failing.suspended),
    facts.StateChanged: _of(_TASK, "task", "changed its state", lives.changed),
    facts.Caught: _of(_TASK, "task", "was caught", failing.caught),
    facts.Reissued: _of(_TASK, "handler", "reissued its failure", failing.reissued),
    facts.Resolved: _of(_TASK, "handler", "resolved its failure", failing.resolved),
    facts.NotResolved: _of(_ITEM, "task", "failed on", failing.not_resolved),
    facts.Unhandled: _of(_TASK, "task", "failed, unhandled,", failing.unhandled),
    facts.Recovered: _of(_ITEM, "task", "recovered", failing.recovered),
    facts.WaitedFor: _of(taps.monitor, "monitor", "was sent to be waited for", taps.waited_for),
    facts.OutlivesRetry: _of(_TASK, "monitor", "was spared", taps.spared),
    facts.MonitorTested: _of(taps.monitor, "monitor", "was tested", taps.tested),
    facts.MonitorEnded: _of(taps.monitor, "monitor", "ended", taps.monitor_ended),
}
"""By kind of fact that the rules are about."""
