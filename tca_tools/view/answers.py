"""What a page asks for as it is needed: one task, notes on those in sight, messages around a moment. As plain data."""

from collections import deque
from dataclasses import asdict
from time import monotonic, sleep
from typing import Any

from tca_tools.analysis.words import moment as moment_text
from tca_tools.analysis.words import seconds
from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.records import OVER, Hold, Message, State, Task
from tca_tools.run.whole_run import Run
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.arrows import kind_of_arrow
from tca_tools.tasktree_viz.failing import failure_chain
from tca_tools.view.reading import Reading
from tca_tools.why.ages import age
from tca_tools.why.coping import Fate, coped_with, fate, told_to
from tca_tools.why.last import Count, Ends, in_the_end
from tca_tools.why.story import Sentence, sender_of, story
from tca_tools.why.waiting import coming, held_above, waits_how, why_waiting
from tca_wire.journal.facts import kind_of
from tca_wire.points import Interval, TaskId, describe_moments
from tca_wire.text.bodies import data_text
from tca_wire.text.facts_in_words import Wording, subject_of
from tca_wire.text.printable import printable_lines

_MOST_LINES = 200
_MOST_NOTES = 500
_WHILE = 0.05
_BREATH = 1e-3
"""Seconds of work at a time, and of rest: who waits for the reading is not woken at once."""
_LONGEST_DATA = 300
_LONGEST_STORY = 1000
_LONGEST_FAILURE = 2000
"""Characters that a tooltip has of it."""


def message_answer(
    reading: Reading, message_id: int, moment: float, within: int | None = None
) -> dict[str, Any] | None:
    """All there is to say about a message or task, as it was at *moment*; None if there is none of that number. What it
    waits for in the end is found *within* so many waits, or else is said to be further.
    """
    with reading:
        run = reading.feed.history
        message = run.messages.get(message_id)
        if message is None:
            return None
        at = reading.at(moment)
        told = [_sentence(one, at.moment) for one in story(run, message_id, at.moment)]
        answer = {
            "id": message.id,
            "name": message.name,
            "class": message.message_class,
            "sender": sender_of(run, message),
            "origin": message.origin,
            "role": message.role,
            "about": run.describe(message.about) if message.about else "",
            "about_id": message.about,
            "received": message.received,
            "data": data_text(message.body),
            "result": data_text(message.was("result", at.moment)),
            "failure_data": data_text(message.was("failure_data", at.moment)),
            **_failure_answer(run, message, at.moment),
            "story": told[-_LONGEST_STORY:],
            "untold": max(len(told) - _LONGEST_STORY, 0),
        }
        if isinstance(message, Task):
            links = failure_chain(run, TaskId(message.id), at.moment)
            answer["chain"] = [asdict(link) | {"text": words.failure_line(link.text)} for link in links]
        if isinstance(message, Task) and message.received <= at.moment:
            answer |= _task_answer(run, at, at.tasks[message.id], within)
        return answer


def _sentence(one: Sentence, moment: float) -> dict[str, Any]:
    """What was known of it; of what was still to come all, since the page says that it was."""
    if one.time <= moment:
        one = one.known(moment)
    return {"time": one.time, "text": printable_lines(one.text), "seconds": one.seconds, "is_open": one.is_open}


def _failure_answer(run: Run, message: Message, moment: float) -> dict[str, Any]:
    """Its failure as it stood, whether the run went on after it, and who was told."""
    failure, time = message.was("failure", moment), message.written("failure", moment)
    return {
        "failure": printable_lines(failure),
        "handled": coped_with(run, message, moment),
        "replaced": bool(failure) and fate(run, message, time, moment) in (Fate.REPLACED, Fate.RETRIED),
        "told": told_to(run, message, time, moment) if failure else "",
    }


