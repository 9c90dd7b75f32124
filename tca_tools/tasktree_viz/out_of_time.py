"""The causes of a passed deadline: the things waited for, their holders, and the time spent suspended. Pure."""

from collections.abc import Iterator
from math import nextafter

from tca_tools.explain.ends import Ends
from tca_tools.explain.wait_words import age_of, how, in_the_end, shown, told_now
from tca_tools.journal.at_time import RunAt, TaskAt
from tca_tools.journal.records import Failure, Message
from tca_tools.journal.whole_run import Run
from tca_wire.messages.failures import TIMEOUT
from tca_wire.points import TaskId
from tca_wire.text.facts_in_words import by_whom, place
from tca_wire.text.measures import duration
from tca_wire.text.waits_in_words import several_in_words
from tca_wire.waits import NAMED, WaitKind

_FAR = 500
"""Waits: what a task that ran out of time waited for beyond so many is not looked for."""


def out_of_time(run: Run, message: Message, failed: float, failure: Failure) -> Iterator[tuple[float, bool, str]]:
    """The causes of a passed deadline: since when, whether of something else, and in words; empty if unknown."""
    deadlines = [one.set_at for one in run.ahead.get(message.id, ()) if one.moment is not None]
    at = RunAt(run, nextafter(failed, 0.0))
    task = at.tasks.get(TaskId(message.id))
    if not deadlines or failure.name != TIMEOUT or task is None or task.watches:
        return
    for one in run.tasks[task.id].suspensions[-NAMED:]:
        if one.start >= deadlines[0] and one.end is not None and one.end < failed:
            how_long = duration(one.end - one.start)
            yield one.start, False, f"{task} was suspended{by_whom(one.by)}, for {how_long}"
    if age := age_of(waits := shown(at, task)):
        end, told = in_the_end(at, task, _FAR), several_in_words(told_now(at, task, waits))
        how_long = f", for {duration(failed - age.since)}" + (f"; in the end {end}" if end else "")
        yield age.since, False, f"{task} {how(task, verb='waited')} {told}{how_long}"
    yield from _had_by(at, task, failed)


def _had_by(at: RunAt, task: TaskAt, failed: float) -> Iterator[tuple[float, bool, str]]:
    """The handlers and lock holders of whatever the task waited for in the end when its time ran out."""
    ends = Ends.at(at).of(task.id, _FAR)
    for number in [end.number for end in ends if end.kind is WaitKind.RUNNING or end.number in at.run.claims][:NAMED]:
        claim, message = at.run.claims.get(number), at.run.messages.get(number)
        if claim is not None and claim.granted is not None and at.is_granted(claim):
            since, what = claim.granted, f"{claim.sender} had the {claim}"
        elif message is None or message.message_class.asks_many:
            continue
        elif (run := at.handling_of(message)) is not None:
            since, what = run.start, f"{message} was being handled by {place(run.module, run.resource)}"
        else:
            continue
        how_long = duration(failed - since)
        yield since, number != task.id, f"{what}, for {how_long} when time ran out"
