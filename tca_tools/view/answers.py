"""What a page asks for as it is needed: one task, notes on those in sight, messages around a moment. As plain data."""

from dataclasses import asdict
from itertools import groupby
from operator import attrgetter
from typing import Any

import msgspec

from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.fates import Fate, coped_with, fate, told_to
from tca_tools.run.records import Failure, Hold, Message, Task
from tca_tools.run.whole_run import Run
from tca_tools.tasktree_viz.failing import failure_chain
from tca_tools.tasktree_viz.words import failure_line, span
from tca_tools.view.reading import Reading
from tca_tools.why.ends import Cause, causes
from tca_tools.why.story import Sentence, story
from tca_tools.why.wait_words import Age, Last, age_of, asked, coming, how, in_the_end, last_of, shown, told_now
from tca_tools.why.waits import Wait, held_above
from tca_wire.journal.facts import kind_of
from tca_wire.points import Interval, TaskId
from tca_wire.text.bodies import data_text
from tca_wire.text.facts_in_words import Wording, subject_of
from tca_wire.text.printable import printable_lines

Data = dict[str, Any]

_MOST_LINES = 200
_MOST_NOTES = 500
_LONGEST_DATA = 300
_LONGEST_STORY = 1000
_LONGEST_FAILURE = 2000
"""Characters that a tooltip has of it."""
_BAD = ("failed", "killed", "dropped", "refused", "module left", "unhandled")
"""Facts that nobody likes to see."""
_GOODBYE = "it said goodbye"
"""Why a module left whose work was done."""


def message_answer(reading: Reading, message_id: int, moment: float) -> Data | None:
    """All there is to say about a message or task, as it was at *moment*; None if there is none of that number."""
    with reading:
        run = reading.feed.history
        message = run.messages.get(message_id)
        if message is None:
            return None
        at = reading.at(moment)
        told = [_sentence(one, at.moment) for one in story(run, message_id, at.moment)]
        origin = run.delivered(message.origin)
        answer = {
            "id": message.id,
            "name": message.name,
            "class": message.message_class,
            "sender": message.sender,
            "origin": _named(run, origin.id) if origin else None,
            "role": message.role,
            "about": _named(run, message.about),
            "received": message.received,
            "data": data_text(message.was("body", at.moment)),
            "result": data_text(message.was("result", at.moment)),
            "failureData": data_text(message.was("failure_data", at.moment)),
            **_failure_answer(run, message, at.moment),
            "story": told[-_LONGEST_STORY:],
            "untold": max(len(told) - _LONGEST_STORY, 0),
        }
        if isinstance(message, Task):
            links = failure_chain(run, TaskId(message.id), at.moment)
            answer["chain"] = [asdict(link) | {"text": failure_line(link.text)} for link in links]
        if isinstance(message, Task) and message.received <= at.moment:
            answer |= _task_answer(at, at.tasks[message.id])
        return answer


def _named(run: Run, number: int) -> Data | None:
    return {"number": number, "name": run.name(number)} if number else None


def _sentence(one: Sentence, moment: float) -> Data:
    """What was known of it; of what was still to come all, since the page says that it was."""
    if one.time <= moment:
        one = one.known(moment)
    return {"time": one.time, "text": printable_lines(one.text), "seconds": one.seconds, "isOpen": one.is_open}


def _failure_answer(run: Run, message: Message, moment: float) -> Data:
    """Its failure as it stood, whether the run went on after it, and who was told."""
    failure, time = message.was("failure", moment), message.written("failure", moment)
    return {
        "failure": _failure(failure),
        "handled": coped_with(run, message, moment),
        "replaced": bool(failure) and fate(run, message, time, moment) in (Fate.REPLACED, Fate.RETRIED),
        "told": told_to(run, message, time, moment) if failure else "",
    }


def _failure(failure: Failure, longest: int | None = None) -> Data | None:
    if not failure:
        return None
    return {"name": printable_lines(failure.name[:longest]), "text": printable_lines(failure.words[:longest])}


def _task_answer(at: RunAt, task: TaskAt) -> Data:
    run = at.run
    return {
        "state": task.standing,
        **_why(at, task, shown(at, task)),
        "killed": None if task.why_killed is None else printable_lines(task.why_killed),
        "parent": _named(run, task.parent),
        "children": len(task.children),
        "caughtBy": [_named(run, handler) for handler in task.caught_by],
        "spans": {interval.name.lower(): span(task, interval) for interval in Interval},
        "constraints": [
            *(_constraint(at, hold) for hold in task.holds),
            *(_constraint(at, hold) | {"way": _named(run, above)} for above, hold in held_above(at, task.id)),
        ],
    }


