"""The failures of a run: one list for all tools."""

from collections.abc import Iterator
from itertools import pairwise
from math import inf
from operator import attrgetter
from typing import NamedTuple

from tca_tools.journal.records import NO_FAILURE, Failure, Handling, Message
from tca_tools.journal.whole_run import Run
from tca_wire.vocabulary import CENTRAL, Outcome


class Failed(NamedTuple):
    """A message failed."""

    message: Message
    time: float
    failure: Failure
    until: float
    """When it failed again, or was begun anew (inf: neither)."""
    is_begun_anew: bool
    handling: Handling | None
    """The run of its handler that failed with it; None: it was raised beside that."""
    by: str
    """The module that raised it, or "central"; "" if the journal does not tell."""
    asker: Handling | None
    """The run of a handler that raised it."""


def all_failures(run: Run) -> list[Failed]:
    """Those of all messages, oldest first."""
    return sorted((one for message in run.messages.values() for one in failures_of(run, message)), key=_TIME)


def failures_of(run: Run, message: Message) -> Iterator[Failed]:
    """Those of one message, oldest first."""
    if not message.changes:
        return
    had = message.became("failure")
    failed = {one.end: one for one in message.handlings if one.outcome is Outcome.FAILED}
    raised = {(one.time, one.failure): one for one in run.raised.get(message.id, ())}
    for (time, failure), (until, after) in pairwise([*had, (inf, NO_FAILURE)]):
        if not failure:
            continue
        handling, beside = failed.get(time), raised.get((time, failure))
        by, asker = (beside.by, beside.asker) if beside else (CENTRAL, None)
        if handling and not beside and not handling.is_lost:
            by, asker = handling.module, handling
        yield Failed(message, time, failure, until, until < inf and not after, handling, by, asker)


_TIME = attrgetter("time")
