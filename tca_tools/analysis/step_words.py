"""The steps of a path in words: the place of each, and why it did not start sooner. Pure."""

from collections.abc import Iterator
from math import nextafter

from tca_tools.analysis.long_waits import handler_wait_in_words
from tca_tools.analysis.steps import Doing, PathStep
from tca_tools.explain.graph import Ends, waits_now
from tca_tools.explain.wait_words import last_of, named_waits
from tca_tools.explain.waits import Wait, waits_of
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.records import Message, Queueing, Task
from tca_tools.journal.whole_run import UNKNOWN, Run
from tca_wire.text.facts_in_words import kill_reason, place
from tca_wire.text.measures import duration, run_time
from tca_wire.text.waits_in_words import several_in_words
from tca_wire.waits import WaitKind

_MOST_TASKS = 6
"""The most tasks in a chain of waits that a text names."""
_STANDSTILLS = {Doing.CIRCLE, Doing.DELAY, Doing.SUSPENDED, Doing.QUEUED, Doing.HELD, Doing.LOCKED}
"""Kinds of steps in which nothing ran."""


def named(run: Run, number: int) -> str:
    """Return the name of a message or lock without its number."""
    name = run.name(number)
    return "a message from before the journal" if name == UNKNOWN else name


def queueing_before(run: Run, step: PathStep) -> Queueing | None:
    """Return the wait in a queue that ended when a step started."""
    message = run.messages.get(step.message_id)
    if message is None or step.resumed or step.doing is not Doing.WORK:
        return None
    for one in reversed(message.queueings):
        if one.end == step.start and one.start < step.start:
            return one
    return None


def wait_in_words(run: Run, step: PathStep) -> str:
    """Return the wait before a step: ``the handler of walk {1} waited until ... is achieved``."""
    who = run.describe(step.message_id)
    if step.resumed is None:
        return f"{who} waited"
    who = step.module if step.doing is Doing.OUTSIDE else f"the handler of {who}"
    return f"{who} waited {handler_wait_in_words(run, step.resumed)}"


def why_not_sooner(run: Run, step: PathStep) -> str:
    """Return why a step did not start sooner, or why it is a standstill; "" if that is unknown."""
    message = run.messages.get(step.message_id)
    if message and step.doing in _STANDSTILLS and (why := _standstill_in_words(run, message, step)):
        return why
    if step.resumed:
        who = "sender" if step.doing is Doing.OUTSIDE else "handler"
        still = still_handled(run, step.resumed.awaited, step.start)
        return f"its {who} waited {handler_wait_in_words(run, step.resumed)}{still}"
    if message is None:
        return ""
    if queueing := queueing_before(run, step):
        where = "without a module that handles it"
        if queueing.module:
            where = f"in the queue for {place(queueing.module, queueing.resource)}"
        still = still_handled(run, message.id, step.start)
        return f"{duration(step.start - queueing.start)} {where}{still}"
    # central sends its own messages as soon as it can
    is_made = message.received == step.start and message.role
    about = run.messages.get(message.about) if is_made else message
    held = ""
    if isinstance(about, Task) and (not is_made or about.received < step.start):
        held = "; ".join(_cause_chain(run, about, step.start))
    if is_made:
        which = f", which {held}" if held else ""
        return f"{message.role} for {run.describe(message.about)}{which}"
    return f"it {held}" if held else ""


def _cause_chain(run: Run, task: Task, time: float) -> Iterator[str]:
    """Yield, in words, the waits of a task that ended at a time.

    Then yield the waits of the awaited task that ended at the same time, and so on. For example
    ``waited until walk {2} is achieved``, ``walk {2} was killed: ...``.
    """
    waits, seen = _ended_at(run, task, time), {task.id}
    if waits:
        yield f"waited {_in_words(run, waits, time)}"
    while waits and len(seen) <= _MOST_TASKS:
        awaited = (run.tasks.get(one.on.number) for one in waits)
        task = next((one for one in awaited if one is not None), task)
        if task.id in seen:
            return
        seen.add(task.id)
        if task.killed is not None and task.written_at("killed") == time:
            yield f"{task} was killed: {kill_reason(task.killed, task.killed_by)}"
            return
        if waits := _ended_at(run, task, time):
            yield f"{task} waited {_in_words(run, waits, time)}"


def _ended_at(run: Run, task: Task, time: float) -> list[Wait]:
    """Return the waits of a task that ended at a time, except for its handler and its subtasks: a
    path passes through those anyway.
    """
    ended = (wait for wait in waits_of(run, task.id) if wait.start < time == wait.end)
    return [wait for wait in ended if wait.kind not in (WaitKind.RUNNING, WaitKind.SUBTASK)]


def _in_words(run: Run, waits: list[Wait], time: float) -> str:
    """Return waits in words, as known just before a time."""
    return several_in_words(named_waits(RunAt(run, nextafter(time, 0.0)), waits))


def still_handled(run: Run, message_id: int, until: float) -> str:
    """Return a remark on a handler that still handled a query after its sender gave up.

    The handler is that of the message, or another one in the resource for which the message was
    queued.
    For example ``; look {8} was given up at 7.000 s, but cam handled it until 9.000 s``; "" if no
    handler did.
    """
    if (message := run.messages.get(message_id)) is None:
        return ""
    at = RunAt(run, nextafter(until, 0.0))
    copies, queueings = at.copies_of(message)
    handlings = [*copies, at.handling_of(message)]
    for queueing in (at.queueing_of(message), *queueings):
        if queueing is not None and queueing.module:
            handlings += at.running(queueing.module, queueing.resource)
    for handling in filter(None, handlings):
        handled = run.messages.get(handling.message_id)
        if handled is None or not handled.was_given_up:
            continue
        given_up = handled.written_at("dropped")
        if given_up <= until and handling.until > given_up:
            where, still = place(handling.module, handling.resource), "still handles it"
            if handling.end is not None:
                still = f"handled it until {run_time(handling.end)}"
            return f"; {handled} was given up at {run_time(given_up)}, but {where} {still}"
    return ""


def _standstill_in_words(run: Run, message: Message, step: PathStep) -> str:
    """Return the wait at the end of a step, in words."""
    at = RunAt(run, nextafter(step.end, 0.0))
    if step.doing is Doing.CIRCLE:
        return f"it waits {last_of(at, Ends.at(at).of(message.id)[0])}"
    words = several_in_words(named_waits(at, waits_now(at, message.id)))
    return f"it waits {words}{still_handled(run, message.id, step.end)}" if words else ""
