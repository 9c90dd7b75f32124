"""Checks in a journal that each visit to a state executed the state's activity anew."""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

from coordination.conditions import activities_seen

from tca_behaviours.coordination import Coordination
from tca_behaviours.coordination.model.states import DONE
from tca_wire.coordination import CoordinationReport, read_report
from tca_wire.journal.facts import Entry, StateChanged


class TimedReport(NamedTuple):
    """A report of a run, with its entry and time."""

    number: int
    """The number of the report's entry."""
    time: float
    report: CoordinationReport


def check_executions(machine: Coordination, entries: list[Entry]) -> int:
    """Check that each completed activity started for the visit that it completed.

    The earliest valid start is the last time at which the activity's state was left, or stopped
    being foreseen. Return the number of executions that started before the visit.
    """
    reports = list(_reports(entries))
    seen = [one for one in activities_seen(machine, entries) if one.entered is not None]
    ahead = 0
    for place, one in enumerate(reports):
        state = one.report.before
        if one.report.taken.split(" ")[0] != DONE or machine.states[state].activity is None:
            continue
        entered = max(
            (place for place, other in enumerate(reports[:place]) if other.report.taken), default=0
        )
        since = _last_left(reports[: entered + 1], state)
        own = [
            began
            for execution in seen
            if execution.state == state and execution.ended <= one.number
            if (began := entries[execution.began].time) >= since
        ]
        assert own, (
            f"{machine.states[state]!r} is left at {one.time:g} s, and nothing was done for it since {since:g} s"
        )
        ahead += own[-1] < reports[entered].time
    return ahead


def _last_left(reports: list[TimedReport], state: int) -> float:
    """Return the time of the last transition, before a state was entered, that left the state or
    made it unforeseen.
    """
    found = 0.0
    for one, following in pairwise(reports):
        is_rest = not (
            following.time == one.time and following.report.taken
        )  # no other report has a preview
        is_foreseen = any(foreseen.state == state for foreseen in one.report.preview)
        is_off = is_rest and not is_foreseen and one.report.current != state
        if one.report.taken and (one.report.before == state or is_off):
            found = one.time
    return found


def _reports(entries: list[Entry]) -> Iterator[TimedReport]:
    for number, entry in enumerate(entries):
        for fact in entry.facts:
            if isinstance(fact, StateChanged) and (report := read_report(fact.body)):
                yield TimedReport(number, entry.time, report)