def _task_answer(run: Run, at: RunAt, task: TaskAt, within: int | None) -> dict[str, Any]:
    is_further = _is_further(at, task, within)
    return {
        "state": task.standing,
        "reasons": [{"text": one} | age(at, task, one)._asdict() for one in why_waiting(at, task.id)],
        "end": "" if is_further else in_the_end(at, task),
        "isFurther": is_further,
        "how": waits_how(task),
        "coming": coming(at, task),
        "failure": printable_lines(task.failure),
        "killed": None if task.why_killed is None else printable_lines(task.why_killed),
        "data": data_text(task.body),
        "result": data_text(task.result),
        "failure_data": data_text(task.failure_data),
        "parent": task.parent,
        "parent_name": run.describe(task.parent) if task.parent else "",
        "children": len(task.children),
        "caught_by": [{"id": handler, "name": run.describe(handler)} for handler in task.caught_by],
        "spans": {interval.name.lower(): words.span(task, interval) for interval in Interval},
        "constraints": [
            *(_constraint_answer(at, task, hold) for hold in task.holds),
            *(
                _constraint_answer(at, above, hold) | {"way": above.id, "way_name": run.describe(above.id)}
                for above, hold in held_above(at, task)
            ),
        ],
    }


def _constraint_answer(at: RunAt, task: TaskAt, hold: Hold) -> dict[str, Any]:
    return {
        "id": hold.constraint.before.task,
        "text": _constraint_text(at.run, hold.constraint),
        "kind": kind_of_arrow(hold.constraint),
        "is_met": task.is_over(hold) if hold.constraint.delay else at.has_reached(hold.constraint.before),
    }


def _constraint_text(run: Run, constraint: Any) -> str:
    before, after = constraint.before, constraint.after
    delay = f"{seconds(constraint.delay)} after " if constraint.delay else ""
    first, second = (", ".join(describe_moments(point.moment)) for point in (before, after))
    what = "its own" if before.task == after.task else "" if not before.task else run.describe(before.task)
    return (
        f"{second} not before {delay}{what} {first}"
        if before.task
        else f"{second} not before {moment_text(constraint.delay)}"
    )


def _is_further(at: RunAt, task: TaskAt, within: int | None) -> bool:
    """Whether what a task waits for in the end lies further than so many waits, or more than those lie before it."""
    return within is not None and task.state not in OVER and not Ends.at(at).of(task.id, within)


def notes_answer(
    reading: Reading, ids: list[int], moment: float, within: int | None = None
) -> dict[str, dict[str, Any]]:
    """For tasks, what keeps each waiting, since when, and since when it waits in all, or how it ended if not well; that
    as a whole; and what it waits for in the end, or whether that is further than *within* so many waits.
    """
    with reading:
        at = reading.at(moment)
        found = ((number, at.run.tasks.get(number)) for number in ids[:_MOST_NOTES])
        return {
            str(number): _note(at, at.tasks[number], within)
            for number, task in found
            if task is not None and task.received <= at.moment
        }


def _note(at: RunAt, task: TaskAt, within: int | None) -> dict[str, Any]:
    is_further = _is_further(at, task, within)
    note = words.note_of(at, task, within=0 if is_further else None)
    whole = printable_lines(task.failure[:_LONGEST_FAILURE]) or note.text
    whole = f"{note.text}\n\n{whole}" if task.state is State.RECOVERING else whole
    whole = "\n\n".join(filter(None, (whole, note.end)))
    its_age = note.age._asdict() if note.age else None
    told = {"text": note.text, "age": its_age, "whole": whole, "end": note.end, "alone": note.alone}
    return told | {"isFurther": is_further}


def causes_answer(reading: Reading, moment: float) -> dict[str, Any]:
    """How many tasks wait, for how many things in the end, and the things that most of them wait for.

    A while at a time: where a hundred thousand wait, others want to look, and the journal to be read on.
    """
    with reading:
        count, known = Count(reading.at(moment)), reading.additions
        steps, is_past = count.steps(), False
    while True:
        with reading:
            if reading.additions != known and not is_past:  # of the entry that this moment is: then all at once
                count = Count(reading.at(moment))
                steps = iter(deque(count.steps(), maxlen=0))
            is_past, known = moment < reading.feed.history.time, reading.additions
            enough = monotonic() + _WHILE
            if all(monotonic() < enough for _ in steps):
                waiting, things, found = count.causes()
                return {"waiting": waiting, "things": things, "causes": [one._asdict() for one in found]}
        sleep(_BREATH)


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
                lines.append(line | {"text": wording.words(fact), "data": data[:_LONGEST_DATA]})
    return lines


def numbers(text: str) -> list[int]:
    """The numbers of a list such as "3,17": what is none is left out."""
    return [TaskId(int(part)) for part in text.split(",") if part.isdecimal() and len(part) < 16]