def _why(at: RunAt, task: TaskAt, waits: list[Wait]) -> Data:
    """What it waits for, each with its age, or what its handler has asked; what that leads to; and what is to come."""
    told = [
        {**msgspec.to_builtins(one), "since": max(wait.start for wait in some)}
        for _, some in ((kind, list(group)) for kind, group in groupby(waits, attrgetter("kind")))
        for one in told_now(at, task, some)
    ]
    last, age, queries = in_the_end(at, task), age_of(waits), asked(at, task)
    found: Data = {"how": how(task), "waits": told, "end": _last(last) if last else None, "ahead": coming(at, task)}
    if not waits and task.suspension and task.handling:
        found["suspended"] = _named(at.run, task.suspension.cause)
        age = Age(task.suspension.start, task.suspension.start)
    elif not waits and queries:
        found |= {"how": "goes on while it waits", "waits": [msgspec.to_builtins(one) for one in queries]}
        age = Age(task.asking[0].received, task.asking[0].received)
    return found | ({"since": age.since, "start": age.begun} if age else {})


def _last(last: Last) -> Data:
    thing = last.thing
    return {"thing": thing, "number": last.number, "which": last.which, "that": last.that, "others": last.more}


def _constraint(at: RunAt, hold: Hold) -> Data:
    before, after, delay = hold.constraint.before, hold.constraint.after, hold.constraint.delay
    return {
        "number": before.task,
        "name": at.run.name(before.task),
        "before": int(before.moment) if before.task else 0,
        "moment": int(after.moment),
        "delay": delay,
        "isOwn": before.task == after.task,
        "isMet": hold.over <= at.moment if delay else at.has_reached(before),
    }


def notes_answer(reading: Reading, ids: list[int], moment: float) -> dict[str, Data]:
    """For tasks: what keeps each waiting and since when, what it waits for in the end, or how it ended if not well."""
    with reading:
        at = reading.at(moment)
        tasks = [at.tasks[number] for number in ids[:_MOST_NOTES] if number in at.tasks]
        return {str(task.id): _note(at, task) for task in tasks}


def _note(at: RunAt, task: TaskAt) -> Data:
    above = at.tasks.get(task.parent)
    is_killed_alone = task.why_killed is not None and not (above and above.why_killed == task.why_killed)
    waits = shown(at, task, with_children=False) or (shown(at, task) if in_the_end(at, task) else [])
    return {
        **_why(at, task, waits),
        "failure": _failure(task.failure, _LONGEST_FAILURE),
        "killed": printable_lines(task.why_killed or "") if is_killed_alone else "",
    }


def causes_answer(reading: Reading, moment: float) -> Data:
    """How many tasks wait, for how many things in the end, and the things that most of them wait for."""
    with reading:
        at = reading.at(moment)
        waiting, things, found = causes(at)
        return {"waiting": waiting, "things": things, "causes": [_cause(at, one) for one in found]}


def _cause(at: RunAt, cause: Cause) -> Data:
    """Of several messages of one name, that name. The way to a lock is by the first task that waits for it."""
    end = cause.ends[0]
    goto = cause.first if end.number in at.run.claims else end.number
    told = _last(last_of(at, end)) | {"tasks": cause.tasks, "goto": goto}
    return told | ({"thing": at.run.name(end.number)} if len(cause.ends) > 1 else {})


def messages_answer(reading: Reading, place: int, before: int, after: int) -> list[dict[str, Any]]:
    """The facts of the entries around the one at *place*, a line each."""
    first = max(place - min(before, _MOST_LINES), 0)
    entries = reading.entries_between(first, place + min(after, _MOST_LINES) + 1)
    lines: list[dict[str, Any]] = []
    with reading:
        run = reading.feed.history
        wording = Wording(run.name)
        for number, entry in enumerate(entries, first):
            for fact in entry.facts:
                data = data_text(getattr(fact, "body", b""))
                line = {"place": number, "time": run.times[number], "kind": kind_of(fact), "id": subject_of(fact)}
                line["isBad"] = kind_of(fact) in _BAD and getattr(fact, "why", "") != _GOODBYE
                lines.append(line | {"text": wording.words(fact), "data": data[:_LONGEST_DATA]})
    return lines


def numbers(text: str) -> list[int]:
    """The numbers of a list such as "3,17": what is none is left out."""
    return [TaskId(int(part)) for part in text.split(",") if part.isdecimal() and len(part) < 16]
