"""The answers to a page's requests: one task, notes on visible tasks, messages around a time.

All sentences are composed here. The page turns each ``name {7}`` in them into a link.
"""

from collections.abc import Iterable, Iterator
from itertools import groupby
from operator import attrgetter
from typing import Any

from tca_tools.explain.graph import Cause, causes, held_above
from tca_tools.explain.story import NOT_HANDLED, Sentence, story
from tca_tools.explain.wait_words import (
    age_of,
    last_of,
    named_waits_now,
    plans_in_words,
    shown_waits,
    verb_of,
)
from tca_tools.journal.at_time import RunAt, TaskAt
from tca_tools.journal.fates import Fate, describe_asker, fate, has_run_survived
from tca_tools.journal.records import OVER, Hold, Message, Task
from tca_tools.journal.whole_run import Run
from tca_tools.tasktree_viz.failing import failure_chain
from tca_tools.tasktree_viz.words import failure_line, note_of, span
from tca_tools.view.machines import machine_answer
from tca_tools.view.pictures import is_picture, picture_in
from tca_tools.view.reading import Reading
from tca_wire.journal.facts import kind_of
from tca_wire.points import Interval, TaskId, describe_moments
from tca_wire.text.bodies import data_text
from tca_wire.text.facts_in_words import Wording, subject_of
from tca_wire.text.measures import counted, duration, run_time
from tca_wire.text.printable import printable_lines
from tca_wire.text.waits_in_words import several_in_words
from tca_wire.waits import WaitFor

Data = dict[str, Any]

_MOST_LINES = 200
_MOST_NOTES = 500
_LONGEST_DATA = 300
_LONGEST_STORY = 1000
_LONGEST_FAILURE = 2000
"""Characters of a failure in a tooltip."""
_BAD = ("failed", "killed", "dropped", "refused", "module left", "unhandled")
"""The kinds of facts that are marked as bad."""


def message_answer(reading: Reading, message_id: int, instant: float) -> Data | None:
    """Return the details of a message or task at *instant*; None if there is no such number."""
    with reading:
        run = reading.feed.history
        message = run.messages.get(message_id)
        if message is None:
            return None
        at = reading.at(instant)
        sentences = story(run, message_id, at.instant)
        answer = {
            "id": message.id,
            "name": message.name,
            "class": message.message_class,
            "isSent": message.received <= at.instant,
            "relations": _relations(at, message),
            "data": data_text(message.value_at("body", at.instant)),
            "result": data_text(message.value_at("result", at.instant)),
            "failureData": data_text(message.value_at("failure_data", at.instant)),
            **_failure_answer(run, message, at.instant),
            "story": [_sentence(one, at.instant) for one in sentences[-_LONGEST_STORY:]],
            "untold": max(len(sentences) - _LONGEST_STORY, 0),
        }
        if isinstance(message, Task):
            answer |= _chain_answer(run, message, at.instant)
            if message.received <= at.instant:
                answer |= _task_answer(at, at.tasks[message.id]) | machine_answer(
                    at, at.tasks[message.id]
                )
        return answer


def _chain_answer(run: Run, task: Task, instant: float) -> Data:
    """Return the steps of a task's failure."""
    links = failure_chain(run, TaskId(task.id), instant)
    shown = links[-_LONGEST_STORY:]
    chain = [
        {"time": one.time, "depth": one.depth, "text": failure_line(one.text)} for one in shown
    ]
    return {"chain": chain, "unlinked": len(links) - len(shown)}


def _relations(at: RunAt, message: Message) -> list[tuple[str, str]]:
    """Return the relations of a message to others: a heading and a text for each."""
    origin = at.run.delivered(message.origin)
    sender = message.sender + (f" while handling {origin}" if origin else "")
    found = [("sent by", sender)]
    if message.role:
        found.append(("as", f"{message.role} for {at.describe(message.about)}"))
    task = at.tasks.get(message.id)
    if task is None:
        return found
    if task.parent:
        found.append(("under", at.describe(task.parent)))
    found += [("handled as a failure by", at.describe(one)) for one in task.caught_by]
    if task.children:
        found.append(("subtasks", f"{len(task.children):,}"))
    return found


def _sentence(one: Sentence, instant: float) -> Data:
    """Return a sentence as known at the instant. The page marks later sentences as future."""
    if one.time <= instant:
        one = one.as_known_at(instant)
    return {
        "time": one.time,
        "text": printable_lines(one.text),
        "seconds": one.seconds,
        "isOpen": one.is_open,
    }


def _failure_answer(run: Run, message: Message, instant: float) -> Data:
    """Return a message's failure, whether the run continued after it, and the notified asker."""
    failure, time = message.value_at("failure", instant), message.written_at("failure", instant)
    became = fate(run, message, time, instant) if failure else None
    return {
        "failure": printable_lines(failure),
        "handled": has_run_survived(run, message, instant),
        "replaced": became in (Fate.REPLACED, Fate.RETRIED),
        "told": describe_asker(run, message, time, instant) if failure else "",
    }


def _task_answer(at: RunAt, task: TaskAt) -> Data:
    note, waits = note_of(at, task), shown_waits(at, task)
    why = task.why_killed
    if task.failure and task.record.killed_for == task.id:
        why = NOT_HANDLED
    groups = [list(group) for _, group in groupby(waits, attrgetter("kind"))]
    rows = []
    for group in groups:
        text = f"{verb_of(task)} {several_in_words(named_waits_now(at, task, group))}"
        rows.append({"text": text, "since": max(wait.start for wait in group)})
    age = age_of(waits) or note.age
    if age and not waits:
        rows = [{"text": note.text, "since": age.since}]
    constraints = [_constraint(at, hold) for hold in task.holds]
    for above, hold in held_above(at, task.id):
        constraints.append(_constraint(at, hold, f", by way of {at.describe(above)}"))
    return {
        "state": task.standing,
        **_life_answer(task),
        "isSuspended": task.suspension is not None,
        "waits": rows,
        "start": age.begun if age else None,
        "end": note.end,
        "ahead": plans_in_words(at, task),
        "killed": None if why is None else printable_lines(why),
        "spans": {interval.name.lower(): span(task, interval) for interval in Interval},
        "constraints": constraints,
    }


def _life_answer(task: TaskAt) -> Data:
    """Return a task's state in its life cycle, its newest progress, and the requested goal."""
    life = task.life
    state = f"{life.state}, {counted(life.serial, 'change')}"
    return {"life": state, "progress": data_text(life.progress), "asked": data_text(life.asked)}


def _constraint(at: RunAt, hold: Hold, way: str = "") -> Data:
    """Return ``start achieving not before 3 s after step {3} end achieving``, and whether met."""
    constraint, delay = hold.constraint, hold.constraint.delay
    before, after = constraint.before, constraint.after
    text = run_time(delay)
    if before.task:
        whose = "its own" if before.task == after.task else at.describe(before.task)
        text = f"{whose} {describe_moments(before.moment)[0]}"
        if delay:
            text = f"{duration(delay)} after {text}"
    return {
        "text": f"{describe_moments(after.moment)[0]} not before {text}{way}",
        "isMet": hold.over <= at.instant if delay else at.has_reached(before),
    }


def notes_answer(reading: Reading, ids: list[int], instant: float) -> dict[str, Data]:
    """Return a note on each task: its wait with its start and last cause, or its bad outcome."""
    with reading:
        at = reading.at(instant)
        tasks = [at.tasks[number] for number in ids[:_MOST_NOTES] if number in at.tasks]
        return {str(task.id): _note(at, task) for task in tasks}


def _note(at: RunAt, task: TaskAt) -> Data:
    """Return the parts of a note, and the messages that it names.

    The note is valid until one of these messages ends.
    """
    note = note_of(at, task, verb="")
    text, failure = note.text, printable_lines(task.failure[:_LONGEST_FAILURE])
    whole = [text, failure]
    if task.state in OVER:
        text = ": ".join(filter(None, (task.standing, note.text)))
        if task.failure and not task.failure.words and (data := data_text(task.failure_data)):
            text += f" {data[:_LONGEST_DATA]}"  # the failure has data, but no text
        whole = [failure or text]
    return {
        "text": text,
        "end": note.end,
        "whole": "\n\n".join(filter(None, (*whole, note.end))),
        "names": list(_numbers(note.waits)),
        "last": note.last.number if note.last else 0,
        **({"since": note.age.since, "start": note.age.begun} if note.age else {}),
    }


def _numbers(waits: Iterable[WaitFor]) -> Iterator[int]:
    for one in waits:
        yield one.number
        yield from _numbers(one.because)


def causes_answer(reading: Reading, instant: float) -> Data:
    """Count the waiting tasks and their last causes, and return the most frequent causes."""
    with reading:
        at = reading.at(instant)
        waiting, things, found = causes(at)
        return {"waiting": waiting, "things": things, "causes": [_cause(at, one) for one in found]}


def _cause(at: RunAt, cause: Cause) -> Data:
    """Return a cause as text. Several messages of one name are shown as that name.

    A lock has no number that a page can show, so its link leads to the first task that waits.
    """
    end = cause.ends[0]
    last = last_of(at, end)
    thing = at.run.name(end.number) if len(cause.ends) > 1 else last.thing
    goto = cause.first if end.number in at.run.claims else end.number
    return {"text": f"{thing}, which {last.which}", "tasks": cause.tasks, "goto": goto}


def messages_answer(reading: Reading, place: int, before: int, after: int) -> list[dict[str, Any]]:
    """Return the facts of the entries around the one at *place*, one line each."""
    first = max(place - min(before, _MOST_LINES), 0)
    entries = reading.entries_between(first, place + min(after, _MOST_LINES) + 1)
    lines: list[dict[str, Any]] = []
    with reading:
        run = reading.feed.history
        wording = Wording(run.name)
        for number, entry in enumerate(entries, first):
            for fact in entry.facts:
                data = data_text(getattr(fact, "body", b""))
                line = {
                    "place": number,
                    "time": run.times[number],
                    "kind": kind_of(fact),
                    "id": subject_of(fact),
                }
                line["isBad"] = kind_of(fact) in _BAD and getattr(fact, "lost", True)
                lines.append(line | {"text": wording.words(fact), "data": data[:_LONGEST_DATA]})
    return lines


def picture_answer(reading: Reading, message_id: int) -> dict[str, str] | None:
    """Return the picture that a message set as a variable's value; None if it is not a picture."""
    with reading:
        message = reading.feed.history.messages.get(message_id)
    return picture_in(message) if message is not None and is_picture(message) else None
